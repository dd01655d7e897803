"""``rovid compare``: every method on each log, each model scored on every log."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
import textwrap
from typing import Any

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Settings
from rovid_ros.commands.arguments import add_json, add_params_file, add_part, html
from rovid_ros.commands.long_work import in_parallel_with_progress
from rovid_ros.commands.replay import replay
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    located_errors,
    print_written,
    printing,
    read_settings,
    warn,
)
from rovid_ros.comparison.report_data import report_data, sentence
from rovid_ros.comparison.trials import best_of, compare, Model, Trial, TrialPlayer
from rovid_ros.files.whole_files import write_json
from rovid_ros.results.text import NO_NEWTONS, NONE, number, percent, table, unit

DESCRIPTION = (
    'Each log is a trial by itself: every method is trained on it, and each model predicts every '
    'log from its thrust alone.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid compare`` takes."""
    add_params_file(command)
    command.add_argument('logs', nargs='+', type=Path, metavar='LOG',
                         help='.mcap, .db3, .bag or .BIN file, or rosbag2 directory')
    command.add_argument('--validate', nargs='+', type=Path, metavar='LOG',
                         help='logs to predict only, not to train on')
    command.add_argument(
        '--report', type=html, metavar='OUT.html', help='write a report to look at and to send')
    add_json(command, 'models')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid compare``."""
    validate = args.validate or []
    check_written([args.report, args.json], [*args.logs, *validate, *args.params_file.paths])
    if args.report:
        check_plotly()
    settings = read_settings(args.params_file, logs=[*args.logs, *validate])
    with located_errors(args.params_file):
        trials = read_trials(args.logs, validate, settings, partial(warn, args.prog),
                             start=args.start, duration=args.duration)
    models = compare(trials, settings, in_parallel_with_progress)
    with printing(comparison_text(models, trials, settings)):
        if args.json:
            write_json(args.json, document(models, settings.thrusters.newtons))
        if args.report:
            from rovid_ros.report.report import write_report  # what draws is needed only here
            write_report(args.report, report_data(models, trials, settings))
    print_written(args.report, args.json)


def read_trials(train: Sequence[Path], validate: Sequence[Path], settings: Settings,
                warn: Callable[[str], None], *, start: float = 0.0,
                duration: float | None = None) -> list[Trial]:
    """Feed each log, from ``start`` for ``duration`` [s], through ``replay`` by itself."""
    paths = [*train, *validate]
    names = [path.name for path in paths]
    trials = []
    for i, path in enumerate(paths):
        # with the folder where it is needed to tell two logs apart
        name = path.name if names.count(path.name) == 1 else str(path)
        player = TrialPlayer(settings)
        warnings: list[str] = []
        result = replay([path], settings, player, start=start, duration=duration,
                        warn=warnings.append)
        for line in warnings:
            warn(f'{name}: {line}')
        trials.append(Trial(name, i < len(train), result, player, warnings))
    return trials


def document(models: Sequence[Model], newtons: bool) -> dict[str, Any]:
    """Return what ``--json`` writes: a model per method, log and choice of terms."""
    grouped: dict[tuple[str, str, bool], dict[str, Any]] = {}
    for model in models:
        key = (model.method, model.trained_on, model.selected)
        grouped.setdefault(key, {})[model.dof] = {
            **model.document(), **({} if newtons else {'newtons': False})}
    return {'models': [
        {'method': method, 'trained_on': log, 'selected_terms': selected, 'dofs': dofs}
        for (method, log, selected), dofs in grouped.items()]}


def comparison_text(models: Sequence[Model], trials: Sequence[Trial], settings: Settings) -> str:
    """Return per DOF the models with equal and with best terms, and the best in a sentence."""
    newtons = settings.thrusters.newtons
    parts = [_tables(dof, [model for model in models if model.dof == dof], trials, newtons)
             for dof in settings.dofs]
    parts.append('\n'.join(f'log {k}: {trial.name}' + ('' if trial.trains else ', not trained on')
                           for k, trial in enumerate(trials, 1)))
    parts.append(_lines(
        'own: mean |v_sim - v| on the log that the model was trained on; others: the mean over '
        'the other logs that push the DOF, with the mean fit. a b g d: alpha, beta, gamma, '
        'delta; best terms: those of them that predict best.') + '\n')
    parts += [_lines(sentence(best_of(models, dof, trials), trials, newtons))
              for dof in settings.dofs]
    if not newtons:
        parts.append(_lines(NO_NEWTONS))
    notes = dict.fromkeys(f'{m.dof}, {m.method}, {m.trained_on}: {m.fit.note}'
                          for m in models if m.fit.note)
    return '\n'.join([*parts, *(['', *map(_lines, notes)] if notes else [])])


def _lines(text: str) -> str:
    return textwrap.fill(text, 99, subsequent_indent='  ')


def _tables(dof: str, models: Sequence[Model], trials: Sequence[Trial], newtons: bool) -> str:
    units = [unit(dof, name, newtons) for name in PHYSICAL]
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
    logs = [trial.name for trial in trials]
    others = [log for log in logs if log != model.trained_on]
    error = fit = NONE
    if others:
        error = number(model.error(others))
        fit = percent(model.fit_on(others))
    return [name, str(logs.index(model.trained_on) + 1),
            *map(number, physical(model.fit.parameters)),
            number(model.scores[model.trained_on].mae), error, fit]


def check_plotly() -> None:
    """Refuse a report that could not be drawn, before the work begins."""
    if find_spec('plotly') is None:
        raise CommandError('--report draws with plotly, which is not installed: '
                           "pip install 'rovid_ros[report]' or apt install python3-plotly")
