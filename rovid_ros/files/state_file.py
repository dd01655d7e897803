"""The file that an identification goes on from after a restart."""

from __future__ import annotations

from collections.abc import Mapping
import json
import os
from pathlib import Path
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.config.fingerprint import decides_parameters, difference, fingerprint
from rovid_ros.files.whole_files import write_json

VERSION = 2


class CheckpointError(ValueError):
    """A checkpoint that cannot be gone on from; the text says which file and why."""


def is_record(settings: Settings) -> bool:
    """Tell whether ``checkpoint.path`` and ``record.path`` are one file."""
    record, checkpoint = settings.record_path, settings.checkpoint_path
    return bool(record and checkpoint) and os.path.realpath(record) == os.path.realpath(checkpoint)


def save(path: Path, settings: Settings, state: Mapping[str, Any]) -> None:
    """
    Write the state; at every moment the file is the old or the new one, whole.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    content = {'rovid_checkpoint': VERSION,
               'settings': fingerprint(settings, decides_parameters), 'state': state}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, content, indent=1)


def load(path: Path, settings: Settings) -> dict[str, Any]:
    """
    Return the state that :func:`save` wrote.

    Raises
    ------
    CheckpointError
        If the file cannot be read or belongs to settings with which its parameters mean
        something else; it names the key.

    """
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError, RecursionError) as error:
        raise CheckpointError(f'{path}: {error}') from None
    if not isinstance(content, dict) or 'rovid_checkpoint' not in content:
        raise CheckpointError(f'{path}: is not a checkpoint')
    if content['rovid_checkpoint'] != VERSION:
        raise CheckpointError(
            f'{path}: has version {content["rovid_checkpoint"]}, this program reads {VERSION}')
    differs = difference(content.get('settings'), fingerprint(settings, decides_parameters))
    if differs:
        raise CheckpointError(f'{path}: {differs}')
    state = content.get('state')
    if not isinstance(state, dict):
        raise CheckpointError(f'{path}: has no state')
    return state
