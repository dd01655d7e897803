"""
The extended Kalman filter on position, velocity, parameters and delay of one DOF.

It takes the fixes themselves, or a velocity sensor's values, and the force before any
low-pass. Its first seconds are gone through again in steps of Gauss-Newton, for a filter
that was linearised far from the truth keeps the mistake for ever.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
import math
from typing import Any, cast, NamedTuple

from rovid_core.identify.ekf.batch_start import BatchStart, DURATION, KNOWN, LONGEST
from rovid_core.identify.ekf.innovations import (
    ChangeDetection,
    HUBER,
    Innovations,
    LARGEST_MEAN,
    SOON,
)
from rovid_core.identify.ekf.linearised_filter import (
    ALPHA,
    DELAY,
    DIAGONAL,
    INDICES,
    Packed,
    VELOCITY,
)
from rovid_core.identify.ekf.step_filter import StepFilter
from rovid_core.identify.excitation import MIN_EXCITATION, MIN_MOTION
from rovid_core.identify.intervals import Uncertainty
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

FIRST_NOISE = 0.02
"""Noise of a measurement to begin with, in typical velocities (times 1 s)."""

CHANGE = 0.5
"""What the parameters may have changed by, relative, when the vehicle has changed."""

LARGEST = 1e4
"""In typical forces and velocities; what is larger is a mistake."""

WALK = 5e-6
"""What the parameters may change by anyway, relative, in an hour."""

FORGET = 5.0
"""[s] over which the thrust's mean square is taken."""

DELAYS = (-0.05, 0.6)
"""Range of the delay [s]; far below 0 the force would have to be known ahead."""

DELAY_STD = 0.05
"""[s] of the guess that there is none."""


class NormalisedModel:
    """
    What :class:`LinearisedFilter` begins with, and its state in SI units.

    alpha to delta become accelerations in typical velocities per second.

    Parameters
    ----------
    scales : Scales
        Of the degree of freedom.

    Attributes
    ----------
    initial : list of 5 floats
        Parameters and delay [s].
    prior : tuple of 7 floats
        Variances of the state before any measurement; 0 for the motion.
    box : list
        Bounds of the state: index, lowest, highest value.
    bounds : tuple
        The lowest and the highest lumped parameters.

    """

    def __init__(self, scales: Scales) -> None:
        v, f = scales.velocity, scales.force
        self._unit = (v / f, 1.0 / v, 1.0, v)
        self._active = scales.active
        self.initial = [*self.of(scales.initial), 0.0]
        self.bounds = low, high = scales.bounds()
        self.box = [
            (ALPHA + k, low[k] / self._unit[k], high[k] / self._unit[k])
            for k in range(4) if scales.active[k]] + [(DELAY, *DELAYS)]
        # a drag of 2 alpha balances twice the typical force at the typical speed
        alpha, beta, gamma, delta = map(abs, self.initial[:4])
        std = (2.0 * alpha, 2.0 * max(alpha, beta), 2.0 * max(alpha, gamma), max(alpha, delta))
        self.prior = (0.0, 0.0, *[s * s if on else 0.0 for s, on in zip(std, self._active)],
                      DELAY_STD**2)

    def of(self, parameters: Sequence[float]) -> list[float]:
        """Return lumped parameters in these units."""
        return [p / u for p, u in zip(parameters, self._unit)]

    def parameters(self, state: Sequence[float]) -> Four:
        """Return the lumped parameters of a state."""
        _, _, p, q, r, s, _ = state
        i, j, k, m = self._unit
        (a, b, c, d), (e, f, g, h) = self.bounds
        p, q, r, s = p * i, q * j, r * k, s * m
        if a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h:
            return p, q, r, s
        # unscaling may lead out of the bounds by a last bit
        return (min(max(p, a), e), min(max(q, b), f), min(max(r, c), g), min(max(s, d), h))

    def uncertainty(self, covariance: Packed, inflation: float) -> Uncertainty:
        """Return that of the lumped parameters; variances are ``inflation`` times as large."""
        return FilterUncertainty(covariance, inflation, self._unit, self._active)


