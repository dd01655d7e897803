"""What the report of a comparison shows, as plain values; None is what is not known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.intervals import intervals
from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings
from rovid_core.trials.output_error import information
from rovid_ros import __version__
from rovid_ros.comparison.trials import best_of, finite, Model, Number, Trial
from rovid_ros.results.text import number, percent, unit

MAX_POINTS = 3000
"""Of a curve: more than a screen shows."""

BINS = 30
"""Of a histogram."""

GAP = 5.0
"""Steps without a measurement at which a curve breaks."""

DETERMINED, VAGUE = 0.1, 0.5
"""Relative bounds up to which a parameter is determined, and from which it is not."""

Column = list[float | None]


@dataclass(frozen=True)
class InputReport:
    """The messages of one input in one log: mean rate [Hz], longest gap [s]."""

    input: str
    topic: str
    rate_hz: float
    count: int
    longest_gap_s: float


@dataclass(frozen=True)
class LogReport:
    """
    One log.

    Attributes
    ----------
    role : str
        train or validate.
    rejected : mapping
        How many samples were refused, by reason.

    """

    name: str
    role: str
    duration_s: float
    messages: int
    inputs: list[InputReport]
    rejected: Mapping[str, int]
    warnings: list[str]


@dataclass(frozen=True)
class ValueReport:
    """A parameter with its 95 % interval."""

    value: Number
    low: Number
    high: Number
    unit: str


@dataclass(frozen=True)
class BestReport:
    """The model of a DOF that predicts best; its parameters by name."""

    method: str
    trained_on: str
    physical: Mapping[str, ValueReport]
    lumped: Mapping[str, ValueReport]


@dataclass(frozen=True)
class ModelReport:
    """
    A model of one DOF.

    Attributes
    ----------
    selected : bool
        Whether these are the method's best terms; else they are the configured ones.
    parameters, physical, std : mapping
        By name; std is of the parameters, None for a method that does not tell it.
    scores : mapping
        By log: ``mae`` [m/s or rad/s] and ``fit``.

    """

    method: str
    trained_on: str
    terms: tuple[str, ...]
    selected: bool
    parameters: Mapping[str, Number]
    physical: Mapping[str, Number]
    std: Mapping[str, Number] | None
    note: str
    scores: Mapping[str, Mapping[str, Number]]


@dataclass(frozen=True)
class SeriesReport:
    """Velocity and force over time [s], and the velocity by method that its model predicts."""

    t: Column
    velocity: Column
    force: Column
    simulated: Mapping[str, Column]


@dataclass(frozen=True)
class AdaptationReport:
    """
    The adaptive identifier over time [s] (Fig. 4 and 5 of the paper).

    Attributes
    ----------
    velocity, v_hat, dv : list
        Measured, of the identifier, and their difference [m/s or rad/s].
    W : list
        Its Lyapunov function against ``reference``.
    alpha, beta, gamma, delta : list
        Its parameters.
    reference : mapping
        The parameters that least squares found, by name.

    """

    t: Column
    velocity: Column
    v_hat: Column
    dv: Column
    W: Column
    alpha: Column
    beta: Column
    gamma: Column
    delta: Column
    reference: Mapping[str, Number]


@dataclass(frozen=True)
class HistogramReport:
    """Counts between edges, of which there is one more."""

    edges: list[float]
    counts: list[int]


@dataclass(frozen=True)
class SpectrumReport:
    """Amplitudes of force and velocity by frequency [Hz]; empty for a very short log."""

    frequency: list[float]
    force: list[float]
    velocity: list[float]


@dataclass(frozen=True)
class ExcitationReport:
    """
    What a log can tell of a DOF.

    Attributes
    ----------
    relative_bound : mapping
        Cramer-Rao bound of each term of the best model, as a share of its value.
    condition : float or None
        Of the information matrix.
    verdict : str
        The same in a sentence.

    """

    force_histogram: HistogramReport
    velocity_histogram: HistogramReport
    spectrum: SpectrumReport
    relative_bound: Mapping[str, Number]
    condition: Number
    verdict: str


@dataclass(frozen=True)
class DofReport:
    """
    One degree of freedom.

    Attributes
    ----------
    series, adaptation, excitation : mapping
        By log; the adaptation only of those that models were trained on.
    units : mapping
        By the name of a parameter, ``velocity`` or ``force``.

    """

    sentence: str
    best: BestReport
    models: list[ModelReport]
    series: Mapping[str, SeriesReport]
    adaptation: Mapping[str, AdaptationReport]
    excitation: Mapping[str, ExcitationReport]
    units: Mapping[str, str]


@dataclass(frozen=True)
class ReportData:
    """All that the report shows; ``dofs`` by name."""

    rovid_version: str
    logs: list[LogReport]
    dofs: Mapping[str, DofReport]


def report_data(models: Sequence[Model], trials: Sequence[Trial],
                settings: Settings) -> ReportData:
    """
    Return what the report of a comparison shows.

    Parameters
    ----------
    models : sequence of Model
        As ``compare`` returns them.
    trials : sequence of Trial
        All logs.
    settings : Settings
        The run.

    """
    return ReportData(__version__, [_log(trial, settings) for trial in trials],
                      {dof: _dof(dof, models, trials, settings) for dof in settings.dofs})


def sentence(best: Model, trials: Sequence[Trial]) -> str:
    """Return in one sentence what was identified of a DOF and how well it predicts."""
    dof = best.dof
    mass, quadratic, linear, bias = physical(best.fit.parameters)
    log = next((t.name for t in trials if t.name != best.trained_on and best.is_scored(t.name)),
               best.trained_on)
    score = best.scores[log]
    own = ', on which it was trained' if log == best.trained_on else ''
    return (
        f'{dof.capitalize()}: effective mass {number(mass)} {unit(dof, "mass")}, quadratic drag '
        f'{number(quadratic)} {unit(dof, "quadratic_drag")}, linear drag {number(linear)} '
        f'{unit(dof, "linear_drag")}, bias {number(bias)} {unit(dof, "bias")}; predicts the '
        f'velocity of {log}{own} to {number(score.mae)} {unit(dof, "mae")} (fit '
        f'{percent(score.fit)}).')


def _verdict(relative: Mapping[str, Number]) -> str:
    """Return in words which parameters a log determines and what would help."""
    known = [name for name, x in relative.items() if x is not None and x <= DETERMINED]
    vague = [name for name, x in relative.items() if x is None or x > VAGUE]
    parts = [f'determines {", ".join(known)}' if known else 'determines no parameter well']
    if vague:
        parts.append(f'can not tell {", ".join(vague)}')
    if {'beta', 'gamma'} & set(vague):
        parts.append('quadratic and linear drag need slow and fast motion: larger and slower '
                     'thrust (0.02 to 0.05 Hz)')
    return f'This log {"; ".join(parts)}.'


def _log(trial: Trial, settings: Settings) -> LogReport:
    stream = trial.stream
    topics = {name: ', '.join(settings.thrusters.topics) if name == 'thrusters'
              else settings.input(name).topic for name in stream.inputs}
    inputs = [InputReport(name, topics[name], health.rate, health.count, health.longest_gap)
              for name, health in stream.inputs.items()]
    return LogReport(
        trial.name, 'train' if trial.trains else 'validate', trial.result.duration,
        trial.result.messages, inputs, stream.rejected_by_reason(), trial.warnings)


def _dof(dof: str, models: Sequence[Model], trials: Sequence[Trial],
         settings: Settings) -> DofReport:
    own = [model for model in models if model.dof == dof]
    best = best_of(models, dof, trials)
    return DofReport(
        sentence(best, trials),
        BestReport(best.method, best.trained_on,
                   _values(best, PHYSICAL, physical(best.fit.parameters)),
                   _values(best, PARAMETERS, best.fit.parameters)),
        [_model(model) for model in own],
        {trial.name: _series(dof, trial, own) for trial in trials},
        {trial.name: _adaptation(dof, trial, own) for trial in trials if trial.trains},
        {trial.name: _excitation(dof, trial, best, settings) for trial in trials},
        {'velocity': unit(dof, 'mae'), 'force': unit(dof, 'bias'),
         **{name: unit(dof, name) for name in (*PARAMETERS, *PHYSICAL)}})


def _values(model: Model, names: tuple[str, ...], values: Four) -> dict[str, ValueReport]:
    covariance = model.fit.covariance
    found = {} if covariance is None else intervals(
        model.fit.parameters, covariance.ravel().tolist())
    reports = {}
    for name, value in zip(names, values):
        low, high = found.get(name, (math.nan, math.nan))
        reports[name] = ValueReport(
            finite(value), finite(low), finite(high), unit(model.dof, name))
    return reports


def _model(model: Model) -> ModelReport:
    document = model.document()
    return ModelReport(
        model.method, model.trained_on, model.terms, model.selected,
        {name: document[name] for name in PARAMETERS},
        {name: document[name] for name in PHYSICAL},
        document['std'], document['note'], document['scores'])


def _series(dof: str, trial: Trial, models: Sequence[Model]) -> SeriesReport:
    """Return Fig. 3: models trained on this log, or the first training log's."""
    trained = [m for m in models if not m.selected and all(map(math.isfinite, m.fit.parameters))]
    chosen = [m for m in trained if m.trained_on == trial.name] or [
        m for m in trained if m.trained_on == trained[0].trained_on]
    times, velocities, forces = trial.scores.series(dof)
    seconds = _seconds(times)
    steps = np.diff(seconds)
    for k in np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else ():
        velocities[k + 1] = math.nan  # the curve breaks
    kept = _thinned(len(times))
    return SeriesReport(
        _picked(seconds, kept), _picked(velocities, kept), _picked(forces, kept),
        {m.method: _picked(trial.scores.predicted(dof, m.fit.parameters), kept) for m in chosen})


