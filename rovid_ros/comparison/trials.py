"""Logs as trials: each through the pipe once, with all that a comparison needs of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from rovid_core.identify import make_identifier, METHODS
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.trials.record import Fit
from rovid_core.trials.score import ScoreLog
from rovid_ros.commands.feeder import PipeFeeder
from rovid_ros.commands.replay import replay
from rovid_ros.commands.replay_run import Result
from rovid_ros.logs.log import LogMessage

PAPER = 'aid'
"""The paper's method, of which the report draws the figures."""


@dataclass
class History:
    """The online estimates of one DOF, step by step."""

    times: list[int] = field(default_factory=list)  # [ns]
    v_hats: list[float] = field(default_factory=list)
    velocities: list[float] = field(default_factory=list)
    parameters: list[Four] = field(default_factory=list)  # published: a mean of
    theta_hats: list[Four] = field(default_factory=list)  # these, to which W belongs


class OnlineMethods(ScoreLog):
    """What a score needs, and every online method on the very same steps."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.identifiers = {dof: {
            method: make_identifier(
                replace(IdentifierSettings(), method=method), settings.dof[dof])
            for method in METHODS if method != PAPER} for dof in settings.dofs}

    def restarted(self, dof: str, time: int, velocity: float) -> None:
        """Take the velocity that a DOF takes up from."""
        super().restarted(dof, time, velocity)
        for identifier in self.identifiers[dof].values():
            identifier.restart(velocity)

    def stepped(self, dof: str, span: tuple[int, int, int], step: Step) -> None:
        """Take a step and its times [ns]."""
        super().stepped(dof, span, step)
        for identifier in self.identifiers[dof].values():
            identifier.step(step)


class TrialFeeder(PipeFeeder):
    """The pipe with the paper's identifier, whose every estimate is kept for its figures."""

    def __init__(self, settings: Settings) -> None:
        # a node that is to start frozen is compared by what it would find
        paper = replace(settings, identifier=replace(settings.identifier, method=PAPER),
                        enable=True)
        self._others = OnlineMethods(settings)
        super().__init__(paper, self._others)
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

    def online(self, dof: str) -> dict[str, Fit]:
        """Return what every online method ended with."""
        history, others = self.history[dof], self._others.identifiers[dof]
        if not history.parameters:  # what they hold is the initial values
            return dict.fromkeys((PAPER, *others), Fit.none('no step'))
        found = {PAPER: Fit(history.parameters[-1])}
        for method, identifier in others.items():
            notes = [identifier.note] if identifier.note else []
            # otherwise it may as well be 0
            if abs(identifier.delay) > 3.0 * identifier.delay_std:
                notes.append(f'the thrust is delayed by {identifier.delay:.3f} s, with a '
                             f'standard deviation of {identifier.delay_std:.3f} s')
            found[method] = Fit(
                identifier.parameters, np.array(identifier.covariance).reshape(4, 4),
                '; '.join(notes))
        return found

    def _kept(self, estimates: list[Estimate]) -> list[Estimate]:
        for estimate in estimates:
            for i in estimate.stepped:
                dof = estimate.dofs[i]
                kept = self.history[dof.dof]
                kept.times.append(estimate.time)
                kept.v_hats.append(dof.v_hat)
                kept.velocities.append(dof.velocity)
                kept.parameters.append(dof.parameters)
                identifier = self.stream.identifier(dof.dof)
                assert isinstance(identifier, AdaptiveIdentifier)
                kept.theta_hats.append(identifier.theta_hat)
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


def read_trials(train: Sequence[Path], validate: Sequence[Path], settings: Settings,
                warn: Callable[[str], None], *, start: float = 0.0,
                duration: float | None = None) -> list[Trial]:
    """
    Feed each log, from ``start`` for ``duration`` [s], through a pipe of its own.

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
        result = replay([path], settings, feeder, start=start, duration=duration,
                        warn=warnings.append)
        for line in warnings:
            warn(f'{name}: {line}')
        trials.append(Trial(name, number < len(train), result, feeder, warnings))
    return trials


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the file names, with folders where they are needed to tell them apart."""
    names = [path.name for path in paths]
    return [name if names.count(name) == 1 else str(path) for name, path in zip(names, paths)]
