"""A filter moved along the steps of the pipe: what is measured when, and with which force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from rovid_core.identify.ekf.linearised_filter import (
    diagonal,
    ForceImpulse,
    INDICES,
    LinearisedFilter,
    packed,
    POSITION,
    SIZE,
    VELOCITY,
)
from rovid_core.model.samples import Step

LARGEST_SUBSTEPS = 50


class StepFilter:
    """
    A :class:`LinearisedFilter` that goes from measurement to measurement.

    With fixes the measurement is the path along the body axis, which is summed up from the
    mean velocities, from 0 at the first fix; with a velocity sensor it is the velocity. The
    force of the half interval after a fix is known when the next mean velocity is; so the
    filter stands at the fix before the end of a step.

    Parameters
    ----------
    nominal : sequence of 5 floats
        The four parameters in units of the scales, delay [s].
    variances : sequence of 7 floats
        Of the state; only those of the parameters and the delay count.
    force, velocity : float
        The units.

    """

    def __init__(self, nominal: Sequence[float], variances: Sequence[float], force: float,
                 velocity: float) -> None:
        self.filter = LinearisedFilter((0.0, 0.0, *nominal), diagonal(variances))
        self._force, self._velocity = force, velocity
        self.moving = False
        self._begin()

    def _begin(self) -> None:
        self._impulse = ForceImpulse()
        self._path = 0.0
        self._fix = -1.0  # [s] time of the last measurement, by the impulse' clock
        self._ahead = 0.0  # [s] from there to the end of the last step

    def restart(self, velocity: float, noise: float) -> None:
        """Take up from a measured velocity [m/s or rad/s]; the path begins with ``noise``."""
        # it may be an outlier
        v = max(-1.0, min(1.0, velocity / self._velocity))
        self.filter.set_motion(v, (noise * noise, 1.0))
        self._begin()
        self.moving = True

    @property
    def initial_velocity(self) -> float:
        """Return the velocity at ``filter.estimate_initial_velocity`` [m/s or rad/s]."""
        return self._velocity * self.filter.initial_velocity

    def move(self, step: Step, noise: float, turned: float) -> tuple[int, float] | None:
        """
        Go to the next measurement and return which state was measured, and its value.

        Parameters
        ----------
        step : Step
            What was measured.
        noise : float
            Spectral density of the acceleration that the model does not know.
        turned : float
            Standard deviation of the path from a turn of 1 rad: the noise of a fix.

        Returns
        -------
        tuple or None
            None for the first fix, which is where the path begins.

        Raises
        ------
        DivergenceError
            If the state means nothing any more.

        """
        impulse, first = self._impulse, self._fix < 0.0
        spans = step.parts if step.interval else (step.dt,)
        at = impulse.end + spans[0]
        one, other = step.forces
        impulse.add(spans, (one / self._force, other / self._force))
        end = impulse.end
        start = end - step.dt if first else self._fix
        if at > start:
            self._predict(start, at, noise)
        self._fix = at
        self._ahead = end - at
        if not step.interval:
            return VELOCITY, step.mean / self._velocity
        path = self._path
        self._path += step.mean * step.interval / self._velocity
        if step.turn:
            # the noise of the fix between two intervals does not cancel when they are turned
            self.filter.widen(((step.turn * turned)**2 + (step.path_noise / self._velocity)**2,))
        return None if first else (POSITION, path)

    def _predict(self, start: float, end: float, noise: float) -> None:
        """Divide a step on which the drag settles: Runge-Kutta would blow up."""
        _, v, _, beta, gamma, _, _ = self.filter.nominal
        turn = (end - start) * (2.0 * abs(beta * v) + abs(gamma))
        if turn < 1.0:
            self.filter.predict(self._impulse, start, end, noise)
            return
        pieces = min(int(turn), LARGEST_SUBSTEPS - 1) + 1
        for k in range(pieces):
            self.filter.predict(
                self._impulse, start + (end - start) * k / pieces,
                start + (end - start) * (k + 1) / pieces, noise)

    def velocity(self, step: Step) -> float:
        """Return the velocity at the end of the step [m/s or rad/s]."""
        _, v, alpha, beta, gamma, delta, _ = self.filter.nominal
        force = step.forces[1] if self._ahead else 0.0
        rate = alpha * force / self._force + (beta * abs(v) + gamma) * v + delta
        return self._velocity * (v + self._ahead * rate)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {
            'nominal': list(self.filter.nominal),
            'covariance': [self.filter.covariance[k] for of in INDICES for k in of],
            'impulses': self._impulse.state(), 'moving': self.moving,
            'path': self._path, 'fix': self._fix, 'ahead': self._ahead}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        nominal = [float(x) for x in state['nominal']]
        entries = [float(x) for x in state['covariance']]
        if len(nominal) != SIZE or len(entries) != SIZE * SIZE:
            raise ValueError('the state of the filter does not fit')
        if not all(map(math.isfinite, (*nominal, *entries))):
            raise ValueError('the state of the filter is not finite')
        path, fix, ahead = (float(state[name]) for name in ('path', 'fix', 'ahead'))
        if not all(map(math.isfinite, (path, fix, ahead))):
            raise ValueError('the path is not finite')
        covariance = packed([entries[k:k + SIZE] for k in range(0, SIZE * SIZE, SIZE)])
        self.filter = LinearisedFilter(nominal, covariance)
        self._impulse.restore(state['impulses'])
        self.moving = bool(state['moving'])
        self._path, self._fix, self._ahead = path, fix, ahead
