"""
Print the figures of the method.

``python -m benchmarks.accuracy.adaptive_identifier [LOGS]``

LOGS is a folder with the two tank recordings; without it, they are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
import sys
from typing import Any

from rovid_core.identify.estimate import Estimate
from rovid_core.model.lowpass import LowPass
from rovid_core.pipeline import steps as pipe
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import DofSettings, Settings
from rovid_core.trials.score import Score, ScoreLog
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.convert import Converter

from test.support.surge import (
    exact_case,
    HEAVY,
    LIGHT,
    prediction,
    run,
    surge_log,
    surge_settings,
)

SEEDS = 20
TANK = Path(__file__).parents[2] / 'config' / 'bluerov2_tank.yaml'


class ForceUnfiltered(pipe.Track):
    """The mistake of filtering the velocity and not the thrust."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.force = LowPass(0.0)


def surge_errors(initial: DofSettings, **identifier: object) -> list[float]:
    """Return the mae [m/s] on the validation profile of every seed's model."""
    errors = []
    for seed in range(SEEDS):
        stream = Stream(surge_settings(initial, **identifier))
        errors.append(prediction(run(stream, surge_log(seed))[-1].dofs[0].parameters).mae)
    return errors


def identify(log: Path, settings: Settings, scorer: ScoreLog | None = None) -> Estimate:
    """Return the last estimate of a recorded log."""
    stream = Stream(settings, scorer=scorer)
    converter = Converter(settings, stream.reject)
    with Log([log]) as opened:
        for message in opened.messages(converter.topics):
            for event in converter.events(message.topic, message.data, message.time):
                stream.receive(event)
    stream.finish()
    assert stream.estimate is not None
    return stream.estimate


def tank_scores(logs: Path) -> tuple[Estimate, dict[str, Score]]:
    """Train on surge_sway_heave.mcap; score on all_axes.mcap against the motion capture."""
    settings = settings_from(load(TANK))
    trained = identify(logs / 'surge_sway_heave.mcap', settings)
    validation = ScoreLog(settings)
    identify(logs / 'all_axes.mcap', settings, validation)
    return trained, {d.dof: validation.score(d.dof, d.parameters) for d in trained.dofs}


def _row(name: str, *cells: str) -> None:
    print(f'{name:<44}' + ''.join(f'{cell:>16}' for cell in cells), flush=True)


def _spread(errors: Sequence[float]) -> tuple[str, str]:
    return f'{1000 * median(errors):.1f} mm/s', f'{1000 * max(errors):.1f} mm/s'


def main() -> None:
    """Print all tables."""
    _row('Eq. 13 vehicle, exact data, 60 s: theta_hat', 'alpha', 'beta', 'growth of W')
    for name, integrator, thrust in (
            ('RK4, 100 Hz, exact stages', 'rk4', 'stage'),
            ('Heun, 100 Hz, mean thrust', 'heun', 'mean'),
            ('Euler, 100 Hz, mean thrust', 'euler', 'mean'),
            ('Euler, 100 Hz, left-end thrust (textbook)', 'euler', 'left')):
        (alpha, beta), growth = exact_case(integrator, thrust)
        _row(name, f'{100 * alpha:+.2f} %', f'{100 * beta:+.2f} %', f'{growth:+.1e} W(0)')
    print()
    _row(f'Surge, 10 Hz, 5 mm, 300 s, {SEEDS} seeds', 'median mae', 'worst')
    for integrator in ('euler', 'heun', 'rk4'):
        for name, initial in (('heavy', HEAVY), ('light', LIGHT)):
            _row(f'{integrator}, guess too {name}',
                 *_spread(surge_errors(initial, integrator=integrator)))
    filtered, pipe.Track = pipe.Track, ForceUnfiltered  # type: ignore[misc]
    _row('heun, guess too heavy, thrust not filtered', *_spread(surge_errors(HEAVY)))
    pipe.Track = filtered  # type: ignore[misc]
    if len(sys.argv) > 1:
        print()
        _row('Tank: surge_sway_heave on all_axes', 'mae', 'fit')
        for dof, score in tank_scores(Path(sys.argv[1]))[1].items():
            _row(dof, f'{score.mae:.3f}', f'{100 * score.fit:.0f} %')


if __name__ == '__main__':
    main()
