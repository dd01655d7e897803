"""A parameter file by itself: does it hold together, and can it be what was meant."""

from __future__ import annotations

import os
from pathlib import Path
import re
import tempfile

from rovid_core.model.dofs import DOFS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.commands.check.findings import Findings
from rovid_ros.config.input_topics import inputs_of, section
from rovid_ros.config.parameter_file import ParameterFileError, read
from rovid_ros.config.parameters import check, settings_from
from rovid_ros.files.state_file import is_record, load as load_checkpoint
from rovid_ros.messages.convert import Converter
from rovid_ros.messages.field_paths import FieldError
from rovid_ros.messages.types import build, standard_types

TOPIC = re.compile(r'(~/|/)?([A-Za-z_{}]\w*\}?/)*[A-Za-z_{}]\w*\}?', re.ASCII)
"""A topic as ROS takes it."""


def read_settings(path: Path, findings: Findings) -> Settings | None:
    """
    Read a parameter file and say everything that is wrong with it.

    Parameters
    ----------
    path : Path
        The file.
    findings : Findings
        Told every key that cannot work; all of those that are wrong by themselves, then the
        first contradiction between them.

    Returns
    -------
    settings : Settings or None
        None if they cannot work.

    """
    try:
        entries = read(path)
    except ParameterFileError as error:
        subject, _, text = str(error).partition(': ')
        findings.error(subject, text)
        return None
    wrong = False
    for key, entry in entries.items():
        try:
            check({key: entry.value})
        except SettingsError as error:
            wrong = True
            findings.error(f'{path}:{entry.line}', str(error))
    if wrong:
        return None
    try:
        settings = settings_from({key: entry.value for key, entry in entries.items()})
        Converter(settings, lambda name, reason: None)
    except SettingsError as error:
        at = entries.get(error.key)
        findings.error(f'{path}:{at.line}' if at else str(path), str(error))
        return None
    findings.ok(str(path), f'{len(entries)} keys')
    return settings


def check_settings(settings: Settings, findings: Findings, *, installed: bool | None) -> None:
    """
    Look for what a parameter file allows but cannot be meant.

    Parameters
    ----------
    settings : Settings
        The run.
    findings : Findings
        Told what is found.
    installed : bool or None
        Whether ROS is here to import message types; None leaves topics and types to others,
        who have a log or a graph.

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
    if type_name in standard_types().fielddefs:
        blank = build(standard_types(), type_name, {})
    if installed:
        from rovid_ros.node.transport.message_classes import import_type, MessageTypeError
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
    import numpy as np
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
    rows = forces[[DOFS.index(dof) for dof in settings.dofs]]
    idle = [dof for dof, row in zip(settings.dofs, rows) if not row.any()]
    for dof in idle:
        findings.error('thrusters.allocation', f'no thruster drives {dof}',
                       f'give the row of {dof}, or take it out of dofs')
    rank = int(np.linalg.matrix_rank(rows))
    if not idle and rank < len(rows):
        findings.warning(
            'thrusters.allocation', f'{", ".join(settings.dofs)} cannot be driven independently '
            f'(rank {rank} of {len(rows)})', 'their data will be alike; check the signs')
    elif not idle:
        findings.ok('thrusters.allocation', f'{len(gains)} thrusters drive {len(rows)} degrees '
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
            findings.warning('checkpoint.path', str(error), 'the node will start from the '
                             'initial values and keep that file under another name')


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
