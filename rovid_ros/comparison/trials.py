"""
Every method on each log, each model scored on every log (Section V of the paper).

A log that has been through the pipeline is a trial. Online methods identify while it is read,
offline methods afterwards from what was kept of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
import math
from typing import Any, Protocol, TypeVar

import numpy as np
from rovid_core.identify import METHODS as ONLINE
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier
from rovid_core.identify.estimate import Current, Estimate
from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import DofSettings, Scales, Settings
from rovid_core.trials.offline import METHODS as OFFLINE, subsets
from rovid_core.trials.record import Fit
from rovid_core.trials.score import Score, ScoreLog
from rovid_ros.logs.log import LogMessage
from rovid_ros.logs.player import PipelinePlayer, repeat_control
from rovid_ros.results.documents import (
    couplings_document,
    json_number,
    json_numbers,
    Result,
    thrusters_document,
)
from rovid_ros.results.text import told_delay

PAPER = 'aid'  # the paper's method, of which the report draws the figures
REFERENCE = 'output_error'  # the method that is preferred among methods that predict equally well
AS_GOOD = 1.02  # errors within this factor are the same
# A term has to lower the error by this share to be kept: without it the model is simpler.
WORTH = 0.01
# Of the strongest push of any log; a log that pushes a DOF by less judges no model of it.
HARDLY = 1.0 / 3.0
# Standard deviations from 0 above which an identified delay of the thrust is noted.
DELAY_SIGNIFICANCE = 3.0

Given = TypeVar('Given')
Made = TypeVar('Made')


class ForEach(Protocol):
    """Does the same work on many things, possibly at the same time, and shows how far it is."""

    def __call__(self, label: str, work: Callable[[Given], Made],
                 given: Sequence[Given]) -> list[Made]:
        """Return what ``work`` made of each, in order."""


@dataclass
class History:
    """The estimates of the adaptive identifier for one DOF, step by step."""

    times: list[int] = field(default_factory=list)  # [ns]
    # its velocity and the measured one [m/s or rad/s]
    v_hats: list[float] = field(default_factory=list)
    velocities: list[float] = field(default_factory=list)
    # the published parameters, which are a mean, and the state, to which W belongs
    parameters: list[Four] = field(default_factory=list)
    theta_hats: list[tuple[float, ...]] = field(default_factory=list)


class TrialPlayer(PipelinePlayer):
    """
    The pipeline of every online method, each as a replay with that method has it.

    The adaptive identifier's steps carry what the scores of all methods need. Those of yaw and
    heave with couplings are taken of the filter of surge and sway, where there is one: products
    of measured velocities are noisy, so that no method finds the whole coupling, and they are not
    through the water.
    """

    def __init__(self, settings: Settings) -> None:
        # a node that is to start frozen is compared by what it would find
        settings = replace(settings, enable=True)
        of = {method: replace(settings, identifier=replace(settings.identifier, method=method))
              for method in ONLINE}
        paper = replace(of.pop(PAPER), all_methods=True)
        super().__init__(paper)
        self._filtered = {method: ScoreLog(one) for method, one in of.items()
                          if one.estimates_current}
        self._others = {method: Stream(one, scorer=self._filtered.get(method))
                        for method, one in of.items()}
        self._coupled = [dof for dof in settings.dofs if dof not in ('surge', 'sway') and any(
            {*name} <= {*'uvwpqr'} and {*name} & {*'uv'} for name in settings.couplings(dof))]
        self.history = {dof: History() for dof in settings.dofs}  # of the adaptive identifier
        self.currents: list[tuple[int, Current]] = []  # of the water, with their times [ns]

    def restore(self, state: Mapping[str, Any]) -> str:
        """Begin anew: methods are compared by what this log alone tells them."""
        return ''

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Add the next message; return the estimates that it released."""
        for stream in self._others.values():
            for event in message.data:
                for estimate in stream.receive(event):
                    self._keep_current(estimate)
        return self._kept(super().add_message(message))

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        """Do again what was done to the node when the log was recorded."""
        for stream in self._others.values():
            repeat_control(stream, name, value)
        return self._kept(super().repeat_control(name, value))

    def finish(self) -> list[Estimate]:
        """Release what is still held back at the log's end."""
        for stream in self._others.values():
            stream.end()
        kept = self._kept(super().finish())
        for scores in self._filtered.values():
            self.scores.take_steps(scores, self._coupled)
        return kept

    def fits(self, dof: str) -> dict[str, Fit]:
        """Return what every online method ended with."""
        history = self.history[dof]
        others = {method: stream.identifier(dof) for method, stream in self._others.items()}
        if not history.parameters:  # the methods hold their initial values
            return dict.fromkeys((PAPER, *others), Fit.none('no step'))
        paper = self.stream.identifier(dof)
        found = {PAPER: Fit(paper.parameters, couplings=paper.couplings,
                            couplings_std=paper.uncertainty.couplings_std)}
        for method, identifier in others.items():
            notes = [identifier.note] if identifier.note else []
            if abs(identifier.delay) > DELAY_SIGNIFICANCE * identifier.delay_std:
                notes.append(told_delay(identifier.delay, identifier.delay_std))
            found[method] = Fit(
                identifier.parameters, np.array(identifier.covariance).reshape(4, 4),
                '; '.join(notes), identifier.couplings, identifier.uncertainty.couplings_std,
                0.0 if math.isnan(identifier.delay) else identifier.delay, identifier.thrusters)
        return found

    def push(self, dof: str) -> float:
        """
        Return the size of what pushed a DOF [N or N m], 0 where nothing did.

        It is sqrt(mean F^4 / mean F^2): time without thrust does not count.
        """
        if self.stream.judgement(dof).status == 'unexcited':
            return 0.0
        pieces = self.scores.records(dof)
        squares, fourths = (math.fsum(float(np.sum(one.dt * one.force ** power)) for one in pieces)
                            for power in (2, 4))
        return math.sqrt(fourths / squares) if squares > 0.0 else 0.0

    def _keep_current(self, estimate: Estimate) -> None:
        current = estimate.current
        if current is not None and current.is_seen:
            self.scores.add_current(estimate.time, current.x, current.y)
            self.currents.append((estimate.time, current))

    def _kept(self, estimates: list[Estimate]) -> list[Estimate]:
        for estimate in estimates:
            for i in estimate.stepped:
                dof = estimate.dofs[i]
                history = self.history[dof.dof]
                history.times.append(estimate.time)
                history.v_hats.append(dof.v_hat)
                history.velocities.append(dof.velocity)
                history.parameters.append(dof.parameters)
                identifier = self.stream.identifier(dof.dof)
                assert isinstance(identifier, AdaptiveIdentifier)
                history.theta_hats.append(identifier.theta_hat)
        return estimates


