"""
Replay against reading alone.

``python -m benchmarks.speed.replay [--long HOURS] [--runs N]``

Whole commands, one after the other in turn, so that what else the machine does hits all alike:
``rovid replay`` to JSON by both methods, and with ``--output``; and rosbags' AnyReader of the same
file, with and without decoding, and the package mcap-ros2-support where it is installed. With
``--long`` replays of so many hours and of one. The logs are made once and kept in the folder for
temporary files.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import importlib.util
from pathlib import Path
import subprocess
import sys
import tempfile

from benchmarks.speed.commands import CLI, environment, measure, ROOT, table

FOLDER = Path(tempfile.gettempdir()) / 'rovid-benchmarks'
TOPICS = 'rov/params,rov/params_std,rov/identifier_state,rov/velocity,rov/model'
READ = """
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, data in reader.messages():
        {work}
"""
READ_MCAP = """
import sys
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
with open(sys.argv[1], 'rb') as file:
    for message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
        message.decoded_message
"""
BASE = 'AnyReader + deserialize'
ASKED = {'aid': 3.0, 'ekf': 4.5, 'aid --output': 7.0, 'ekf --output': 10.0}
"""By what ``rovid replay`` is given: processor time, as a multiple of ``BASE``."""


def log(hours: int) -> tuple[Path, Path]:
    """Return a log and its parameter file; make them if they are not there."""
    FOLDER.mkdir(exist_ok=True)
    path, parameters = FOLDER / f'{hours}h.mcap', FOLDER / 'aid.yaml'
    if not (path.exists() and parameters.exists()):
        print(f'making {path} ...', file=sys.stderr)
        subprocess.run([sys.executable, '-m', 'benchmarks.speed.long_log', str(hours), path,
                        parameters], check=True, cwd=ROOT, env=environment())
    return path, parameters


def replay(hours: int, method: str = 'aid', *more: object) -> list[str]:
    """Return the command."""
    path, parameters = log(hours)
    return [*CLI, 'replay', str(path), '--params-file', str(parameters), '--method', method,
            '--json', str(FOLDER / f'{hours}h.json'), *map(str, more)]


def replays() -> dict[str, list[str]]:
    """Return the commands of one hour by what is asked of them."""
    out = ('--output', FOLDER / 'out.mcap')
    return {f'rovid replay {name}': replay(1, name.split()[0], *more) for name, more in (
        ('aid', ()), ('ekf', ()), ('aid --output', out), ('ekf --output', out),
        ('aid --output, without rov/estimate', (*out, '--topics', TOPICS)))}


def decoding(path: Path) -> list[str]:
    """Return the command that reads and decodes all of a log with AnyReader."""
    return [sys.executable, '-c', READ.format(
        work='reader.deserialize(data, connection.msgtype)'), str(path)]


def readers(hours: int) -> dict[str, list[str]]:
    """Return the commands that only read."""
    path = str(log(hours)[0])
    programs = {'AnyReader raw': READ.format(work='pass')}
    if importlib.util.find_spec('mcap_ros2'):
        programs['mcap_ros2 decoded'] = READ_MCAP
    return {BASE: decoding(log(hours)[0]),
            **{name: [sys.executable, '-c', text, path] for name, text in programs.items()}}


def lines(runs: int) -> list[str]:
    """Return the tables of one hour, and what they are of."""
    found = measure({**replays(), **readers(1)}, runs)
    parts = subprocess.run(
        [sys.executable, '-m', 'benchmarks.speed.replay_parts', *map(str, log(1))],
        env=environment(), cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True)
    asked = ', '.join(f'`{name}` {ratio:g}' for name, ratio in ASKED.items())
    return [f'1 h, 360,000 messages, 3 DOFs, to JSON; whole commands, {runs} runs in turn. '
            f'Asked for, in processor time of {BASE}: {asked}.', '', table(found, BASE),
            '', parts.stdout.rstrip()]


def long_lines(runs: int, hours: int) -> list[str]:
    """Return the table of some hours against one, and what it is of."""
    found = measure({f'rovid replay, {length} h': replay(length) for length in (1, hours)}, runs)
    return [f'The same log as long as that, {runs} runs. Asked for: at most {1.05 * hours:g} '
            'times the time and 1.1 times the memory.', '', table(found, 'rovid replay, 1 h')]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--long', type=int, metavar='HOURS', help='so many against one')
    given = parser.parse_args(arguments)
    print('\n'.join(long_lines(given.runs, given.long) if given.long else lines(given.runs)))


if __name__ == '__main__':
    main()
