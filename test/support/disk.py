"""A disk that can lose its power or fail: what would be there then."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
from typing import Any

import pytest

_fsync, _replace, _link, _open = os.fsync, os.replace, os.link, Path.open


class _Failing:
    """A file that can be opened and not be written."""

    def __init__(self, file: Any, fail: Callable[[str, Path], None], path: Path) -> None:
        self._file, self._fail, self._path = file, fail, path

    def write(self, data: Any) -> Any:
        self._fail('write', self._path)
        return self._file.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> _Failing:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()


class Disk:
    """
    Records what is done to the files of a folder, and knows what outlasts a loss of power.

    Without ``fsync`` a file has its name and no content, and a folder has either its old names or
    its new ones: that is how ext4 and others are found after a power failure.

    Parameters
    ----------
    patch : pytest.MonkeyPatch
        Puts the recorder in the place of the calls of the system.
    folder : Path
        What is there already is on the disk.
    fail_at : int, optional
        This call, counted from 0, fails.
    error : int
        Number of its error.

    Attributes
    ----------
    calls : list of str
        What was done, in order, such as ``fsync state.json``.

    """

    def __init__(self, patch: pytest.MonkeyPatch, folder: Path, fail_at: int = -1,
                 error: int = 0) -> None:
        self.calls: list[str] = []
        self.failed = ''  # the call that did
        self._folder, self._fail_at, self._error = folder, fail_at, error
        self._names = self._now()
        self._contents = {inode: (folder / name).read_bytes()
                          for name, inode in self._names.items()}
        self._watched: dict[Path, set[bytes | None]] = {}
        patch.setattr(os, 'fsync', self._on_fsync)
        patch.setattr(os, 'fdatasync', self._on_fsync)
        patch.setattr(os, 'replace', self._on_replace)
        patch.setattr(os, 'link', self._on_link)
        patch.setattr(Path, 'open', lambda path, mode='r', *a, **k: self._on_open(
            path, mode, *a, **k))

    def watch(self, path: Path) -> set[bytes | None]:
        """Return what a file could be found to hold if the power failed now; None is no file."""
        holds: set[bytes | None] = set()
        for names in (self._names, self._now()):
            inode = names.get(path.name)
            holds.add(None if inode is None else self._contents.get(inode, b''))
        self._watched.setdefault(path, set()).update(holds)
        return holds

    def seen(self, path: Path) -> set[bytes | None]:
        """Return what a watched file could have been found to hold at any call."""
        return self._watched[path]

    def _now(self) -> dict[str, int]:
        return {entry.name: entry.inode() for entry in os.scandir(self._folder)
                if entry.is_file(follow_symlinks=False)}

    def _call(self, what: str, path: Path) -> None:
        for watched in self._watched:
            self.watch(watched)
        self.calls.append(f'{what} {path.name}')
        if len(self.calls) - 1 == self._fail_at:
            self.failed = self.calls[-1]
            raise OSError(self._error, os.strerror(self._error), str(path))

    def _on_fsync(self, descriptor: int) -> None:
        path = Path(os.readlink(f'/proc/self/fd/{descriptor}'))
        self._call('fsync', path)
        _fsync(descriptor)
        if path == self._folder:
            self._names = self._now()
        elif path.is_file():
            self._contents[os.fstat(descriptor).st_ino] = path.read_bytes()

    def _on_replace(self, source: Path, target: Path) -> None:
        self._call('replace', Path(target))
        _replace(source, target)

    def _on_link(self, source: Path, target: Path) -> None:
        self._call('link', Path(target))
        _link(source, target)

    def _on_open(self, path: Path, mode: str, *given: Any, **named: Any) -> Any:
        file = _open(path, mode, *given, **named)
        return _Failing(file, self._call, path) if 'w' in mode else file