@dataclass(frozen=True)
class Trial:
    """One log after the pipeline."""

    name: str  # of the log, unlike that of any other trial
    trains: bool  # whether models are identified from it, or it is only predicted
    result: Result  # what a replay says of it
    player: TrialPlayer  # the pipeline after the log
    warnings: list[str]  # one line each

    @property
    def scores(self) -> ScoreLog:
        """Return thrust and velocity of every step."""
        return self.player.scores


@dataclass(frozen=True)
class Model:
    """A model of one DOF."""

    # where it comes from
    method: str
    trained_on: str
    dof: str
    terms: tuple[str, ...]  # what it has
    selected: bool  # whether these are the method's best terms; else they are the configured ones
    fit: Fit  # parameters and covariance
    scores: Mapping[str, Score]  # by the name of the log
    couplings: tuple[str, ...] = ()  # names of those that the fit has
    # by the name of the log, with all DOFs of the same method simulated together; empty without
    # couplings
    joint: Mapping[str, Score] = field(default_factory=dict)
    # names of logs that hardly push the DOF: averages leave them out
    idle: frozenset[str] = frozenset()

    @property
    def all_parameters(self) -> tuple[float, ...]:
        """Return alpha, beta, gamma, delta and the couplings, as a score takes them."""
        return (*self.fit.parameters, *self.fit.couplings)

    def error(self, logs: Sequence[str]) -> float:
        """Return the mean mae over those logs that judge it; infinite without any."""
        values = [self.scores[log].mae for log in self.judges(logs)]
        return math.fsum(values) / len(values) if values else math.inf

    def fit_on(self, logs: Sequence[str]) -> float:
        """Return the mean fit over those logs that judge it; NaN without any."""
        values = [self.scores[log].fit for log in self.judges(logs)]
        return math.fsum(values) / len(values) if values else math.nan

    def judges(self, logs: Sequence[str]) -> list[str]:
        """Return those logs that have steps to score it on and push the DOF, if any does."""
        scored = [log for log in logs if not math.isnan(self.scores[log].mae)]
        return [log for log in scored if log not in self.idle] or scored

    def document(self) -> dict[str, Any]:
        """Return the model's part of the JSON."""
        parameters = self.fit.parameters
        return {
            **json_numbers(PARAMETERS, parameters), **json_numbers(PHYSICAL, physical(parameters)),
            'std': None if self.fit.covariance is None else json_numbers(PARAMETERS, self.fit.std),
            **couplings_document(self.couplings, self.fit.couplings, self.fit.couplings_std),
            **thrusters_document(self.fit.thrusters),
            'terms': list(self.terms), 'note': self.fit.note,
            'scores': {log: self._score_document(log) for log in self.scores}}

    def _score_document(self, log: str) -> dict[str, float | None]:
        score = self.scores[log]
        return {'mae': json_number(score.mae), 'fit': json_number(score.fit),
                **({'fit_joint': json_number(self.joint[log].fit)} if log in self.joint else {})}


