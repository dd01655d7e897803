"""What one seed gives of each case that the online methods are judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import inf, isfinite

import numpy as np
from rovid_core.identify import make_identifier
from rovid_core.identify.intervals import intervals
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import lumped
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales

from test.support import surge as cases
from test.support.online_trials import (
    bound,
    Case,
    CLEAN,
    follow,
    prediction_error,
    trial,
)
from test.support.surge import HEAVY, surge_log, surge_settings, SURGE_TRUTH, TRAINING, VALIDATION
from test.support.trials import Array, Waves

TRUTH = dict(zip((*PARAMETERS, *PHYSICAL), (*SURGE_TRUTH, 290.0, 290.0, 43.5, 2.9)))
METHODS = ('ekf', 'aid')


def identifier(method: str, guess: DofSettings = HEAVY, **settings: float) -> Identifier:
    """Return a method with otherwise default settings."""
    return make_identifier(replace(IdentifierSettings(method), **settings), guess)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Run:
    """Parameters and the intervals that hold the truth at each mark, and the model's error."""

    parameters: list[Four]
    covered: list[list[bool]]
    error: float
    delay: float
    changed: bool


def run(case: Case, method: str, seed: int) -> Run:
    """Identify one trial of the surge case and look after 60 s and in the end."""
    found = follow(identifier(method), trial(case, seed).pieces(), (60.0, inf))
    last = found[-1]
    return Run([f.parameters for f in found], [covered(f.parameters, f.covariance) for f in found],
               prediction_error(last.parameters, last.delay, case), last.delay,
               isfinite(last.changed_at))


def covered(parameters: Four, covariance: Sequence[float]) -> list[bool]:
    """Tell of each lumped and physical parameter whether its 95 % interval holds the truth."""
    found = intervals(parameters, covariance)
    return [name in found and found[name][0] <= true <= found[name][1]
            for name, true in TRUTH.items()]


def piped(seed: int) -> Run:
    """Identify the surge case through the whole pipe."""
    dof = cases.run(Stream(surge_settings(method='ekf')), surge_log(seed))[-1].dofs[0]
    return Run([dof.parameters], [covered(dof.parameters, dof.covariance)],
               prediction_error(dof.parameters, dof.delay, CLEAN), dof.delay, False)


@dataclass(frozen=True)
class Scale:
    """Factors of mass, drag, force and time; velocities stay."""

    mass: float = 1.0
    drag: float = 1.0
    force: float = 1.0
    time: float = 1.0

    def of(self, guess: DofSettings) -> DofSettings:
        """Return a vehicle on this scale."""
        return replace(guess, mass=self.mass * guess.mass, bias=self.force * guess.bias,
                       quadratic_drag=self.drag * guess.quadratic_drag,
                       linear_drag=self.drag * guess.linear_drag)

    def waves(self, waves: Waves) -> tuple[tuple[float, float], ...]:
        """Return a thrust on this scale."""
        return tuple([(self.force * f, hz / self.time) for f, hz in waves])


def _unit(k: float) -> Scale:
    return Scale(k, k, k)


def _same_shape(k: float) -> Scale:
    length = k**(1 / 3)
    return Scale(k, length**2, length**2, length)


SCALES = {
    '290 kg, N': _unit(1.0), 'kN': _unit(1e-3), 'a command: 150 N is 1': _unit(1 / 150),
    '10 kg, same motion': _unit(10 / 290), '10 t, same motion': _unit(10_000 / 290),
    '10 kg, same shape': _same_shape(10 / 290), '10 t, same shape': _same_shape(10_000 / 290)}


def scaled_error(name: str, seed: int) -> tuple[float, Array]:
    """
    Let ekf identify a vehicle, in a unit of force, of another size.

    Returns
    -------
    float, ndarray of shape (4,)
        Error of the model on the other profile [m/s], and those of the parameters over the
        bound for this vehicle.

    """
    scale = SCALES[name]
    true = scale.of(DofSettings(290.0, 290.0, 43.5, 2.9))
    case = Case(truth=lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias),
                waves=scale.waves(TRAINING))
    found = follow(identifier('ekf', scale.of(HEAVY)), trial(case, seed).pieces())[0]
    off = np.subtract(found.parameters, case.truth) / bound(case.duration, True, case)
    return (prediction_error(found.parameters, found.delay, case, scale.waves(VALIDATION)),
            np.asarray(off))


