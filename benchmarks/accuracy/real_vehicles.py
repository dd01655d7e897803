"""
Tell how a method does on vehicles that are not exactly the model.

The plants are those of ``test.support.real_vehicles``. A table says, per kind of vehicle, how
far the mass is off, how often its 95 % interval holds the true one, how often the status says
``converged``, how often it says so with the true mass outside of the interval, or with a mass that
is off by more than 10 %, whether and when the vehicle is said to have changed, how often the
notes name what is missing, and what they say most often. With ``--configured`` the vehicles that
have what a configuration can say are given it: thrusters and couplings as they are.

Usage: python -m benchmarks.accuracy.real_vehicles [--seeds N] [--duration S] [--method M]
           [--configured]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import inf
import re

import numpy as np
from rovid_core.identify import make_identifier
from rovid_core.identify.intervals import intervals
from rovid_core.identify.method import Identifier
from rovid_core.identify.status import DofStatus
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales

from benchmarks.markdown import table
from test.support.real_vehicles import (
    couplings_of,
    GUESS,
    LINEAR,
    MASS,
    pieces,
    QUADRATIC,
    Vehicle,
    VEHICLES,
)

NAMES = {
    'dead-band 3 N': 'dead band', 'reverse thrust x 0.8': 'reverse thrust',
    'reverse drag x 1.3': 'reverse drag', 'lag 0.15 s': ' lag ',
    'turns lag 0.15 s': 'turns lag', 'turns lag 0.3 s': 'turns lag',
    'turns lag 0.2 s, closed loop': 'turns lag',
    'thrust that swings in at 6 rad/s, piloted': 'otherwise',
    'thrust that fades at 3 m/s': 'with speed', 'battery: thrust -15 % in 300 s': 'battery',
    'coupled': 'follows v r', 'zig-zag': 'follows v r'}
"""What is missing, in the words of the notes."""


@dataclass(frozen=True)
class Result:
    """What a method says of one drive."""

    errors: tuple[float, float]  # of mass and alpha: relative, and in standard deviations
    drag: float  # error of the force of the drag at the typical speed, relative
    held: bool
    converged: bool
    by_120: bool
    notes: tuple[str, ...]
    changed_at: float


def identify(identifier: Identifier, guess: DofSettings, vehicle: Vehicle, seed: int,
             duration: float, configured: bool) -> Result:
    """Let a method identify a vehicle, and look at what it says."""
    status = DofStatus(Scales.of(guess), 3.0)
    time, changed_at, by_120 = 0.0, inf, False
    notes: set[str] = set()
    for piece in pieces(vehicle, seed, duration, configured):
        if not isinstance(piece, Step):
            identifier.restart(piece)
            continue
        judged = status.update(identifier, piece, identifier.step(piece), True)
        time += piece.dt
        if 'changed' in identifier.note and changed_at == inf:
            changed_at = time
        if time > 0.5 * duration and identifier.note:
            notes.add(identifier.note)
        by_120 = by_120 or (time <= 120.0 and judged.status == 'converged')
    mass = MASS * (vehicle.change[1] if vehicle.change[0] < duration else 1.0)
    low, high = intervals(identifier.parameters, identifier.covariance).get('mass', (-inf, inf))
    alpha, beta, gamma, _ = identifier.parameters
    speed = GUESS.typical_velocity
    drag = (QUADRATIC * speed + LINEAR) * speed
    return Result(((1.0 / alpha / mass - 1.0), (alpha - 1.0 / mass) / identifier.std[0]),
                  -(beta * speed + gamma) * speed / alpha / drag - 1.0,
                  low <= mass <= high, judged.status == 'converged', by_120,
                  (identifier.note or ' '.join(judged.method_reasons[:1]),), changed_at)


def case(method: str, duration: float, configured: bool, name: str, seed: int) -> Result:
    """Return the result of one seed."""
    vehicle = VEHICLES[name]
    guess, watched = (replace(GUESS, couplings=couplings_of(vehicle)), ()) if configured else (
        GUESS, ('vr',))
    identifier = make_identifier(IdentifierSettings(method), guess, watched=watched)
    return identify(identifier, guess, vehicle, seed, duration, configured)


def can_be_configured(vehicle: Vehicle) -> bool:
    """Tell whether a configuration can say what a vehicle has and the model has not."""
    return not vehicle.size and vehicle.change[0] == inf and (
        vehicle.thrust is not float or vehicle.lag > 0.0 or vehicle.reverse_drag != 1.0
        or vehicle.disturbance in ('coupled', 'zigzag'))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seeds', type=int, default=8)
    parser.add_argument('--duration', type=float, default=300.0)
    parser.add_argument('--method', default='ekf')
    parser.add_argument('--only', default='')
    parser.add_argument('--configured', action='store_true')
    given = parser.parse_args(arguments)
    rows = []
    with ProcessPoolExecutor(2) as pool:
        for name, vehicle in VEHICLES.items():
            if given.only not in name or given.configured and not can_be_configured(vehicle):
                continue
            found = list(pool.map(partial(
                case, given.method, given.duration, given.configured, name), range(given.seeds)))
            errors = np.array([one.errors for one in found])
            at = [one.changed_at for one in found if one.changed_at < inf]
            # without the numbers, which are others in each drive
            notes = [re.split(' % of the error follows |, | (?:of|by|is) about |: | with a', note)[
                note[0].isdigit()] for one in found for note in one.notes if note]
            named = '' if name not in NAMES else (
                f'{100 * np.mean([NAMES[name] in " ".join(one.notes) for one in found]):.0f}')
            most = max(set(notes), key=notes.count) if notes else ''
            rows.append((
                name, f'{100 * np.median(errors[:, 0]):+.1f}',
                f'{100 * np.abs(errors[:, 0]).max():.1f}',
                f'{100 * np.median([one.drag for one in found]):+.1f}',
                f'{np.sqrt(np.mean(errors[:, 1]**2)):.2f}',
                *(f'{100 * np.mean(x):.0f}' for x in (
                    [one.held for one in found], [one.converged for one in found],
                    [one.by_120 for one in found],
                    [one.converged and not one.held for one in found],
                    [one.converged and abs(one.errors[0]) > 0.1 for one in found],
                    [one.changed_at < inf for one in found])),
                f'{np.median(at):.0f}' if at else '', named, most))
    print(f'{given.method}, {given.seeds} seeds of {given.duration:g} s.\n')
    print(table(('vehicle', 'mass off, median [%]', 'largest [%]',
                 f'drag at {GUESS.typical_velocity:g} m/s off, median [%]',
                 'rms of alpha over its std',
                 'interval holds the mass [%]', 'converged [%]', 'by 120 s [%]',
                 'converged, mass outside [%]', 'converged, mass off by over 10 % [%]',
                 'said to have changed [%]',
                 'at [s], median', 'named [%]', 'noted most often'), rows))


if __name__ == '__main__':
    main()
