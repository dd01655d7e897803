"""The live node as a program; signals are handled before anything slow is imported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import os
import signal
import sys
from threading import Thread
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """Turns SIGINT and SIGTERM into a flag."""

    def __init__(self) -> None:
        self.received = False
        self._waking: tuple[Thread, int] | None = None
        for number in SIGNALS:
            signal.signal(number, self._on_signal)

    def call_on_signal(self, wake: Callable[[], object]) -> None:
        """Have a thread call ``wake`` at the first signal, which alone ends no wait of rclpy."""
        reading, writing = os.pipe()
        os.set_blocking(writing, False)

        def wait_and_call() -> None:
            os.read(reading, 1)
            wake()

        thread = Thread(target=wait_and_call, daemon=True)
        thread.start()
        self._waking = thread, writing
        signal.set_wakeup_fd(writing)

    def ignore_signals(self) -> None:
        """Ignore all further signals: under a launch file SIGINT comes twice."""
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if self._waking:
            thread, writing = self._waking
            signal.set_wakeup_fd(-1)
            os.write(writing, b'.')  # a signal before call_on_signal has not written anything
            thread.join()
            self._waking = None

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.received = True


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    stop = StopRequest()
    # these imports take half a second, in which Ctrl-C would otherwise give a traceback
    from rovid_ros.commands.running import open_standard_files
    open_standard_files()  # before ROS opens anything
    from rovid_ros.node.node import IdentifierNode
    from rovid_ros.node.process import run
    return run(IdentifierNode, sys.argv if arguments is None else arguments, stop)


if __name__ == '__main__':
    sys.exit(main())
