"""
Tell how a method does on vehicles that move in all axes at once.

Two planar vehicles with the Coriolis forces of their masses are simulated with noisy fixes, an
attitude and thrust on all three axes at once: one as large as the paper's, with a mass matrix that
is not diagonal, and one as large as a BlueROV2. Each log is identified without couplings and with
those of ``docs/guide.md``. The table says, per DOF, how far the effective mass (to a force on this
DOF alone) and the quadratic drag are off, how often the 95 % interval of the mass holds the true
one, how often the status is ``converged`` in the end, and how often it is so with the true mass
outside, or off by more than 10 %. A method without intervals holds none.

Usage: python -m benchmarks.accuracy.coupled_vehicles [--seeds N] [--duration S] [--method M]
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.model.plant import physical
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.sensors import simulate

from benchmarks.markdown import table

COUPLINGS = {'surge': ('vr',), 'sway': ('ur',), 'yaw': ('v', 'uv')}
OFF_DIAGONAL = {'sway': ('yaw_thrust',), 'yaw': ('sway_thrust',)}
"""What those need besides whose mass matrix is not diagonal."""


def _matrix(planar: list[list[float]]) -> tuple[float, ...]:
    mass = np.zeros((6, 6))
    mass[np.ix_([0, 1, 5], [0, 1, 5])] = planar
    return tuple(mass.ravel().tolist())


VEHICLES = {
    "as the paper's, 520 to 620 kg": SimulationSettings(coriolis=True, mass_matrix=_matrix(
        [[520.0, -20.0, -5.0], [-20.0, 620.0, -40.0], [-5.0, -40.0, 110.0]]), dofs={
            'surge': SimulatedDof(520.0, 400.0, 60.0, 0.0, (150.0, 60.0), (0.05, 0.13)),
            'sway': SimulatedDof(620.0, 600.0, 80.0, 0.0, (150.0, 60.0), (0.07, 0.17)),
            'yaw': SimulatedDof(110.0, 80.0, 20.0, 0.0, (25.0, 10.0), (0.04, 0.11))}),
    'as a BlueROV2, 17 to 24 kg': SimulationSettings(coriolis=True, dofs={
        'surge': SimulatedDof(17.6, 18.2, 4.0, 0.0, (12.0, 6.0), (0.05, 0.13)),
        'sway': SimulatedDof(24.2, 21.7, 6.2, 0.0, (12.0, 6.0), (0.07, 0.17)),
        'yaw': SimulatedDof(0.5, 1.6, 0.1, 0.0, (0.8, 0.4), (0.04, 0.11))}),
}


class Result(NamedTuple):
    """What is said of one DOF in the end."""

    mass: float  # relative error
    drag: float
    held: bool
    converged: bool


def effective_mass(vehicle: str, dof: str) -> float:
    """Return the mass [kg or kg m^2] to a force on a DOF alone."""
    matrix = np.array(VEHICLES[vehicle].mass_matrix).reshape(-1, 6)
    if not matrix.any():
        return VEHICLES[vehicle].dofs[dof].mass
    moved = np.flatnonzero(matrix.diagonal())
    inverse = np.linalg.inv(matrix[np.ix_(moved, moved)])
    k = moved.tolist().index(DOFS.index(dof))
    return 1.0 / float(inverse[k, k])


def couplings_of(vehicle: str, dof: str) -> tuple[str, ...]:
    """Return the couplings that a DOF needs."""
    return COUPLINGS[dof] + (
        OFF_DIAGONAL.get(dof, ()) if VEHICLES[vehicle].mass_matrix else ())


def configured(vehicle: str, method: str, coupled: bool) -> Settings:
    """Return the settings of a run whose guess is wrong by 1.5 to 2."""
    simulation = VEHICLES[vehicle]
    return Settings(
        dofs=tuple(simulation.dofs),
        dof={d: DofSettings(1.5 * t.mass, t.quadratic_drag / 1.8, t.linear_drag / 2.0,
                            couplings=couplings_of(vehicle, d) if coupled else ())
             for d, t in simulation.dofs.items()},
        position=InputSettings(topic='/position', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 6,
            allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
        identifier=IdentifierSettings(method=method), simulation=simulation)


def identify(seed: int, vehicle: str, method: str, duration: float
             ) -> dict[tuple[bool, str], Result]:
    """Identify one log without and with couplings."""
    found = {}
    streams = {coupled: Stream(configured(vehicle, method, coupled)) for coupled in (False, True)}
    for time, name, value in simulate(streams[False].settings, duration, seed):
        for stream in streams.values():
            stream.receive(Event(time, (Sample(name, value),)))
    for coupled, stream in streams.items():
        stream.finish()
        assert stream.estimate is not None
        for dof in stream.estimate.dofs:
            true = VEHICLES[vehicle].dofs[dof.dof]
            mass, drag, *_ = physical(dof.parameters)
            low, high = dof.intervals.get('mass', (np.nan, np.nan))
            true_mass = effective_mass(vehicle, dof.dof)
            found[coupled, dof.dof] = Result(
                mass / true_mass - 1.0, drag / true.quadratic_drag - 1.0,
                bool(low <= true_mass <= high), dof.status == 'converged')
    return found


def main() -> None:
    """Identify all vehicles, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seeds', type=int, default=8)
    parser.add_argument('--duration', type=float, default=300.0)
    parser.add_argument('--method', default='ekf')
    args = parser.parse_args()
    rows = []
    with ProcessPoolExecutor() as pool:
        for vehicle in VEHICLES:
            work = partial(identify, vehicle=vehicle, method=args.method, duration=args.duration)
            runs = list(pool.map(work, range(args.seeds)))
            for coupled, dof in runs[0]:
                mass, drag, held, converged = (
                    np.array(column) for column in zip(*(run[coupled, dof] for run in runs)))
                rows.append((
                    vehicle, ', '.join(couplings_of(vehicle, dof)) if coupled else 'none', dof,
                    f'{100 * np.median(mass):+.1f}', f'{100 * np.abs(mass).max():.1f}',
                    f'{100 * np.median(drag):+.1f}', f'{100 * held.mean():.0f}',
                    f'{100 * converged.mean():.0f}',
                    f'{100 * (converged & ~held).mean():.0f}',
                    f'{100 * (converged & (np.abs(mass) > 0.1)).mean():.0f}'))
    print(f'{args.method}, {args.seeds} seeds, {args.duration:g} s, fixes at 10 Hz with 5 mm, '
          'attitudes at 20 Hz with 2 mrad; all numbers in %.\n')
    print(table(('vehicle', 'couplings', 'DOF', 'mass off: median', 'worst',
                 'quadratic drag off: median', 'interval holds the mass', 'converged',
                 'converged, mass outside', 'converged, mass off by over 10 %'), rows))


if __name__ == '__main__':
    main()
