"""
Tell what somebody gets from a log that nobody has configured.

``rovid init``, ``check`` and ``replay`` go over each log as it is, with the parameter file that
``init`` wrote, in processes of their own. Beside it stands the file that the user of the vehicle
wrote: the topics that are others, what else is written otherwise, and the fit of the model on its
own log with either. Whatever the keys are, velocity and force of a DOF have to come out alike:
the table has their correlations, and the size of the force over that of the user's file, by which
the mass differs where all else is right. Both the other way is another choice of axes, one alone
a wrong sign. Of the simulated examples the table says the true mass, too. A log whose commands
fail or whose topics or signs are wrong makes the exit code 1.

Usage: python -m benchmarks.accuracy.first_hour [FOLDER] [--seeds N] [--only NAME]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import json
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rovid_core.settings.run import Settings
from rovid_ros.commands.examples import example_truth, EXAMPLES
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.accuracy.recordings import RECORDINGS
from benchmarks.markdown import table
from test.support.tank import measured
from test.support.trials import CONFIG

TANK = ('surge_sway_heave.mcap', 'all_axes.mcap', 'short_all_axes.mcap')


class Dive(NamedTuple):
    """A log, the configuration of its user, and the true masses where they are known."""

    name: str
    log: Path
    user: Path
    masses: dict[str, float]


def rovid(*arguments: object) -> int:
    """Run a command; return its exit code."""
    done = subprocess.run([sys.executable, '-m', 'rovid_ros.commands', *map(str, arguments)],
                          capture_output=True, text=True, check=False)
    if done.returncode:
        print(f'rovid {" ".join(map(str, arguments))}: {done.stderr.strip()}', file=sys.stderr)
    return done.returncode


def examples(folder: Path, seeds: int, only: str) -> Iterator[Dive]:
    """Simulate the examples whose name has a word."""
    for name in [name for name in EXAMPLES if only in f'example {name}']:
        truth = example_truth(name).simulation.dofs
        for seed in range(1, seeds + 1):
            log = folder / f'{name}_{seed}.mcap'
            if rovid('simulate', '--example', name, '--seed', seed, '--output', log):
                raise SystemExit(f'{name} could not be simulated')
            yield Dive(f'example {name}, seed {seed}', log, log.with_suffix('.yaml'),
                       {dof: true.mass for dof, true in truth.items()})


def recorded(tank: Path) -> Iterator[Dive]:
    """Find the recordings that are there."""
    for name in TANK:
        yield Dive(f'bluerov2_tank, {Path(name).stem}', tank / name,
                   CONFIG / 'bluerov2_tank.yaml', {})
    for vehicle, (configuration, names) in RECORDINGS.items():
        folder = tank.parent / vehicle
        if folder.is_dir():
            for name in names:
                yield Dive(f'{vehicle}, {Path(name).stem}', folder / name,
                           folder / configuration, {})


class Likeness(NamedTuple):
    """How velocity and force of a DOF agree with those by the user's file."""

    velocity: float  # correlation
    force: float
    size: float  # of the force

    @property
    def signs_agree(self) -> bool:
        """Tell whether the vehicle goes where it is pushed by one file as by the other."""
        return self.velocity * self.force > 0.0


def likeness(log: Path, made: Settings, user: Settings) -> dict[str, Likeness]:
    """Return how the DOFs that both files have agree."""
    ours, theirs = [measured(log.parent, log.name, settings) for settings in (made, user)]
    found = {}
    for dof in set(made.dofs) & set(user.dofs):
        times, velocities, forces = map(np.array, ours.series(dof))
        others = [np.array(values) for values in theirs.series(dof)]
        at = others[0][(others[0] >= times[0]) & (others[0] <= times[-1])]
        v, w, f, g = [np.interp(at, where, values) for where, values in (
            (times, velocities), (others[0], others[1]), (times, forces), (others[0], others[2]))]
        found[dof] = Likeness(float(np.corrcoef(v, w)[0, 1]), float(np.corrcoef(f, g)[0, 1]),
                              float(np.std(f) / np.std(g)))
    return found


def topic(settings: Settings, name: str) -> str:
    """Return the topic of an input, '' if it is not used."""
    if name not in settings.used_inputs():
        return ''
    return settings.thrusters.topics[0] if name == 'thrusters' else settings.input(name).topic


