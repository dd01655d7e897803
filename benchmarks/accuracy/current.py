"""
Tell how the ekf does in water that moves, and with slow fixes.

Two planar vehicles with the Coriolis forces of their masses, one as large as a BlueROV2 and one
as large as the paper's, go along a box, circles or a lawn-mower pattern, or keep one heading, all
with changing thrust in surge and sway, in a current whose direction differs from seed to seed.
The guess is wrong by 1.5 to 2. The table says, of surge and sway together, the rms error of the
mass and of the quadratic drag, in how many of all intervals (of the lumped parameters, of the
coupling and of the delay) the truth lies, the median relative width of the mass (one standard
deviation), the rms error of the current and how often its intervals hold it, and how
often the status is ``converged`` in the end, and in which share of all steps with the mass
outside of its interval.

Usage: python -m benchmarks.accuracy.current [RECORDINGS] [--seeds N] [--only PATTERN] [--short]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
import math
from pathlib import Path
import re
from typing import NamedTuple

import numpy as np
from rovid_core.identify.estimate import Estimate
from rovid_core.model.plant import lumped, physical
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.coupled_plant import Water
from rovid_core.simulation.profiles import Profile, Sinusoid, Steps
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.markdown import table
from test.support.tank import replayed
from test.support.trials import CONFIG

VEHICLES = {
    'BlueROV2': {'surge': SimulatedDof(17.6, 18.2, 4.0), 'sway': SimulatedDof(24.2, 21.7, 6.2),
                 'yaw': SimulatedDof(0.5, 1.6, 0.1)},
    'JHU': {'surge': SimulatedDof(520.0, 400.0, 60.0), 'sway': SimulatedDof(620.0, 600.0, 80.0),
            'yaw': SimulatedDof(110.0, 80.0, 20.0)},
}
THRUST = {'BlueROV2': (12.0, 12.0, 0.8), 'JHU': (150.0, 150.0, 25.0)}
"""[N, N m]"""

COUPLINGS = {'surge': ('vr',), 'sway': ('ur',), 'yaw': ('v', 'uv')}


class Case(NamedTuple):
    """A vehicle, how it goes, and what measures it."""

    vehicle: str = 'BlueROV2'
    path: str = 'box'
    current: float = 0.2  # [m/s]
    prior: float = 0.3  # [m/s]
    input: str = 'position'
    rate: float = 10.0  # [Hz]
    noise: float = 0.005  # [m] or [m/s]
    duration: float = 300.0  # [s]
    turn: float = 0.0  # [s] in which the current turns once
    tide: float = 0.0  # [s] in which it comes and goes

    @property
    def name(self) -> str:
        """Return it in words, for ``--only``."""
        return (f'{self.vehicle}, {self.path}, {self.current:g} m/s, prior {self.prior:g}, '
                f'{self.input} {self.rate:g} Hz {self.noise:g}'
                f'{", turn" if self.turn else ""}{", tide" if self.tide else ""}')


CASES = (
    *[Case(vehicle, 'box', current) for vehicle in VEHICLES for current in (0.0, 0.05, 0.2, 0.4)],
    *[Case(vehicle, path, current) for vehicle in VEHICLES
      for path in ('circles', 'lawn-mower') for current in (0.0, 0.2)],
    *[Case(vehicle, 'box', 0.0, 0.0) for vehicle in VEHICLES],
    *[Case(vehicle, 'one heading', duration=200.0) for vehicle in VEHICLES],
    *[Case(vehicle, 'box', rate=1.0, noise=noise, duration=duration)
      for vehicle in VEHICLES for noise, duration in ((0.1, 600.0), (0.3, 900.0))],
    Case(rate=0.2, noise=0.3, duration=1800.0),
    *[Case(vehicle, input='velocity', noise=0.01) for vehicle in VEHICLES],
    Case(turn=600.0, duration=600.0),
    Case(tide=3600.0, duration=600.0),
)


class Result(NamedTuple):
    """What is said in the end."""

    mass: list[float]  # relative errors
    drag: list[float]
    width: list[float]
    held: list[bool]
    current: list[float]  # [m/s]
    current_held: list[bool]
    status: str
    converged: float  # shares
    wrong: float


def pushes(case: Case) -> Profile:
    """Return the thrust."""
    a, b, c = THRUST[case.vehicle]
    slow = 1.0 if case.vehicle == 'BlueROV2' else 2.0
    legs = (Steps((0.8 * a, 0.5 * a, 0.9 * a, 0.3 * a), 9.0 * slow), Sinusoid(
        0.2 * a, 0.11 / slow))
    sides = (Steps((0.0, 0.6 * b, -0.5 * b), 6.0 * slow), Sinusoid(0.2 * b, 0.15 / slow))
    if case.path == 'box':
        return {'surge': (Steps((0.8 * a, 0.5 * a, 0.9 * a, 0.3 * a, -0.3 * a), 7.0 * slow),
                          Sinusoid(0.3 * a, 0.13 / slow)),
                'sway': (Steps((0.0, 0.7 * b, -0.4 * b, 0.0, -0.8 * b, 0.4 * b), 5.0 * slow),
                         Sinusoid(0.2 * b, 0.17 / slow)),
                'yaw': (Steps((0.0, 0.0, 0.0, 0.6 * c), 4.0 * slow), Sinusoid(
                    0.15 * c, 0.11 / slow))}
    if case.path == 'circles':
        return {'surge': (Steps((0.8 * a, 0.4 * a), 15.0 * slow), Sinusoid(0.4 * a, 0.07 / slow)),
                'sway': (Sinusoid(0.5 * b, 0.05 / slow), Sinusoid(0.3 * b, 0.13 / slow)),
                'yaw': (Steps((0.35 * c, 0.3 * c), 20.0 * slow),)}
    if case.path == 'lawn-mower':
        turns = (*[0.0] * 9, 0.6 * c, *[0.0] * 9, -0.6 * c)
        return {'surge': legs, 'sway': sides, 'yaw': (Steps(turns, 4.0 * slow),)}
    return {'surge': legs, 'sway': sides, 'yaw': ()}


def configured(case: Case, seed: int) -> Settings:
    """Return the settings of a run."""
    truth = VEHICLES[case.vehicle]
    if case.path == 'one heading':
        truth = {**truth, 'yaw': SimulatedDof(1e3, 1e6, 1e6)}
    angle = 2.4 * seed
    used = InputSettings(topic='/measured', type='t', field='f')
    return replace(Settings(
        dofs=('surge', 'sway'),
        dof={d: DofSettings(1.5 * t.mass, t.quadratic_drag / 1.8, t.linear_drag / 2.0,
                            couplings=COUPLINGS[d]) for d, t in truth.items()},
        position=InputSettings(topic='/p', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        max_gap=max(1.0, 2.5 / case.rate),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 6,
            timeout=max(1.0, 3.0 / case.rate),
            allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
        identifier=IdentifierSettings(method='ekf'), current=CurrentSettings(prior=case.prior),
        simulation=SimulationSettings(
            dofs=truth, coriolis=True, current_turn=case.turn, current_tide=case.tide,
            current=(case.current * math.cos(angle), case.current * math.sin(angle)),
            position_rate=case.rate, position_noise=case.noise, velocity_rate=case.rate,
            velocity_noise=case.noise)),
        **{'position': InputSettings(), case.input: used})


def identify(seed: int, case: Case) -> Result:
    """Identify one log."""
    settings = configured(case, seed)
    stream = Stream(settings)
    said = []
    for time, name, value in simulate(settings, case.duration, seed, pushes(case)):
        said += [(dof.status == 'converged', _holds(settings, one))
                 for one in stream.receive(Event(time, (Sample(name, value),)))
                 for dof in one.dofs]
    stream.finish()
    assert stream.estimate is not None
    water = Water(settings.simulation).at(case.duration)
    return _judged(settings, stream.estimate, water, said)


def _holds(settings: Settings, estimate: Estimate) -> bool:
    """Tell whether the interval of each converged mass holds it."""
    return all(low <= settings.simulation.dofs[dof.dof].mass <= high
               for dof in estimate.dofs if dof.status == 'converged'
               for low, high in [dof.intervals.get('mass', (-math.inf, math.inf))])


def _judged(settings: Settings, last: Estimate, water: Sequence[float],
            said: Sequence[tuple[bool, bool]]) -> Result:
    found = Result([], [], [], [], [], [], last.current.status if last.current else 'off',
                   float(np.mean([converged for converged, _ in said])),
                   float(np.mean([not held for _, held in said])))
    masses = [settings.simulation.dofs[d].mass for d in ('surge', 'sway')]
    ratios = {'surge': masses[1] / masses[0], 'sway': -masses[0] / masses[1]}
    for dof in last.dofs:
        true = settings.simulation.dofs[dof.dof]
        mass, drag, *_ = physical(dof.parameters)
        found.mass.append(mass / true.mass - 1.0)
        found.drag.append(drag / true.quadratic_drag - 1.0)
        found.width.append(dof.std[0] / dof.parameters[0])
        truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        values = [*zip(dof.parameters, truth, dof.std),
                  (dof.couplings[0], ratios[dof.dof], dof.couplings_std[0]),
                  (dof.delay, 0.0, dof.delay_std)]
        found.held.extend([abs(p - t) <= 1.96 * std for p, t, std in values])
    if last.current is not None:
        errors = [a - b for a, b in zip(last.current[:2], water)]
        found.current.extend(errors)
        found.current_held.extend(
            [abs(e) <= 1.96 * std for e, std in zip(errors, last.current.std)])
    return found


def _row(case: Case, runs: Sequence[Result]) -> tuple[str, ...]:
    def rms(values: Sequence[Sequence[float]]) -> float:
        return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else math.nan

    moves = f'{case.current:g}' + (f', turns in {case.turn:g} s' if case.turn else '') + (
        f', tide of {case.tide:g} s' if case.tide else '')
    sensor = 'DVL' if case.input == 'velocity' else 'fixes'
    known = case.prior > 0.0
    return (
        case.vehicle, case.path, moves, 'yes' if known else 'no',
        f'{sensor}, {case.rate:g} Hz, {100 * case.noise:g} cm{"/s" if sensor == "DVL" else ""}',
        f'{case.duration:g}',
        f'{100 * rms([run.mass for run in runs]):.2f}',
        f'{100 * rms([run.drag for run in runs]):.2f}',
        f'{100 * float(np.mean([run.held for run in runs])):.0f}',
        f'{100 * float(np.median([run.width for run in runs])):.2f}',
        f'{100 * rms([run.current for run in runs]):.2f}' if known else '',
        f'{100 * float(np.mean([run.current_held for run in runs])):.0f}' if known else '',
        ', '.join(dict.fromkeys(run.status for run in runs)),
        f'{100 * float(np.mean([run.converged for run in runs])):.0f}',
        f'{100 * float(np.mean([run.wrong for run in runs])):.1f}')


def of_recordings(logs: Path) -> list[tuple[str, ...]]:
    """Identify two recordings of a tank with and without a current; return the rows."""
    rows = []
    names = 'surge_sway_heave', 'all_axes'
    for prior in (0.0, 0.3):
        settings = replace(settings_from(load(CONFIG / 'bluerov2_tank.yaml')),
                           current=CurrentSettings(prior=prior))
        found = {name: replayed(logs, f'{name}.mcap', settings) for name in names}
        for name, other in (names, names[::-1]):
            last = found[name][1]
            c = last.current
            fits = [found[other][0].score(
                dof.dof, (*dof.parameters, *dof.couplings), dof.delay, dof.thrusters).fit
                    for dof in last.dofs[:2]]
            rows.append((name, f'{prior:g}', *[f'{100.0 * fit:.1f}' for fit in fits], *(
                [f'{100.0 * x:+.1f} +- {196.0 * std:.1f}' for x, std in zip(c[:2], c.std)]
                if c else ['', ''])))
    return rows


def main() -> None:
    """Identify all cases, and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('recordings', nargs='?', type=Path)
    parser.add_argument('--seeds', type=int, default=8)
    parser.add_argument('--only', default='', help='regular expression of the cases')
    parser.add_argument('--short', action='store_true', help='a tenth of the time')
    args = parser.parse_args()
    cases = [case._replace(duration=0.1 * case.duration) if args.short else case
             for case in CASES if re.search(args.only, case.name)]
    rows = []
    with ProcessPoolExecutor() as pool:
        for case in cases:
            runs = list(pool.map(partial(identify, case=case), range(args.seeds)))
            rows.append(_row(case, runs))
    print(f'ekf, {args.seeds} seeds, attitudes at 20 Hz with 2 mrad; errors of masses, drags and '
          'intervals in %, of the current in cm/s.\n')
    print(table(('vehicle', 'path', 'current [m/s]', 'estimated', 'measured by', '[s]',
                 'mass off', 'drag off', 'intervals hold', 'sd of the mass', 'current off',
                 'its intervals hold', 'status of the current', 'converged',
                 'converged, mass outside'), rows))
    if args.recordings is not None:
        print('\nTwo recordings of a tank, whose water is still, with and without a current: fit '
              'on the other recording in %, and the current in cm/s with its 95 % interval.\n')
        print(table(('recording', 'prior [m/s]', 'fit of surge', 'fit of sway', 'current x',
                     'current y'), of_recordings(args.recordings)))


if __name__ == '__main__':
    main()
