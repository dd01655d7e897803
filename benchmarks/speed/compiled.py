"""
What compiling is worth: the same commands in pure Python and compiled by mypyc, and their bits.

``python -m benchmarks.speed.compiled [--runs N]``

Installs these sources with ``ROVID_COMPILE=1`` into a folder of its own, which takes some minutes
and a C compiler. Then ``rovid replay`` of an hour of log by both methods, with and without
``--output``, in turn with the sources and with the installation, against reading and decoding of
the same log. What both write is compared byte by byte, but for the name of the build.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import os
from pathlib import Path
import re
import subprocess
import sys
from tempfile import TemporaryDirectory

from benchmarks.speed.commands import environment, measure, ROOT, show, table
from benchmarks.speed.replay import BASE, decoding, log

BUILDS = ('pure Python', 'compiled')
ASKED = {'aid': 1.2, 'ekf': 1.5, 'aid --output': 4.0, 'ekf --output': 5.0}
"""Processor time of the compiled build, as that of ``benchmarks.speed.replay``."""


def install(folder: Path) -> Path:
    """Install the compiled package into a folder; return it."""
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check',
         '--no-deps', '--target', folder, ROOT],
        check=True, env={**os.environ, 'ROVID_COMPILE': '1'})
    return folder


def written(folder: Path) -> dict[str, bytes]:
    """Return what the commands of a build wrote, without its name."""
    return {file.name: re.sub(rb'"rovid": "[^"]*"', b'', file.read_bytes())
            for file in folder.iterdir()}


def lines(folder: Path, runs: int) -> list[str]:
    """Return the tables and what they are of."""
    sources = dict(zip(BUILDS, (ROOT, install(folder / 'installed'))))
    path, parameters = log(1)
    commands: dict[str, Sequence[object]] = {}
    for build in BUILDS:
        (folder / build).mkdir()
        for name in ASKED:
            method, _, output = name.partition(' ')
            file = folder / build / method
            commands[f'rovid replay {name}, {build}'] = [
                # Python imports from the folder that it is started in before all others
                'env', '-C', sources[build], f'PYTHONPATH={sources[build]}', sys.executable, '-m',
                'rovid_ros.commands', 'replay', path, '--params-file', parameters, '--method',
                method, *([output, f'{file}.mcap'] if output else ['--json', f'{file}.json'])]
    commands[BASE] = decoding(path)
    found = measure(commands, runs)
    pure, compiled = (written(folder / build) for build in BUILDS)
    step = subprocess.run(
        ['env', f'PYTHONPATH={sources["compiled"]}{os.pathsep}{ROOT}', sys.executable,
         ROOT / 'benchmarks' / 'speed' / 'step.py'],
        env=environment(), stdout=subprocess.PIPE, check=True, text=True).stdout
    asked = ', '.join(f'`{name}` {ratio:g}' for name, ratio in ASKED.items())
    return [f'1 h, 360,000 messages, 3 DOFs; whole commands, {runs} runs in turn. JSON and MCAP '
            f'of both builds {"have" if pure == compiled else "DO NOT HAVE"} the same bytes. '
            f'Asked for where it is compiled, in processor time of {BASE}: {asked}.', '',
            table(found, BASE), '', 'One step, compiled:', '', step.split('\n\n')[1]]


if __name__ == '__main__':
    with TemporaryDirectory() as made:
        show(__doc__, partial(lines, Path(made)), 1)
