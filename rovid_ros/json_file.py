"""JSON files that are never seen half written."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


def write_json(path: Path, document: Any, indent: int = 2) -> None:
    """
    Write a document; at every moment the file is the old or the new one, whole.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If there is a number that is not finite.

    """
    text = json.dumps(document, indent=indent, allow_nan=False)
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(text + '\n')
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
