"""The same work on many things, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import multiprocessing
import os
import signal
from typing import Any, TypeVar

Given = TypeVar('Given')
Made = TypeVar('Made')

LOOK = 0.1  # [s] between two looks at what is done


class WorkerError(ValueError):
    """A process that worked on a part is gone; the text is the line to print."""


def in_parallel(work: Callable[[Given], Made], given: Sequence[Given],
                tick: Callable[[int], None], workers: int | None = None) -> list[Made]:
    """
    Return ``work`` of each, in order; with one core, or no fork, it is done one by one.

    Parameters
    ----------
    work : callable
        What it reaches is shared with the workers as it is now; what it changes is lost.
    given : sequence
        What to work on.
    tick : callable
        Told now and then how many are done.
    workers : int, optional
        Number of processes; one per core if it is not given.

    Raises
    ------
    WorkerError
        If the system ended a worker; what ``work`` raises comes out as it is.

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
    before = multiprocessing.active_children()
    pool = ProcessPoolExecutor(
        workers, multiprocessing.get_context('fork'), _begin, (work,))
    try:
        yield pool
        pool.shutdown()
    except BrokenProcessPool:
        raise WorkerError(
            'a process of this command was ended by the system; is the memory full?') from None
    finally:
        mine = [child for child in multiprocessing.active_children() if child not in before]
        pool.shutdown(wait=False, cancel_futures=True)
        for child in mine:
            child.terminate()
        for child in mine:
            child.join()


def _await(futures: Sequence[Future[Any]], tick: Callable[[int], None]) -> None:
    pending = set(futures)
    while pending:
        done, pending = wait(pending, LOOK)
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
