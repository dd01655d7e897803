"""
The same work on many things, by processes that may die: of this computer, or of a Dask cluster.

Both ways of working give their answers as soon as they are there, in any order, as index and what
came of it: what the work made, or the error that it ended with. A list without answers is given
now and then, so that the caller can look at other things.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
import multiprocessing
from multiprocessing.connection import Connection, wait
import os
import signal
import sys
import time
from typing import Any, TypeAlias, TypeVar

from rovid_ros.commands.long_work import POLL_PERIOD
from rovid_ros.commands.running import CommandError

ATTEMPTS = 4  # after so many workers died of the same thing it is given up, as Dask does
CONNECT = 10.0  # [s] in which a scheduler has to answer

Given = TypeVar('Given')
Answers: TypeAlias = Iterator[list[tuple[int, Any]]]


class WorkerDiedError(ValueError):
    """Work that ended its process each time."""


def on_this_computer(work: Callable[[Given], Any], given: Sequence[Given],
                     workers: int | None = None) -> Answers:
    """
    Work in a process of its own for each, ``workers`` (by default a core each) at a time.

    A process that dies costs another attempt. What runs when this ends is ended.
    """
    if not hasattr(os, 'sched_getaffinity'):  # where a process can not be forked safely
        for k, one in enumerate(given):
            yield [(k, _made(work, one))]
        return
    places = workers or len(os.sched_getaffinity(0))
    waiting = deque(range(len(given)))
    attempts: Counter[int] = Counter()
    running: dict[Any, tuple[Any, int]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < places:
                k = waiting.popleft()
                attempts[k] += 1
                answer, process = _begin(work, given[k])
                running[answer] = process, k
            answers = []
            ready: list[Any] = list(wait(list(running), POLL_PERIOD))
            for answer in ready:
                process, k = running.pop(answer)
                try:
                    answers.append((k, answer.recv()))
                except (EOFError, OSError):
                    if attempts[k] < ATTEMPTS:
                        waiting.append(k)
                    else:
                        answers.append((k, WorkerDiedError(
                            f'its process was ended {ATTEMPTS} times; is the memory full?')))
                answer.close()
                process.join()
            yield answers
    finally:
        for process, _ in running.values():
            process.kill()
        for process, _ in running.values():
            process.join()


def _begin(work: Callable[[Given], Any], one: Given) -> tuple[Connection, Any]:
    context = multiprocessing.get_context('fork')
    answer, place = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(place, work, one), daemon=True)
    # it leaves Ctrl-C to its parent, who ends it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    place.close()  # so that the end of the process is the end of the answer
    return answer, process


def _answer(place: Connection, work: Callable[[Given], Any], one: Given) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    sys.stderr = open(os.devnull, 'w', encoding='utf-8')  # no progress bar of its own
    made = _made(work, one)
    with suppress(OSError):  # nobody waits for it any more
        place.send(made)


def _made(work: Callable[[Given], Any], one: Given) -> Any:
    try:
        return work(one)
    except Exception as error:  # of any kind: it must not cost the others
        return error


def on_dask(address: str, work: Callable[[Given], Any], given: Sequence[Given]) -> Answers:
    """Work on the cluster of a scheduler, which gives the work of a dead worker to another."""
    try:
        distributed: Any = import_module('distributed')
    except ImportError:
        raise CommandError('--scheduler needs dask.distributed, which is not installed: '
                           "pip install 'rovid_ros[cluster]'") from None
    try:
        client = distributed.Client(address, timeout=CONNECT)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise CommandError(f'--scheduler {address}: no answer: {error}') from None
    numbers: dict[Any, int] = {}
    try:
        if not client.scheduler_info()['workers']:
            raise CommandError(f'--scheduler {address}: has no workers; start one with '
                               f'dask worker {address}')
        numbers |= {future: k for k, future in enumerate(client.map(work, given, pure=False))}
        done = distributed.as_completed(list(numbers))
        while done.count():
            batch = done.next_batch(block=False)
            if not batch:
                time.sleep(POLL_PERIOD)
            yield [(numbers[future], future.exception() or future.result()) for future in batch]
    finally:
        with suppress(Exception):  # a scheduler that is gone needs no farewell
            client.cancel(list(numbers))
        client.close()
