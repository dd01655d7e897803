"""
The adaptive identifier of Smallwood & Whitcomb (2003), eq. 7, 8 and 11.

    dv         = v_hat - v
    v_hat'     = a dv + theta_hat . phi(v_hat, tau)       phi(v, tau) = [tau, v|v|, v, 1]
    theta_hat' = -Gamma dv phi(v_hat, tau)                a < 0, Gamma diagonal, > 0

phi is longer by one measured regressor for each coupling of the DOF.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, cast, Final

from rovid_core.identify.excitation import MIN_EXCITATION
from rovid_core.identify.intervals import KnownUncertainty
from rovid_core.identify.method import check_bounds, Identifier
from rovid_core.model.dofs import Four, PARAMETERS, Three
from rovid_core.model.samples import finite, Step
from rovid_core.settings.run import Scales, SettingsError

MAX_PIECES: Final = 100  # a step that would have to be divided into more pieces is refused
# Limit of the mean square of the thrust, so that one wild force cannot make it infinite.
MAX_EXCITATION: Final = 1e12


@dataclass(frozen=True, slots=True)
class Gains:
    """Feedback gain and adaptation gains."""

    feedback: float  # ``a`` of eq. 7 [1/s], below 0
    # diagonal of Gamma of eq. 11, each at least 0, in the units of parameter per (velocity x
    # regressor x time); those of couplings last
    adaptation: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse gains for which the stability proof does not hold."""
        if not (self.feedback < 0.0 and math.isfinite(self.feedback)):
            raise SettingsError(
                'identifier.feedback_gain', f'got {self.feedback}, takes a number below 0')
        if not (finite(self.adaptation) and min(self.adaptation) >= 0.0):
            raise SettingsError('identifier.adaptation_gains',
                                f'got {list(self.adaptation)}, takes numbers of at least 0')

    @staticmethod
    def from_time(adaptation_time: float, scales: Scales) -> Gains:
        """
        Return gains that settle the best-excited direction in ``adaptation_time`` [s] (1/e).

        With regressors normalised to about 1 and thrust that is slow compared with ``a``, the
        slow mode has T = |a| / g. ``a`` of 2 rad/s follows the vehicle and not the noise; a
        short T needs a larger one to stay damped.
        """
        a = max(2.0, 4.0 / adaptation_time)
        g = a / adaptation_time
        s = (*scales.regressor, *scales.coupling_regressor)
        return Gains(-a, tuple([g * x * x for x in s]))


# v_hat, alpha, beta, gamma, delta and each kappa, or their rates
State = tuple[float, ...]


def rates(a: float, gamma: Sequence[float], state: State, v: float, tau: float,
          couplings: Sequence[float] = ()) -> State:
    """Return the right-hand sides of eq. 7 and 11; ``couplings`` are the x of each kappa."""
    v_hat, p0, p1, p2, p3, *kappas = state
    dv = v_hat - v
    drag = v_hat * abs(v_hat)
    rate = a * dv + p0 * tau + p1 * drag + p2 * v_hat + p3
    for kappa, x in zip(kappas, couplings):
        rate += kappa * x
    return (rate, -gamma[0] * dv * tau, -gamma[1] * dv * drag, -gamma[2] * dv * v_hat,
            -gamma[3] * dv, *[-g * dv * x for g, x in zip(gamma[4:], couplings)])


# Feedback gain, Gamma, state and step to the state after the step.
Integrator = Callable[[float, Sequence[float], State, Step], State]


def _shifted(x: State, h: float, d: State) -> State:
    return tuple([p + h * q for p, q in zip(x, d)])


def _euler(a: float, gamma: Sequence[float], x: State, step: Step) -> State:
    # the force in the middle, in the pipeline the mean over the step: with the force at the
    # start, a part of the thrust would be taken for drag
    return _shifted(x, step.dt, rates(
        a, gamma, x, step.velocity[0], step.force[1], step.filtered_couplings))


def _heun(a: float, gamma: Sequence[float], x: State, step: Step) -> State:
    h, others = step.dt, step.filtered_couplings
    first = rates(a, gamma, x, step.velocity[0], step.force[0], others)
    last = rates(a, gamma, _shifted(x, h, first), step.velocity[2], step.force[2], others)
    return _shifted(_shifted(x, 0.5 * h, first), 0.5 * h, last)


