"""
Put faults into a simulated and a real log.

``python -m benchmarks.faults.campaign [LOGS] [--live]``

LOGS is a folder with the two tank recordings; without it, they are left out. ``--live``
publishes every faulty simulated log over DDS as well, into the node in a process of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial
from math import isfinite
from multiprocessing import get_context
import os
from pathlib import Path
import re
import sys

from test.support.fault_cases import BY_NAME, Fault, FAULTS, UNDISTURBED
from test.support.fault_outcomes import Outcome, without_numbers
from test.support.fault_runs import Bench, replayed, simulated, tank

WITHIN = 1.2
"""How much larger than without the fault a model's mae may be once it has cleared."""

METHODS = ('ekf', 'aid')

SHOWN = 3
"""How many of the things that were said stand in the table."""


@dataclass
class Row:
    """What came of one fault in one log."""

    fault: str
    refused: dict[str, int] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    ratios: dict[str, tuple[float, str]] = field(default_factory=dict)  # by method, 'live'
    off: float = 0.0
    same: bool | None = None  # live: the bits of a replay
    wrong: list[str] = field(default_factory=list)


def work(name: str, logs: Path | None, over_dds: bool, fault: str) -> Row:
    """Put a fault into a log and return what came of it."""
    bench, case = _bench(name, logs), BY_NAME[fault]
    span = case.span(bench.recording)
    messages = case.edit(bench.recording, span)
    row = Row(fault)
    for method in METHODS:
        settings = bench.method(method)
        outcome, usual = replayed(messages, settings), bench.usual(settings)
        row.ratios[method] = bench.ratio(outcome, usual)
        row.wrong += _wrong(method, outcome, usual if fault != UNDISTURBED else Outcome())
        if method == METHODS[0]:
            row.refused, row.said = outcome.beyond(usual, span)
            row.off = bench.off(outcome)
    if not _is_said(case, row.refused, row.said):
        row.wrong.append('not said')
    if over_dds:
        _add_live(_bench('short', logs), case, row)
    row.wrong += [f'mae {method}' for method in (METHODS[0], 'live')
                  if method in row.ratios and not row.ratios[method][0] <= WITHIN]
    return row


def _add_live(bench: Bench, case: Fault, row: Row) -> None:
    """Do the same over DDS; the order in which topics come is left to it."""
    from test.support.fault_live import live, WAIT
    settings = bench.method(METHODS[0], WAIT)
    messages = case.edit(bench.recording, case.span(bench.recording))
    expected, usual = replayed(messages, settings), bench.usual(settings)
    outcome = live(messages, bench, expected)
    row.ratios['live'] = bench.ratio(outcome, usual)
    row.same = outcome.steps == expected.steps
    row.wrong += _wrong('live', outcome, Outcome())
    if case.settled and not row.same:
        shed = sum(count for name, count in outcome.rejected.items()
                   if name.endswith('.overload'))
        row.wrong.append('live differs' + (f': {shed} fixes left out, overload' if shed else ''))
    said = [*outcome.warnings, *expected.beyond(usual, case.span(bench.recording))[1]]
    # with so long a max_wait some faults change nothing, and there is nothing to say
    if expected.steps != usual.steps and not _is_said(case, outcome.rejected, said):
        row.wrong.append('not said live')


def _wrong(run: str, outcome: Outcome, usual: Outcome) -> list[str]:
    wrong = [f'{run} failed: {outcome.failed}'] if outcome.failed else []
    return wrong + ([f'{run}: {outcome.not_finite} not finite']
                    if outcome.not_finite > usual.not_finite else [])


def _is_said(case: Fault, refused: Iterable[str], said: Iterable[str]) -> bool:
    return re.search(case.says, '\n'.join([*refused, *said])) is not None


