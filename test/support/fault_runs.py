"""A fault in a log, written to a file and replayed: what is said, and what the model is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, isfinite, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import Four
from rovid_core.model.plant import lumped
from rovid_core.settings.run import Settings
from rovid_core.simulation.profiles import Profile, Sinusoid
from rovid_core.trials.score import ScoreLog
from rovid_ros.commands.replay import replay
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log, LogMessage
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import standard_types

from test.support.fault_edits import Messages, Recording, SECOND, shifted
from test.support.fault_outcomes import Outcome, step_text
from test.support.tank import TANK_LENGTH
from test.support.trials import CONFIG, error

PAUSE = 1.5
"""[s] Between two recordings that are joined."""

WAVES = {'surge': ((120.0, 1 / 12), (60.0, 1 / 25)), 'heave': ((300.0, 1 / 20), (120.0, 1 / 9)),
         'yaw': ((16.0, 1 / 16), (8.0, 1 / 8))}
"""Thrust of the simulated log that the models are judged by."""


class Bench:
    """
    A vehicle: a log to put faults into, and another one to judge the models by.

    Parameters
    ----------
    values : mapping
        The parameter file.
    train : Recording
        The one.
    judge : Path
        The other.
    start : float
        Where in it the judging begins [s].
    truth : mapping
        DOF -> true parameters, where they are known.

    """

    def __init__(self, values: dict[str, Any], train: Recording, judge: Path,
                 start: float = 0.0, truth: Mapping[str, Four] | None = None) -> None:
        self.values = values
        self.recording = train
        self.truth = truth or {}
        # in still water what models are scored on is the same with every method
        player = PipelinePlayer(self.method('aid'))
        replay([judge], self.method('aid'), player, start=start)
        self.judge: ScoreLog = player.scores
        self._usual: dict[tuple[str, float], Outcome] = {}

    def method(self, name: str, max_wait: float | None = None) -> Settings:
        """Return the settings with another method."""
        settings = self.recording.settings
        return replace(settings, max_wait=settings.max_wait if max_wait is None else max_wait,
                       identifier=replace(settings.identifier, method=name))

    def usual(self, settings: Settings) -> Outcome:
        """Return what comes of the log as it is."""
        key = settings.identifier.method, settings.max_wait
        if key not in self._usual:
            self._usual[key] = replayed(self.recording.messages, settings)
        return self._usual[key]

    def ratio(self, outcome: Outcome, usual: Outcome) -> tuple[float, str]:
        """Return the largest ratio of a model's mae to that without the fault, and whose."""
        if not outcome.models:
            return inf, 'all'
        return max((self._mae(dof, model) / self._mae(dof, usual.models[dof]), dof)
                   for dof, model in outcome.models.items())

    def off(self, outcome: Outcome) -> float:
        """Return the largest error of a model against the truth, in parts of the speed."""
        return max((error(true, outcome.models[dof], WAVES[dof])  # type: ignore[arg-type]
                    / self._speed(dof) for dof, true in self.truth.items()), default=nan)

    def _mae(self, dof: str, model: tuple[float, ...]) -> float:
        return self.judge.score(dof, model).mae

    def _speed(self, dof: str) -> float:
        return float(np.abs(self.judge.series(dof)[1]).mean())


def simulated(duration: float = 300.0, on: float = 80.0, **rates: float) -> Bench:
    """Return the vehicle of config/jhurov.yaml; faults come on after a time [s]."""
    values = {**load(CONFIG / 'jhurov.yaml'),
              **{f'simulation.{name}_rate': rate for name, rate in rates.items()}}
    settings = settings_from(values)
    profile: Profile = {dof: tuple([Sinusoid(*wave) for wave in waves])
                        for dof, waves in WAVES.items()}
    truth = {name: lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
             for name, true in settings.simulation.dofs.items()}
    with TemporaryDirectory() as folder:
        train, judge = Path(folder, 'train.mcap'), Path(folder, 'judge.mcap')
        simulate_log(settings, train, duration, seed=1)
        simulate_log(settings, judge, min(duration, 150.0), seed=2, profile=profile)
        return Bench(values, _recording(settings, on, train), judge, truth=truth)