def _adaptation(dof: str, trial: Trial, models: Sequence[Model]) -> AdaptationReport:
    """Return Fig. 4 and 5: the online identifier, its errors taken against least squares."""
    history = trial.history[dof]
    reference = next(m.fit.parameters for m in models if not m.selected
                     and m.method == 'least_squares' and m.trained_on == trial.name)
    energy = trial.stream.identifier(dof).energy
    kept = _thinned(len(history.times))
    dv = [v_hat - v for v_hat, v in zip(history.v_hats, history.velocities)]
    alpha, beta, gamma, delta = (
        _picked([p[i] for p in history.parameters], kept) for i in range(4))
    return AdaptationReport(
        t=_picked(_seconds(history.times), kept), velocity=_picked(history.velocities, kept),
        v_hat=_picked(history.v_hats, kept), dv=_picked(dv, kept),
        W=[finite(energy(dv[k], history.theta_hats[k], reference)) for k in kept],
        alpha=alpha, beta=beta, gamma=gamma, delta=delta,
        reference=dict(zip(PARAMETERS, map(finite, reference))))


def _excitation(dof: str, trial: Trial, best: Model, settings: Settings) -> ExcitationReport:
    times, velocities, forces = trial.scores.series(dof)
    records = trial.scores.records(dof)
    relative: dict[str, Number] = dict.fromkeys(best.terms)
    condition = None
    if records and all(map(math.isfinite, best.fit.parameters)):
        bound = information(records, Scales.of(settings.dof[dof]), best.fit.parameters)
        condition = finite(bound.condition) if bound else None
        for i, name in enumerate(PARAMETERS):
            if bound and name in relative and best.fit.parameters[i]:
                relative[name] = finite(
                    math.sqrt(bound.covariance[i, i]) / abs(best.fit.parameters[i]))
    return ExcitationReport(
        _histogram(forces), _histogram(velocities),
        _spectrum(_seconds(times), forces, velocities), relative, condition, _verdict(relative))


