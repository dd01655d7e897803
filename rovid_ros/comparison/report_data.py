"""
What the report of a comparison shows, as plain values by name.

::

    rovid_version
    current     by log, where it was seen: t, x, y, x_std, y_std, status (the last)
    logs        a list of: name, role (train or validate), duration_s, messages, warnings,
                rejected (counts by reason), inputs (a list of: input, topic, rate_hz, count,
                longest_gap_s)
    dofs        by name of the DOF:
      sentence    what was identified and how well it predicts
      best        method, trained_on; physical, lumped (by parameter: value, low, high, unit)
                  and couplings (likewise, by name)
      models      a list of: method, trained_on, terms, selected (whether these are the method's
                  best terms), parameters, physical, std, note, couplings (names), scores (by
                  log: mae, fit, and of a model with couplings fit_joint)
      series      by log: t, velocity, force, simulated (by method)
      adaptation  by training log: t, velocity, v_hat, dv, W, alpha, beta, gamma, delta, reference
      excitation  by log: force_histogram, velocity_histogram (edges, counts), spectrum
                  (frequency, force, velocity), relative_bound (by term), condition, verdict
      units       by parameter, and of velocity and force

Times are in seconds, low and high are the 95 % interval, W is the Lyapunov function against
``reference``, the parameters of least squares. None is a value that is not known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.intervals import intervals, Z95
from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings
from rovid_core.trials.output_error import information
from rovid_ros import __version__
from rovid_ros.comparison.trials import best_of, Model, Trial, unseen
from rovid_ros.results.current import told
from rovid_ros.results.documents import json_number, json_numbers
from rovid_ros.results.text import number, percent, quantity, unit

BINS = 30  # of a histogram
GAP = 5.0  # steps without a measurement at which a curve breaks
# Relative bounds up to which a parameter is determined, and from which it is not.
DETERMINED, VAGUE = 0.1, 0.5

Column = list[float | None]
Data = dict[str, Any]


def report_data(models: Sequence[Model], trials: Sequence[Trial], settings: Settings) -> Data:
    """Return what the report of a comparison shows."""
    return {
        'rovid_version': __version__, 'logs': [_log(trial, settings) for trial in trials],
        'current': {trial.name: _current(trial, settings) for trial in trials
                    if trial.player.currents},
        'dofs': {dof: _dof(dof, models, trials, settings) for dof in settings.dofs}}


def sentence(best: Model, trials: Sequence[Trial], newtons: bool = True) -> str:
    """Return in one sentence what was identified of a DOF and how well it predicts."""
    dof, values = best.dof, dict(zip(PHYSICAL, physical(best.fit.parameters)))
    mass, quadratic, linear, bias = [
        quantity(dof, name, values, newtons) for name in PHYSICAL]
    logs = unseen(best, [trial.name for trial in trials]) or [best.trained_on]
    error, fit = best.error(logs), best.fit_on(logs)
    what = logs[0] if len(logs) == 1 else f'{len(logs)} logs that it was not trained on'
    own = ', on which it was trained,' if logs == [best.trained_on] else ''
    verdict = ': no better than a constant, so it says nothing of the vehicle' if fit < 0.0 else ''
    return (
        f'{dof.capitalize()}: effective mass {mass}, quadratic drag {quadratic}, linear drag '
        f'{linear}, bias {bias}; predicts the velocity of '
        f'{what}{own} to {number(error)} {unit(dof, "mae")} (fit {percent(fit)}){verdict}.')


def _verdict(relative: Mapping[str, float | None]) -> str:
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


def _log(trial: Trial, settings: Settings) -> Data:
    stream = trial.player.stream
    topics = {name: ', '.join(settings.thrusters.topics) if name == 'thrusters'
              else settings.input(name).topic for name in stream.inputs}
    return {
        'name': trial.name, 'role': 'train' if trial.trains else 'validate',
        'duration_s': trial.result.duration, 'messages': trial.result.messages,
        'inputs': [
            {'input': name, 'topic': topics[name], 'rate_hz': health.rate,
             'count': health.count, 'longest_gap_s': health.longest_gap}
            for name, health in stream.inputs.items()],
        'rejected': stream.rejected_by_reason(), 'warnings': trial.warnings}


def _dof(dof: str, models: Sequence[Model], trials: Sequence[Trial], settings: Settings) -> Data:
    own = [model for model in models if model.dof == dof]
    best = best_of(models, dof, trials)
    units = {name: unit(dof, name, settings.thrusters.newtons)
             for name in (*PARAMETERS, *PHYSICAL)}
    return {
        'sentence': sentence(best, trials, settings.thrusters.newtons),
        'best': {
            'method': best.method, 'trained_on': best.trained_on,
            'physical': _values(best, units, PHYSICAL, physical(best.fit.parameters)),
            'lumped': _values(best, units, PARAMETERS, best.fit.parameters),
            'couplings': _couplings(best)},
        'models': [_model(model) for model in own],
        'series': {trial.name: _series(dof, trial, own) for trial in trials},
        'adaptation': {trial.name: _adaptation(dof, trial, own)
                       for trial in trials if trial.trains},
        'excitation': {trial.name: _excitation(dof, trial, best, settings)
                       for trial in trials},
        'units': {'velocity': unit(dof, 'mae'), 'force': units['bias'], **units}}


def _current(trial: Trial, settings: Settings) -> Data:
    """Return the current of the water over a log, in the world of its messages."""
    times = [time for time, _ in trial.player.currents]
    found = [told(current, settings.frames) for _, current in trial.player.currents]
    x_std, y_std = zip(*(current.std for current in found))
    return {'t': _column(_seconds(times)), 'x': _column([c.x for c in found]),
            'y': _column([c.y for c in found]), 'x_std': _column(x_std), 'y_std': _column(y_std),
            'status': found[-1].status}


def _values(model: Model, units: Mapping[str, str], names: tuple[str, ...],
            values: Four) -> Data:
    covariance = model.fit.covariance
    found = {} if covariance is None else intervals(
        model.fit.parameters, covariance.ravel().tolist())
    reports = {}
    for name, value in zip(names, values):
        low, high = found.get(name, (math.nan, math.nan))
        reports[name] = {'unit': units[name], **json_numbers(
            ('value', 'low', 'high'), (value, low, high))}
    return reports


def _couplings(model: Model) -> Data:
    return {name: json_numbers(('value', 'low', 'high'),
                               (kappa, kappa - Z95 * std, kappa + Z95 * std))
            for name, kappa, std in zip(
                model.couplings, model.fit.couplings, model.fit.couplings_std)}


def _model(model: Model) -> Data:
    document = model.document()
    return {
        'method': model.method, 'trained_on': model.trained_on, 'selected': model.selected,
        'parameters': {name: document[name] for name in PARAMETERS},
        'physical': {name: document[name] for name in PHYSICAL},
        'couplings': list(model.couplings),
        **{key: document[key] for key in ('terms', 'std', 'note', 'scores')}}


def _series(dof: str, trial: Trial, models: Sequence[Model]) -> Data:
    """Return Fig. 3: models trained on this log, or the first training log's."""
    trained = [m for m in models if not m.selected and all(map(math.isfinite, m.fit.parameters))]
    chosen = [m for m in trained if m.trained_on == trial.name] or [
        m for m in trained if m.trained_on == trained[0].trained_on]
    times, velocities, forces = trial.scores.series(dof)
    seconds = _seconds(times)
    steps = np.diff(seconds)
    for k in np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else ():
        velocities[k + 1] = math.nan  # the curve breaks
    return {
        't': _column(seconds), 'velocity': _column(velocities),
        'force': _column(forces),
        'simulated': {m.method: _column(trial.scores.predicted(
            dof, m.all_parameters, m.fit.delay, m.fit.thrusters)) for m in chosen}}


