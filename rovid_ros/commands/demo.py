"""
What rovid does, without a vehicle: simulate one, identify it from its log, compare.

Run it with ``python -m rovid_ros.commands.demo``.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
import sys
from typing import Any

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.commands.replay import replay
from rovid_ros.commands.running import read_settings, run_to_exit_code
from rovid_ros.commands.simulate import simulate_log, truth
from rovid_ros.config.parameter_file import shipped_file
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.results.documents import dofs_document
from rovid_ros.results.text import NONE, percent, quantity, table

CONFIG = 'jhurov.yaml'
DURATION = 600.0  # [s]
Dofs = Mapping[str, Mapping[str, Any]]
NAMES = {'mass': 'effective mass'}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demonstration; returns the exit code."""
    parser = argparse.ArgumentParser(prog='python -m rovid_ros.commands.demo', description=__doc__)
    parser.add_argument('folder', nargs='?', type=Path, default=Path('build/demo'),
                        help='where to write the log (default: build/demo)')
    return run_to_exit_code(
        'rovid_ros.commands.demo', lambda: demo(parser.parse_args(argv).folder))


def demo(folder: Path, duration: float = DURATION) -> None:
    """Simulate ``duration`` [s], identify, and print what is true beside what was found."""
    settings = read_settings(shipped_file(CONFIG))
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / 'jhurov.mcap'
    print(f'1. Simulate {duration / 60.0:.3g} minutes of the vehicle in the shipped {CONFIG}:')
    count = simulate_log(settings, log, duration, seed=1)
    print(f'   {log}, {count:,} messages.\n')
    print('2. Identify it from this log, as the live node would:')
    player = PipelinePlayer(settings)
    found = replay([log], settings, player)
    print(f'   {found.steps:,} steps of {settings.identifier.method}.\n')
    guess = dofs_document(settings, None)
    print(table(_parameters(settings, found.dofs, guess), left=2))
    print('\n3. Both drags slow the vehicle down, and one can stand in for the other: what counts '
          'is how\n   well the model predicts. Its velocity from the thrust alone, v_sim, '
          'against the measured v\n   (mae = mean |v_sim - v|, fit = 1 - rms(v_sim - v) / '
          'std(v)):\n')
    print(table(_scores(found.dofs, guess, player.scores)))
    print('\nNext, your own vehicle, from a log of it:\n\n'
          '   rovid init YOUR_LOG --output YOUR_FILE.yaml\n'
          '   rovid replay YOUR_LOG --params-file YOUR_FILE.yaml')


def _parameters(settings: Settings, found: Dofs, guess: Dofs) -> list[list[str]]:
    true = {name: float(text) for name, text in truth(settings.simulation.dofs).items()}
    rows = [['', '', 'initial guess', 'identified', 'true', 'ratio']]
    for dof, values in found.items():
        for name in (*PHYSICAL, *PARAMETERS):
            exact = {name: true[f'{dof}.{name}']}
            ratio = f'{values[name] / exact[name]:.3f}' if exact[name] else NONE
            rows.append([
                dof if name == PHYSICAL[0] else '', NAMES.get(name, name.replace('_', ' ')),
                quantity(dof, name, guess[dof]), quantity(dof, name, values),
                quantity(dof, name, exact), ratio])
    return rows


def _scores(found: Dofs, guess: Dofs, scores: ScoreLog) -> list[list[str]]:
    rows = [['', 'mae, initial guess', 'fit', 'mae, identified', 'fit']]
    for dof, values in found.items():
        before = scores.score(dof, [guess[dof][name] for name in PARAMETERS])
        rows.append([
            dof, quantity(dof, 'mae', {'mae': before.mae}), percent(before.fit),
            quantity(dof, 'mae', values), percent(values['fit'])])
    return rows


if __name__ == '__main__':
    sys.exit(main())
