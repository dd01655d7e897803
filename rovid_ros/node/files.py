"""The files that the node writes: checked at the start, and no other file lost to them."""

from __future__ import annotations

from pathlib import Path
import tempfile
import time

from rovid_core.settings.run import SettingsError


def prepare(key: str, path: Path) -> None:
    """
    Make the folder of a file that is going to be written, and see whether that will work.

    Raises
    ------
    SettingsError
        If it will not; it names the key.

    """
    try:
        if path.exists() and not path.is_file():
            what = 'is a directory' if path.is_dir() else 'is not a regular file'
            raise SettingsError(key, f'{path} {what}, takes the name of a file')
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise SettingsError(key, f'{path} cannot be written: {error.strerror or error}') from None


def age(path: str) -> float | None:
    """Return how long ago [s] a file was written, None where there is none."""
    try:
        return max(0.0, time.time() - Path(path).stat().st_mtime) if path else None
    except OSError:
        return None


def claim(path: Path) -> Path:
    """
    Make an empty file of a name that is not taken, and return it.

    It is ``path``, or has the first free number behind its stem. Two processes that claim the
    same at once get two files.
    """
    number, found = 0, path
    while True:
        try:
            found.touch(exist_ok=False)
            return found
        except FileExistsError:
            number += 1
            found = path.with_name(f'{path.stem}-{number}{path.suffix}')
