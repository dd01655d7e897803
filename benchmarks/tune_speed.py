"""
``rovid tune`` against one replay of the same log; ``python -m benchmarks.tune_speed``.

Whole commands in turn, reading included: 10 minutes of the simulated vehicle with 3 DOFs, and
about a thousand candidates of cutoff and gains.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
from time import perf_counter

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / 'config' / 'jhurov.yaml'
DURATION = 600.0  # [s]
ASKED = 3.0
"""Replays that tuning may take."""


def command(*arguments: object) -> float:
    """Run ``rovid`` and return the time that it took [s]."""
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'PYTHONPATH': os.pathsep.join(
        filter(None, [str(ROOT), os.environ.get('PYTHONPATH', '')]))}
    began = perf_counter()
    subprocess.run([sys.executable, '-m', 'rovid_ros.cli', *map(str, arguments)],
                   env=environment, stdout=subprocess.DEVNULL, check=True)
    return perf_counter() - began


def measure(folder: Path, runs: int) -> dict[str, list[float]]:
    """Return the times of the two commands [s]."""
    log, parameters = folder / 'log.mcap', folder / 'aid.yaml'
    text = CONFIG.read_text(encoding='utf-8').replace('method: ekf ', 'method: aid ', 1)
    parameters.write_text(text, encoding='utf-8')
    command('simulate', '--params-file', parameters, '--duration', DURATION, '--output', log)
    works = {
        'rovid replay': ('replay', log, '--params-file', parameters,
                         '--json', folder / 'found.json'),
        'rovid tune': ('tune', log, '--params-file', parameters,
                       '--output', folder / 'tuned.yaml')}
    found: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(runs):
        for name, arguments in works.items():
            found[name].append(command(*arguments))
    return found


def table(found: dict[str, list[float]]) -> str:
    """Return the times and their ratio as Markdown."""
    base = found['rovid replay']
    lines = ['| command | time [s] | ratio | lowest to highest |', '|---|---|---|---|']
    for name, times in found.items():
        each = [a / b for a, b in zip(times, base)]
        lines.append(f'| {name} | {median(times):.2f} | {median(times) / median(base):.2f} | '
                     f'{min(each):.2f} to {max(each):.2f} |')
    return '\n'.join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=5)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder), given.runs)
    print(f'{DURATION:.0f} s of log, 3 DOFs, {given.runs} runs in turn; asked for: '
          f'{ASKED:g}\n\n{table(found)}')


if __name__ == '__main__':
    main()
