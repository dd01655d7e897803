"""A progress bar for a person at a terminal; nothing for a pipe, a file or a quick run."""

from __future__ import annotations

from collections.abc import Callable
import sys
import time
from types import TracebackType
from typing import TextIO

BAR = 30  # characters


class Progress:
    """
    A bar on standard error that appears when the work takes over a second.

    Parameters
    ----------
    label : str
        What is being done, in a word or two.
    fraction : callable
        Returns how much is done, 0 to 1; called only when the bar is drawn.
    stream : file, optional
        Where to draw; nothing is drawn unless it is a terminal.
    delay : float
        Time [s] before the bar appears.

    """

    def __init__(self, label: str, fraction: Callable[[], float], *,
                 stream: TextIO | None = None, delay: float = 1.0) -> None:
        self._label = label
        self._fraction = fraction
        self._stream = sys.stderr if stream is None else stream
        self._visible = self._stream.isatty()
        self._start = time.monotonic()
        self._due = self._start + delay
        self._width = 0

    def tick(self) -> None:
        """Draw the bar if it is time to; cheap enough to call for every message."""
        if not self._visible:
            return
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + 0.1
        done = min(max(self._fraction(), 0.0), 1.0)
        full = round(done * BAR)
        line = f'{self._label}  [{"#" * full}{"." * (BAR - full)}] {100.0 * done:3.0f} %'
        if done > 0.02:
            line += f'  {(now - self._start) * (1.0 - done) / done:.0f} s left'
        self._draw(line)

    def close(self) -> None:
        """Wipe the bar, so that what follows starts on a clean line."""
        if self._width:
            self._draw('')
            self._stream.write('\r')
            self._stream.flush()

    def _draw(self, line: str) -> None:
        self._stream.write(f'\r{line:<{self._width}}')
        self._stream.flush()
        self._width = len(line)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