@cache
def _bench(name: str, logs: Path | None) -> Bench:
    if name == 'tank':
        assert logs is not None
        return tank(logs)
    return simulated(160.0, 40.0) if name == 'short' else simulated()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('logs', nargs='?', type=Path, help='folder of the tank recordings')
    parser.add_argument('--live', action='store_true', help='over DDS as well')
    parser.add_argument('--only', default='', metavar='NAME', help='faults with this in the name')
    parser.add_argument('--workers', type=int, metavar='N', help='processes; default: one per '
                        'core, but a live run mostly waits')
    given = parser.parse_args()
    os.environ['OPENBLAS_NUM_THREADS'] = '1'  # one process per core is enough
    print('\n'.join(_head()), flush=True)
    with ProcessPoolExecutor(given.workers, mp_context=get_context('spawn')) as pool:
        for name in ('simulated', 'tank') if given.logs else ('simulated',):
            recording = _bench(name, given.logs).recording
            fitting = [fault for fault in BY_NAME.values()
                       if given.only in fault.name and fault.fits(recording)]
            rows, live = {}, given.live and name == 'simulated'
            for row in pool.map(partial(work, name, given.logs, live),
                                [fault.name for fault in fitting]):
                rows[row.fault] = row
                print(f'{name:10} {row.fault:32} {"; ".join(row.wrong) or "ok"}',
                      file=sys.stderr, flush=True)
            print('\n'.join(_tables(name, rows, live)), flush=True)


def _head() -> list[str]:
    """Return what stands above the tables: what is done, and what each fault is."""
    lines = INTRODUCTION.format(within=round(100 * (WITHIN - 1.0))).splitlines()
    for group, faults in FAULTS.items():
        lines += ['', f'**{group}**', '', '| fault | what is done | for [s] |',
                  '| --- | --- | --- |']
        lines += [f'| {fault.name} | {fault.what} | '
                  + (f'{fault.duration:g}' if isfinite(fault.duration) else 'the rest')
                  + ' |' for fault in faults]
    return lines


def _tables(name: str, rows: dict[str, Row], over_dds: bool) -> list[str]:
    failed = [row for row in rows.values() if row.wrong]
    lines = ['', f'### {TITLES[name]}', '', f'{len(rows)} faults, {len(rows) - len(failed)} as '
             'asked.']
    for group, faults in FAULTS.items():
        own = [rows[fault.name] for fault in faults if fault.name in rows]
        if own:
            columns = ['fault', 'refused', 'said', *(f'mae, {m}' for m in METHODS), 'truth',
                       *(['mae, live', 'live is replay'] if over_dds else []), 'not as asked']
            lines += ['', f'**{group}**', '', f'| {" | ".join(columns)} |',
                      '| --- ' * len(columns) + '|', *(_line(row, over_dds) for row in own)]
    return lines


def _line(row: Row, over_dds: bool) -> str:
    said = [without_numbers(text) for text in row.said]
    cells = [row.fault, ', '.join(f'{name} {count}' for name, count in row.refused.items()),
             '; '.join(said[:SHOWN]) + (f'; and {len(said) - SHOWN} more'
                                        if len(said) > SHOWN else '')]
    cells += [_ratio(row.ratios[method]) for method in METHODS]
    cells.append(f'{100 * row.off:.2f} %' if isfinite(row.off) else '')
    if over_dds:
        cells += [_ratio(row.ratios['live']), 'yes' if row.same else 'no']
    return f'| {" | ".join([*cells, "; ".join(row.wrong)])} |'


def _ratio(found: tuple[float, str]) -> str:
    return f'{found[0]:.2f} {found[1]}'


TITLES = {'simulated': 'Simulated log', 'tank': 'Tank recording'}

INTRODUCTION = """\
Each fault is put into the messages of a log, which is written to a file and replayed with the
shipped settings. The log goes on undisturbed when the fault has cleared; what the model is worth
in the end is the paper's score on another log.

* refused: input and reason with counts, beyond those of the undisturbed log
* said: warnings, and what the status says while the fault is on and 10 s longer, that it does
  not say of the undisturbed log; # stands for a number
* mae: the largest ratio, over the degrees of freedom, of a model's mae to that of the model from
  the undisturbed log. Asked of the shipped method, ekf: at most {within} % more. aid beside it;
  it is not asked.
* truth: the error of ekf's model against the true one, in parts of the mean speed, the largest
  over the degrees of freedom; the mae above is mostly the noise of the fixes
* live is replay: every step over DDS has the bits of a replay. Live, `max_wait` is 5 s, because
  DDS keeps no order between topics, and the simulated log is shorter, so the mae can differ from
  the other one. Where the time or the order of arrival decides, it need not be the same.
* not as asked: a crash, a number that is not finite, a model that did not recover, a fault that
  matters and of which the node said nothing that tells it

The model explains some 60 % of the motion in the tank, and the status says so with and without a
fault: there, what changes the thrust alone for 20 s does not stand out."""


if __name__ == '__main__':
    main()
