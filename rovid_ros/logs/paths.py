"""From the paths on a command line to the files of a log."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import shutil
from typing import Any

from rovid_ros.logs import dataflash, mcap, ros1, sqlite
from rovid_ros.logs.container import Container, LogError, MALFORMED
import yaml
import zstandard

_SUFFIXES = ('.mcap', '.db3', '.bag')
_PACKED = ('.zst', '.zstd')
_LARGEST_LIST = 1 << 22  # [bytes] of metadata.yaml that are read
_STEP = 1 << 20  # [bytes]
_SURE = 1 << 30  # [bytes] that a file may have when it is unpacked; beyond, this many times its
_RATIO = 100  # size
_POINTER = b'version https://git-lfs'  # what Git LFS keeps in place of a large file
_FORMATS: dict[bytes, type[Container]] = {
    mcap.MAGIC: mcap.McapFile,
    sqlite.MAGIC: sqlite.SqliteFile,
    ros1.MAGIC: ros1.BagFile,
    dataflash.MAGIC: dataflash.DataflashFile,
}


def open_all(paths: Sequence[Path], scratch: Path) -> tuple[list[Container], list[str]]:
    """
    Open files of any known format and rosbag2 directories; return them and warnings.

    ``scratch`` is for unpacked copies of files that are compressed as a whole. Warnings are of
    files of a directory that are missing or of no use. Raises LogError if a path is not there, is
    no log or is given twice.
    """
    containers: list[Container] = []
    warnings: list[str] = []
    for path in paths:
        try:
            if path.is_dir():
                found, problems = _open_directory(path, scratch)
                containers += found
                warnings += problems
            else:
                containers.append(_open_file(path, scratch))
        except OSError as error:
            raise LogError(f'{path}: {(error.strerror or str(error)).lower()}') from None
    places: set[str] = set()
    for container in containers:
        place = os.path.realpath(container.name)
        if place in places:
            raise LogError(f'{container.name}: is given twice')
        places.add(place)
    alone = next((one for one in containers if one.own_clock), None)
    if alone is not None and len(containers) > 1:
        raise LogError(f'{alone.name}: counts its time from the start of the autopilot, so it '
                       'cannot be joined with other logs; give it alone')
    return containers, warnings


def _open_directory(path: Path, scratch: Path) -> tuple[list[Container], list[str]]:
    """Open a rosbag2 directory, also one whose recorder was killed or whose files moved."""
    listed = _listed(path)
    files = [file for file in listed if os.path.lexists(file)]
    warnings = [f'{file}: is in metadata.yaml, but not there' for file in listed
                if file not in files]
    if not files:
        files = sorted(file for file in path.iterdir() if _is_log(file))
    if not files and listed:
        raise LogError(warnings[0])
    if not files:
        raise LogError(f'{path}: no log in this directory ({", ".join(_SUFFIXES)})')
    containers = []
    for file in files:
        try:
            containers.append(_open_file(file, scratch))
        except LogError as error:
            warnings.append(str(error))
        except OSError as error:
            warnings.append(f'{file}: {(error.strerror or str(error)).lower()}')
    if not containers:
        raise LogError(warnings[-1])
    return containers, warnings


def _listed(path: Path) -> list[Path]:
    """Return the files that the directory's metadata.yaml names; none if it is of no use."""
    try:
        list_of_files = path / 'metadata.yaml'
        if not list_of_files.is_file():
            return []
        with list_of_files.open('rb') as file:
            text = file.read(_LARGEST_LIST)
        # the base loader only: merged mappings can grow out of a few lines without end
        metadata: Any = yaml.load(text, yaml.BaseLoader)
        names = metadata['rosbag2_bagfile_information']['relative_file_paths']
        return [path / Path(name).name for name in names]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, RecursionError):
        return []


def _is_log(path: Path) -> bool:
    name = path.stem if path.suffix in _PACKED else path.name
    return Path(name).suffix in _SUFFIXES and path.is_file()


def _open_file(path: Path, scratch: Path) -> Container:
    name = str(path)
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise LogError(f'{name}: is not a regular file')
    if path.suffix in _PACKED:
        path = _unpacked(path, scratch)
    with path.open('rb') as file:
        head = file.read(len(_POINTER))
    if not head:
        raise LogError(f'{name}: is empty')
    if head == _POINTER:
        raise LogError(f'{name}: only points to the log, which git lfs pull brings')
    for magic, format in _FORMATS.items():
        if head.startswith(magic):
            if format is sqlite.SqliteFile:
                path = _whole_pages(path, head, scratch)
            return _open_format(format, path, name)
        if magic.startswith(head):
            raise LogError(f'{name}: cut off before its first message')
    raise LogError(f'{name}: is not a log (MCAP, sqlite3 of rosbag2, ROS 1 bag 2.0, or '
                   'ArduPilot .BIN)')


def _open_format(format: type[Container], path: Path, name: str) -> Container:
    try:
        return format(path, name)
    except LogError:
        raise
    except MALFORMED:
        raise LogError(f'{name}: too damaged to be read') from None


def _whole_pages(path: Path, head: bytes, scratch: Path) -> Path:
    """Return the file, or a copy without a broken page, which sqlite would fill with zeros."""
    size = path.stat().st_size
    broken = sqlite.part_of_page(head, size)
    if not broken:
        return path
    copy = _copy_of(path, scratch)
    shutil.copyfile(path, copy)
    os.truncate(copy, size - broken)
    return copy


def _unpacked(path: Path, scratch: Path) -> Path:
    """Return a copy that is not compressed as a whole; rosbag2 can do that to its files."""
    copy = _copy_of(path, scratch)
    try:
        left = max(_SURE, _RATIO * path.stat().st_size)
        with path.open('rb') as packed, copy.open('wb') as plain:
            for piece in zstandard.ZstdDecompressor().read_to_iter(packed, write_size=_STEP):
                left -= plain.write(piece)
                if left < 0:
                    raise LogError(f'{path}: unpacks to more than {_RATIO} times its size; if '
                                   'that is right, unpack it first')
    except zstandard.ZstdError as error:
        raise LogError(f'{path}: cannot be decompressed: {error}') from None
    return copy


def _copy_of(path: Path, scratch: Path) -> Path:
    return scratch / f'{len(list(scratch.iterdir()))}-{path.name}'