def _guess(mass: float, drag: float) -> DofSettings:
    return DofSettings(290.0 * mass, 290.0 * drag, 43.5 * drag)


GUESSES = {
    'default guess': HEAVY, 'mass x 4': _guess(4, 1), 'mass / 4': _guess(0.25, 1),
    'drags x 4': _guess(1, 4), 'drags / 4': _guess(1, 0.25), 'both x 4': _guess(4, 4),
    'both / 4': _guess(0.25, 0.25), 'mass x 4, drags / 4': _guess(4, 0.25),
    'mass / 4, drags x 4': _guess(0.25, 4)}


def guess_error(name: str, seed: int) -> float:
    """Return the error [m/s] of ekf from another guess."""
    return _error(identifier('ekf', GUESSES[name]), seed)


def _typical(force: float, velocity: float) -> DofSettings:
    usual = Scales.of(HEAVY)
    return replace(HEAVY, typical_force=force * usual.force,
                   typical_velocity=velocity * usual.velocity)


SETTINGS = {
    'default settings': partial(identifier, 'aid'),
    **{f'typical force x {f:.2g}, velocity x {v:.2g}': partial(identifier, 'aid', _typical(f, v))
       for f, v in ((3, 1), (1 / 3, 1), (1, 3), (1, 1 / 3), (3, 3), (1 / 3, 1 / 3))},
    **{f'adaptation_time {t:g} s': partial(identifier, 'aid', adaptation_time=t)
       for t in (1.0, 2.0, 5.0, 10.0)}}


def aid_error(name: str, seed: int) -> float:
    """Return the error [m/s] of aid with other settings."""
    return _error(SETTINGS[name](), seed)


def _error(one: Identifier, seed: int) -> float:
    found = follow(one, trial(CLEAN, seed).pieces())[0]
    return prediction_error(found.parameters, found.delay, CLEAN)


class Rest(Enum):
    """An hour without thrust; noise goes on, or the fixes stay where they are."""

    REST = 'at rest'
    NOISE = 'noise only'
    REST_LATER = 'at rest, after a minute of motion'
    NOISE_LATER = 'noise only, after a minute of motion'


COASTING = 60.0
"""[s] after the thrust, for the vehicle to come to rest; it still shows drag until then."""


def moved(rest: Rest, method: str, seed: int, hour: float = 3600.0) -> Array:
    """
    Return how far alpha to delta and the delay move, in standard deviations.

    Of the standard deviations before and after the smaller counts.
    """
    later = rest in (Rest.REST_LATER, Rest.NOISE_LATER)
    stop = 60.0 if later else 0.0
    begin = stop + COASTING if later else 0.0
    noisy = rest in (Rest.NOISE, Rest.NOISE_LATER)
    case = Case(begin + hour, lumped(290.0, 290.0, 43.5, 0.0), stop=stop,
                quiet=inf if noisy else begin)
    before, after = follow(identifier(method), trial(case, seed).pieces(), (begin, inf))
    change = np.subtract((*after.parameters, after.delay), (*before.parameters, before.delay))
    return np.asarray(np.abs(change) / np.minimum(
        (*after.std, after.delay_std), (*before.std, before.delay_std)))


@dataclass(frozen=True)
class Payload:
    """Time from the change to where it is said [s], and alpha's relative error a minute on."""

    after: float
    alpha: float


def followed_payload(case: Case, seed: int) -> Payload:
    """Let ekf follow 20 % more mass from 200 s on."""
    loaded = lumped(1.2 * 290.0, 290.0, 43.5, 2.9)
    case = replace(case, duration=400.0, payload=200.0, loaded=loaded)
    minute, end = follow(
        identifier('ekf'), trial(case, seed).pieces(), (260.0, inf), since=200.0)
    return Payload(end.changed_at - 200.0, minute.parameters[0] / loaded[0] - 1.0)
