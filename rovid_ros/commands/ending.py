"""How a command reads its settings, minds its files, and ends: exit codes and one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from rovid_ros.commands.interrupt import Interrupted

if TYPE_CHECKING:
    from rovid_core.settings.run import Settings

LONGEST_LINE = 2000
"""[characters] What a foreign log makes of an error message can be longer than of use."""

DONE, AT_FAULT, USAGE, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141


class CommandError(ValueError):
    """What a command was given does not work; the text is the line to print."""


class UsageError(ValueError):
    """The command line itself is wrong."""


def guarded(name: str, run: Callable[[], None]) -> int:
    """Run a command; turn what goes wrong into one line on stderr and an exit code."""
    try:
        run()
        if sys.stdout is not None:
            sys.stdout.flush()
        return DONE
    except Interrupted as stop:
        return _fail(name, str(stop), stop.code)
    except KeyboardInterrupt:
        return _fail(name, 'interrupted', INTERRUPTED)
    except BrokenPipeError:
        # The reader left: that is its right. Python would complain again when it flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except OSError as error:
        reason = error.strerror or str(error)
        return _fail(name, f'{error.filename}: {reason}' if error.filename else reason, AT_FAULT)
    except UsageError as error:
        return _fail(name, f'{error} (see {name} --help)', USAGE)
    except ValueError as error:
        if not type(error).__module__.startswith('rovid_'):
            raise  # not one of ours: a defect, whose traceback is wanted
        return _fail(name, str(error), AT_FAULT)


def read_settings(path: Path, method: str = '') -> Settings:
    """
    Read a parameter file as the node does.

    Raises
    ------
    ParameterFileError, CommandError, UsageError
        If the file, a value in it or the ``method`` of the command line cannot work.

    """
    from rovid_ros.config.parameters import settings_from
    with naming(path):
        try:
            return settings_from(read_values(path, method))
        except ValueError as error:
            if method and getattr(error, 'key', '') == 'identifier.method':
                raise UsageError(f'--method: {str(error).partition(": ")[2]}') from None
            raise


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Begin an error about a key with the parameter file, and the line if the key is in it."""
    from rovid_ros.config.parameter_file import read
    try:
        yield
    except ValueError as error:
        key = getattr(error, 'key', '')  # of a SettingsError or FieldError
        if not key:
            raise
        entry = read(path).get(key)
        place = f'{path}:{entry.line}' if entry else f'{path}'
        raise CommandError(f'{place}: {error}') from None


def read_values(path: Path, method: str = '') -> dict[str, Any]:
    """Read the parameters by their dotted names; ``method`` wins over the file's."""
    from rovid_ros.config.parameter_file import load
    return {**load(path), **({'identifier.method': method} if method else {})}


def check_written(written: Sequence[Path | None], read: Sequence[Path]) -> None:
    """Refuse to write over what is read, twice to one file, or to where nothing can be."""
    seen: list[Path] = []
    for path in (p for p in written if p is not None):
        place = Path(os.path.realpath(path))  # which takes a link to itself too
        if not place.parent.is_dir():
            raise CommandError(f'{path}: the directory {path.parent} does not exist')
        if place.is_dir():
            raise CommandError(f'{path}: is a directory, takes the name of a file')
        for source in (Path(os.path.realpath(p)) for p in read):
            if place == source or (place.exists() and place.parent == source):
                raise CommandError(f'{path}: is read by this command; write to another file')
        if place in seen:
            raise CommandError(f'{path}: would be written twice')
        seen.append(place)


def printable(text: str) -> str:
    """Return a text as one line of a sensible length that does nothing to a terminal."""
    line = ' '.join(text.split())
    if len(line) > LONGEST_LINE:
        line = f'{line[:LONGEST_LINE]} ...'
    return ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in line)


def _fail(name: str, message: str, code: int) -> int:
    print(f'{name}: {printable(message)}', file=sys.stderr)
    return code
