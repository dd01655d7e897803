"""What surrounds the work of every command: files to read and write, signals, exit codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import sys
import threading
from types import FrameType
from typing import Any, NoReturn, TYPE_CHECKING

if TYPE_CHECKING:
    from rovid_core.settings.run import Settings
    from rovid_ros.config.parameter_file import ParameterSource

DONE, AT_FAULT, USAGE, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141  # exit codes
# [characters] An error about a damaged log can quote more of it than is of use
LONGEST_LINE = 2000
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class CommandError(ValueError):
    """What a command was given does not work; the text is the line to print."""


class UsageError(ValueError):
    """The command line itself is wrong."""


class Interrupted(KeyboardInterrupt):
    """A run that a signal ended; the text says what was kept, ``code`` is for the process."""

    def __init__(self, message: str, code: int = INTERRUPTED) -> None:
        super().__init__(message)
        self.code = code


class Interrupt:
    """
    Turn the first signal into a flag, so that nothing is left half written.

    The loop looks at ``asked`` between two messages and leaves; ``code`` is what the process is to
    end with then. A second signal stops at once and leaves ``output`` incomplete.
    """

    def __init__(self, output: Path | None = None) -> None:
        self.asked = False
        self.code = 0
        self._output = output

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            kept = f'; {self._output} is incomplete' if self._output else ''
            raise Interrupted(f'interrupted twice{kept}', 128 + number)
        self.asked, self.code = True, 128 + number

    def __enter__(self) -> Interrupt:
        self._previous = [signal.getsignal(number) for number in SIGNALS]
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *error: object) -> None:
        if threading.current_thread() is threading.main_thread():
            for number, previous in zip(SIGNALS, self._previous):
                signal.signal(number, previous)


def run_to_exit_code(prog: str, run: Callable[[], None]) -> int:
    """Run a command; turn what goes wrong into one line on stderr and an exit code."""
    try:
        run()
        if sys.stdout is not None:
            sys.stdout.flush()
        return DONE
    except SystemExit as stop:  # of argparse, which has printed what there is to say
        return int(stop.code or DONE)
    except Interrupted as stop:
        return _fail(prog, str(stop), stop.code)
    except KeyboardInterrupt:
        return _fail(prog, 'interrupted', INTERRUPTED)
    except BrokenPipeError:
        _give_up_output()  # the reader left, which is its right
        return BROKEN_PIPE
    except OSError as error:
        _give_up_output()
        reason = error.strerror or str(error)
        return _fail(prog, f'{error.filename}: {reason}' if error.filename else reason, AT_FAULT)
    except UsageError as error:
        return _fail(prog, f'{error} (see {prog} --help)', USAGE)
    except ValueError as error:
        if not type(error).__module__.startswith('rovid_'):
            raise  # not one of ours: a defect, whose traceback is wanted
        return _fail(prog, str(error), AT_FAULT)


def open_standard_files() -> None:
    """
    Open what was closed of stdin, stdout and stderr.

    Otherwise the next file that is opened is taken for it, and gets what is printed.
    """
    while (opened := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(opened)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, 'w', encoding='utf-8')


def tell(line: str) -> None:
    """Print a line on stderr; that nobody can read it is no reason to stop."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:  # Python would complain again at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def wrong_usage(prog: str, message: str) -> NoReturn:
    """Print a line about the command line and exit."""
    tell(f'{prog}: {message} (see {prog} --help)')
    raise SystemExit(USAGE)


def warn(prog: str, line: str) -> None:
    """Print a warning."""
    tell(f'{prog}: warning: {printable(line)}')


def printable(text: str) -> str:
    """Return a text as one line of a sensible length that does nothing to a terminal."""
    line = ' '.join(text.split())
    if len(line) > LONGEST_LINE:
        line = f'{line[:LONGEST_LINE]} ...'
    return ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in line)


