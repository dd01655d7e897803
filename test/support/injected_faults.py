"""Faults put into the stream of the paper's vehicle, and what becomes of its model."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
import math
from pathlib import Path
from random import Random

from rovid_core.inputs.refusals import REASONS
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.score import ScoreLog
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

START = 1_700_000_000_000_000_000  # [ns]
DURATION = 240.0
Value = tuple[float, ...]
Fault = Callable[[float, Value, Random], Value | None]


@cache
def vehicle(method: str = 'aid') -> Settings:
    """Return the settings of the paper's vehicle."""
    settings = settings_from(load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml'))
    return replace(settings, identifier=IdentifierSettings(method))


@cache
def clean(duration: float = DURATION) -> tuple[Event, ...]:
    """Return what its sensors measure."""
    return tuple([Event(START + t, (Sample(n, v),))
                  for t, n, v in simulate(vehicle(), duration, 1)])


def seconds(event: Event) -> float:
    """Return the time since the start [s]."""
    return (event.time - START) * 1e-9


def spoilt(input: str, fault: Fault, events: Sequence[Event] | None = None) -> list[Event]:
    """Return the stream with the values of an input changed; None leaves a message out."""
    random, out = Random(1), []
    for event in clean() if events is None else events:
        sample = event.samples[0]
        if sample.input == input:
            value = fault(seconds(event), sample.value, random)
            if value is None:
                continue
            event = event._replace(samples=(sample._replace(value=value),))
        out.append(event)
    return out


def stepped(inputs: Sequence[str], start: float, end: float, by: float) -> list[Event]:
    """Return the stream with the clock of some inputs off for a while [s]."""
    return [e._replace(time=e.time + round(by * 1e9))
            if e.samples[0].input in inputs and start <= seconds(e) < end else e
            for e in clean()]


def run(settings: Settings, events: Sequence[Event], scorer: ScoreLog | None = None) -> Stream:
    """Feed a stream; whatever it is, the estimates are finite and the reasons known."""
    stream = Stream(settings, scorer=scorer)
    for event in events:
        for estimate in stream.receive(event):
            for dof in estimate.dofs:
                assert all(map(math.isfinite, dof.parameters))
                assert dof.parameters[0] > 0.0 >= max(dof.parameters[1:3])
    stream.finish()
    assert {reason for _, reason in stream.rejected} <= REASONS.keys()
    return stream


@cache
def undisturbed(method: str) -> tuple[ScoreLog, dict[str, float]]:
    """Return the log to score on, and the mae of the model that it gives."""
    settings = vehicle(method)
    log = ScoreLog(settings)
    stream = run(settings, clean(), log)
    assert stream.rejected == {}
    assert stream.take_warnings() == []
    assert stream.estimate is not None
    return log, {d.dof: log.score(d.dof, d.parameters).mae for d in stream.estimate.dofs}


def worse(stream: Stream) -> float:
    """Return the largest mae of a DOF's model over that of the undisturbed run."""
    settings = stream.settings
    log, maes = undisturbed(settings.identifier.method)
    assert stream.estimate is not None
    return max(log.score(d.dof, d.parameters).mae / maes[d.dof] for d in stream.estimate.dofs)
