"""``rovid tune``: better settings from a log, and what they gain."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from functools import partial
import math
from pathlib import Path
from typing import Any

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.choice import Done
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.tune import observed, Score, Stage, tune, Tuned, TuningError
from rovid_ros.commands.arguments import add_json, add_logs, add_params_file, add_part
from rovid_ros.commands.long_work import in_parallel, Progress
from rovid_ros.commands.replay import replay
from rovid_ros.commands.running import (
    check_written,
    located_errors,
    print_written,
    read_settings,
    warn,
)
from rovid_ros.config.parameter_file import edited
from rovid_ros.files.whole_files import write_json, write_text
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.messages.converter import Converter
from rovid_ros.results.text import NONE, number, table, unit

DESCRIPTION = (
    'Tries them on blocks of the log that the model was not identified from, and writes a '
    'parameter file with what clearly predicts better; the rest of the file stays as it is.')

BEFORE = 0.4
"""Share of the work before the gains."""

MODEL, IDENTIFIER = 'output error', 'aid'


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid tune`` takes."""
    add_params_file(command)
    add_logs(command)
    command.add_argument(
        '--output', type=Path, required=True, metavar='TUNED.yaml',
        help='parameter file to write')
    command.add_argument(
        '--method', default='', metavar='M',
        help="tune for this method, not the file's; gains are those of aid")
    add_json(command, 'result')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid tune``."""
    check_written([args.output, args.json], [*args.logs, args.params_file])
    settings = read_settings(args.params_file, args.method)
    with located_errors(args.params_file):
        tuned = tune_logs(args.logs, settings, start=args.start, duration=args.duration,
                          warn=partial(warn, args.prog))
    print(tuned_text(tuned))
    write_text(args.output, edited(args.params_file, tuned.changes()))
    read_settings(args.output)
    if args.json:
        write_json(args.json, tuned_document(tuned))
    print_written(args.output, args.json)


class TuneError(ValueError):
    """A log that nothing can be tuned with; the text is the line to print."""


class _Motion(Stream):
    """A stream of which the motion alone counts."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Begin anew: what an identifier held is of no use here."""

    def control(self, name: str, value: str) -> list[Estimate]:
        """Follow time alone."""
        return super().control(name, value) if name in ('time_jump', 'interrupt') else []

    def change(self, settings: Settings, told: str) -> None:
        """Stay with the settings that are tuned."""


class TuningPlayer(PipelinePlayer):
    """The pipe, which keeps what is needed to run it with other settings."""

    def __init__(self, settings: Settings) -> None:
        self.scores = self.log = TuningLog(settings)
        self.stream = _Motion(settings, recorder=self.log, scorer=self.log)
        self.converter = Converter(settings, self.stream.reject)


def tune_logs(logs: Sequence[Path], settings: Settings, *, start: float = 0.0,
              duration: float | None = None,
              warn: Callable[[str], None] = lambda line: None) -> Tuned:
    """
    Read logs once and tune with them.

    Raises
    ------
    LogError, FieldError, ReplayError, Interrupted
        As in ``replay``.
    TuneError
        If the log tells nothing.

    """
    seen = observed(settings)
    player = TuningPlayer(seen)
    ours = tuple(f'{dof}: its ' for dof in seen.dofs)  # of typical sizes, which are found here
    replay(logs, seen, player, start=start, duration=duration,
           warn=lambda line: None if line.startswith(ours) else warn(line))
    share = 0.0
    with Progress('tune', lambda: share) as progress:
        def done(now: float) -> None:
            nonlocal share
            share = now
            progress.tick()

        def each(work: Callable[[int], Done], given: Sequence[int]) -> list[Done]:
            begin = share
            left = 1.0 - begin if begin >= BEFORE else 0.0  # before, it is done soon
            return in_parallel(
                work, given, lambda count: done(begin + left * count / len(given)))

        try:
            return tune(player.log, settings, done, each)
        except TuningError as error:
            raise TuneError(f'{", ".join(map(str, logs))}: {error}') from None


def tuned_text(tuned: Tuned) -> str:
    """Return what ``rovid tune`` prints."""
    parts = [table(_keys(tuned.stages)), *_notes(tuned), table(_scores(tuned.scores), left=2),
             'mean |v_sim - v| on blocks of the log that the model was not identified from. '
             'Output error\nneeds no gains: it tells delay, lag and heading alone.']
    return '\n\n'.join(part for part in parts if part)


def _keys(stages: Sequence[Stage]) -> list[list[str]]:
    rows = [['', 'before', 'after', 'as good']]
    for stage in stages:
        for key, change in stage.keys.items():
            after = number(change.after) if change.after != change.before else 'stays'
            known = math.isfinite(change.low) and change.low < change.high
            rows.append([key, number(change.before), after,
                         f'{number(change.low)} .. {number(change.high)}' if known else NONE])
    return rows


def _notes(tuned: Tuned) -> list[str]:
    lines = []
    for stage in tuned.stages:
        names = list(stage.keys)
        what = names[0] if len(names) == 1 else f'{names[0]} to {names[-1]}' \
            if len(names) > 2 else ' and '.join(names)
        gain = f'{100.0 * stage.gain:.1f} ± {100.0 * stage.spread:.1f} % on held-out blocks'
        better = stage.gain > stage.spread
        lines.append(f'{what}: gain {gain}' + ('' if better else ': not clearly better, stay'))
        if stage.note:
            lines.append(f'  {stage.note}')
    lines += [f'{dof}: left out: {why}; what is shared by all DOFs changes for it too'
              for dof, why in tuned.left_out.items()]
    return ['\n'.join([*lines, *tuned.notes])]


def _scores(scores: Mapping[str, Score]) -> list[list[str]]:
    rows = [['', 'model', 'before', 'after', '']]
    for dof, score in scores.items():
        for name, pair in ((MODEL, score.model), (IDENTIFIER, score.identifier)):
            if pair is not None:
                rows.append([dof, name, *map(number, pair), unit(dof, 'mae')])
    return rows


def tuned_document(tuned: Tuned) -> dict[str, Any]:
    """Return what ``--json`` writes."""
    return {
        'keys': {key: {
            'before': change.before, 'after': change.after, 'low': _finite(change.low),
            'high': _finite(change.high), 'gain': stage.gain, 'spread': stage.spread}
            for stage in tuned.stages for key, change in stage.keys.items()},
        'dofs': {dof: {name: None if pair is None else
                       {'before': _finite(pair[0]), 'after': _finite(pair[1])}
                       for name, pair in (('output_error', score.model),
                                          ('aid', score.identifier))}
                 for dof, score in tuned.scores.items()},
        'left_out': dict(tuned.left_out),
        'notes': [*tuned.notes, *(stage.note for stage in tuned.stages if stage.note)]}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
