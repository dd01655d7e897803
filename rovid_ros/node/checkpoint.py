"""The node's saved state: where it goes on from, and what it writes again and again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.files.state_file import is_record, restore, save
from rovid_ros.files.whole_files import claim, prepare


class Checkpoint:
    """
    The file of ``checkpoint.path``.

    One that does not fit, such as another vehicle's, is kept under another name.

    Parameters
    ----------
    settings : Settings
        The run.
    stream : Stream
        Whose state it is.
    log : RcutilsLogger
        Told what happens to the file.

    Raises
    ------
    SettingsError
        If the file could not be written.

    """

    def __init__(self, settings: Settings, stream: Stream, log: RcutilsLogger) -> None:
        self.path = Path(settings.checkpoint_path)
        self._settings = settings
        self._stream = stream
        self._log = log
        self._misfit = False
        if settings.checkpoint_path:
            prepare('checkpoint.path', self.path)
        if is_record(settings):
            raise SettingsError('checkpoint.path', 'is record.path, takes another file')

    def restore(self) -> dict[str, Any] | None:
        """Go on from the file where there is one that fits; return its state."""
        if not self._settings.checkpoint_path or not self.path.exists():
            return None
        try:
            state = restore(self.path, self._stream)
        except ValueError as error:
            self._misfit = True
            self._log.error(
                f'checkpoint.path: not restored, starting from the initial values: {error}')
            return None
        frozen = '' if self._stream.adapting else ', frozen'
        self._log.info(f'going on from {self.path}{frozen}')
        return state

    def save(self) -> str:
        """Write the file; return why not, or ''."""
        if not self._settings.checkpoint_path:
            return 'checkpoint.path is not set'
        try:
            state = self._stream.state()
            if self._misfit:
                self._set_aside()
            save(self.path, self._settings, state)
        except (OSError, ValueError) as error:
            self._log.error(f'checkpoint: {error}')
            return str(error)
        return ''

    def _set_aside(self) -> None:
        if self.path.exists():
            kept = claim(self.path)
            self.path.replace(kept)
            self._log.warning(f'checkpoint: {self.path} was not restored; kept as {kept}')
        self._misfit = False
