"""What a process that was killed has left behind: files under its number, never finished."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shutil


def remove_leftovers(folder: Path, prefix: str) -> None:
    """
    Remove files and folders of processes that are no more.

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
