"""The tables that a comparison prints."""

from __future__ import annotations

from collections.abc import Sequence

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Settings
from rovid_ros.comparison.compare import best_of, Model
from rovid_ros.comparison.report_data import sentence
from rovid_ros.comparison.trials import Trial
from rovid_ros.results.text import NONE, number, percent, table, unit


def comparison_text(models: Sequence[Model], trials: Sequence[Trial],
                    settings: Settings) -> str:
    """Return per DOF the models with equal and with best terms, and the best in a sentence."""
    parts = []
    for dof in settings.dofs:
        own = [model for model in models if model.dof == dof]
        parts.append(_tables(dof, own, trials))
    parts.append('\n'.join(f'log {k}: {trial.name}' + ('' if trial.trains else ', not trained on')
                           for k, trial in enumerate(trials, 1)))
    parts.append('own: mean |v_sim - v| on the log that the model was trained on; others: the '
                 'mean over the\nother logs, with the mean fit.\n')
    parts += [sentence(best_of(models, dof, trials), trials) for dof in settings.dofs]
    notes = dict.fromkeys(f'{m.dof}, {m.method}, {m.trained_on}: {m.fit.note}'
                          for m in models if m.fit.note)
    return '\n'.join([*parts, *(['', *notes] if notes else [])])


def _tables(dof: str, models: Sequence[Model], trials: Sequence[Trial]) -> str:
    units = [unit(dof, name) for name in PHYSICAL]
    head = [dof, 'log', 'mass', 'quadratic', 'linear', 'bias', 'own', 'others', 'fit']
    rows = [head, ['', '', *units, unit(dof, 'mae'), unit(dof, 'mae'), '']]
    for model in models:
        if not model.selected:
            rows.append(_row(model, model.method, trials))
    rows.append(['best terms', *[''] * (len(head) - 1)])
    for model in models:
        if model.selected:
            terms = ' '.join(PARAMETERS[i][0] for i in range(4) if PARAMETERS[i] in model.terms)
            rows.append(_row(model, f'{model.method} ({terms})', trials))
    return table(rows, left=2) + '\n'


def _row(model: Model, name: str, trials: Sequence[Trial]) -> list[str]:
    others = [trial.name for trial in trials if trial.name != model.trained_on]
    error = fit = NONE
    if others:
        error = number(model.error(others))
        fit = percent(sum(model.scores[log].fit for log in others) / len(others))
    number_of_log = [trial.name for trial in trials].index(model.trained_on) + 1
    return [name, str(number_of_log), *map(number, physical(model.fit.parameters)),
            number(model.scores[model.trained_on].mae), error, fit]
