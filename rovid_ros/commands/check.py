"""
``rovid check``: a parameter file by itself, against a log, or against the live ROS graph.

What the data of the log or of the graph say is judged in ``check_data``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
import os
from pathlib import Path
import re
import tempfile
from typing import Any

import numpy as np
from rovid_core.model.dofs import DOFS, LINEAR_DOFS, PHYSICAL
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Scales, Settings, SettingsError
from rovid_ros.commands.arguments import (
    add_json,
    add_logs,
    add_params_file,
    add_part,
    AddToSource,
    positive,
)
from rovid_ros.commands.check_data import check_data, ERROR, Findings, Observation
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    print_written,
    printing,
    source_of,
    UsageError,
)
from rovid_ros.config.parameter_file import ParameterFileError, ParameterSource
from rovid_ros.config.parameters import (
    check as check_values,
    inputs_of,
    section,
    settings_from,
    topics_of,
)
from rovid_ros.discovery.candidates import FAST
from rovid_ros.files.state_file import DamagedStateError, is_record, load as load_checkpoint
from rovid_ros.files.whole_files import before, write_json
from rovid_ros.logs.container import LogError
from rovid_ros.logs.dataflash import PACKAGE as DATAFLASH
from rovid_ros.logs.log import Log
from rovid_ros.logs.static_frames import TOPIC as TF_STATIC, values_in_logs
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.field_paths import FieldError, nearest
from rovid_ros.messages.types import build, normalised, standard_types
from rovid_ros.results.text import NO_NEWTONS, NONE, number, table, unit

DESCRIPTION = (
    'By itself; with logs, against what they hold and what the pipe would make of it; with '
    '--live, against the ROS graph and what comes in some seconds. Prints how the file is '
    'read, then a line for each finding: OK, WARNING or ERROR. Exits with 1 if there is an '
    'ERROR.')

# A topic as ROS takes it.
TOPIC = re.compile(r'(~/|/)?([A-Za-z_{}]\w*\}?/)*[A-Za-z_{}]\w*\}?', re.ASCII)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid check`` takes."""
    command.add_argument('params_file', type=Path, metavar='FILE', action=AddToSource,
                         help="the vehicle's parameter file, the same as the node's")
    add_params_file(command, required=False)
    add_logs(command, '*')
    command.add_argument('--live', action='store_true', help='against the ROS graph')
    command.add_argument('--timeout', type=positive, metavar='S',
                         help='with --live: listen for S seconds (default: 5)')
    command.add_argument('--namespace', default='', metavar='NS',
                         help='with --live: of the node; relative topics are in it')
    add_json(command, 'findings')
    add_part(command)
    command.set_defaults(start=None)  # to tell whether it was given


def run(args: argparse.Namespace) -> None:
    """Run ``rovid check``."""
    if args.live and args.logs:
        raise UsageError('--live and a LOG exclude each other')
    for name in ('timeout', 'namespace'):
        if getattr(args, name) and not args.live:
            raise UsageError(f'--{name} goes with --live')
    for name in ('start', 'duration'):
        if getattr(args, name) is not None and not args.logs:
            raise UsageError(f'--{name} goes with a LOG')
    check_written([args.json], [*args.logs, *args.params_file.paths])
    outcome = check(args.params_file, args.logs, start=args.start or 0.0, duration=args.duration,
                    live=args.live, timeout=args.timeout or 5.0, namespace=args.namespace)
    with printing(outcome.text):
        if args.json:
            write_json(args.json, outcome.document)
    print_written(args.json)
    if outcome.errors:
        raise CommandError(f'{args.params_file.files}: {outcome.verdict}')
    print(outcome.verdict)


@dataclass(frozen=True)
class Outcome:
    """What to print, the number of errors, all in one line, and what ``--json`` writes."""

    text: str
    errors: int
    verdict: str
    document: dict[str, Any]


def check(path: Path | ParameterSource, logs: Sequence[Path] = (), *, start: float = 0.0,
          duration: float | None = None, live: bool = False, timeout: float = 5.0,
          namespace: str = '') -> Outcome:
    """
    Check parameter files.

    Parameters
    ----------
    path : Path or ParameterSource
        The file, or the files and what wins over them.
    logs : sequence of Path
        Logs to check it against, joined in time order.
    start, duration : float
        Part of the logs to use [s].
    live : bool
        Whether to check it against the ROS graph instead.
    timeout : float
        How long to listen there [s].
    namespace : str
        Of the node there; relative topics are in it.

    Raises
    ------
    CommandError
        If the live graph is asked for where there is no ROS.

    """
    findings, source = Findings(), source_of(path)
    settings = _read_settings(source, findings)
    seen: Observation | None = None
    if settings is not None:
        alone = not live and not logs
        _check_settings(settings, findings, find_spec('rclpy') is not None if alone else None)
        if live:
            seen = _check_live(source, settings, findings, timeout, namespace)
        elif logs:
            seen = _check_log(source, settings, findings, logs, start, duration)
    return Outcome(
        _text(source.files, settings, findings), findings.count(ERROR), findings.verdict(), {
            'file': source.files, 'logs': [str(log) for log in logs], 'live': live,
            'errors': findings.count(ERROR), 'findings': findings.document(),
            **(seen.document() if seen else {})})


