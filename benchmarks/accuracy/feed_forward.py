"""
Tell what a controller gets from ``/rov/model`` from the first second on.

A simulated vehicle with noisy fixes follows wanted velocities on three axes. Its controller pulls
each velocity (v_hat of the message) to the wanted one, and adds the force of the model while that
is marked valid. All goes through the messages of the node, in one process: sensors, pipe,
``/rov/model``, ``Model``, force, vehicle. The guess that it begins with is wrong by 1.5 to 2. The
``exact`` vehicle obeys the model, the ``coupled`` one has the Coriolis forces of its masses on all
axes at once, and the couplings of ``docs/guide.md`` in its model.

The table says when a DOF became valid, for how much of the time after that it was, how many of the
values marked valid (mass, drags, bias, at every message) were off by more than their 95 %
interval, and by how much the true velocity missed the wanted one (rms), without feed-forward and
with it; ``worse`` are the runs in which feed-forward made it larger.

Usage: python -m benchmarks.accuracy.feed_forward [--seeds N] [--duration S] [--method M]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any, NamedTuple

import numpy as np
from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import DOFS, PHYSICAL
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings
from rovid_core.settings.run import Settings, SimulationSettings
from rovid_core.simulation.sensors import simulate
from rovid_ros.model import Model
from rovid_ros.results.outputs import Outputs

from benchmarks.accuracy.coupled_vehicles import configured, VEHICLES
from benchmarks.markdown import table
from test.support.outputs import message_of

VEHICLE = 'as a BlueROV2, 17 to 24 kg'
WANTED = {  # amplitude [m/s, rad/s] and frequency [Hz] of the sinusoids
    'surge': ((0.35, 0.05), (0.15, 0.13)), 'sway': ((0.3, 0.07), (0.12, 0.17)),
    'yaw': ((0.3, 0.04), (0.2, 0.11))}
LETTERS = dict(zip('uvwpqr', DOFS))
BANDWIDTH = 1.0  # [1/s] of the feedback, with the mass of the guess


class Controller:
    """Feedback on v_hat, and feed-forward from the model where it is asked for and valid."""

    def __init__(self, masses: Mapping[str, float], feed_forward: bool) -> None:
        self.model: Model | None = None
        self._gains = {dof: BANDWIDTH * mass for dof, mass in masses.items()}
        self._feed_forward = feed_forward

    def force(self, dof: str, t: float) -> float:
        """Return the force [N or N m] at a time [s]."""
        if self.model is None:
            return 0.0
        row = self.model[dof]
        v, rate = wanted(dof, t)
        force = 0.0
        if math.isfinite(row.v_hat):
            force = self._gains[dof] * (v - row.v_hat)
        if self._feed_forward and row.valid:
            force += self.model.force(dof, rate, v, {
                name: math.prod(wanted(LETTERS[x], t)[0] for x in name)
                for name in row.couplings})
        return force


@dataclass(frozen=True)
class Thrust:
    """The controller as the thrust profile of a DOF."""

    force: Callable[[float], float]
    max_frequency: float = 1.0

    def at(self, t: float) -> float:
        """Return the thrust [N or N m] at ``t`` [s]."""
        return self.force(t)


class Result(NamedTuple):
    """What came of one DOF in a run."""

    first: float  # time at which it became valid [s]
    share: float  # of the messages after that
    values: int  # that were marked valid
    off: int  # of these by more than the interval
    error: float  # rms of true - wanted velocity


def wanted(dof: str, t: float) -> tuple[float, float]:
    """Return the wanted velocity and acceleration of a DOF."""
    waves = WANTED.get(dof, ())
    return (math.fsum(a * math.sin(2.0 * math.pi * f * t) for a, f in waves),
            math.fsum(2.0 * math.pi * f * a * math.cos(2.0 * math.pi * f * t) for a, f in waves))


def settings_of(kind: str, method: str) -> Settings:
    """Return the settings of the exact or of the coupled vehicle."""
    coupled = configured(VEHICLE, method, kind == 'coupled')
    truth = VEHICLES[VEHICLE]
    simulation = truth if kind == 'coupled' else SimulationSettings(dofs=truth.dofs)
    return replace(coupled, simulation=simulation,
                   reference=InputSettings(topic='/truth', type='t', field='f'))


def run(seed: int, kind: str, method: str, duration: float, feed_forward: bool
        ) -> dict[str, Result]:
    """Let a vehicle follow its wanted velocities."""
    settings = settings_of(kind, method)
    stream, outputs = Stream(settings), Outputs(settings)
    controller = Controller({d: settings.dof[d].mass for d in settings.dofs}, feed_forward)
    profile = {dof: (Thrust(partial(controller.force, dof)),) for dof in settings.dofs}
    errors: dict[str, list[float]] = {dof: [] for dof in settings.dofs}
    told: dict[str, list[tuple[float, bool, int]]] = {dof: [] for dof in settings.dofs}
    for time, name, value in simulate(settings, duration, seed, profile):
        if name == 'reference':
            for dof in settings.dofs:
                errors[dof].append(value[DOFS.index(dof)] - wanted(dof, time * 1e-9)[0])
        for estimate in stream.receive(Event(time, (Sample(name, value),))):
            message, = outputs.messages(estimate, ['rov/model'])
            controller.model = model = Model.from_message(message_of(message))
            for dof in settings.dofs:
                told[dof].append((time * 1e-9, model[dof].valid, off(model[dof], settings)))
    return {dof: summary(told[dof], errors[dof]) for dof in settings.dofs}


def off(row: Any, settings: Settings) -> int:
    """Return how many of the physical parameters miss the truth by more than their interval."""
    truth = settings.simulation.dofs[row.dof]
    return sum(not abs(getattr(row, name) - getattr(truth, name)) <= Z95 * row.std[name]
               for name in PHYSICAL)


def summary(told: list[tuple[float, bool, int]], errors: list[float]) -> Result:
    """Sum up what was told of a DOF."""
    valid = [(time, off) for time, is_valid, off in told if is_valid]
    first = valid[0][0] if valid else math.nan
    after = sum(time >= first for time, _, _ in told)
    return Result(first, len(valid) / after if after else 0.0, len(PHYSICAL) * len(valid),
                  sum(off for _, off in valid), math.sqrt(np.mean(np.square(errors))))


def main() -> None:
    """Run all vehicles without and with feed-forward, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--duration', type=float, default=240.0)
    parser.add_argument('--method', default='ekf')
    args = parser.parse_args()
    rows = []
    with ProcessPoolExecutor() as pool:
        for kind in ('exact', 'coupled'):
            plain, helped = (list(pool.map(partial(
                run, kind=kind, method=args.method, duration=args.duration, feed_forward=on),
                range(args.seeds))) for on in (False, True))
            for dof in WANTED:
                without, with_it = [one[dof] for one in plain], [one[dof] for one in helped]
                values = sum(one.values for one in with_it)
                firsts = [one.first for one in with_it if one.values]
                rows.append((
                    kind, dof, f'{len(firsts)} of {args.seeds}',
                    f'{np.median(firsts):.0f} s' if firsts else '-',
                    f'{100.0 * np.mean([one.share for one in with_it]):.0f} %',
                    f'{100.0 * sum(one.off for one in with_it) / values:.1f} %' if values else '-',
                    *(f'{1000.0 * np.mean([one.error for one in some]):.1f}'
                      for some in (without, with_it)),
                    sum(b.error > a.error for a, b in zip(without, with_it))))
            everything = [one[dof] for one in helped for dof in WANTED]
            values = sum(one.values for one in everything)
            off_share = sum(one.off for one in everything) / max(values, 1)
            rows.append((kind, 'all', '', '', '', f'{100.0 * off_share:.1f} %', '', '', ''))
    print(table(('vehicle', 'DOF', 'valid in', 'since (median)', 'of the time after', 'values off',
                 'error without [mm/s, mrad/s]', 'error with', 'worse'), rows))


if __name__ == '__main__':
    main()
