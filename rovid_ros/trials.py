"""Logs as trials: each through the pipe once, with all that a comparison needs of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rovid_core.dofs import Four
from rovid_core.score import ScoreLog
from rovid_core.settings import Settings
from rovid_core.values import Estimate
from rovid_ros.feeder import PipeFeeder
from rovid_ros.logs import LogMessage
from rovid_ros.replay import replay, Result


@dataclass
class History:
    """The online estimates of one DOF, step by step."""

    times: list[int] = field(default_factory=list)  # [ns]
    v_hats: list[float] = field(default_factory=list)
    velocities: list[float] = field(default_factory=list)
    parameters: list[Four] = field(default_factory=list)


class TrialFeeder(PipeFeeder):
    """The pipe, which keeps what the online identifier said."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.history = {dof: History() for dof in settings.dofs}

    def feed(self, message: LogMessage) -> list[Estimate]:
        """Take the next message; return the estimates that it released."""
        return self._kept(super().feed(message))

    def control(self, name: str, value: str) -> list[Estimate]:
        """Do again what a service call did when the log was recorded."""
        return self._kept(super().control(name, value))

    def finish(self) -> list[Estimate]:
        """Take the log's end."""
        return self._kept(super().finish())

    def _kept(self, estimates: list[Estimate]) -> list[Estimate]:
        for estimate in estimates:
            for i in estimate.stepped:
                dof = estimate.dofs[i]
                kept = self.history[dof.dof]
                kept.times.append(estimate.time)
                kept.v_hats.append(dof.v_hat)
                kept.velocities.append(dof.velocity)
                kept.parameters.append(dof.parameters)
        return estimates


@dataclass(frozen=True)
class Trial:
    """
    One log after the pipe.

    Attributes
    ----------
    name : str
        Of the log, unlike that of any other trial.
    trains : bool
        Whether models are identified from it, or it is only predicted.
    result : Result
        What a replay says of it.
    feeder : TrialFeeder
        The pipe after the log: scores, history, inputs.
    warnings : list of str
        One line each.

    """

    name: str
    trains: bool
    result: Result
    feeder: TrialFeeder
    warnings: list[str]

    @property
    def scores(self) -> ScoreLog:
        """Return thrust and velocity of every step."""
        return self.feeder.scores

    @property
    def final(self) -> Estimate:
        """Return what the online method ended with."""
        assert self.feeder.stream.estimate is not None
        return self.feeder.stream.estimate


def read_trials(train: Sequence[Path], validate: Sequence[Path], settings: Settings,
                warn: Callable[[str], None]) -> list[Trial]:
    """
    Feed each log through a pipe of its own.

    Raises
    ------
    LogError, FieldError, ReplayError, Interrupted
        As in ``replay``.

    """
    paths = [*train, *validate]
    trials = []
    for number, (path, name) in enumerate(zip(paths, _names(paths))):
        feeder = TrialFeeder(settings)
        warnings: list[str] = []
        result = replay([path], settings, feeder, warn=warnings.append)
        for line in warnings:
            warn(f'{name}: {line}')
        trials.append(Trial(name, number < len(train), result, feeder, warnings))
    return trials


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the file names, with folders where they are needed to tell them apart."""
    names = [path.name for path in paths]
    return [name if names.count(name) == 1 else str(path) for name, path in zip(names, paths)]