def compare(trials: Sequence[Trial], settings: Settings, for_each: ForEach) -> list[Model]:
    """
    Identify by each method from each training log and score the models on all logs.

    Return per training log, DOF and method: with the configured terms, then, for the offline
    methods, with the best choice of terms by the error on the other logs (on the log itself where
    there is only one).
    """
    pairs = [(trial, dof) for trial in trials if trial.trains for dof in settings.dofs]
    idle = {dof: _idle(dof, trials) for dof in settings.dofs}
    chosen = for_each('terms', lambda pair: _best_terms(
        *pair, settings, trials, idle[pair[1]]), pairs)
    jobs = [job for (trial, dof), best in zip(pairs, chosen)
            for job in _jobs(trial, dof, settings, best)]
    models: list[Model] = []
    for job, model in zip(jobs, for_each(
            'compare', lambda job: _model(job, settings, trials, idle[job.dof]), jobs)):
        models.append(model)
        if job.configured and job.best:
            models.append(replace(model, selected=True))
    return _with_joint_scores(models, trials, for_each)


def _with_joint_scores(models: Sequence[Model], trials: Sequence[Trial],
                       for_each: ForEach) -> list[Model]:
    """Score the models of all DOFs together that have couplings, are of one log and method."""
    groups: dict[tuple[str, str, bool], dict[str, Model]] = {}
    for model in models:
        groups.setdefault((model.method, model.trained_on, model.selected), {})[model.dof] = model

    def score(key: tuple[str, str, bool]) -> dict[str, dict[str, Score]]:
        together = {dof: model.all_parameters for dof, model in groups[key].items()}
        if not all(map(math.isfinite, chain(*together.values()))):
            return {}
        delays = {dof: model.fit.delay for dof, model in groups[key].items()}
        thrusters = {dof: model.fit.thrusters for dof, model in groups[key].items()}
        return {trial.name: trial.scores.score_joint(together, delays, thrusters)
                for trial in trials}

    coupled = [key for key, group in groups.items()
               if any(model.fit.couplings for model in group.values())]
    if not coupled:
        return list(models)
    found = dict(zip(coupled, for_each('joint', score, coupled)))
    return [replace(model, joint={
        log: scores[model.dof] for log, scores in found.get(
            (model.method, model.trained_on, model.selected), {}).items()
        if model.dof in scores}) for model in models]