def _give_up_output() -> None:
    """Drop what cannot be printed; Python would complain again at the end."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(prog: str, message: str, code: int) -> int:
    tell(f'{prog}: {printable(message)}')
    return code


def read_settings(path: Path | ParameterSource, method: str = '',
                  logs: Sequence[Path] = ()) -> Settings:
    """
    Read parameters as the node does; ``method`` is that of the command line.

    What is to be looked up in /tf_static is looked up in the logs, if there are any. Raises
    ParameterFileError, CommandError or UsageError if one of them cannot work, and LogError.
    """
    from rovid_ros.config.parameters import settings_from
    with located_errors(path):
        try:
            return settings_from(read_values(path, method, logs))
        except ValueError as error:
            if method and getattr(error, 'key', '') == 'identifier.method':
                raise UsageError(f'--method: {str(error).partition(": ")[2]}') from None
            raise


def read_values(path: Path | ParameterSource, method: str = '',
                logs: Sequence[Path] = ()) -> dict[str, Any]:
    """Read the parameters by their dotted names; ``method`` wins over the file's."""
    values = {**source_of(path).values(), **({'identifier.method': method} if method else {})}
    if logs and any(value for key, value in values.items() if key.endswith('.sensor_frame')):
        from rovid_ros.config.parameters import settings_from
        from rovid_ros.logs.static_frames import values_in_logs
        values.update(values_in_logs(settings_from(values), logs))
    return values


def source_of(path: Path | ParameterSource) -> ParameterSource:
    """Return where parameters come from that may be one file alone."""
    from rovid_ros.config.parameter_file import ParameterSource
    return ParameterSource((path,)) if isinstance(path, Path) else path


@contextmanager
def located_errors(path: Path | ParameterSource) -> Iterator[None]:
    """Begin an error about a key with the parameter file, and the line if the key is in it."""
    try:
        yield
    except ValueError as error:
        key = getattr(error, 'key', '')  # of a SettingsError
        if not key:
            raise
        raise CommandError(f'{source_of(path).place_of(key)}: {error}') from None


@contextmanager
def locked(path: Path | None) -> Iterator[None]:
    """Keep other processes from a file that is read and written; None is no file."""
    if path is None:
        yield
        return
    from rovid_ros.files.whole_files import FileLock
    try:
        lock = FileLock(path)
    except BlockingIOError as error:
        raise CommandError(f'{path}: {error.strerror}') from None
    try:
        yield
    finally:
        lock.release()


def check_written(written: Sequence[Path | None], read: Sequence[Path | None]) -> None:
    """
    Refuse to write over what is read, twice to one file, or to where nothing can be.

    Raises CommandError, which names the first path that cannot be written. None is no path.
    """
    sources = [_real(path) for path in read if path is not None]
    seen: list[Path] = []
    for path in (path for path in written if path is not None):
        place = _real(path)
        if not place.parent.is_dir():
            raise CommandError(f'{path}: the directory {path.parent} does not exist')
        if place.is_dir():
            raise CommandError(f'{path}: is a directory, takes the name of a file')
        # a device is written to, a file replaced in its directory
        goes_to = place if place.exists() and not place.is_file() else place.parent
        if not os.access(goes_to, os.W_OK):
            raise CommandError(f'{path}: cannot be written: no permission')
        # a log may be a directory of files
        if place in sources or (place.exists() and place.parent in sources):
            raise CommandError(f'{path}: is read by this command; write to another file')
        if place in seen:
            raise CommandError(f'{path}: would be written twice')
        seen.append(place)


@contextmanager
def printing(text: str) -> Iterator[None]:
    """
    Print a text when the files that belong to it are written, or cannot be.

    So neither is lost where the other fails: a disk that is full, a reader that left.
    """
    try:
        yield
    finally:
        print(text)


def print_written(*paths: Path | None) -> None:
    """Say which files were written."""
    for path in filter(None, paths):
        print(f'written   {path}')


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))  # unlike Path.resolve, takes a link to itself too
