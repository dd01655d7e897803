"""Faults put into the stream of the paper's vehicle, and what becomes of its model."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
import math
from pathlib import Path
from random import Random

from rovid_core.identify.estimate import Estimate
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
    """Return the settings of the paper's vehicle, with all inputs at the rate of the fixes."""
    settings = settings_from(load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml'))
    rate = settings.simulation.position_rate
    return replace(settings, identifier=IdentifierSettings(method), simulation=replace(
        settings.simulation, depth_rate=rate, attitude_rate=rate, thruster_rate=rate))


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
            event = event.replaced(samples=(sample.replaced(value=value),))
        out.append(event)
    return out


def stepped(inputs: Sequence[str], start: float, end: float, by: float,
            events: Sequence[Event] | None = None) -> list[Event]:
    """Return the stream with the clock of some inputs off for a while [s]."""
    return [e.replaced(time=e.time + round(by * 1e9))
            if e.samples[0].input in inputs and start <= seconds(e) < end else e
            for e in (clean() if events is None else events)]


def arriving(events: Sequence[Event], start: float, end: float = math.inf) -> list[Event]:
    """Return what arrives in a time [s], whatever its stamp says; no message may be left out."""
    return [event for event, on_time in zip(events, clean(), strict=True)
            if start <= seconds(on_time) < end]


def run(settings: Settings, events: Sequence[Event], scorer: ScoreLog | None = None) -> Stream:
    """Feed a stream to its end."""
    stream = Stream(settings, scorer=scorer)
    feed(stream, events)
    stream.finish()
    return stream


def feed(stream: Stream, events: Sequence[Event]) -> set[tuple[str, str]]:
    """
    Feed a part of a stream; whatever it is, the estimates are finite and the reasons known.

    Returns
    -------
    set
        Input and reason of what is refused of it.

    """
    before = dict(stream.rejected)
    for event in events:
        for estimate in stream.receive(event):
            for dof in estimate.dofs:
                assert all(map(math.isfinite, dof.parameters))
                assert dof.parameters[0] > 0.0 >= max(dof.parameters[1:3])
    refused = {one for one, count in stream.rejected.items() if count > before.get(one, 0)}
    assert {reason for _, reason in refused} <= REASONS.keys()
    return refused


@cache
def undisturbed(method: str = 'aid') -> tuple[ScoreLog, Estimate]:
    """Return the log to score on, and the last estimate that it gives."""
    settings = vehicle(method)
    log = ScoreLog(settings)
    stream = run(settings, clean(), log)
    assert stream.rejected == {}
    assert stream.take_warnings() == []
    assert stream.estimate is not None
    return log, stream.estimate


@cache
def _usual_errors(method: str) -> list[float]:
    return _errors(*undisturbed(method))


def _errors(log: ScoreLog, estimate: Estimate) -> list[float]:
    return [log.score(dof.dof, dof.parameters).mae for dof in estimate.dofs]


def worse(stream: Stream) -> float:
    """Return the largest mae of a DOF's model over that of the undisturbed run."""
    method = stream.settings.identifier.method
    assert stream.estimate is not None
    return max(now / before for now, before in zip(
        _errors(undisturbed(method)[0], stream.estimate), _usual_errors(method)))