@dataclass(frozen=True)
class _Job:
    """A model to be found; whether its terms are the configured and the method's best ones."""

    trial: Trial
    dof: str
    method: str
    dof_settings: DofSettings
    configured: bool
    best: bool


def _jobs(trial: Trial, dof: str, settings: Settings, best: DofSettings) -> Iterator[_Job]:
    configured = settings.dof[dof]
    for method in trial.player.fits(dof):
        yield _Job(trial, dof, method, configured, True, False)
    for method in OFFLINE:
        yield _Job(trial, dof, method, configured, True, best == configured)
        if best != configured:
            yield _Job(trial, dof, method, best, False, True)


def _idle(dof: str, trials: Sequence[Trial]) -> frozenset[str]:
    """Return the names of the logs that hardly push a DOF: what predicts these says little."""
    pushes = {trial.name: trial.player.push(dof) for trial in trials}
    least = HARDLY * max(pushes.values(), default=0.0)
    return frozenset([name for name, push in pushes.items() if push <= least])


def _best_terms(trial: Trial, dof: str, settings: Settings, trials: Sequence[Trial],
                idle: frozenset[str]) -> DofSettings:
    """Choose with the models of a quick method; every method then fits the chosen terms."""
    configured = settings.dof[dof]
    # least squares is quicker, but leaves couplings out
    method = OFFLINE[REFERENCE if configured.couplings else 'least_squares']
    records = trial.scores.records(dof)
    judges = [t for t in trials if t is not trial and t.scores.records(dof)
              and t.name not in idle] or [trial]

    def error(candidate: DofSettings) -> float:
        fit = method(records, Scales.of(candidate), settings)
        if not all(map(math.isfinite, fit.parameters)):
            return math.inf
        model = (*fit.parameters, *fit.couplings)
        return math.fsum([judge.scores.score(dof, model).mae for judge in judges])

    best, least = configured, error(configured)
    for candidate in subsets(configured):
        worth = WORTH * (len(configured.terms) - len(candidate.terms))
        found = error(candidate)
        if found < least * (1.0 + (worth if best == configured else 0.0)):
            best, least = candidate, found
    return best


def _model(job: _Job, settings: Settings, trials: Sequence[Trial],
           idle: frozenset[str]) -> Model:
    trial, dof = job.trial, job.dof
    if job.method in OFFLINE:
        fit = OFFLINE[job.method](trial.scores.records(dof), Scales.of(job.dof_settings), settings)
    else:
        fit = trial.player.fits(dof)[job.method]
    sound = all(map(math.isfinite, fit.parameters))
    model = Model(job.method, trial.name, dof, job.dof_settings.terms, not job.configured, fit, {},
                  settings.dof[dof].couplings if fit.couplings else (), idle=idle)
    return replace(model, scores={
        t.name: t.scores.score(dof, model.all_parameters, fit.delay, fit.thrusters)
        if sound else Score() for t in trials})


def unseen(model: Model, logs: Sequence[str]) -> list[str]:
    """Return the logs that judge a model and that it was not trained on, and push its DOF."""
    return [log for log in model.judges(logs)
            if log != model.trained_on and log not in model.idle]


def best_of(models: Sequence[Model], dof: str, trials: Sequence[Trial]) -> Model:
    """
    Return the model of a DOF that predicts best, on logs that it was not trained on.

    Among models that are as good, one that comes with its uncertainty, and of those the
    reference.
    """
    names = [trial.name for trial in trials]

    def error(model: Model) -> float:
        return model.error(unseen(model, names) or names)

    own = [model for model in models if model.dof == dof]
    least = min(map(error, own))
    good = [model for model in own if error(model) <= AS_GOOD * least]
    return min(good or own, key=lambda model: (
        model.fit.covariance is None, model.method != REFERENCE, error(model)))
