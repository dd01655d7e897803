"""``rovid compare``: every method on each log, each model scored on every log (Section V)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, TypeVar

from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import DofSettings, Settings
from rovid_core.settings.scales import Scales
from rovid_core.trials.offline import METHODS, subsets
from rovid_core.trials.record import Fit
from rovid_core.trials.score import Score
from rovid_ros.commands.parallel import in_parallel
from rovid_ros.commands.progress import Progress
from rovid_ros.comparison.trials import Trial

Given = TypeVar('Given')
Made = TypeVar('Made')

REFERENCE = 'output_error'
"""What the other methods are held against."""

AS_GOOD = 1.02
"""Errors within this factor are the same."""

WORTH = 0.01
"""A term has to lower the error by this share to be kept: without it the model is simpler."""


@dataclass(frozen=True)
class Model:
    """
    A model of one DOF.

    Attributes
    ----------
    method, trained_on, dof : str
        Where it comes from.
    terms : tuple of str
        What it has.
    selected : bool
        Whether these are the method's best terms; else they are the configured ones.
    fit : Fit
        Parameters and covariance.
    scores : mapping of str to Score
        By the name of the log.

    """

    method: str
    trained_on: str
    dof: str
    terms: tuple[str, ...]
    selected: bool
    fit: Fit
    scores: Mapping[str, Score]

    def error(self, logs: Sequence[str]) -> float:
        """Return the mean mae over those logs that it has one in; infinite without any."""
        values = [self.scores[log].mae for log in logs if self.is_scored(log)]
        return sum(values) / len(values) if values else math.inf

    def is_scored(self, log: str) -> bool:
        """Tell whether there are steps in a log to score it on."""
        return not math.isnan(self.scores[log].mae)

    def document(self) -> dict[str, Any]:
        """Return the model's part of the JSON."""
        parameters = self.fit.parameters
        return {
            **_named(PARAMETERS, parameters), **_named(PHYSICAL, physical(parameters)),
            'std': None if self.fit.covariance is None else _named(PARAMETERS, self.fit.std),
            'terms': list(self.terms), 'note': self.fit.note,
            'scores': {log: {'mae': _finite(score.mae), 'fit': _finite(score.fit)}
                       for log, score in self.scores.items()}}


def compare(trials: Sequence[Trial], settings: Settings) -> list[Model]:
    """
    Identify by each method from each training log and score the models on all logs.

    Parameters
    ----------
    trials : sequence of Trial
        Those that train are used to identify; all to score.
    settings : Settings
        The run.

    Returns
    -------
    list of Model
        Per training log, DOF and method: with the configured terms, then, for the offline
        methods, with the best choice of terms by the error on the other logs (on the log
        itself where there is only one).

    """
    pairs = [(trial, dof) for trial in trials if trial.trains for dof in settings.dofs]
    chosen = _on_all_cores(
        'terms', lambda pair: _best_terms(*pair, settings, trials), pairs)
    jobs = [job for (trial, dof), best in zip(pairs, chosen)
            for job in _jobs(trial, dof, settings, best)]
    models: list[Model] = []
    for job, model in zip(jobs, _on_all_cores(
            'compare', lambda job: _model(job, settings, trials), jobs)):
        models.append(model)
        if job.configured and job.best:
            models.append(replace(model, selected=True))
    return models


@dataclass(frozen=True)
class _Job:
    """
    A model to be found.

    Attributes
    ----------
    trial, method, dof
        From what, and how.
    known : DofSettings
        The terms that it is to have.
    configured, best : bool
        Whether these are the configured terms, and the method's best ones.

    """

    trial: Trial
    dof: str
    method: str
    known: DofSettings
    configured: bool
    best: bool


def _jobs(trial: Trial, dof: str, settings: Settings, best: DofSettings) -> Iterator[_Job]:
    known = settings.dof[dof]
    for name in trial.feeder.online(dof):
        yield _Job(trial, dof, name, known, True, False)
    for name in METHODS:
        yield _Job(trial, dof, name, known, True, best == known)
        if best != known:
            yield _Job(trial, dof, name, best, False, True)


def _on_all_cores(label: str, work: Callable[[Given], Made],
                  given: Sequence[Given]) -> list[Made]:
    done = 0
    with Progress(label, lambda: done / len(given)) as progress:
        def tick(count: int) -> None:
            nonlocal done
            done = count
            progress.tick()

        return in_parallel(work, given, tick)


def _best_terms(trial: Trial, dof: str, settings: Settings,
                trials: Sequence[Trial]) -> DofSettings:
    """Choose with the quick method's models; every method then fits the chosen terms."""
    known = settings.dof[dof]
    records = trial.scores.records(dof)
    judges = [t for t in trials if t is not trial and t.scores.records(dof)] or [trial]

    def error(candidate: DofSettings) -> float:
        fit = METHODS['least_squares'](records, Scales.of(candidate), settings)
        if not all(map(math.isfinite, fit.parameters)):
            return math.inf
        return sum(judge.scores.score(dof, fit.parameters).mae for judge in judges)

    best, least = known, error(known)
    for candidate in subsets(known):
        worth = WORTH * (len(known.terms) - len(candidate.terms))
        found = error(candidate)
        if found < least * (1.0 + (worth if best == known else 0.0)):
            best, least = candidate, found
    return best


def _model(job: _Job, settings: Settings, trials: Sequence[Trial]) -> Model:
    trial, dof = job.trial, job.dof
    if job.method in METHODS:
        fit = METHODS[job.method](trial.scores.records(dof), Scales.of(job.known), settings)
    else:
        fit = trial.feeder.online(dof)[job.method]
    sound = all(map(math.isfinite, fit.parameters))
    scores = {t.name: t.scores.score(dof, fit.parameters) if sound else Score() for t in trials}
    return Model(job.method, trial.name, dof, job.known.terms, not job.configured, fit, scores)


def best_of(models: Sequence[Model], dof: str, trials: Sequence[Trial]) -> Model:
    """
    Return the model of a DOF that predicts best, on logs that it was not trained on.

    Among models that are as good, one that comes with its uncertainty, and of those the
    reference.
    """
    names = [trial.name for trial in trials]

    def error(model: Model) -> float:
        others = [name for name in names if name != model.trained_on and model.is_scored(name)]
        return model.error(others or names)

    own = [model for model in models if model.dof == dof]
    least = min(map(error, own))
    good = [model for model in own if error(model) <= AS_GOOD * least]
    return min(good or own, key=lambda model: (
        model.fit.covariance is None, model.method != REFERENCE, error(model)))


def document(models: Sequence[Model]) -> dict[str, Any]:
    """Return what ``--json`` writes: a model per method, log and choice of terms."""
    grouped: dict[tuple[str, str, bool], dict[str, Any]] = {}
    for model in models:
        key = (model.method, model.trained_on, model.selected)
        grouped.setdefault(key, {})[model.dof] = model.document()
    return {'models': [
        {'method': method, 'trained_on': log, 'selected_terms': selected, 'dofs': dofs}
        for (method, log, selected), dofs in grouped.items()]}


def _named(names: tuple[str, ...], values: Four) -> dict[str, float | None]:
    return {name: _finite(value) for name, value in zip(names, values)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
