"""Files that are never seen half written, and names for new ones that are not taken."""

from __future__ import annotations

from contextlib import suppress
import errno
import fcntl
import json
import os
from pathlib import Path
import re
import shutil
import sys
import tempfile
import time
from typing import Any

from rovid_core.settings.run import SettingsError

STDOUT = Path('/dev/stdout')


def write_json(path: Path, document: Any) -> None:
    """
    Write a document as :func:`write_text` writes a text.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If there is a number that is not finite.

    """
    write_text(path, json.dumps(document, indent=2, allow_nan=False) + '\n')


def write_text(path: Path, text: str, keep: bool = False) -> None:
    """Write a text as :func:`write_bytes` writes bytes, in UTF-8."""
    if path == STDOUT:  # opened anew, it would go over what was printed to a file
        sys.stdout.write(text)
    else:
        write_bytes(path, text.encode(), keep)


def write_bytes(path: Path, data: bytes, keep: bool = False) -> None:
    """
    Write all of a file; at every moment the file is the old or the new one, whole.

    With ``keep`` the old one stays as :func:`before`.

    What a symbolic link points to is replaced, not the link. A pipe or a device is written
    to as it is.

    Raises
    ------
    OSError
        If the file cannot be written; it names ``path``.

    """
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)
        else:
            _replace(Path(os.path.realpath(path)), data, keep)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def before(path: Path) -> Path:
    """Return where a file is kept that had this name before."""
    return Path(f'{os.path.realpath(path)}.1')


def sync_folder(folder: Path) -> None:
    """Let new names in a folder outlast a loss of power."""
    directory = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _replace(path: Path, data: bytes, keep: bool) -> None:
    prefix = f'.{path.name}.'
    remove_stale_files(path.parent, prefix)
    temporary = path.with_name(f'{prefix}{os.getpid()}')
    spare = path.with_name(f'{temporary.name}-1')
    try:
        with temporary.open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if keep and path.exists():
            _link(path, spare)
            os.replace(spare, before(path))
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        spare.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def _link(path: Path, other: Path) -> None:
    """Give a file a second name, or a copy where the file system has no links."""
    try:
        os.link(path, other)
    except OSError:
        with path.open('rb') as old, other.open('wb') as new:
            shutil.copyfileobj(old, new)
            new.flush()
            os.fsync(new.fileno())


class FileLock:
    """
    The right to write a file, for one holder at a time; it ends with ``release`` or the process.

    The lock is on a hidden file beside it, for the file itself is replaced with every save.

    Raises
    ------
    OSError
        BlockingIOError if another one holds it, others if the hidden file cannot be made.

    """

    def __init__(self, path: Path) -> None:
        place = Path(os.path.realpath(path))
        self._path = place.with_name(f'.{place.name}.lock')
        while not self._acquire():
            pass

    def _acquire(self) -> bool:
        """Lock the file that has the name; False if the holder before removed it meanwhile."""
        self._file: int | None = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise BlockingIOError(errno.EWOULDBLOCK, 'is in use by another process') from None
        except OSError:  # a file system without locks
            return True
        try:
            if os.path.samestat(os.fstat(self._file), os.stat(self._path)):
                return True
        except FileNotFoundError:
            pass
        os.close(self._file)
        return False

    def release(self) -> None:
        """Let another one have it."""
        if self._file is not None:
            with suppress(OSError):  # its folder may be gone
                os.unlink(self._path)
            os.close(self._file)
            self._file = None


def remove_stale_files(folder: Path, prefix: str) -> None:
    """
    Remove temporary files and folders of processes that do not run any more.

    Parameters
    ----------
    folder : Path
        Where they are.
    prefix : str
        What their names begin with; then come the number of the process and, behind a
        hyphen, anything.

    """
    pattern = re.compile(re.escape(prefix) + r'(\d{1,9})(-.*)?')
    for entry in os.scandir(folder):
        found = pattern.fullmatch(entry.name)
        if found and not _is_running(int(found[1])):
            _remove(entry)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        pass
    return True


def _remove(entry: os.DirEntry[str]) -> None:
    try:
        if entry.stat(follow_symlinks=False).st_uid != os.getuid():
            return
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path, ignore_errors=True)
        else:
            os.unlink(entry.path)
    except OSError:  # another process was faster, or it has to stay
        pass


def prepare_file(key: str, path: Path) -> None:
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


def file_age(path: str) -> float | None:
    """Return how long ago [s] a file was written, None where there is none."""
    try:
        return max(0.0, time.time() - Path(path).stat().st_mtime) if path else None
    except OSError:
        return None


def create_unused(path: Path) -> Path:
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
