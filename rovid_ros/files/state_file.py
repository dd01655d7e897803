"""
The saved state: what a node or a replay leaves behind, and another one begins from.

That of a node is locked, guarded, and never lost to one that knows less.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import hashlib
import json
import os
from pathlib import Path
from threading import Thread
from typing import Any, Protocol

from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.config.keys import KEYS
from rovid_ros.files.whole_files import before, create_unused, FileLock, prepare_file, write_text

VERSION = 10

_FORCE = ('names', 'offset', 'scale', 'deadband', 'dead_zone', 'limit', 'model', 'gain', 'reverse',
          'polynomial', 'table_command', 'table_force', 'delay', 'time_constant',
          'lag_of_turns', 'lag_at', 'hold', 'allocation', 'sign.topic')
_UNITS = ('dofs', 'identifier.method', 'frames', 'depth.scale', 'attitude.unit',
          'attitude.heading', *(f'{sensor}.{name}' for name in ('frames', 'mounting')
                                for sensor in ('velocity', 'attitude', 'angular_velocity')),
          *(f'thrusters.{name}' for name in _FORCE))

_MAX_TEXT = 60  # characters of a value in a message


class StateError(ValueError):
    """A saved state that a run cannot begin from; the text says which file and why."""


class DamagedStateError(StateError):
    """A saved state of which something was changed since it was written."""


def save(path: Path, settings: Settings, state: Mapping[str, Any]) -> None:
    """
    Write the state of a stream; at every moment the file is the old or the new one, whole.

    The one before is kept as ``path`` with ``.1`` behind it.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    _write(path, _document(settings, state))


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text, keep=True)


def _document(settings: Settings, state: Mapping[str, Any]) -> str:
    """
    Return the text of the file for a state; raises ValueError for a number that is not finite.

    It is encoded once and without line breaks: with them it takes five times as long, in which a
    live node hears nothing.
    """
    made_with, text = [json.dumps(one, allow_nan=False) for one in (_fingerprint(settings), state)]
    return (f'{{"rovid_checkpoint": {VERSION}, "settings": {made_with}, "state": {text}, '
            f'"sha256": "{_digest(made_with, text)}"}}\n')


def place_for(path: Path, stream: Stream) -> Path:
    """
    Return where the state of a stream goes that is kept in ``path``.

    A state that begins anew because a clock went back is none to take the place of a learned one.
    """
    if stream.reset_by_clock and path.exists():
        return path.with_name(f'{path.stem}-reset{path.suffix}')
    return path


def load(path: Path, settings: Settings) -> dict[str, Any]:
    """
    Return the state that :func:`save` wrote.

    Raises
    ------
    StateError
        If the file cannot be read or is damaged, or if it was made with settings that give its
        parameters another meaning; then it names the key.

    """
    content = _read(path)
    version, made_with, state = (
        content.get(key) for key in ('rovid_checkpoint', 'settings', 'state'))
    if version != VERSION:
        raise StateError(f'{path}: has version {version}, this program reads {VERSION}')
    if unknown := content.keys() - {'rovid_checkpoint', 'settings', 'state', 'sha256'}:
        raise DamagedStateError(f'{path}: is damaged: it has {_text(unknown.pop())}')
    # files of earlier releases have no digest
    digest = _digest(json.dumps(made_with), json.dumps(state))
    if content.get('sha256', digest) != digest:
        raise DamagedStateError(f'{path}: is damaged: its content does not fit its digest')
    differs = _difference(made_with, _fingerprint(settings))
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


def _read(path: Path) -> dict[str, Any]:
    """Return the document of a file that says that it is a saved state."""
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise StateError(f'{path}: is not a regular file')
        content = json.loads(path.read_text(encoding='utf-8'), parse_float=_exact)
    except OSError as error:
        raise StateError(f'{path}: {error.strerror or error}') from None
    except StateError:
        raise
    except (ValueError, RecursionError) as error:
        raise DamagedStateError(f'{path}: is damaged: {error}') from None
    if not isinstance(content, dict) or 'rovid_checkpoint' not in content:
        raise StateError(f'{path}: is not a saved state')
    return content


def _exact(text: str) -> float:
    """Return the number of a text that is how Python writes it: no other digit was put there."""
    value = float(text)
    if repr(value) != text:
        raise ValueError(f'{_text(text)} is no number that was saved')
    return value


def _digest(made_with: str, state: str) -> str:
    return hashlib.sha256(f'[{made_with}, {state}]'.encode()).hexdigest()


def _fingerprint(settings: Settings) -> dict[str, Any]:
    """
    Return the keys that give the identified parameters their meaning, with their values.

    These are the method, the degrees of freedom, their terms and couplings, what a force and a
    length are, and the initial and typical values, which the identifiers count in. Limits can
    change, and topics and gains as long as there are any.
    """
    values = {}
    for key in KEYS:
        if key.name in _UNITS or key.name.partition('.')[0] in settings.dofs and (
                '.initial.' in key.name or '.typical.' in key.name
                or key.name.endswith('.terms')):
            value = _value(settings, key.setting)
            if value is not None:
                values[key.name] = value
    values['current.prior'] = 'above 0' if settings.estimates_current else '0'
    values['identifier.adaptation_gains'] = bool(settings.identifier.adaptation_gains)
    for dof in settings.dofs:
        for name, regressors in (('couplings', settings.couplings(dof)),
                                 ('possible couplings', settings.watched(dof))):
            if regressors:
                values[f'{dof}.{name}'] = list(regressors)
    return values