def _rk4(a: float, gamma: Sequence[float], x: State, step: Step) -> State:
    h, v, tau, others = step.dt, step.velocity, step.force, step.filtered_couplings
    k1 = rates(a, gamma, x, v[0], tau[0], others)
    k2 = rates(a, gamma, _shifted(x, 0.5 * h, k1), v[1], tau[1], others)
    k3 = rates(a, gamma, _shifted(x, 0.5 * h, k2), v[1], tau[1], others)
    k4 = rates(a, gamma, _shifted(x, h, k3), v[2], tau[2], others)
    x = _shifted(_shifted(x, h / 6.0, k1), h / 3.0, k2)
    return _shifted(_shifted(x, h / 3.0, k3), h / 6.0, k4)


INTEGRATORS: dict[str, Integrator] = {'euler': _euler, 'heun': _heun, 'rk4': _rk4}


def piece_of_step(step: Step, k: int, pieces: int) -> Step:
    """Return piece ``k`` of a step, by the parabola through its three points."""

    def at(values: Three, x: float) -> float:
        start, middle, end = values
        return (start * (1.0 - x) * (1.0 - 2.0 * x) + 4.0 * middle * x * (1.0 - x)
                + end * x * (2.0 * x - 1.0))

    xs = (k / pieces, (k + 0.5) / pieces, (k + 1.0) / pieces)
    return Step(step.dt / pieces,
                (at(step.velocity, xs[0]), at(step.velocity, xs[1]), at(step.velocity, xs[2])),
                (at(step.force, xs[0]), at(step.force, xs[1]), at(step.force, xs[2])),
                filtered_couplings=step.filtered_couplings)


# v_hat and theta_hat after a step, None if the step is refused
NewState = tuple[float, tuple[float, ...]] | None


