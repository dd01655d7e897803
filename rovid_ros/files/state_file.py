"""The saved state: what a node or a replay leaves behind, and another one begins from."""

from __future__ import annotations

from collections.abc import Mapping
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.config.fingerprint import difference, fingerprint
from rovid_ros.files.whole_files import write_json

VERSION = 2


class StateError(ValueError):
    """A saved state that a run cannot begin from; the text says which file and why."""


def is_record(settings: Settings) -> bool:
    """Tell whether ``checkpoint.path`` and ``record.path`` are one file."""
    record, checkpoint = settings.record_path, settings.checkpoint_path
    return bool(record and checkpoint) and os.path.realpath(record) == os.path.realpath(checkpoint)


def save(path: Path, settings: Settings, state: Mapping[str, Any]) -> None:
    """
    Write the state of a stream; at every moment the file is the old or the new one, whole.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    made_with = fingerprint(settings)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {'rovid_checkpoint': VERSION, 'settings': made_with, 'state': state,
                      'sha256': _digest(made_with, state)}, indent=1)


def load(path: Path, settings: Settings) -> dict[str, Any]:
    """
    Return the state that :func:`save` wrote.

    Raises
    ------
    StateError
        If the file cannot be read or is damaged, or if it was made with settings that give its
        parameters another meaning; then it names the key.

    """
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise StateError(f'{path}: {error.strerror or error}') from None
    except (ValueError, RecursionError) as error:
        raise StateError(f'{path}: is damaged: {error}') from None
    if not isinstance(content, dict) or 'rovid_checkpoint' not in content:
        raise StateError(f'{path}: is not a saved state')
    version, made_with, state = (
        content.get(key) for key in ('rovid_checkpoint', 'settings', 'state'))
    if version != VERSION:
        raise StateError(f'{path}: has version {version}, this program reads {VERSION}')
    # files of earlier releases have no digest
    if 'sha256' in content and content['sha256'] != _digest(made_with, state):
        raise StateError(f'{path}: is damaged: its content does not fit its digest')
    differs = difference(made_with, fingerprint(settings))
    if differs:
        raise StateError(f'{path}: {differs}')
    if not isinstance(state, dict):
        raise StateError(f'{path}: has no state')
    return state


def restore(path: Path, stream: Stream) -> dict[str, Any]:
    """
    Let a stream that is new begin from a saved state, and return that state.

    The parameters are adapted only if they were when the state was saved and the settings say so.

    Raises
    ------
    StateError
        As :func:`load`, and for values that are out of bounds; the stream stays as it was.

    """
    enabled = stream.settings.enable
    state = load(path, stream.settings)
    try:
        stream.restore(state)
    except ValueError as error:
        raise StateError(f'{path}: {error}') from None
    if stream.adapting and not enabled:
        stream.enable(False)
    return state


def _digest(made_with: object, state: object) -> str:
    return hashlib.sha256(json.dumps([made_with, state]).encode()).hexdigest()