class FilterUncertainty(NamedTuple):
    """What a filter's covariance says of the lumped parameters."""

    of_state: Packed
    inflation: float
    unit: Four
    active: tuple[bool, bool, bool, bool]

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the lumped parameters, 16 floats by rows."""
        return tuple([self.of_state[k] * (u * v * self.inflation)
                      for of, u in zip(INDICES[ALPHA:DELAY], self.unit)
                      for k, v in zip(of[ALPHA:DELAY], self.unit)])

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN for left-out terms."""
        return cast(Four, tuple([
            math.sqrt(x) if on else math.nan
            for x, on in zip(self.covariance[::5], self.active)]))

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return math.sqrt(self.of_state[DIAGONAL[DELAY]])


class ExtendedKalman(Identifier):
    """
    The extended Kalman filter on one DOF.

    The noise of the measurements is learned from the innovations. While these hang together
    the model is in error; the filter then forgets quickly how it came where it is
    (``Innovations``). Measurements beyond ``HUBER`` standard deviations count less, beyond
    ``OUTLIER`` not at all.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.

    """

    def __init__(self, scales: Scales) -> None:
        self._scales = scales
        self._normalised = NormalisedModel(scales)
        self.bounds = self._normalised.bounds
        self._largest = (LARGEST * scales.force, LARGEST * scales.velocity)
        self.reset()

    def reset(self) -> None:
        """Go back to the initial values."""
        self._filter = self._new(self._normalised.initial)
        self._innovations = Innovations(FIRST_NOISE)
        self._start: BatchStart | None = BatchStart()
        self._changes = ChangeDetection()
        self.v_hat = math.nan
        self.excitation = 0.0
        self._publish()

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity [m/s or rad/s], keeping the parameters."""
        self._filter.restart(velocity, self._innovations.noise)
        self._changes.restart()
        self.v_hat = velocity
        if self._start is not None:
            self._start.add(velocity)

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Take one step; return '' or why it was refused.

        Parameters
        ----------
        step : Step
            What was measured.
        adapt : bool
            False leaves the parameters as they are.

        """
        if not self._in_range(step):
            self._filter.moving = False  # the path goes on from the next step
            return 'out_of_range'
        if not self._filter.moving:
            self.restart(step.velocity[0])
        start = self._start
        adapt = adapt and not self._at_rest(step)
        try:
            measured = self._filter.move(
                step, self._innovations.model_noise(step), self._innovations.noise)
            outlier = measured is not None and self._update(step, *measured, adapt)
        except ArithmeticError:  # a number out of range on the way is no better than a divergence
            self._begin_again()
            return 'diverged'
        self._changes.time += step.dt
        self.v_hat = self._filter.velocity(step)
        if self._start is start is not None:  # or it begins after this step
            self._go_on_with_start(step, outlier, adapt)
        if adapt:
            self._publish()
        return ''

    @property
    def note(self) -> str:
        """Return what the filter has to say of the vehicle and its model, '' if nothing."""
        since = self._changes.since_change
        if math.isfinite(since):
            return f'the vehicle changed {since:.0f} s ago: its parameters are found anew'
        if self._innovations.model_error and self._start is None:
            return 'the model does not explain all of the motion: the intervals are wider'
        return ''

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {
            'parameters': list(self.parameters), 'follower': self._filter.state(),
            'innovations': self._innovations.state(),
            'start': None if self._start is None else self._start.state(),
            'upsets': self._changes.state(),
            'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
            'excitation': self.excitation}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        parameters = [float(x) for x in state['parameters']]
        low, high = self.bounds
        if len(parameters) != 4:
            raise ValueError(f'{len(parameters)} parameters, not 4')
        for name, p, bottom, top in zip(PARAMETERS, parameters, low, high):
            if not bottom <= p <= top:
                raise ValueError(f'{name} {p} is outside {bottom} to {top}')
        new = ExtendedKalman(self._scales)
        new._filter.restore(state['follower'])
        new._innovations.restore(state['innovations'])
        if state['start'] is None:
            new._start = None
        elif new._start is not None:
            new._start.restore(state['start'])
        new._changes.restore(state['upsets'])
        new.v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        new.excitation = float(state['excitation'])
        if not math.isfinite(new.excitation):
            raise ValueError('excitation is not finite')
        new._publish()
        self.__dict__ = new.__dict__

    def _new(self, nominal: Sequence[float]) -> StepFilter:
        """Return a filter at the initial values that is linearised at others."""
        step_filter = StepFilter(
            nominal, self._normalised.prior, self._scales.force, self._scales.velocity)
        step_filter.filter.deviate(self._normalised.initial)
        return step_filter

    def _in_range(self, step: Step) -> bool:
        f, v = self._largest
        one, other = step.forces
        return (abs(step.force[1]) <= f and abs(one) <= f and abs(other) <= f
                and abs(step.mean) <= v and abs(step.velocity[0]) <= v)

    def _at_rest(self, step: Step) -> bool:
        """Tell whether there is neither thrust nor sure motion: noise would be taken for drag."""
        square = (step.force[1] / self._scales.force)**2
        self.excitation -= math.expm1(-step.dt / FORGET) * (square - self.excitation)
        if square > MIN_EXCITATION or self.excitation > MIN_EXCITATION:
            return False
        filter = self._filter.filter
        speed = filter.nominal[VELOCITY]
        return speed * speed < MIN_MOTION + 9.0 * filter.variance(VELOCITY)

    def _update(self, step: Step, i: int, value: float, adapt: bool) -> bool:
        """Update with a measurement; return whether it is an outlier."""
        filter, innovations, changes = self._filter.filter, self._innovations, self._changes
        error, variance = filter.innovation(i, value, innovations.noise**2)
        normalised = error / math.sqrt(variance)
        changes.was_right = changes.was_right or not innovations.model_error
        if adapt:
            innovations.add_innovation(normalised, step.dt)
        if changes.outlier(normalised):
            beginning = self._start is not None and self._start.duration < SOON
            if changes.lost(beginning):
                self._find_again(error, adapt)
            return True
        if adapt:
            share = step.dt * (0.5 * WALK) ** 2 / 3600.0
            filter.widen([share * x for x in self._normalised.prior])
        size = abs(normalised) / HUBER
        filter.update(i, error, variance * size if size > 1.0 else variance, adapt)
        filter.relinearise(self._normalised.box)
        if adapt and (changes.still_wrong or changes.was_right and innovations.model_error
                      and innovations.mean_deviation > LARGEST_MEAN):
            self._note_change()
        return False

    def _find_again(self, error: float, adapt: bool) -> None:
        """Take position and velocity anew; twice in a short time, the vehicle has changed."""
        if self._start is not None:
            # it began with an outlier
            self._filter, self._start = self._new(self._normalised.initial), BatchStart()
            self._filter.filter.relinearise(self._normalised.box)
            self.restart(0.0)
            return
        self._filter.filter.widen((error * error, error * error))
        if self._changes.lost_again() and adapt:
            self._note_change()

    def _note_change(self) -> None:
        self._filter.filter.loosen_parameters(CHANGE)
        self._innovations.model_error = True
        self._changes.changed()

    def _go_on_with_start(self, step: Step, outlier: bool, adapt: bool) -> None:
        """Keep the first seconds, and go through them again once they say something."""
        assert self._start is not None
        if not adapt:
            if self._start.duration:
                self._start = BatchStart()
                self._start.add(self.v_hat)
            return
        self._start.add(step, outlier)
        if self._start.duration < DURATION:
            return
        filter = self._filter.filter
        alpha = filter.nominal[ALPHA]
        if filter.variance(ALPHA) < (KNOWN * alpha) ** 2:
            with suppress(ArithmeticError):
                self._filter, self._innovations = self._start.solve(
                    self._new, self._normalised.box, filter.nominal[ALPHA:],
                    self._innovations.noise)
            self._start = None
        elif self._start.duration > LONGEST:
            self._start = BatchStart()
            self._start.add(self.v_hat)

    def _begin_again(self) -> None:
        """Keep the last good parameters, and nothing else."""
        good = [*self._normalised.of(self.parameters), 0.0]
        self._filter = StepFilter(
            good, self._normalised.prior, self._scales.force, self._scales.velocity)
        self._innovations = Innovations(FIRST_NOISE)
        self._start, self._changes, self.v_hat = BatchStart(), ChangeDetection(), math.nan

    def _publish(self) -> None:
        filter, normalised = self._filter.filter, self._normalised
        self.parameters = normalised.parameters(filter.nominal)
        self.delay = filter.nominal[DELAY]
        self.uncertainty = normalised.uncertainty(
            filter.covariance, self._innovations.inflation)
