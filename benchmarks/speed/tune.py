"""
``rovid tune`` against one replay of the same log; ``python -m benchmarks.speed.tune``.

Whole commands in turn, reading included: 10 minutes of the simulated vehicle with 3 DOFs.
"""

from __future__ import annotations

from pathlib import Path
import tempfile

from benchmarks.speed.commands import CLI, measure, Measured, ROOT, show, table

CONFIG = ROOT / 'config' / 'jhurov.yaml'
DURATION = 600.0  # [s]
ASKED = 3.0
"""Replays that tuning may take."""


def measured(folder: Path, runs: int) -> dict[str, Measured]:
    """Return what the two commands take."""
    log, parameters = folder / 'log.mcap', folder / 'aid.yaml'
    text = CONFIG.read_text(encoding='utf-8').replace('method: ekf ', 'method: aid ', 1)
    parameters.write_text(text, encoding='utf-8')
    measure({'rovid simulate': (*CLI, 'simulate', '--params-file', CONFIG,
                                '--duration', DURATION, '--output', log)}, 1)
    return measure({
        'rovid replay': (*CLI, 'replay', log, '--params-file', CONFIG,
                         '--json', folder / 'found.json'),
        'rovid replay, aid': (*CLI, 'replay', log, '--params-file', parameters,
                              '--json', folder / 'found.json'),
        'rovid tune': (*CLI, 'tune', log, '--params-file', CONFIG,
                       '--output', folder / 'tuned.yaml')}, runs)


def lines(runs: int) -> list[str]:
    """Return the table, and what it is of."""
    with tempfile.TemporaryDirectory() as folder:
        found = measured(Path(folder), runs)
    return [f'{DURATION:.0f} s of log, 3 DOFs, `ekf`, {runs} runs in turn, reading included; '
            f'asked for: at most {ASKED:g} replays.', '', table(found, 'rovid replay')]


if __name__ == '__main__':
    show(__doc__, lines, 5)
