"""Work that takes a while: a progress bar, and the same work on many things on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import os
import signal
import sys
import time
from typing import Any, TextIO, TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

Given = TypeVar('Given')
Made = TypeVar('Made')

BAR_WIDTH = 30  # [characters]
POLL_PERIOD = 0.1  # [s] between two looks at what the workers have done


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
        full = round(done * BAR_WIDTH)
        line = f'{self._label}  [{"#" * full}{"." * (BAR_WIDTH - full)}] {100.0 * done:3.0f} %'
        if done > 0.02:
            line += f'  {(now - self._start) * (1.0 - done) / done:.0f} s left'
        self._draw(line)

    def close(self) -> None:
        """Wipe the bar, so that what follows starts on a clean line."""
        if self._width:
            self._draw('', '\r')

    def _draw(self, line: str, end: str = '') -> None:
        try:
            self._stream.write(f'\r{line:<{self._width}}{end}')
            self._stream.flush()
            self._width = len(line)
        except OSError:  # the terminal is gone, the work goes on
            self._visible, self._width = False, 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class WorkerError(ValueError):
    """A process that worked on a part is gone; the text is the line to print."""


def in_parallel_with_progress(label: str, work: Callable[[Given], Made],
                              given: Sequence[Given]) -> list[Made]:
    """Return ``work`` of each, in order, and show a progress bar meanwhile."""
    done = 0
    with Progress(label, lambda: done / len(given)) as progress:
        def tick(count: int) -> None:
            nonlocal done
            done = count
            progress.tick()

        return in_parallel(work, given, tick)


def in_parallel(work: Callable[[Given], Made], given: Sequence[Given],
                tick: Callable[[int], None], workers: int | None = None) -> list[Made]:
    """
    Return ``work`` of each, in order; with one core, or no fork, it is done one by one.

    What it reaches is shared with the workers as it is now; what it changes is lost. ``tick`` is
    told now and then how many are done. There is a process per core, or ``workers``. Raises
    WorkerError if the system ended one; what ``work`` raises comes out as it is.
    """
    workers = min(len(given), _cores() if workers is None else workers)
    if workers < 2:
        made = []
        for one in given:
            made.append(work(one))
            tick(len(made))
        return made
    with _pool(workers, lambda k: work(given[k])) as pool:
        # workers begin here and leave Ctrl-C to their parent, who ends them
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            futures = [pool.submit(_work_on, k) for k in range(len(given))]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        _await(futures, tick)
        return [future.result() for future in futures]


def _cores() -> int:
    """Return how many cores this process may use; 1 where it can not be forked safely."""
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else 1


@contextmanager
def _pool(workers: int, work: Callable[[int], Any]) -> Iterator[ProcessPoolExecutor]:
    """Provide processes, which are gone afterwards, whatever happens."""
    # here, as most commands start sooner without
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool
    import multiprocessing
    before = multiprocessing.active_children()
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context('fork'), _begin, (work,))
    try:
        yield pool
        pool.shutdown()
    except BrokenProcessPool:
        raise WorkerError(
            'a process of this command was ended by the system; is the memory full?') from None
    finally:
        mine = [child for child in multiprocessing.active_children() if child not in before]
        for child in mine:
            child.terminate()
        # waits for its thread, which while Python ends would lose its pipes
        pool.shutdown(cancel_futures=True)
        for child in mine:
            child.join()


def _await(futures: Sequence[Future[Any]], tick: Callable[[int], None]) -> None:
    from concurrent.futures import wait
    pending = set(futures)
    while pending:
        done, pending = wait(pending, POLL_PERIOD)
        for future in done:
            future.result()  # what went wrong ends it at once
        tick(len(futures) - len(pending))


_work: Callable[[int], Any]


def _begin(work: Callable[[int], Any]) -> None:
    """Begin a worker."""
    global _work
    _work = work
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _work_on(k: int) -> Any:
    return _work(k)
