"""``rovid survey``: many dives, a row for each and DOF, and whether the vehicle changes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
import textwrap
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.commands.arguments import add_params_file, add_part, count, html
from rovid_ros.commands.compare import check_plotly
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.replay import replay
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    Interrupt,
    Interrupted,
    located_errors,
    locked,
    print_written,
    printable,
    printing,
    read_settings,
    read_values,
    UsageError,
    warn,
)
from rovid_ros.commands.workers import Answers, on_dask, on_this_computer
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.results.text import NONE, number, table
from rovid_ros.survey.dives import find_dives, tags
from rovid_ros.survey.table import (
    failed,
    Journal,
    journal_of,
    Row,
    rows_of,
    write_csv,
    write_parquet,
)
from rovid_ros.survey.trends import survey_data

DESCRIPTION = (
    'Identifies each dive by itself, on all cores, and tests whether a parameter drifts from dive '
    'to dive. What is finished is kept beside the table: a survey that was interrupted goes on '
    'from there, and one of more dives computes the new ones only. A log that cannot be read '
    'costs a line.')
WRITERS = {'.csv': write_csv, '.parquet': write_parquet}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid survey`` takes."""
    add_params_file(command)
    command.add_argument(
        'logs', nargs='+', metavar='LOG',
        help='a log, each a dive; a folder or a pattern (*) of logs; a .txt file with one of '
             'these a line')
    command.add_argument(
        '--method', default='', metavar='M', help="use this method, not the file's")
    command.add_argument('--output', type=_table, metavar='TABLE.csv|.parquet',
                         help='write the table: a row per dive and DOF')
    command.add_argument('--report', type=html, metavar='OUT.html',
                         help='write the parameters over time as a page to look at and to send')
    command.add_argument('--workers', type=count, metavar='N',
                         help='so many dives at once (default: one per core)')
    command.add_argument('--scheduler', metavar='ADDRESS',
                         help='work on the Dask cluster of this scheduler, as tcp://host:8786; '
                              'its workers need rovid and see the logs under the same paths')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid survey``."""
    if args.workers and args.scheduler:
        raise UsageError('--workers and --scheduler: takes one of them')
    dives = find_dives(args.logs)
    check_written([args.output, args.report], [*dives, *args.params_file.paths])
    if args.output and args.output.suffix == '.parquet' and find_spec('pyarrow') is None:
        raise CommandError('--output: parquet needs pyarrow, which is not installed: '
                           "pip install 'rovid_ros[parquet]'; CSV needs nothing")
    if args.report:
        check_plotly()
    settings = read_settings(args.params_file, args.method, dives)
    with located_errors(args.params_file):
        PipelinePlayer(settings)  # what is wrong with the configuration is no fault of the dives
    given = {'parameters': read_values(args.params_file, args.method, dives),
             'part': [args.start, args.duration]}
    kept = journal_of(args.output) if args.output else None
    with locked(kept):
        finished = _survey(args, dives, settings, Journal(kept, given))
    rows = [row for path in dives for row in finished[path]]
    data = survey_data(rows, settings.thrusters.newtons)
    with printing(survey_text(data)):
        if args.output:
            WRITERS[args.output.suffix](args.output, rows)
        if args.report:
            from rovid_ros.report.survey import write_survey  # what draws is needed only here
            write_survey(args.report, data)
    print_written(args.output, args.report)
    if data['failed']:
        raise CommandError(f'{len(data["failed"])} of {len(dives)} dives gave nothing')


def survey_dive(path: Path, settings: Settings, start: float = 0.0,
                duration: float | None = None) -> list[Row]:
    """Return the rows of one dive, replayed as ``rovid replay`` does; raises what is wrong."""
    warnings: list[str] = []
    result = replay([path], settings, PipelinePlayer(settings), start=start, duration=duration,
                    warn=warnings.append)
    return rows_of(path, result, tags(path, result.metadata), len(warnings))


def _survey(args: argparse.Namespace, dives: Sequence[Path], settings: Settings,
            journal: Journal) -> dict[Path, list[Row]]:
    """Return the rows of all dives; those that the journal has are not computed again."""
    before = {path: journal.rows(path) for path in dives}
    finished = {path: rows for path, rows in before.items() if rows is not None}
    left = [path for path in dives if path not in finished]
    if finished:
        print(f'{len(finished)} of {len(dives)} dives were finished before\n')
    work = partial(survey_dive, settings=settings, start=args.start, duration=args.duration)
    answers: Answers = (on_dask(args.scheduler, work, left) if args.scheduler else
                        on_this_computer(work, left, args.workers)) if left else iter(())
    with Interrupt() as interrupt, Progress(
            'survey', lambda: len(finished) / len(dives)) as progress:
        for answered in answers:
            for k, made in answered:
                finished[left[k]] = _rows(left[k], made, journal, args.prog)
            progress.tick()
            if interrupt.asked:
                answers.close()  # type: ignore[attr-defined]
                again = '; the same command goes on from there' if args.output else ''
                raise Interrupted(f'interrupted after {len(finished)} of {len(dives)} dives'
                                  f'{again}', interrupt.code)
    return finished


def _rows(path: Path, made: list[Row] | Exception, journal: Journal, prog: str) -> list[Row]:
    if isinstance(made, list):
        journal.add(path, made)
        return made
    text = str(made)
    if isinstance(made, OSError) and made.strerror:
        text = f'{path}: {made.strerror.lower()}'
    elif not isinstance(made, ValueError):
        text = f'{type(made).__name__}: {text}'
    line = printable(text if str(path) in text else f'{path}: {text}')
    warn(prog, line)
    return failed(path, line)


def survey_text(data: dict[str, Any]) -> str:
    """Return what ``rovid survey`` prints: a line per parameter, and what drifts."""
    axis = data['axis']
    rows = [['', '', 'dives', 'mean', 'scatter', 'change', '95 %', 'p', '']]
    for dof, values in data['dofs'].items():
        for name, parameter in values['parameters'].items():
            rows.append([dof, name, *_cells(parameter)])
    left_out = [f'{dof}: {_dives(values["left_out"])} left out (no thrust, or a fit below 0)'
                for dof, values in data['dofs'].items() if values['left_out']]
    along = (f'over the days since {axis["from"][:10]}' if axis['from']
             else 'from dive to dive, as the logs do not tell their dates')
    parts = [f'{_dives(data["dives"])}, {len(data["failed"])} without a result']
    if data['dofs']:
        parts += [table(rows, left=2), '\n'.join([*left_out, textwrap.fill(
            f'change = from the first dive to the last, {along}; scatter = standard deviation '
            'between dives beyond their intervals; p = how likely such a change is where nothing '
            f'drifts, for all {data["tests"]} tests together. A line takes three dives.', 99)])]
    return '\n\n'.join(parts) + '\n'


def _dives(count: int) -> str:
    return f'{count} dive' + 's' * (count != 1)


def _cells(parameter: dict[str, Any]) -> list[str]:
    found = parameter['trend']
    if found is None:
        return [str(len(parameter['points']['x'])), *[NONE] * 5, '']
    return [str(found['count']), f'{number(found["mean"])} {parameter["unit"]}',
            number(found['scatter']), number(found['change']),
            f'{number(found["change_low"])} .. {number(found["change_high"])}',
            f'{found["p_together"]:.2g}', 'drifts' if found['drifts'] else '']


def _table(text: str) -> Path:
    path = Path(text)
    if path.suffix not in WRITERS:
        raise argparse.ArgumentTypeError(
            f'got {text!r}, takes a name that ends in {" or ".join(WRITERS)}')
    return path