def differences(made: Settings, user: Settings) -> str:
    """Return what of the user's configuration ``init`` has written otherwise."""
    pairs: list[tuple[str, Any, Any]] = [
        ('dofs', ' '.join(made.dofs), ' '.join(user.dofs)),
        ('yaw_offset', made.yaw_offset, user.yaw_offset)]
    for name in sorted({*made.used_inputs(), *user.used_inputs()} - {
            'reference', 'thrusters'}):
        if not (topic(made, name) and topic(user, name)):
            pairs.append((name, topic(made, name), topic(user, name)))
            continue
        pairs += [(f'{name}.frames', made.frames_of(name), user.frames_of(name)),
                  (f'{name}.latency', made.input(name).latency, user.input(name).latency)]
    pairs += [(f'{dof}.couplings', ' '.join(made.couplings(dof)), ' '.join(user.couplings(dof)))
              for dof in user.dofs if dof in made.dofs]
    return '; '.join(f'{key} {one or "none"} ({other or "none"})' for key, one, other in pairs
                     if one != other)


def replay(log: Path, yaml: Path, output: Path) -> tuple[int, dict[str, Any]]:
    """Return the exit code and what came out of each DOF."""
    code = rovid('replay', log, '--params-file', yaml, '--json', output)
    return code, {} if code else json.loads(output.read_text())['dofs']


def percent(found: dict[str, Any], dof: str) -> str:
    """Return the fit of a DOF."""
    fit = found.get(dof, {}).get('fit')
    return '' if fit is None else f'{100 * fit:.0f}'


def row(dive: Dive, folder: Path) -> tuple[bool, list[list[str]]]:
    """Return whether a log went as asked, and the lines of the table."""
    yaml = folder / f'{dive.name}.yaml'
    codes = [rovid('init', dive.log, '--output', yaml)]
    if codes[0]:
        return False, [[dive.name, f'init: exit code {codes[0]}', *[''] * 10]]
    codes.append(rovid('check', yaml, dive.log))
    code, found = replay(dive.log, yaml, folder / f'{dive.name}.json')
    codes.append(code)
    made, user = settings_from(load(yaml)), settings_from(load(dive.user))
    _, theirs = replay(dive.log, dive.user, folder / f'{dive.name}.user.json')
    wrong = [name for name in user.used_inputs()
             if topic(made, name) not in ('', topic(user, name))]
    alike = likeness(dive.log, made, user)
    right = not any(codes) and not wrong and all(one.signs_agree for one in alike.values())
    head = [dive.name, f'exit codes {codes}' if any(codes) else 'run', ', '.join(wrong) or 'right']
    otherwise = differences(made, user)
    lines = []
    for dof, one in found.items():
        low, high = one['intervals']['mass'] or (None, None)
        mass = f'{one["mass"]:.3g}' if one['mass'] is not None else ''
        if low is not None and high is not None:
            mass += f' [{low:.3g}, {high:.3g}]'
        lines.append([
            *head, dof,
            *([f'{value:.2f}' for value in alike[dof]] if dof in alike else [''] * 3),
            f'{percent(found, dof)} ({percent(theirs, dof)})', mass,
            f'{dive.masses[dof]:.3g}' if dof in dive.masses else '', one['status'], otherwise])
        head, otherwise = [''] * 3, ''
    return right, lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('folder', type=Path, nargs='?', help='of the tank recordings')
    parser.add_argument('--seeds', type=int, default=1, help='of each example')
    parser.add_argument('--only', default='', metavar='NAME')
    given = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        dives = [*examples(folder, given.seeds, given.only),
                 *(recorded(given.folder) if given.folder else ())]
        dives = [dive for dive in dives if given.only in dive.name]
        with ThreadPoolExecutor(2) as pool:
            done = list(pool.map(lambda dive: row(dive, folder), dives))
    right = sum(good for good, _ in done)
    print(f'{right} of {len(done)} logs: all three commands run, on the right topics, with the '
          "right signs. In brackets what the user's own file gives or says.\n")
    print(table(('log', 'commands', 'topics', 'DOF', 'velocity', 'force', 'its size',
                 'own fit [%]', 'mass [interval]', 'true mass', 'status', 'written otherwise'),
                [line for _, lines in done for line in lines]))
    if right < len(done):
        raise SystemExit(1)


if __name__ == '__main__':
    main()
