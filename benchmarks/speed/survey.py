"""
A survey of many dives is complete, whoever works; ``python -m benchmarks.speed.survey``.

The dives are those of the JHUROV over a season in which it gets fouled: the quadratic drag of
surge grows, nothing else does. Three more logs are broken. The same survey is made by one process,
by two, by two of which one is killed half-way, and by two workers of a Dask scheduler, of which
one is killed too. The time of the processor is that of all processes of the command.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time

from rovid_core.settings.run import Settings
from rovid_ros.commands.long_work import in_parallel
from rovid_ros.commands.running import read_settings
from rovid_ros.commands.simulate import EPOCH, simulate_log

from benchmarks.markdown import table

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / 'config' / 'jhurov.yaml'
CLI = (sys.executable, '-m', 'rovid_ros.commands')
DAY = 86400  # [s]
FOULED = 1.3
"""Of the quadratic drag of surge, at the end of the season."""
ASKED = 1.8


def make_dives(folder: Path, count: int, duration: float) -> None:
    """Simulate the dives, one a day, and break three more logs."""
    settings = read_settings(CONFIG)

    def dive(k: int) -> None:
        simulate_log(_fouled(settings, k / max(count - 1, 1)), folder / f'{k:03d}.mcap', duration,
                     k + 1, start=EPOCH + k * DAY * 10**9)

    in_parallel(dive, range(count), lambda done: None)
    whole = (folder / '000.mcap').read_bytes()
    (folder / 'cut.mcap').write_bytes(whole[:200])
    (folder / 'empty.mcap').write_bytes(b'')
    (folder / 'text.mcap').write_text('no log')


def _fouled(settings: Settings, share: float) -> Settings:
    """Return the vehicle at a share of the season."""
    truth = settings.simulation
    surge = truth.dofs['surge']
    surge = replace(surge, quadratic_drag=surge.quadratic_drag * (1 + (FOULED - 1) * share))
    return replace(settings, simulation=replace(truth, dofs={**truth.dofs, 'surge': surge}))


@contextmanager
def dask(folder: Path) -> Iterator[tuple[str, list[int]]]:
    """Run a scheduler and two workers on this computer; give address and processes of workers."""
    place = folder / 'scheduler.json'
    common = ('--scheduler-file', str(place), '--no-dashboard')
    commands = [('distributed.cli.dask_scheduler', '--host', '127.0.0.1', '--port', '0'), *[
        ('distributed.cli.dask_worker', '--nthreads', '1', '--host', '127.0.0.1',
         '--local-directory', str(folder))] * 2]
    processes = [subprocess.Popen([sys.executable, '-m', *command, *common], cwd=ROOT,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                 for command in commands]
    try:
        from distributed import Client
        while not place.exists():
            time.sleep(0.1)
        with Client(scheduler_file=str(place)) as client:
            client.wait_for_workers(2)
            address = client.scheduler.address
            yield address, list(client.run(os.getpid).values())
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def children(process: int) -> list[int]:
    """Return the processes that a process began and that run."""
    return [int(text) for text in Path(
        f'/proc/{process}/task/{process}/children').read_text(encoding='ascii').split()]


def survey(folder: Path, name: str, *arguments: str,
           victims: Callable[[int], list[int]] | None = None, half: float = 0.0,
           ) -> tuple[float, float, str]:
    """Run a survey, kill a worker after ``half`` [s]; return both times [s] and the table."""
    output = folder / f'{name}.csv'
    began = time.perf_counter()
    process = subprocess.Popen(
        [*CLI, 'survey', str(folder / 'dives'), '--params-file', str(CONFIG), '--output',
         str(output), *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'})
    if victims:
        def kill() -> None:
            os.kill(victims(process.pid)[0], signal.SIGKILL)
        threading.Timer(half, kill).start()
    _, status, usage = os.wait4(process.pid, 0)
    taken = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 1:  # for the broken logs
        raise SystemExit(f'survey {name} ended with {process.returncode}')
    return taken, usage.ru_utime + usage.ru_stime, output.read_text(encoding='utf-8')


def lines(count: int, duration: float) -> Iterator[str]:
    """Yield the table, and what it is of."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'dives').mkdir()
        make_dives(folder / 'dives', count, duration)
        one, own, expected = survey(folder, 'one', '--workers', '1')
        rows = [('1 process', one, own, expected),
                ('2 processes', *survey(folder, 'two', '--workers', '2'))]
        rows.append(('2 processes, one killed half-way', *survey(
            folder, 'killed', '--workers', '2', victims=children,
            half=rows[-1][1] / 2)))
        with dask(folder) as (address, workers):
            rows.append(('Dask, 2 workers', *survey(folder, 'dask', '--scheduler', address)))
            rows.append(('Dask, 2 workers, one killed half-way', *survey(
                folder, 'dask_killed', '--scheduler', address, victims=lambda _: workers,
                half=rows[-1][1] / 2)))
        load = os.getloadavg()[0]
        yield table(('', 'time [s]', 'of the processor [s]', 'speed-up', 'rows', 'failed',
                     'same table'), [
            (what, f'{taken:.0f}', '-' if 'Dask' in what else f'{used:.0f}', f'{one / taken:.2f}',
             text.count('\n') - 1,
             text.count(',failed,'), 'yes' if text == expected else 'NO')
            for what, taken, used, text in rows])
        printed = subprocess.run(
            [*CLI, 'survey', str(folder / 'dives'), '--params-file', str(CONFIG), '--output',
             str(folder / 'two.csv')], cwd=ROOT, capture_output=True, text=True, check=False)
        yield (f'\n{count} dives of {duration:.0f} s, and three broken logs; by the clock on the '
               f'wall, the load of the machine at the end {load:.1f}. Asked: a speed-up of '
               f'{ASKED:g} by two processes. The quadratic drag of surge grows by '
               f'{FOULED - 1:.0%} from the first dive to the last:\n\n```\n'
               f'{printed.stdout.partition("written")[0].strip()}\n```')


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--dives', type=int, default=200)
    parser.add_argument('--duration', type=float, default=40.0, help='[s] of each dive')
    given = parser.parse_args()
    print('\n'.join(lines(given.dives, given.duration)))