def _adaptation(dof: str, trial: Trial, models: Sequence[Model]) -> Data:
    """Return Fig. 4 and 5: the online identifier, its errors taken against least squares."""
    history = trial.player.history[dof]
    reference = next(m.fit.parameters for m in models if not m.selected
                     and m.method == 'least_squares' and m.trained_on == trial.name)
    energy = trial.player.stream.identifier(dof).energy
    dv = [v_hat - v for v_hat, v in zip(history.v_hats, history.velocities)]
    return {
        't': _column(_seconds(history.times)), 'v_hat': _column(history.v_hats),
        'velocity': _column(history.velocities), 'dv': _column(dv),
        **{name: _column([p[i] for p in history.parameters])
           for i, name in enumerate(PARAMETERS)},
        'W': [json_number(energy(error, theta_hat, reference))
              for error, theta_hat in zip(dv, history.theta_hats)],
        'reference': json_numbers(PARAMETERS, reference)}


def _excitation(dof: str, trial: Trial, best: Model, settings: Settings) -> Data:
    times, velocities, forces = trial.scores.series(dof)
    records = trial.scores.records(dof)
    relative: dict[str, float | None] = dict.fromkeys(best.terms)
    condition = None
    scales = replace(Scales.of(settings.dof[dof]), couplings=best.couplings)
    if records and all(map(math.isfinite, best.fit.parameters)):
        bound = information(records, scales, best.all_parameters)
        condition = json_number(bound.condition) if bound else None
        for i, name in enumerate(PARAMETERS):
            if bound and name in relative and best.fit.parameters[i]:
                relative[name] = json_number(
                    math.sqrt(bound.covariance[i, i]) / abs(best.fit.parameters[i]))
    return {
        'force_histogram': _histogram(forces), 'velocity_histogram': _histogram(velocities),
        'spectrum': _spectrum(_seconds(times), forces, velocities),
        'relative_bound': relative, 'condition': condition, 'verdict': _verdict(relative)}


def _histogram(values: Sequence[float]) -> Data:
    counts, edges = np.histogram(np.array(values), BINS)
    return {'edges': edges.tolist(), 'counts': counts.tolist()}


def _spectrum(seconds: Sequence[float], force: Sequence[float], velocity: Sequence[float]) -> Data:
    """Return amplitudes by frequency, of the series at even steps."""
    if len(seconds) < 16:
        return {'frequency': [], 'force': [], 'velocity': []}
    grid = np.linspace(seconds[0], seconds[-1], len(seconds))
    frequency = np.fft.rfftfreq(len(grid), (seconds[-1] - seconds[0]) / (len(seconds) - 1))
    kept: NDArray[np.bool_] = (frequency > 0.0) & (frequency <= 1.0)
    window = np.hanning(len(grid))

    def amplitude(values: Sequence[float]) -> list[float]:
        even = np.interp(grid, seconds, values)
        spectrum = np.abs(np.fft.rfft((even - even.mean()) * window)) * 2.0 / window.sum()
        return [float(x) for x in spectrum[kept]]

    return {'frequency': frequency[kept].tolist(), 'force': amplitude(force),
            'velocity': amplitude(velocity)}


def _column(values: Sequence[float]) -> Column:
    return list(map(json_number, values))


def _seconds(times: Sequence[int]) -> list[float]:
    return [(t - times[0]) * 1e-9 for t in times]
