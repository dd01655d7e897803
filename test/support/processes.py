"""The node as a process of its own: started, watched and stopped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

PATIENCE = 60.0
"""[s] Discovery takes up to 3 s, more on a busy machine."""

PAGE = os.sysconf('SC_PAGE_SIZE')
TICK = os.sysconf('SC_CLK_TCK')
REPOSITORY = Path(__file__).resolve().parents[2]


def child_environment() -> dict[str, str]:
    """
    Return the environment for a child process.

    The ROS wheels from PyPI start python twice, the second time with a library path and a
    guard. A child that inherits the guard uses the parent's libraries, or none: leave both
    out, and it finds its own.
    """
    child = dict(os.environ)
    if child.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None):
        child.pop('LD_LIBRARY_PATH', None)
    return child


@contextmanager
def patience(seconds: float = 20.0) -> Iterator[None]:
    """End what would wait for ever, such as for the other end of a pipe; that is a failure."""
    said: list[str] = []

    def give_up(number: int, frame: object) -> None:
        said.append(f'it is still waiting after {seconds} s')
        raise AssertionError(said[0])

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert not said, said  # what was raised in a callback may have become something else


def resident(pid: int | str = 'self') -> int:
    """Return the memory that a process holds [bytes]."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE


def cpu_time(pid: int | str = 'self') -> float:
    """Return the time that the cores have worked for a process [s]."""
    # the name in parentheses may hold spaces
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def run_time(pid: int | str) -> float:
    """Return the same of its present threads, to the microsecond [s]."""
    total = 0
    for task in Path(f'/proc/{pid}/task').iterdir():
        try:
            total += int((task / 'schedstat').read_text().split()[0])
        except OSError:  # it has just ended
            continue
    return total * 1e-9


class NodeProcess:
    """The node, or another module that takes its arguments, as its own process."""

    def __init__(self, arguments: Sequence[str | Path], environment: dict[str, str],
                 folder: Path, repository: Path, module: str = 'rovid_ros.node') -> None:
        self._stderr = folder / 'stderr'
        with self._stderr.open('w') as stderr:
            self.process = subprocess.Popen(
                [sys.executable, '-m', module, *map(str, arguments)],
                env=environment, cwd=repository, stdout=stderr, stderr=stderr)

    @property
    def output(self) -> str:
        return self._stderr.read_text()

    def wait(self) -> int:
        return self.process.wait(PATIENCE)

    def stop(self, *signals: int) -> int:
        """Send the signals, one right after the other, and return the exit code."""
        for number in signals or (signal.SIGINT,):
            self.process.send_signal(number)
            time.sleep(0.02)
        return self.wait()

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