def _histogram(values: Sequence[float]) -> HistogramReport:
    counts, edges = np.histogram(np.array(values), BINS)
    return HistogramReport(edges.tolist(), counts.tolist())


def _spectrum(seconds: Sequence[float], force: Sequence[float],
              velocity: Sequence[float]) -> SpectrumReport:
    """Return amplitudes by frequency, of the series at even steps."""
    if len(seconds) < 16:
        return SpectrumReport([], [], [])
    grid = np.linspace(seconds[0], seconds[-1], len(seconds))
    frequency = np.fft.rfftfreq(len(grid), (seconds[-1] - seconds[0]) / (len(seconds) - 1))
    kept: NDArray[np.bool_] = (frequency > 0.0) & (frequency <= 1.0)
    window = np.hanning(len(grid))

    def amplitude(values: Sequence[float]) -> list[float]:
        even = np.interp(grid, seconds, values)
        spectrum = np.abs(np.fft.rfft((even - even.mean()) * window)) * 2.0 / window.sum()
        return [float(x) for x in spectrum[kept]]

    return SpectrumReport(frequency[kept].tolist(), amplitude(force), amplitude(velocity))


def _thinned(count: int) -> range:
    return range(0, count, max(1, -(-count // MAX_POINTS)))


def _picked(values: Sequence[float], kept: Sequence[int]) -> Column:
    return [finite(values[k]) for k in kept]


def _seconds(times: Sequence[int]) -> list[float]:
    return [(t - times[0]) * 1e-9 for t in times]