def _read_settings(source: ParameterSource, findings: Findings) -> Settings | None:
    """
    Read parameter files; return None if they cannot work.

    All keys that are wrong by themselves are told, then the first contradiction between keys.
    """
    try:
        values = source.values()
    except ParameterFileError as error:
        subject, _, text = str(error).partition(': ')
        findings.error(subject, text)
        return None
    wrong = False
    for key, value in values.items():
        try:
            check_values({key: value})
        except SettingsError as error:
            wrong = True
            findings.error(source.place_of(key), str(error))
    if wrong:
        return None
    try:
        settings = settings_from(values)
        Converter(settings, lambda name, reason: None)
    except SettingsError as error:
        findings.error(source.place_of(error.key), str(error))
        return None
    findings.ok(source.files, f'{len(values)} keys')
    return settings


def _check_settings(settings: Settings, findings: Findings, installed: bool | None) -> None:
    """
    Look for what a parameter file allows but cannot be meant.

    ``installed`` tells whether ROS is here to import message types; None leaves topics and types
    to the check against a log or a graph.
    """
    if installed is not None:
        _check_topics(settings, findings, installed)
    _check_thrusters(settings, findings)
    for dof in settings.dofs:
        known = settings.dof[dof]
        if known.dry_mass > known.mass:
            findings.warning(
                f'{dof}.initial.mass', f'is {known.mass:g}, less than dry_mass {known.dry_mass:g}',
                'an effective mass has the added mass of the water in it')
        if dof in LINEAR_DOFS and known.typical_velocity > FAST:
            findings.warning(
                f'{dof}.typical.velocity', f'is {known.typical_velocity:g} m/s',
                'is what measures it in metres? A depth has depth.scale for that')
    if settings.reference.topic and settings.reference.topic == settings.velocity.topic:
        findings.warning('reference.topic', 'is velocity.topic: the score is against what was '
                         'identified from', 'give another source, or none')
    for line in Stream(settings).take_warnings():
        findings.warning('dofs', line)
    _check_files(settings, findings)


def _check_topics(settings: Settings, findings: Findings, installed: bool) -> None:
    """Check names, types and field paths without any message."""
    converter = Converter(settings, lambda name, reason: None)
    for topic, type_name in converter.topics.items():
        names = inputs_of(settings, topic)
        key = section(names[0])
        if not TOPIC.fullmatch(topic):
            findings.error(f'{key}.topic', f'{topic!r} is no name of a ROS topic',
                           'the node refuses it; only letters, digits, _ and single / between')
        if not type_name:
            findings.warning(f'{key}.type', 'is not given',
                             'a log knows its own; the node needs it to subscribe')
            continue
        if _check_type(converter, topic, type_name, f'{key}.type', findings, installed):
            findings.ok(' and '.join(names), f'{topic} {type_name}')


def _check_type(converter: Converter, topic: str, type_name: str, key: str,
                findings: Findings, installed: bool) -> bool:
    """Check a type and the field paths into it; return whether all is well."""
    blank = None
    if type_name.startswith(f'{DATAFLASH}/'):  # no ROS type, and none to be installed
        return True
    if type_name in standard_types().fielddefs:
        blank = build(standard_types(), type_name, {})
    if installed:
        from rovid_ros.node.transport.message_types import import_type, MessageTypeError
        try:
            blank = import_type(type_name)()
        except MessageTypeError as error:
            findings.warning(key, str(error), 'rovid replay does without: a log has its own')
    elif blank is None:
        findings.warning(key, f'{type_name} is not among the types that come with ROS 2, so its '
                              'fields cannot be checked', 'check against a log of it')
    if blank is None:
        return False
    try:
        converter.check_type(topic, blank)
    except FieldError as error:
        findings.error(error.key, str(error).partition(': ')[2])
        return False
    return True


