"""Results, in JSON or other text, in files that are never seen half written."""

from __future__ import annotations

import json
import os
from pathlib import Path
import sys
from typing import Any

STDOUT = Path('/dev/stdout')


def write_json(path: Path, document: Any, indent: int = 2) -> None:
    """
    Write a document as :func:`write_text` writes a text.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If there is a number that is not finite.

    """
    write_text(path, json.dumps(document, indent=indent, allow_nan=False) + '\n')


def write_text(path: Path, text: str) -> None:
    """
    Write a text; at every moment the file is the old or the new one, whole.

    What a symbolic link points to is replaced, not the link. A pipe or a device is written
    to as it is.

    Raises
    ------
    OSError
        If the file cannot be written; it names ``path``.

    """
    try:
        if path == STDOUT:  # opened anew, it would go over what was printed to a file
            sys.stdout.write(text)
        elif path.exists() and not path.is_file():
            path.write_text(text, encoding='utf-8')
        else:
            _replace(Path(os.path.realpath(path)), text)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    # the new name itself is only safe once its directory is
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
