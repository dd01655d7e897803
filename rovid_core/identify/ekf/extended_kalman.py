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
from typing import Any

from rovid_core.identify.ekf.batch_start import DURATION, KNOWN, LONGEST, Start
from rovid_core.identify.ekf.change_detection import SOON, SURPRISE, Upsets
from rovid_core.identify.ekf.follower import Follower
from rovid_core.identify.ekf.innovations import HUBER, Innovations
from rovid_core.identify.ekf.linearised import ALPHA, DELAY, VELOCITY
from rovid_core.identify.ekf.normalised import Normalised
from rovid_core.identify.excitation import LEAST_EXCITATION, LEAST_MOTION
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.samples import Step
from rovid_core.settings.scales import Scales

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
        self._normalised = Normalised(scales)
        self.bounds = self._normalised.bounds
        self._most = (LARGEST * scales.force, LARGEST * scales.velocity)
        self.reset()

    def reset(self) -> None:
        """Go back to the initial values."""
        self._follower = self._new(self._normalised.initial)
        self._innovations = Innovations(FIRST_NOISE)
        self._start: Start | None = Start()
        self._upsets = Upsets()
        self.v_hat = math.nan
        self.excitation = 0.0
        self._publish()

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity [m/s or rad/s], keeping the parameters."""
        self._follower.restart(velocity, self._innovations.noise)
        self._upsets.restart()
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
            self._follower.moving = False  # the path goes on from the next step
            return 'out_of_range'
        if not self._follower.moving:
            self.restart(step.velocity[0])
        start = self._start
        adapt = adapt and not self._at_rest(step)
        try:
            measured = self._follower.move(
                step, self._innovations.model_noise(step), self._innovations.noise)
            outlier = measured is not None and self._take(step, *measured, adapt)
        except ArithmeticError:  # a number out of range on the way is no better than a divergence
            self._begin_again()
            return 'diverged'
        self._upsets.time += step.dt
        self.v_hat = self._follower.velocity(step)
        if self._start is start is not None:  # or it begins after this step
            self._go_on_with_start(step, outlier, adapt)
        if adapt:
            self._publish()
        return ''

    @property
    def note(self) -> str:
        """Return what the filter has to say of the vehicle and its model, '' if nothing."""
        since = self._upsets.since_change
        if math.isfinite(since):
            return f'the vehicle changed {since:.0f} s ago: its parameters are found anew'
        if self._innovations.model_error and self._start is None:
            return 'the model does not explain all of the motion: the intervals are wider'
        return ''

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {
            'parameters': list(self.parameters), 'follower': self._follower.state(),
            'innovations': self._innovations.state(),
            'start': None if self._start is None else self._start.state(),
            'upsets': self._upsets.state(),
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
        new._follower.restore(state['follower'])
        new._innovations.restore(state['innovations'])
        if state['start'] is None:
            new._start = None
        elif new._start is not None:
            new._start.restore(state['start'])
        new._upsets.restore(state['upsets'])
        new.v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        new.excitation = float(state['excitation'])
        if not math.isfinite(new.excitation):
            raise ValueError('excitation is not finite')
        new._publish()
        self.__dict__ = new.__dict__

    def _new(self, nominal: Sequence[float]) -> Follower:
        """Return a filter at the initial values that is linearised at others."""
        follower = Follower(
            nominal, self._normalised.prior, self._scales.force, self._scales.velocity)
        follower.filter.deviate(self._normalised.initial)
        return follower

    def _in_range(self, step: Step) -> bool:
        f, v = self._most
        one, other = step.forces
        return (abs(step.force[1]) <= f and abs(one) <= f and abs(other) <= f
                and abs(step.mean) <= v and abs(step.velocity[0]) <= v)

    def _at_rest(self, step: Step) -> bool:
        """Tell whether there is neither thrust nor sure motion: noise would be taken for drag."""
        square = (step.force[1] / self._scales.force)**2
        self.excitation -= math.expm1(-step.dt / FORGET) * (square - self.excitation)
        if square > LEAST_EXCITATION or self.excitation > LEAST_EXCITATION:
            return False
        filter = self._follower.filter
        speed = filter.nominal[VELOCITY]
        return speed * speed < LEAST_MOTION + 9.0 * filter.variance(VELOCITY)

    def _take(self, step: Step, i: int, value: float, adapt: bool) -> bool:
        """Take a measurement; return whether it is an outlier."""
        filter, innovations, upsets = self._follower.filter, self._innovations, self._upsets
        error, variance = filter.innovation(i, value, innovations.noise**2)
        normalised = error / math.sqrt(variance)
        upsets.was_right = upsets.was_right or not innovations.model_error
        if adapt:
            innovations.take(normalised, step.dt)
        if upsets.outlier(normalised):
            beginning = self._start is not None and self._start.duration < SOON
            if upsets.lost(beginning):
                self._find_again(error, adapt)
            return True
        if adapt:
            share = step.dt * (0.5 * WALK) ** 2 / 3600.0
            filter.widen([share * x for x in self._normalised.prior])
        size = abs(normalised) / HUBER
        filter.update(i, error, variance * size if size > 1.0 else variance, adapt)
        filter.relinearise(self._normalised.box)
        if adapt and (upsets.still_wrong or upsets.was_right and innovations.model_error
                      and innovations.surprise > SURPRISE):
            self._note_change()
        return False

    def _find_again(self, error: float, adapt: bool) -> None:
        """Take position and velocity anew; twice in a short time, the vehicle has changed."""
        if self._start is not None:
            # it began with an outlier
            self._follower, self._start = self._new(self._normalised.initial), Start()
            self._follower.filter.relinearise(self._normalised.box)
            self.restart(0.0)
            return
        self._follower.filter.widen((error * error, error * error))
        if self._upsets.lost_again() and adapt:
            self._note_change()

    def _note_change(self) -> None:
        self._follower.filter.loosen_parameters(CHANGE)
        self._innovations.model_error = True
        self._upsets.changed()

    def _go_on_with_start(self, step: Step, outlier: bool, adapt: bool) -> None:
        """Keep the first seconds, and go through them again once they say something."""
        assert self._start is not None
        if not adapt:
            if self._start.duration:
                self._start = Start()
                self._start.add(self.v_hat)
            return
        self._start.add(step, outlier)
        if self._start.duration < DURATION:
            return
        filter = self._follower.filter
        alpha = filter.nominal[ALPHA]
        if filter.variance(ALPHA) < (KNOWN * alpha) ** 2:
            with suppress(ArithmeticError):
                self._follower, self._innovations = self._start.again(
                    self._new, self._normalised.box, filter.nominal[ALPHA:],
                    self._innovations.noise)
            self._start = None
        elif self._start.duration > LONGEST:
            self._start = Start()
            self._start.add(self.v_hat)

    def _begin_again(self) -> None:
        """Keep the last good parameters, and nothing else."""
        good = [*self._normalised.of(self.parameters), 0.0]
        self._follower = Follower(
            good, self._normalised.prior, self._scales.force, self._scales.velocity)
        self._innovations = Innovations(FIRST_NOISE)
        self._start, self._upsets, self.v_hat = Start(), Upsets(), math.nan

    def _publish(self) -> None:
        filter, normalised = self._follower.filter, self._normalised
        self.parameters = normalised.parameters(filter.nominal)
        self.delay = filter.nominal[DELAY]
        self.uncertainty = normalised.uncertainty(
            filter.covariance, self._innovations.inflation)