def _check_thrusters(settings: Settings, findings: Findings) -> None:
    """Check that every DOF is driven, by itself, and that every thruster drives something."""
    thrusters = settings.thrusters
    gains = np.array(thrusters.gain)
    forces = np.array(thrusters.allocation) * gains
    names = [f'thruster {i + 1}' + (f' ({thrusters.names[i]})' if thrusters.names else '')
             for i in range(len(gains))]
    for name, gain, column in zip(names, gains, np.array(thrusters.allocation).T):
        if not gain:
            findings.warning('thrusters.gain', f'of {name} is 0: it never pushes',
                             'give its N per command, or leave the thruster out')
        elif not column.any():
            findings.warning('thrusters.allocation', f'has only zeros for {name}',
                             'give its direction and position')
    rows = {dof: forces[DOFS.index(dof)] for dof in settings.dofs}
    driven = [dof for dof, row in rows.items() if row.any()]
    lost = False
    for dof in [dof for dof in rows if dof not in driven]:
        other = {'surge': 'sway', 'sway': 'surge'}.get(dof)
        if other in driven:
            findings.warning('thrusters.allocation', f'no thruster drives {dof}', 'right if it '
                             f'only drifts: {other} takes its velocity from there')
        else:
            lost = True
            findings.error('thrusters.allocation', f'no thruster drives {dof}',
                           f'give the row of {dof}, or take it out of dofs')
    if lost:
        return
    rank = int(np.linalg.matrix_rank([rows[dof] for dof in driven]))
    if rank < len(driven):
        findings.warning(
            'thrusters.allocation', f'{", ".join(driven)} cannot be driven independently '
            f'(rank {rank} of {len(driven)})', 'their data will be alike; check the signs')
    else:
        findings.ok('thrusters.allocation', f'{len(gains)} thrusters drive {len(driven)} degrees '
                    f'of freedom independently (rank {rank})')


def _check_files(settings: Settings, findings: Findings) -> None:
    paths = {'record.path': settings.record_path, 'checkpoint.path': settings.checkpoint_path}
    for key, text in paths.items():
        if not text:
            continue
        problem = unwritable(Path(text))
        if problem:
            findings.error(key, f'{text} cannot be written: {problem}')
        else:
            findings.ok(key, f'{text} can be written')
    if is_record(settings):
        findings.error('checkpoint.path', 'is record.path', 'give another name')
    elif settings.checkpoint_path and Path(settings.checkpoint_path).is_file():
        try:
            load_checkpoint(Path(settings.checkpoint_path), settings)
        except ValueError as error:
            older = before(Path(settings.checkpoint_path))
            findings.warning('checkpoint.path', str(error), 'the node will start from ' + (
                f'{older}' if isinstance(error, DamagedStateError) and older.exists()
                else 'the initial values') + ' and keep that file under another name')


def unwritable(path: Path) -> str:
    """Return why a file could not be written, '' if it could; nothing is made or changed."""
    if path.exists():
        if not path.is_file():
            return 'it is a directory' if path.is_dir() else 'it is not a regular file'
        return '' if os.access(path, os.W_OK) else 'no permission'
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if not folder.is_dir():
        return f'{folder} is not a directory'
    try:
        tempfile.TemporaryFile(dir=folder).close()  # permissions alone do not tell
    except OSError as error:
        return f'{folder}: {error.strerror or error}'
    return ''


def _with_found(source: ParameterSource, settings: Settings, findings: Findings,
                look_up: Callable[[Settings], Mapping[str, Any]]) -> Settings:
    """Return the settings with what is looked up in /tf_static, and tell it."""
    try:
        found = look_up(settings)
        settings = settings_from({**source.values(), **found})
    except SettingsError as error:
        findings.error(error.key, str(error).partition(': ')[2])
    else:
        for key, value in found.items():
            findings.ok(key, f'{", ".join(map(number, value))} from {TF_STATIC}')
    return settings


def _check_log(source: ParameterSource, settings: Settings, findings: Findings,
               logs: Sequence[Path], start: float, duration: float | None) -> Observation | None:
    """Read a log and say how it fits; return None if it cannot be read."""
    try:
        settings = _with_found(source, settings, findings,
                               lambda settings: values_in_logs(settings, logs))
        with Log(logs) as log:
            seen = Observation(settings, all_at_hand=True)
            topics = _readable_topics(log, seen.converter, settings, findings)
            with Progress('check', lambda: log.progress) as progress:
                for message in log.messages(topics, start, duration):
                    seen.add_message(topics[message.topic], message.data, message.time)
                    progress.tick()
            seen.finish()
            for line in log.warnings:
                findings.warning('log', line)
    except (LogError, FieldError) as error:
        findings.error('log', str(error))
        return None
    check_data(seen, findings)
    return seen