class AdaptiveIdentifier(Identifier):
    """
    The adaptive identifier on one DOF.

    Parameters
    ----------
    integrator : str
        ``euler`` (the paper's online form, with the mean thrust of the step), ``heun`` or
        ``rk4``.

    Raises
    ------
    SettingsError
        If there is no such integrator.

    Notes
    -----
    An explicit step is unstable when it is long compared with the time constants of the loop:
    those of the feedback with the drag, |a| + 2|beta v| + |gamma|, and of the adaptation,
    phi' Gamma phi / |a|. ``step`` divides the step until the products of its length with these
    rates are below 1 and 1/2. If this takes more than ``MAX_PIECES`` pieces, or the result is
    not finite, the step is refused and v_hat is set to the measurement. The parameters are
    projected on a box (``Scales.bounds``) that contains the true ones, so the projection does
    not increase W.

    Each coupling of the DOF is one more parameter kappa with a measured regressor x. Since x does
    not depend on v_hat, eq. 9 to 12 hold with it term by term.

    Velocity and force have gone through the same low-pass. That of v|v| is not v|v| of the
    low-passed v, so drag comes out too high, by more the faster the motion is for the filter.

    ``parameters`` are the published values, here theta_hat itself: with raw gains this is the
    paper's identifier unchanged. It adapts at rest too, where the velocity is noise, whose echo in
    v_hat it takes for drag: 0.2 1/s of gamma in an hour. ``SelfTuningIdentifier`` takes its gains
    from the data, and does not.

    """

    def __init__(self, scales: Scales, gains: Gains, integrator: str = 'euler') -> None:
        if integrator not in INTEGRATORS:
            raise SettingsError('identifier.integrator',
                                f'got {integrator!r}, takes {", ".join(INTEGRATORS)}')
        self._scales = scales
        self._regressor_scale = (*scales.regressor, *scales.coupling_regressor)
        self._per_force = scales.regressor[0]
        self._a = gains.feedback
        active = (*scales.active, *(True for _ in scales.couplings))
        gamma = [g if on else 0.0 for g, on in zip(gains.adaptation, active)]
        self._gamma: tuple[float, ...] = tuple(gamma)
        self._none = (0.0,) * len(gamma)
        rate = max(g / (s * s) for g, s in zip(gamma, self._regressor_scale)) / -self._a
        self.adaptation_time = 1.0 / rate if rate > 0.0 else math.inf  # of the fastest [s]
        self._integrate = INTEGRATORS[integrator]
        self.bounds = scales.bounds()
        low, high = scales.coupling_bounds()
        self._low, self._high = (*self.bounds[0], *low), (*self.bounds[1], *high)
        self.uncertainty = KnownUncertainty(couplings_std=(math.nan,) * len(scales.couplings))
        self.reset()

    def _set_published(self, values: tuple[float, ...]) -> None:
        """Publish parameters and couplings."""
        self.parameters, self.couplings = cast(Four, values[:4]), values[4:]

    def reset(self) -> None:
        """Return to the initial values."""
        self.theta_hat: tuple[float, ...] = (
            *self._scales.initial, *(0.0 for _ in self._scales.couplings))
        self._set_published(self.theta_hat)
        self.v_hat = math.nan
        self.excitation = 0.0

    def restart(self, velocity: float) -> None:
        """Set v_hat to a measured velocity [m/s or rad/s] and keep the parameters."""
        self.v_hat = velocity

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Process one step (eq. 7 and 11); return '', or ``unstable_step`` if it was refused.

        With ``adapt`` False the parameters stay as they are.
        """
        if self.v_hat != self.v_hat:  # NaN: there is none yet
            self.restart(step.velocity[0])
        force, excitation = step.force[1] * self._per_force, self.excitation
        square = force * force
        idle = square < MIN_EXCITATION and excitation < MIN_EXCITATION
        moved = self._advance(step, adapt, idle)
        if moved is None:
            self.v_hat = step.velocity[2]
            return 'unstable_step'
        self.v_hat, self.theta_hat = moved
        # the mean square of the normalised thrust over about one adaptation time
        if not square < MAX_EXCITATION:
            square = MAX_EXCITATION
        self.excitation = excitation - math.expm1(-step.dt / self.adaptation_time) * (
            square - excitation)
        if adapt:
            self._publish(step, idle)
        return ''

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W of eq. 9 (terms with gain 0 left out); NaN if the truth lacks couplings."""
        if len(truth) < len(parameters):
            return math.nan
        return 0.5 * (dv * dv + math.fsum(
            (p - t) ** 2 / g for p, t, g in zip(parameters, truth, self._gamma) if g))

    def lyapunov(self, velocity: float, truth: Sequence[float]) -> float:
        """Return the present W against the true parameters."""
        return self.energy(self.v_hat - velocity, self.theta_hat, truth)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""
        return {'parameters': [*self.parameters, *self.couplings],
                'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
                'excitation': self.excitation}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""
        parameters = self._checked(state['parameters'])
        v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        excitation = float(state['excitation'])
        if math.isinf(v_hat) or not 0.0 <= excitation <= MAX_EXCITATION:
            raise ValueError(f'v_hat {v_hat} or excitation {excitation} is out of range')
        self.theta_hat = parameters
        self._set_published(parameters)
        self.v_hat, self.excitation = v_hat, excitation

    def _checked(self, values: Sequence[float]) -> tuple[float, ...]:
        """Return parameters of a saved state; raise ValueError if they are out of bounds."""
        parameters = tuple([float(x) for x in values])
        if len(parameters) != len(self._low):
            raise ValueError(f'{len(parameters)} parameters, not {len(self._low)}')
        check_bounds((*PARAMETERS, *self._scales.couplings), parameters, self._low, self._high)
        return parameters

    def _publish(self, step: Step, idle: bool) -> None:
        """Set the published values after a step, with thrust or idle."""
        self._set_published(self.theta_hat)

    def _advance(self, step: Step, adapt: bool, idle: bool) -> NewState:
        """Return v_hat and theta_hat after a step, None if it is refused."""
        gamma = self._gamma if adapt else self._none
        state: State = (self.v_hat, *self.theta_hat)
        pieces = self._number_of_pieces(step, gamma)
        if pieces > MAX_PIECES:
            return None
        if pieces == 1:
            state = self._advance_piece(state, step, gamma)
        else:
            for k in range(pieces):
                state = self._advance_piece(state, piece_of_step(step, k, pieces), gamma)
        return (state[0], state[1:]) if finite(state) else None

    def _number_of_pieces(self, step: Step, gamma: tuple[float, ...]) -> int:
        force, others = max(abs(step.force[0]), abs(step.force[2])), step.filtered_couplings
        gain = abs(self.theta_hat[0] * force) + abs(self.theta_hat[3])
        for kappa, x in zip(self.theta_hat[4:], others):
            gain += abs(kappa * x)
        speed = step.dt * gain + max(
            abs(self.v_hat), abs(step.velocity[0]), abs(step.velocity[2]))
        square = speed * speed
        adaptation = (gamma[0] * force * force + gamma[1] * square * square
                      + gamma[2] * square + gamma[3])
        for g, x in zip(gamma[4:], others):
            adaptation += g * x * x
        feedback = -self._a + 2.0 * abs(self.theta_hat[1]) * speed + abs(self.theta_hat[2])
        turns = step.dt * max(feedback, 2.0 * adaptation / -self._a)
        return int(turns) + 1 if turns <= MAX_PIECES else MAX_PIECES + 1

    def _advance_piece(self, state: State, step: Step, gamma: tuple[float, ...]) -> State:
        v_hat, *theta = self._integrate(self._a, gamma, state, step)
        return (v_hat, *[bottom if p < bottom else top if p > top else p
                         for p, bottom, top in zip(theta, self._low, self._high)])