def _difference(saved: object, mine: Mapping[str, Any]) -> str:
    """Return in which key a saved fingerprint differs from one's own, '' if in none."""
    if not isinstance(saved, Mapping):
        return 'was made with no settings'
    for name in [*mine, *saved]:
        if saved.get(name) != mine.get(name):
            return (f'was made with {name} {_text(saved.get(name))}, configured is '
                    f'{_text(mine.get(name))}')
    return ''


def _value(settings: Settings, setting: str) -> Any:
    """Return a setting by its dotted name; None for a DOF that there is not."""
    found: Any = settings
    for name in setting.split('.'):
        found = found.get(name) if isinstance(found, Mapping) else getattr(found, name)
        if found is None:
            return None
    return _listed(found)


def _listed(value: Any) -> Any:
    return [_listed(x) for x in value] if isinstance(value, tuple) else value


def _text(value: Any) -> str:
    text = str(value)
    return text if len(text) <= _MAX_TEXT else f'{text[:_MAX_TEXT]}...'


def is_record(settings: Settings) -> bool:
    """Tell whether ``checkpoint.path`` and ``record.path`` are one file."""
    record, checkpoint = settings.record_path, settings.checkpoint_path
    return bool(record and checkpoint) and os.path.realpath(record) == os.path.realpath(checkpoint)


class Log(Protocol):
    """The log of a node, as far as it is needed here."""

    def info(self, message: str) -> object: ...

    def warning(self, message: str) -> object: ...

    def error(self, message: str) -> object: ...


class Checkpoint:
    """
    The state of a stream, in the file of ``checkpoint.path``.

    It is locked from the beginning to ``close``, so that no second node writes to it. A file that
    does not fit, such as another vehicle's, is kept under another name; of one that is damaged the
    one before is taken. What a stream learns after its clock went back goes to a file beside it.
    The log gets a line for what happens to the file.

    Attributes
    ----------
    path : Path
        Where the next save goes.

    Raises
    ------
    SettingsError
        If the file could not be written, is the record of the node, or another process uses it.

    """

    def __init__(self, stream: Stream, log: Log) -> None:
        settings = stream.settings
        self.path = Path(settings.checkpoint_path)
        self._stream = stream
        self._log = log
        self._does_not_fit = False
        self._beside = False
        self._writing: Thread | None = None
        self._lock: FileLock | None = None
        if is_record(settings):
            raise SettingsError('checkpoint.path', 'is record.path, takes another file')
        if settings.checkpoint_path:
            prepare_file('checkpoint.path', self.path)
            try:
                self._lock = FileLock(self.path)
            except OSError as error:
                raise SettingsError('checkpoint.path', f'{self.path} {error.strerror}') from None

    @property
    def is_kept(self) -> bool:
        """Tell whether the state is to be saved to a file."""
        return bool(self._stream.settings.checkpoint_path)

    def restore(self) -> dict[str, Any] | None:
        """Go on from the file where there is one that fits; return its state."""
        if not self.is_kept or not self.path.exists():
            return None
        state = self._restore(self.path)
        if state is None:
            self._log.warning('checkpoint.path: starting from the initial values')
        return state

    def save(self) -> str:
        """Write the file; return why not, or ''."""
        if not self.is_kept:
            return 'checkpoint.path is not set'
        self._join()
        return self._attempt(lambda: _write(*self._taken()))

    def begin_saving(self) -> None:
        """
        Write the file while the node goes on: a card may take longer than a message may wait.

        What is being written from the last time is not written once more.
        """
        if self._writing is None or not self._writing.is_alive():
            self._attempt(lambda: self._begin_writing(*self._taken()))

    def close(self) -> None:
        """Let another process use the file."""
        self._join()
        if self._lock:
            self._lock.release()

    def _attempt(self, action: Callable[[], object]) -> str:
        """Return why something could not be done, or ''."""
        try:
            action()
        except (OSError, ValueError) as error:
            self._log.error(f'checkpoint: {error}')
            return str(error)
        return ''

    def _taken(self) -> tuple[Path, str]:
        """Return where the state as it is now goes, and the text of the file."""
        text = _document(self._stream.settings, self._stream.state())
        if self._does_not_fit:
            self._set_aside()
        if self._stream.reset_by_clock and not self._beside:
            self._go_beside()
        return self.path, text

    def _begin_writing(self, path: Path, text: str) -> None:
        self._writing = Thread(
            target=self._attempt, args=(lambda: _write(path, text),), daemon=True)
        self._writing.start()

    def _join(self) -> None:
        if self._writing is not None:
            self._writing.join()

    def _restore(self, path: Path) -> dict[str, Any] | None:
        try:
            state = restore(path, self._stream)
        except ValueError as error:
            self._does_not_fit = True
            self._log.error(f'checkpoint.path: not restored: {error}')
            older = before(path)
            return self._restore(older) if (
                isinstance(error, DamagedStateError) and older.exists()) else None
        frozen = '' if self._stream.adapting else ', frozen'
        self._log.info(f'going on from {path}{frozen}')
        return state

    def _set_aside(self) -> None:
        if self.path.exists():
            kept = create_unused(self.path)
            self.path.replace(kept)
            self._log.warning(f'checkpoint: {self.path} was not restored; kept as {kept}')
        self._does_not_fit = False

    def _go_beside(self) -> None:
        place = place_for(self.path, self._stream)
        if place != self.path:
            self._log.warning(f'checkpoint: a clock that went back has reset the parameters; '
                              f'{self.path} stays as it was, {place} is written from now on')
        self.path, self._beside = place, True
