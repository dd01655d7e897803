"""The node's saved state in its file: locked, guarded, and never lost to one that knows less."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Protocol

from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.files.state_file import DamagedStateError, place_for, restore, save
from rovid_ros.files.whole_files import before, create_unused, FileLock, prepare_file


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
        self._lock: FileLock | None = None
        if is_record(settings):
            raise SettingsError('checkpoint.path', 'is record.path, takes another file')
        if settings.checkpoint_path:
            prepare_file('checkpoint.path', self.path)
            try:
                self._lock = FileLock(self.path)
            except OSError as error:
                raise SettingsError('checkpoint.path', f'{self.path} {error.strerror}') from None

    def restore(self) -> dict[str, Any] | None:
        """Go on from the file where there is one that fits; return its state."""
        if not self._stream.settings.checkpoint_path or not self.path.exists():
            return None
        state = self._restore(self.path)
        if state is None:
            self._log.warning('checkpoint.path: starting from the initial values')
        return state

    def save(self) -> str:
        """Write the file; return why not, or ''."""
        if not self._stream.settings.checkpoint_path:
            return 'checkpoint.path is not set'
        try:
            state = self._stream.state()
            if self._does_not_fit:
                self._set_aside()
            if self._stream.reset_by_clock and not self._beside:
                self._go_beside()
            save(self.path, self._stream.settings, state)
        except (OSError, ValueError) as error:
            self._log.error(f'checkpoint: {error}')
            return str(error)
        return ''

    def close(self) -> None:
        """Let another process use the file."""
        if self._lock:
            self._lock.release()

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
