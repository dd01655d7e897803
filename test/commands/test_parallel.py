"""Work on all cores, and what ends it early."""

import multiprocessing
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest
from rovid_ros.commands.long_work import in_parallel, WorkerError

INTERRUPTED = """
import sys, time
from rovid_ros.commands.running import run_to_exit_code
from rovid_ros.commands.long_work import in_parallel
def work(k):
    print('begun', flush=True)
    time.sleep(60)
sys.exit(run_to_exit_code('rovid', lambda: in_parallel(work, [1, 2], lambda done: None, 2)))
"""


@pytest.mark.parametrize('workers', [1, 2])
def test_results_are_in_order_and_progress_is_told(workers: int) -> None:
    told: list[int] = []
    shared = [10, 20, 30]  # a closure, which no process could be sent
    assert in_parallel(lambda k: shared[k], [2, 0, 1], told.append, workers) == [30, 10, 20]
    assert told[-1] == 3
    assert told == sorted(told)
    assert in_parallel(lambda k: k, [], told.append, workers) == []
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize('workers', [1, 2])
def test_what_goes_wrong_comes_out_at_once(workers: int) -> None:
    def work(k: int) -> None:
        if k == 0:
            raise OSError(28, 'No space left on device')
        time.sleep(30 * (workers - 1))

    start = time.monotonic()
    with pytest.raises(OSError, match='No space left'):
        in_parallel(work, [0, 1], lambda done: None, workers)
    assert time.monotonic() - start < 10


def test_a_worker_that_is_killed_is_told() -> None:
    with pytest.raises(WorkerError, match='ended by the system'):
        in_parallel(lambda k: os.kill(os.getpid(), signal.SIGKILL), [0, 1], lambda done: None, 2)


def test_ctrl_c_ends_it_with_one_line_and_leaves_nobody(repository: Path) -> None:
    with subprocess.Popen([sys.executable, '-c', INTERRUPTED], cwd=repository, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith('begun')
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, err = process.communicate(timeout=20)  # until the last one has closed it
    assert (process.returncode, err) == (130, 'rovid: interrupted\n')
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
