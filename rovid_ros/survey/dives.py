"""The logs of a survey: found by path, pattern, folder or list, each one dive; and their tags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import glob
import os
from pathlib import Path
from typing import Any

from rovid_ros.logs.container import LogError
import yaml

LIST = '.txt'  # suffix of a list of logs
SUFFIXES = ('.mcap', '.db3', '.bag', '.bin', '.zst', '.zstd')
UNFINISHED = '.part.mcap'  # what a replay that still runs, or was killed, writes
BAG = 'metadata.yaml'  # what makes a folder a bag of rosbag2
LARGEST = 1 << 22  # [bytes] of YAML that is read
# Metadata that programs write for themselves; what remains was written about the dive.
OTHERS = ('rovid_', 'rosbag2', 'ardupilot_parameters')


def find_dives(given: Sequence[str]) -> list[Path]:
    """
    Return the logs of a survey, each once, in the order given.

    A log, a bag of rosbag2, a pattern with ``*``, a folder with logs and bags at any depth, or a
    text file (``.txt``) with one of these a line, relative to the file; ``#`` begins a comment. A
    path that is not there stays in the list. Raises LogError where a pattern, folder or list has
    no log, or a list names itself.
    """
    found: dict[str, Path] = {}
    for text in given:
        for path in _dives(text):
            found.setdefault(os.path.realpath(path), path)
    return list(found.values())


def _dives(text: str, lists: tuple[str, ...] = ()) -> Iterator[Path]:
    """Yield the logs of a path in some lists, of which each names the next one."""
    path = Path(text)
    if path.suffix == LIST and path.is_file():
        if os.path.realpath(path) in lists:
            raise LogError(f'{path}: the list names itself')
        found = list(_listed(path, (*lists, os.path.realpath(path))))
    elif path.is_dir() and not (path / BAG).is_file():
        found = list(_inside(path))
    elif glob.has_magic(text) and not path.exists():
        found = [dive for name in sorted(glob.glob(text, recursive=True))
                 for dive in _dives(name, lists)]
    else:
        found = [path]
    if not found:
        raise LogError(f'{text}: has no log ({", ".join(SUFFIXES)}, or a bag of rosbag2)')
    yield from found


def _listed(path: Path, lists: tuple[str, ...]) -> Iterator[Path]:
    for line in path.read_text(encoding='utf-8', errors='replace').splitlines():
        name = line.partition('#')[0].strip()
        if name:
            yield from _dives(str(path.parent / name), lists)


def _inside(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            yield from [path] if (path / BAG).is_file() else _inside(path)
        elif path.suffix.lower() in SUFFIXES and not path.name.endswith(UNFINISHED):
            yield path


def tags(path: Path, metadata: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """
    Return what was noted about a dive, by name: temperature, payload, and so on.

    It is every entry of the log's own metadata (an MCAP metadata record), and ``custom_data`` of
    rosbag2, in the log or in the folder's ``metadata.yaml``.
    """
    found = {key: value for name, entries in metadata.items() if not name.startswith(OTHERS)
             for key, value in entries.items()}
    found |= _custom_data(metadata.get('rosbag2', {}).get('serialized_metadata', ''))
    bag = path / BAG
    if bag.is_file():
        with bag.open('rb') as file:
            found |= _custom_data(file.read(LARGEST).decode('utf-8', 'replace'))
    return {key: ' '.join(value.split()) for key, value in found.items()}


def _custom_data(text: str) -> dict[str, str]:
    try:
        # the base loader only: merged mappings can grow out of a few lines without end
        document: Any = yaml.load(text[:LARGEST], yaml.BaseLoader)
        custom = document.get('rosbag2_bagfile_information', document)['custom_data']
        return {str(key): str(value) for key, value in custom.items()}
    except (yaml.YAMLError, LookupError, AttributeError, TypeError, RecursionError):
        return {}


def stamps(path: Path) -> list[list[Any]]:
    """Return name, size and time of change of all files of a log: another log has others."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    found = [(file, file.stat()) for file in files if file.is_file()]
    return [[file.name, stat.st_size, stat.st_mtime_ns] for file, stat in found]