def _readable_topics(log: Log, converter: Converter, settings: Settings,
                     findings: Findings) -> dict[str, str]:
    """Return the topics that can be read: the log's name to the configured one."""
    there = sorted(name for name, info in log.topics.items() if info.count != 0)
    readable = {}
    for topic, type_name in converter.topics.items():
        name = f'/{topic.lstrip("/")}'
        inputs = inputs_of(settings, topic)
        key = section(inputs[0])
        if name not in there:
            report = findings.warning if inputs == ['reference'] else findings.error
            report(f'{key}.topic', f'no messages on {name}{_hint(log, name, type_name, there)}',
                   f'the log has {", ".join(there[:12])}{" ..." if len(there) > 12 else ""}')
            continue
        found = log.topics[name]
        if type_name and normalised(type_name) != found.type:
            findings.error(f'{key}.type', f'{name} is {found.type}, not {type_name}',
                           f'write {found.type}, and a field path that it has')
            continue
        try:
            converter.check_type(topic, log.blank(name))
        except FieldError as error:
            findings.error(error.key, str(error).partition(': ')[2])
            continue
        except LogError as error:
            findings.error(name, str(error))
            continue
        findings.ok(' and '.join(inputs), f'{name} {found.type}')
        readable[name] = topic
    return readable


def _hint(log: Log, name: str, type_name: str, there: Sequence[str]) -> str:
    """Return a topic that could be meant: best one of the same type."""
    same = [other for other in there if log.topics[other].type == normalised(type_name)]
    return nearest(name, same) or nearest(name, there) or (
        f'; {same[0]} has that type' if len(same) == 1 else '')


def _check_live(source: ParameterSource, settings: Settings, findings: Findings, timeout: float,
                namespace: str) -> Observation:
    """Listen to the graph and say how it fits."""
    try:
        from rovid_ros.node.live_check import LiveCheck
    except ImportError as error:
        raise CommandError(
            f'--live needs ROS 2, which is not installed here: {error}') from None
    try:
        live = LiveCheck(partial(_with_found, source, settings, findings), findings, namespace)
    except (RuntimeError, ValueError) as error:  # of rcl: an impossible domain or namespace
        raise CommandError(f'--live: {str(error).splitlines()[0]}') from None
    try:
        return live.run(timeout)
    finally:
        live.close()


def _text(files: str, settings: Settings | None, findings: Findings) -> str:
    """Return the tables of the settings, if there are any, and a line for each finding."""
    parts = [] if settings is None else [
        f'{files}: {settings.identifier.method}, frames {settings.frames}', _input_table(settings),
        _dof_table(settings), _thruster_table(settings)]
    if settings is not None and not settings.thrusters.newtons:
        parts.append(f'{NO_NEWTONS}.')
    return '\n\n'.join([*parts, '\n'.join(map(str, findings.all))])


def _input_table(settings: Settings) -> str:
    rows = [['input', 'topic', 'type', 'field', 'drives']]
    for name in settings.used_inputs():
        given = settings.thrusters if name == 'thrusters' else settings.input(name)
        topics = topics_of(settings, name)
        dofs = [dof for dof in settings.dofs if name in settings.needs(dof)]
        drives = 'the score' if name == 'reference' else ', '.join(dofs) or '-'
        rows.append([section(name), topics[0] + (f' and {len(topics) - 1} more' if topics[1:]
                                                 else ''),
                     given.type or "(the log's)", given.field or '(all)', drives])
    return table(rows, left=5)


def _dof_table(settings: Settings) -> str:
    coupled = any(map(settings.couplings, settings.dofs))
    newtons = settings.thrusters.newtons
    rows = [['', 'velocity from', *(name.replace('_', ' ') for name in PHYSICAL),
             'typical force', 'typical velocity', *(['couplings'] if coupled else [])]]
    for dof in settings.dofs:
        known, scales = settings.dof[dof], Scales.of(settings.dof[dof])
        rows.append([
            dof, settings.source(dof),
            *(f'{number(getattr(known, name))} {unit(dof, name, newtons)}' for name in PHYSICAL),
            f'{number(scales.force)} {unit(dof, "bias", newtons)}',
            f'{number(scales.velocity)} {unit(dof, "mae")}',
            *([' '.join(settings.couplings(dof)) or NONE] if coupled else [])])
    return table(rows, left=2)


def _thruster_table(settings: Settings) -> str:
    thrusters = settings.thrusters
    rows = [['thruster', 'gain', *DOFS]]
    for i, gain in enumerate(thrusters.gain):
        name = thrusters.names[i] if thrusters.names else str(i + 1)
        rows.append([name, number(gain), *(f'{row[i]:g}' for row in thrusters.allocation)])
    return table(rows)
