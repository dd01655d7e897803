"""``rovid tune``: better settings from a log, and what they gain."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
import math
from pathlib import Path
import shlex
import textwrap
from typing import Any

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.trials.record import LogWater
from rovid_core.trials.tuning.cross_validation import Result
from rovid_core.trials.tuning.likelihood import Prediction, PredictionErrors
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import reading_settings, TuningError
from rovid_core.trials.tuning.tune import tune, Tuned
from rovid_ros.commands.arguments import add_json, add_logs, add_params_file, add_part
from rovid_ros.commands.long_work import in_parallel, Progress
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
from rovid_ros.config.keys import KEYS
from rovid_ros.config.parameter_file import edited, override
from rovid_ros.files.whole_files import write_json, write_text
from rovid_ros.logs.log import LogMessage
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.messages.converter import Converter
from rovid_ros.results.documents import json_number, json_numbers
from rovid_ros.results.text import NONE, number, table, unit

DESCRIPTION = (
    'Tries them on blocks of the log that the model was not identified from, and writes a '
    'parameter file with what clearly predicts better; the rest of the file stays as it is.')

ENOUGH = 300.0  # [s] of a log that the filter predicts with each of about twenty thrusters

_STAYS = 'stays'


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid tune`` takes."""
    add_params_file(command)
    add_logs(command)
    command.add_argument('--output', type=Path, required=True, metavar='TUNED.yaml',
                         help='parameter file to write')
    add_json(command, 'result')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid tune``."""
    source = args.params_file
    check_written([args.output, args.json], [*args.logs, *args.params_file.paths])
    settings = read_settings(args.params_file, logs=args.logs)
    with located_errors(args.params_file):
        tuned = tune_logs(args.logs, settings, start=args.start, duration=args.duration,
                          warn=partial(warn, args.prog))
    changes = tuned.changes()
    with printing(tuned_text(tuned)):
        write_text(args.output, edited(source.paths[-1], changes))
        read_settings(replace(source, paths=(*source.paths[:-1], args.output)))
        if args.json:
            write_json(args.json, tuned_document(tuned))
    wins = [rule for rule in source.overrides if changes.keys() & override(rule)]
    for rule in wins:
        warn(args.prog, f'-p {rule} wins over what {args.output} says: leave it out')
    print_written(args.output, args.json)
    found = replace(source, paths=(*source.paths[:-1], args.output), overrides=tuple(
        [rule for rule in source.overrides if rule not in wins]))
    print(f'next      rovid replay {shlex.join([*map(str, args.logs), *found.arguments])}')


class AnewPlayer(PipelinePlayer):
    """The pipeline, which leaves out what a recorded node did with its identifier."""

    def restore(self, state: Mapping[str, Any]) -> str:
        """Begin anew: the state of an identifier is of no use here."""
        return ''

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        """Do a control again only if it is about time."""
        return super().repeat_control(name, value) if name in ('time_jump', 'interrupt') else []


class TuningPlayer(AnewPlayer):
    """The pipeline, which keeps what is needed to predict the log with other settings."""

    def __init__(self, settings: Settings, water: LogWater | None = None) -> None:
        self.scores = self.log = TuningLog(settings, water)
        self.stream = Stream(settings, recorder=self.log, scorer=self.log,
                             water=None if water is None else water.at)
        self.converter = Converter(settings, self.stream.reject)


class PredictingPlayer(AnewPlayer):
    """The pipeline with the filter, of which it notes how well it predicts."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.errors = PredictionErrors(self.stream)

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Add the next message, and note what comes of it."""
        estimates = super().add_message(message)
        if estimates:
            self.errors.note(estimates[-1].time)
        return estimates


def tune_logs(logs: Sequence[Path], settings: Settings, *, start: float = 0.0,
              duration: float | None = None,
              warn: Callable[[str], None] = lambda line: None) -> Tuned:
    """
    Read logs with ``replay``, and tune with them; CommandError if they tell nothing.

    Where a current shows, they are read once before, by the method that estimates it.
    """
    # by heading offset: a latency hardly moves what goes on for minutes
    found: dict[float, LogWater] = {}

    def read(tried: Settings) -> TuningLog:
        if tried.sees_current and tried.yaw_offset not in found:
            # the others tell nothing of it
            plane = tuple([dof for dof in tried.dofs if dof in ('surge', 'sway')])
            first = replace(tried, dofs=plane, identifier=IdentifierSettings('ekf'))
            finder = TuningPlayer(first)
            replay(logs, first, finder, start=start, duration=duration)
            found[tried.yaw_offset] = finder.log.water
        read_with = reading_settings(tried)
        player = TuningPlayer(read_with, found.get(tried.yaw_offset))
        # typical sizes are found here, so that warnings about them would be out of place, as are
        # those about what is only tried
        try:
            replay(logs, read_with, player, start=start, duration=duration, warn=lambda line: (
                None if tried is not settings or line.startswith('typical sizes')
                else warn(line)))
        except CommandError as error:
            if tried is settings:
                raise
            raise TuningError(str(error)) from None
        return player.log

    def predict(tried: Settings) -> Prediction:
        filtered = replace(tried, identifier=IdentifierSettings('ekf'))
        player = PredictingPlayer(filtered)
        with suppress(CommandError):  # with some thrusters nothing can be made of a log
            replay(logs, filtered, player, start=start,
                   duration=ENOUGH if duration is None else min(ENOUGH, duration))
        return player.errors.prediction()

    share = 0.0
    with Progress('tune', lambda: share) as progress:
        def show(done: float) -> None:
            nonlocal share
            share = done
            progress.tick()

        def each(work: Callable[[int], Result], given: Sequence[int]) -> list[Result]:
            return in_parallel(work, given, lambda count: progress.tick())

        try:
            return tune(read, settings, show, each, predict)
        except TuningError as error:
            raise CommandError(f'{", ".join(map(str, logs))}: {error}') from None


def tuned_text(tuned: Tuned) -> str:
    """Return what ``rovid tune`` prints."""
    errors = [['mae', 'before', 'after', '']]
    errors += [[dof, *map(number, pair), unit(dof, 'mae')] for dof, pair in tuned.errors.items()]
    return '\n\n'.join([
        table(_keys(tuned)), _notes(tuned), table(errors),
        'mae = mean |v_sim - v| on blocks of the log that the model was not identified from, by\n'
        'output error; better: by how much it falls there. as good: values that predict as well.\n'
        'A replay has the fit of its own method on all of the log: a bias that hardly shows can\n'
        'lower it although the rest is better. rovid compare has both.'])


def _keys(tuned: Tuned) -> list[list[str]]:
    rows = [['', 'before', 'after', 'as good']]
    for stage in tuned.stages:
        for key, change in stage.keys.items():
            after = _value(change.after) if change.after != change.before else _STAYS
            known = math.isfinite(change.low) and change.low < change.high
            rows.append([_with_unit(key), _value(change.before), after,
                         f'{number(change.low)} .. {number(change.high)}' if known else NONE])
    for names in tuned.lists:
        after = ' '.join(names.after) if names.after != names.before else _STAYS
        rows.append([names.key, ' '.join(names.before) or 'none', after, NONE])
    return rows


def _value(value: float) -> str:
    return str(value).lower() if isinstance(value, bool) else number(value)


def _with_unit(key: str) -> str:
    found = [one.unit for one in KEYS if one.name == key and one.unit]
    return f'{key} [{found[0]}]' if found else key


def _notes(tuned: Tuned) -> str:
    """Return what has changed with its gain, and what has not in one line."""
    better: list[tuple[float, str]] = []
    stay: list[str] = []
    told: list[str] = []
    for stage in tuned.stages:
        changes = stage.changes
        if changes:
            better.append((stage.gain, f'{" and ".join(changes)}: '
                           f'{_percent(stage.gain, stage.spread)} better'))
        stay += [key for key in stage.keys if key not in changes]
        if stage.note:
            told.append(stage.note)
    for names in tuned.lists:
        if names.after == names.before:
            stay.append(names.key)
        else:
            better.append((names.gain, f'{names.key}: '
                           f'{_percent(names.gain, names.spread)} better'))
    lines = [line for _, line in sorted(better, reverse=True)]
    if stay:
        what = 'nothing else is' if better else 'nothing is'
        lines.append(f'{what} clearly better, so these stay: {", ".join(stay)}')
    lines += told
    lines += [f'{dof}: left out: {why}; what is shared by all DOFs changes for it too'
              for dof, why in tuned.left_out.items()]
    return '\n'.join(textwrap.fill(line, 99, subsequent_indent='  ') for line in lines)


def _percent(gain: float, spread: float) -> str:
    return f'{100.0 * gain:.1f} ± {100.0 * spread:.1f} %'


def tuned_document(tuned: Tuned) -> dict[str, Any]:
    """Return what ``--json`` writes."""
    keys: dict[str, Any] = {
        key: {'before': change.before, 'after': change.after, 'low': json_number(change.low),
              'high': json_number(change.high), 'gain': stage.gain, 'spread': stage.spread}
        for stage in tuned.stages for key, change in stage.keys.items()}
    for names in tuned.lists:
        keys[names.key] = {'before': names.before, 'after': names.after,
                           'gain': names.gain, 'spread': names.spread}
    return {
        'keys': keys,
        'dofs': {dof: {'output_error': json_numbers(('before', 'after'), errors)}
                 for dof, errors in tuned.errors.items()},
        'left_out': dict(tuned.left_out),
        'notes': [stage.note for stage in tuned.stages if stage.note]}
