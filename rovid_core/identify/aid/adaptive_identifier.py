"""
The adaptive identifier of Smallwood & Whitcomb (2003), eq. 7, 8 and 11.

    dv         = v_hat - v
    v_hat'     = a dv + theta_hat . phi(v_hat, tau)       phi(v, tau) = [tau, v|v|, v, 1]
    theta_hat' = -Gamma dv phi(v_hat, tau)                a < 0, Gamma diagonal, > 0
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, cast

from rovid_core.identify.aid.integrators import Five, INTEGRATORS, part, Rates, rates
from rovid_core.identify.aid.written_out import general, Moved, Unrolled
from rovid_core.identify.excitation import LEAST_EXCITATION, LEAST_MOTION
from rovid_core.identify.uncertainty import NOTHING, Uncertainty
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.samples import finite, Step
from rovid_core.settings.run import SettingsError
from rovid_core.settings.scales import Scales

MOST_PIECES = 100
"""A step that would have to be divided further is refused."""

MOST_EXCITATION = 1e12
"""Keeps a wild force from making the mean infinite for ever."""


@dataclass(frozen=True, slots=True)
class Gains:
    """
    Feedback gain and adaptation gains.

    Attributes
    ----------
    feedback : float
        ``a`` of eq. 7 [1/s], below 0.
    adaptation : tuple of 4 floats
        Diagonal of Gamma of eq. 11, each at least 0, in the units of parameter per
        (velocity x regressor x time).

    """

    feedback: float
    adaptation: Four

    def __post_init__(self) -> None:
        """Refuse gains for which the stability proof does not hold."""
        if not (self.feedback < 0.0 and math.isfinite(self.feedback)):
            raise SettingsError(
                'identifier.feedback_gain', f'got {self.feedback}, takes a number below 0')
        if not (finite(self.adaptation) and min(self.adaptation) >= 0.0):
            raise SettingsError(
                'identifier.adaptation_gains',
                f'got {list(self.adaptation)}, takes numbers of at least 0')

    @staticmethod
    def from_time(adaptation_time: float, scales: Scales) -> Gains:
        """
        Return gains that settle the best-excited direction in ``adaptation_time`` [s] (1/e).

        With regressors normalised to about 1 and thrust that is slow beside ``a``, the slow
        mode has T = |a| / g. ``a`` of 2 rad/s follows the vehicle and not the noise; a
        short T needs it faster to stay damped.
        """
        a = max(2.0, 4.0 / adaptation_time)
        g = a / adaptation_time
        s = scales.regressor
        return Gains(-a, cast(Four, tuple([g * x * x for x in s])))


class AdaptiveIdentifier:
    """
    The adaptive identifier on one DOF.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.
    gains : Gains
        Feedback and adaptation gains.
    integrator : str
        ``euler`` (the paper's online form, with the mean thrust of the step), ``heun`` or
        ``rk4``.

    Raises
    ------
    SettingsError
        For an integrator that there is not.

    Notes
    -----
    An explicit step blows up when it is long against the loop's own dynamics. On a step
    h these are the feedback with the drag, |a| + 2|beta v| + |gamma|, and the adaptation,
    phi' Gamma phi / |a|. ``step`` divides h until both turn by less than 1 and 1/2; if
    that takes more than ``MOST_PIECES`` pieces, or the result is not finite, the step is
    refused and v_hat taken from the measurement. The parameters are projected on a box
    (``Scales.bounds``) that holds the true ones, so W does not grow by it.

    At rest the velocity is noise, and its echo in v_hat would be taken for drag: 0.2 1/s of
    gamma in an hour. With neither thrust nor motion beta and gamma therefore stay. What then
    is missing in W' is |dv (dbeta v|v| + dgamma v)|, with v next to 0.

    ``parameters`` are what is published, here theta_hat itself: with raw gains this is the
    paper's identifier as it is. ``AveragedIdentifier`` takes its gains from the data.

    """

    note = ''
    uncertainty: Uncertainty = NOTHING
    std, covariance, delay_std = NOTHING.std, NOTHING.covariance, NOTHING.delay_std
    delay = math.nan

    def __init__(self, scales: Scales, gains: Gains, integrator: str = 'euler') -> None:
        if integrator not in INTEGRATORS:
            raise SettingsError(
                'identifier.integrator',
                f'got {integrator!r}, takes {", ".join(INTEGRATORS)}')
        self._scales = scales
        self._regressor_scale = scales.regressor
        self._per_force, _, self._per_velocity, _ = scales.regressor
        self._a = gains.feedback
        gamma = [g if on else 0.0 for g, on in zip(gains.adaptation, scales.active)]
        self._gamma: tuple[float, ...] = tuple(gamma)
        self._resting: tuple[float, ...] = (gamma[0], 0.0, 0.0, gamma[3])
        rate = max(g / (s * s) for g, s in zip(gamma, self._regressor_scale)) / -self._a
        self.adaptation_time = 1.0 / rate if rate > 0.0 else math.inf  # of the fastest [s]
        self._advance = INTEGRATORS[integrator]
        self._rates: Rates = rates
        self._unrolled: Unrolled = general
        self.bounds = scales.bounds()
        self.reset()

    def reset(self) -> None:
        """Go back to the initial values."""
        self.theta_hat = self.parameters = self._scales.initial
        self.v_hat = math.nan
        self.excitation = 0.0

    def retune(self, adaptation_time: float) -> None:
        """Do nothing: the time follows from the raw gains."""

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity [m/s or rad/s], keeping the parameters."""
        self.v_hat = velocity

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Take one step (eq. 7 and 11); return '' or ``unstable_step`` when it was refused.

        With ``adapt`` False the parameters stay as they are.
        """
        v_hat = self.v_hat
        if v_hat != v_hat:  # NaN: there is none yet
            v_hat = self.v_hat = step.velocity[0]
        force, excitation = step.force[1] * self._per_force, self.excitation
        square = force * force
        rest = (square < LEAST_EXCITATION and excitation < LEAST_EXCITATION
                and (speed := v_hat * self._per_velocity) * speed < LEAST_MOTION)
        gamma = self._gamma
        if rest or not adapt:
            gamma = self._resting if adapt else (0.0,) * len(gamma)
        moved = self._unrolled(self._a, gamma, v_hat, self.theta_hat, step, self.bounds)
        if moved is None:
            moved = self._moved(step, gamma)
            if moved is None:
                self.v_hat = step.velocity[2]
                return 'unstable_step'
        self.v_hat, self.theta_hat = moved
        # the mean square of the normalised thrust over about one adaptation time
        if not square < MOST_EXCITATION:
            square = MOST_EXCITATION
        self.excitation = excitation - math.expm1(-step.dt / self.adaptation_time) * (
            square - excitation)
        if adapt:
            self._adapted(step, rest)
        return ''

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W of eq. 9 (terms with gain 0 left out)."""
        return 0.5 * (dv * dv + math.fsum(
            (p - t) ** 2 / g for p, t, g in zip(parameters, truth, self._gamma) if g))

    def lyapunov(self, velocity: float, truth: Sequence[float]) -> float:
        """Return W as it is now, against the true parameters."""
        return self.energy(self.v_hat - velocity, self.theta_hat, truth)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'parameters': list(self.theta_hat),
                'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
                'excitation': self.excitation}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        parameters = self._allowed(state['parameters'])
        v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        excitation = float(state['excitation'])
        if math.isinf(v_hat) or not 0.0 <= excitation <= MOST_EXCITATION:
            raise ValueError(f'v_hat {v_hat} or excitation {excitation} is out of range')
        self.theta_hat = self.parameters = parameters
        self.v_hat, self.excitation = v_hat, excitation

    def _allowed(self, values: Sequence[float]) -> Four:
        """Return parameters from a state; raises ValueError for what cannot be one."""
        parameters = [float(x) for x in values]
        low, high = self.bounds
        for name, p, bottom, top in zip(PARAMETERS, parameters, low, high):
            if not bottom <= p <= top:
                raise ValueError(f'{name} {p} is outside {bottom} to {top}')
        if len(parameters) != 4:
            raise ValueError(f'{len(parameters)} parameters, not 4')
        return cast(Four, tuple(parameters))

    def _adapted(self, step: Step, rest: bool) -> None:
        """Publish what a step has made of theta_hat."""
        self.parameters = self.theta_hat

    def _moved(self, step: Step, gamma: tuple[float, ...]) -> Moved:
        """Return v_hat and theta_hat after a step, None if it is refused."""
        state: Five = (self.v_hat, *self.theta_hat)
        pieces = self._pieces(step, gamma)
        if pieces > MOST_PIECES:
            return None
        if pieces == 1:
            state = self._piece(state, step, gamma)
        else:
            for k in range(pieces):
                state = self._piece(state, part(step, k, pieces), gamma)
        return (state[0], state[1:]) if finite(state) else None

    def _pieces(self, step: Step, gamma: tuple[float, ...]) -> int:
        force = max(abs(step.force[0]), abs(step.force[2]))
        gain = abs(self.theta_hat[0] * force) + abs(self.theta_hat[3])
        speed = step.dt * gain + max(
            abs(self.v_hat), abs(step.velocity[0]), abs(step.velocity[2]))
        square = speed * speed
        adaptation = (gamma[0] * force * force + gamma[1] * square * square
                      + gamma[2] * square + gamma[3])
        feedback = -self._a + 2.0 * abs(self.theta_hat[1]) * speed + abs(self.theta_hat[2])
        turns = step.dt * max(feedback, 2.0 * adaptation / -self._a)
        return int(turns) + 1 if turns <= MOST_PIECES else MOST_PIECES + 1

    def _piece(self, state: Five, step: Step, gamma: tuple[float, ...]) -> Five:
        state = self._advance(self._a, gamma, state, step, self._rates)
        return state[0], *self._inside(state[1:])

    def _inside(self, parameters: Four) -> Four:
        """Return the nearest parameters inside the bounds, as W measures distance."""
        low, high = self.bounds
        return cast(Four, tuple([
            bottom if p < bottom else top if p > top else p
            for p, bottom, top in zip(parameters, low, high)]))