def tank(logs: Path) -> Bench:
    """
    Return the vehicle of config/bluerov2_tank.yaml.

    The faults are in ``surge_sway_heave``; the same again and the first 60 % of ``all_axes``
    are the undisturbed stretch that follows, and its rest is what the models are judged by.
    """
    values = load(CONFIG / 'bluerov2_tank.yaml')
    settings = settings_from(values)
    judge, share = logs / 'all_axes.mcap', 0.6 * TANK_LENGTH
    train = _recording(settings, 90.0, logs / 'surge_sway_heave.mcap')
    more = _recording(settings, 0.0, judge)
    until = more.begin + share * SECOND
    for stretch in (list(train.messages), [m for m in more.messages if m.time < until]):
        wait = (train.end - stretch[0].time) / SECOND + PAUSE
        train.messages += [shifted(message, wait) for message in stretch]
    return Bench(values, train, judge, share)


def _recording(settings: Settings, on: float, path: Path) -> Recording:
    """Return the messages of a log that the vehicle is identified from."""
    topics = {f'/{topic.lstrip("/")}' for topic in PipelinePlayer(settings).converter.topics}
    with Log([path]) as log:
        return Recording(settings, list(log.messages(topics)), on)


def replayed(messages: Messages, settings: Settings) -> Outcome:
    """Write messages to a log, replay it, and return what came of it."""
    player = _Watched(settings)
    outcome = player.outcome
    with TemporaryDirectory() as folder:
        path = Path(folder, 'faulty.mcap')
        write(messages, path)
        try:
            replay([path], settings, player, warn=lambda line: outcome.warnings.append(
                line.replace(f'{folder}/', '')))
        except Exception as failure:  # a defect of any kind is a row of the table
            outcome.failed = f'{type(failure).__name__}: {failure}'
    outcome.rejected = {f'{name}.{reason}': count
                        for (name, reason), count in player.stream.rejected.items()}
    if player.stream.estimate is not None:
        outcome.models = {dof.dof: dof.parameters for dof in player.stream.estimate.dofs}
    return outcome


def write(messages: Messages, path: Path) -> None:
    """Write messages to an MCAP file in the order in which they arrive."""
    with LogWriter(path) as writer:
        for message in messages:
            writer.write_raw(message.topic, message.type, cdr(message), message.time)


def cdr(message: LogMessage) -> bytes:
    """Return the bytes of a message, which it may be already."""
    if isinstance(message.data, bytes):
        return message.data
    return bytes(standard_types().serialize_cdr(message.data, message.type))


class _Watched(PipelinePlayer):
    """The pipe, and somebody who looks at everything that comes out."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.outcome = Outcome()

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Take the next message; return the estimates that it released."""
        estimates = super().add_message(message)
        for estimate in estimates:
            self._look(estimate, message.time)
        self.outcome.released.append((message.time, len(self.outcome.steps)))
        self.outcome.warnings += self.stream.take_warnings()
        return estimates

    def finish(self) -> list[Estimate]:
        """Take the log's end."""
        estimates = super().finish()
        for estimate in estimates:
            self._look(estimate, estimate.time)
        return estimates

    def _look(self, estimate: Estimate, now: int) -> None:
        outcome = self.outcome
        outcome.steps.append(step_text(
            estimate.time, [d.v_hat for d in estimate.dofs], [d.force for d in estimate.dofs]))
        for index, dof in enumerate(estimate.dofs):
            numbers = [*dof.parameters]
            if dof.covariance:
                numbers += [*dof.std, *dof.covariance]
            if index in estimate.stepped and not dof.stale_for:  # those are NaN on purpose
                numbers += [dof.velocity, dof.v_hat, dof.force, dof.excitation]
            outcome.not_finite += not all(map(isfinite, numbers))
        texts = tuple([f'{dof.dof} {text}' for dof in estimate.dofs
                       for text in (dof.status, *dof.reasons)])
        if not outcome.notes or outcome.notes[-1][1] != texts:
            outcome.notes.append((now, texts))
