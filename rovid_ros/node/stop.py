"""An orderly end of the node's process by a signal."""

from __future__ import annotations

from collections.abc import Callable
import os
import signal
from threading import Thread
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """
    Turns SIGINT and SIGTERM into a flag.

    Attributes
    ----------
    asked : bool
        Whether one has come.

    """

    def __init__(self) -> None:
        self.asked = False
        self._waking: tuple[Thread, int] | None = None
        for number in SIGNALS:
            signal.signal(number, self._ask)

    def wakes(self, wake: Callable[[], object]) -> None:
        """Have a thread call ``wake`` at the first signal: by itself it ends no wait of rclpy."""
        reading, writing = os.pipe()
        os.set_blocking(writing, False)

        def call() -> None:
            os.read(reading, 1)
            wake()

        thread = Thread(target=call, daemon=True)
        thread.start()
        self._waking = thread, writing
        signal.set_wakeup_fd(writing)

    def ignore(self) -> None:
        """Mind no more signals: under a launch file SIGINT comes twice."""
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if self._waking:
            thread, writing = self._waking
            signal.set_wakeup_fd(-1)
            os.write(writing, b'.')  # the signal may have come before all this
            thread.join()
            self._waking = None

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
