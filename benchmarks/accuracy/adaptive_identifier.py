"""
What the adaptive identifier ``aid`` is worth with exact data and with noise.

``python -m benchmarks.accuracy.adaptive_identifier [LOGS] [--seeds N]``

LOGS is a folder with the two tank recordings; without it, they are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

from rovid_core.identify.aid.adaptive_identifier import Gains
from rovid_core.model.plant import physical
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.markdown import table
from test.support.surge import (
    exact_case,
    HEAVY,
    LIGHT,
    prediction,
    run,
    surge_log,
    surge_settings,
)
from test.support.tank import tank_scores
from test.support.trials import CONFIG

EXACT = """\
**Exact data.** The paper's eq. 13 vehicle: 250 kg, quadratic drag 200, 100 N at 1/4 Hz, 60 s.
Guess: 400 kg, drag 160. The gains follow from an `adaptation_time` of 3 s. Errors are those of
theta_hat itself, not of its mean.
"""
LOW_PASS = """
**What the low-pass does to drag.** The vehicle of `config/jhurov.yaml`, {duration:g} s without any
noise, 0.6 Hz: errors of mass and drags [%]. With gains from the data velocities are not filtered,
with raw gains of the same adaptation time (Heun) they are.
"""
SURGE = """
**A simulated surge trial.** Mass 290, quadratic drag 290, linear drag 43.5, bias 2.9; thrust 150
N at 1/18 Hz + 80 N at 1/7.3 Hz; 10 Hz fixes of 5 mm; 300 s; default settings; mass and drags of
the guess off by 1.6 to 2. Mean absolute error [mm/s] of the model on another profile (120 N at
1/12 Hz + 60 N at 1/25 Hz), {seeds} seeds.
"""
TANK = """
**Tank recordings of a BlueROV2 Heavy.** Trained on `surge_sway_heave.mcap`, scored on
`all_axes.mcap` against the motion capture's velocity, with `config/bluerov2_tank.yaml` as it is
shipped, which takes `ekf`.
"""
DURATION = 600.0  # [s] of the trial without noise
CASES = (('RK4, 100 Hz, exact stages', 'rk4', 'stage'),
         ('Heun, 100 Hz, mean thrust', 'heun', 'mean'),
         ('Euler, 100 Hz, mean thrust', 'euler', 'mean'),
         ('Euler, 100 Hz, left-end thrust (textbook)', 'euler', 'left'))


def surge_errors(seeds: int, initial: DofSettings, integrator: str) -> list[float]:
    """Return the mae [m/s] of every seed's model; with an integrator it has raw gains."""
    errors, gains = [], Gains.from_time(3.0, Scales.of(initial))
    raw = {'integrator': integrator, 'feedback_gain': gains.feedback,
           'adaptation_gains': gains.adaptation} if integrator else {}
    for seed in range(seeds):
        stream = Stream(surge_settings(initial, **raw))
        errors.append(prediction(run(stream, surge_log(seed))[-1].dofs[0].parameters).mae)
    return errors


def exact() -> str:
    """Return the table of the exact data."""
    rows = []
    for name, integrator, thrust in CASES:
        (alpha, beta), growth = exact_case(integrator, thrust)
        rows.append((name, f'{100 * alpha:+.2f} %', f'{100 * beta:+.2f} %', f'{growth:+.1e}'))
    return table(('integrator', 'error of alpha', 'error of beta',
                  'largest growth of W at a step [W(0)]'), rows)


def low_pass() -> str:
    """Return the table of the bias of the low-pass."""
    simulated = settings_from(load(CONFIG / 'jhurov.yaml'))
    simulated = replace(simulated, simulation=replace(
        simulated.simulation, position_noise=0.0, depth_noise=0.0, attitude_noise=0.0))
    raw = IdentifierSettings(feedback_gain=-2.0, adaptation_gains=tuple(
        gain for dof in simulated.dofs
        for gain in Gains.from_time(3.0, Scales.of(simulated.dof[dof])).adaptation))
    rows = []
    for name, identifier in (('from the data', IdentifierSettings()), ('raw', raw)):
        settings = replace(simulated, identifier=identifier)
        last = run(Stream(settings), simulate(settings, DURATION, 1))[-1]
        for dof in last.dofs:
            true = settings.simulation.dofs[dof.dof]
            truth = true.mass, true.quadratic_drag, true.linear_drag
            rows.append((name, dof.dof, *(
                f'{100.0 * (x / y - 1.0):+.1f}' for x, y in zip(physical(dof.parameters), truth))))
    return table(('gains', 'DOF', 'mass', 'quadratic drag', 'linear drag'), rows)


def surge(seeds: int) -> str:
    """Return the table of the surge trial."""
    rows = [('from the data', *_spread(surge_errors(seeds, HEAVY, '')),
             *_spread(surge_errors(seeds, LIGHT, '')))]
    rows += [(f'raw, {integrator}', *_spread(surge_errors(seeds, HEAVY, integrator)),
              *_spread(surge_errors(seeds, LIGHT, integrator)))
             for integrator in ('euler', 'rk4')]
    return table(('gains', 'guess too heavy: median', 'worst', 'guess too light: median',
                  'worst'), rows)


def tank(logs: Path) -> str:
    """Return the table of the tank recordings."""
    return table(('DOF', 'mae [m/s]', 'fit'), (
        (dof, f'{score.mae:.3f}', f'{100 * score.fit:.0f} %')
        for dof, score in tank_scores(logs)[1].items()))


def _spread(errors: Sequence[float]) -> tuple[str, str]:
    return f'{1000 * median(errors):.2f}', f'{1000 * max(errors):.2f}'


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('logs', nargs='?', type=Path, help='folder of the tank recordings')
    parser.add_argument('--seeds', type=int, default=20)
    given = parser.parse_args()
    print(f'{EXACT}\n{exact()}', flush=True)
    print(f'{LOW_PASS.format(duration=DURATION)}\n{low_pass()}', flush=True)
    print(f'{SURGE.format(seeds=given.seeds)}\n{surge(given.seeds)}', flush=True)
    if given.logs:
        print(f'{TANK}\n{tank(given.logs)}')


if __name__ == '__main__':
    main()
