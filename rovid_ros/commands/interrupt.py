"""Ctrl-C and SIGTERM between two messages instead of inside one."""

from __future__ import annotations

from pathlib import Path
import signal
import threading
from types import FrameType, TracebackType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """
    A run that a signal ended.

    Parameters
    ----------
    message : str
        Says what was kept.
    code : int
        What the process ends with.

    """

    def __init__(self, message: str, code: int = 128 + signal.SIGINT) -> None:
        super().__init__(message)
        self.code = code


class Interrupt:
    """
    Turn the first signal into a flag, so that nothing is left half written.

    The loop looks at ``asked`` and leaves; a second signal stops at once.

    Parameters
    ----------
    output : Path, optional
        The file that is being written, which a second signal leaves incomplete.

    Attributes
    ----------
    asked : bool
        Whether there was a signal.
    code : int
        What the process is to end with then.

    """

    def __init__(self, output: Path | None = None) -> None:
        self.asked = False
        self.code = 0
        self._output = output

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            kept = f'; {self._output} is incomplete' if self._output else ''
            raise Interrupted(f'interrupted twice{kept}', 128 + number)
        self.asked, self.code = True, 128 + number

    def __enter__(self) -> Interrupt:
        self._previous = [signal.getsignal(number) for number in SIGNALS]
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                signal.signal(number, self._ask)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if threading.current_thread() is threading.main_thread():
            for number, previous in zip(SIGNALS, self._previous):
                signal.signal(number, previous)
