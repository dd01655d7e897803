"""Whole commands, timed in turn, so that what else the machine does hits all alike."""

# this imports nothing large: a child's peak memory is never below its parent's

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import time
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
CLI = (sys.executable, '-m', 'rovid_ros.commands')
"""What ``rovid`` runs, with these sources."""


@dataclass
class Measured:
    """Processor times and times by the clock on the wall [s], and peak memory [MB]."""

    times: list[float] = field(default_factory=list)
    elapsed: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)


def environment() -> dict[str, str]:
    """Return that of the commands: this project, and no more threads than one."""
    own = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'PYTHONPATH': os.pathsep.join(
        filter(None, [str(ROOT), os.environ.get('PYTHONPATH', '')]))}
    own.pop('PYTHONDONTWRITEBYTECODE', None)  # an installed command is not compiled every time
    return own


class Usage(NamedTuple):
    """What a command took: by the clock on the wall and of the processor [s], and memory [MB]."""

    elapsed: float
    processor: float
    memory: float


def run(command: Sequence[object], own: Mapping[str, str]) -> Usage:
    """
    Run a command in an environment.

    Raises
    ------
    SystemExit
        If it fails.

    """
    began = time.perf_counter()
    child = subprocess.Popen([*map(str, command)], env=own, cwd=ROOT, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    elapsed = time.perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(f'{" ".join(map(str, command))}: exit code {child.returncode}')
    return Usage(elapsed, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)


def measure(commands: Mapping[str, Sequence[object]], runs: int) -> dict[str, Measured]:
    """
    Run all commands in turn, ``runs`` times.

    Processor time is that of a command and all that it started, and depends little on what else
    the machine does; the clock on the wall tells what several cores are worth.
    """
    found = {name: Measured() for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            usage = run(command, environment())
            found[name].times.append(usage.processor)
            found[name].elapsed.append(usage.elapsed)
            found[name].memory.append(usage.memory)
    return found


def ratios(one: Sequence[float], other: Sequence[float]) -> tuple[float, float, float]:
    """Return the median, lowest and highest ratio of the runs that were side by side."""
    each = [a / b for a, b in zip(one, other)]
    return median(each), min(each), max(each)


def table(found: Mapping[str, Measured], base: str) -> str:
    """Return times, ratios to ``base`` with their spread, and peak memory, as Markdown."""
    lines = ['| command | processor time [s] | ratio | lowest to highest | by the clock [s] | '
             'ratio | lowest to highest | peak memory [MB] |', '|---|---|---|---|---|---|---|---|']
    for name, one in found.items():
        cells = [name]
        for mine, other in ((one.times, found[base].times), (one.elapsed, found[base].elapsed)):
            middle, low, high = ratios(mine, other)
            cells += [f'{median(mine):.3g}', f'{middle:.2f}', f'{low:.2f} to {high:.2f}']
        lines.append(f'| {" | ".join(cells)} | {median(one.memory):.0f} |')
    return '\n'.join(lines)


def show(about: str | None, lines: Callable[[int], Sequence[str]], runs: int,
         arguments: Sequence[str] | None = None) -> None:
    """Print lines for as many runs as the command line says, ``runs`` if it says nothing."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument('--runs', type=int, default=runs)
    print('\n'.join(lines(parser.parse_args(arguments).runs)))
