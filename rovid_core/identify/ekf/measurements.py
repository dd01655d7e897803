"""What is measured when along the steps of the pipe, and with which force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from rovid_core.identify.ekf.linearised_filter import floats, POSITION, VELOCITY
from rovid_core.identify.ekf.recent_force import RecentForce
from rovid_core.model.samples import Step


class Measurement(NamedTuple):
    """
    The span that a filter moves over, and what is measured at its end.

    Attributes
    ----------
    start, end : float
        [s] on the clock of the force.
    i : int
        ``POSITION`` or ``VELOCITY``.
    value : float or None
        In typical velocities (times 1 s); None for the first fix, where the path begins.
    turn : float
        By which the body turned [rad]: the noise of a fix times this goes into the path.
    slip : float
        Standard deviation of what the attitude puts the path wrong by.
    dt : float
        [s] since the last measurement.
    couplings : tuple of m floats
        The mean of each regressor of the couplings over the span.
    watched : tuple of floats
        The same of those that are only watched.

    """

    start: float
    end: float
    i: int
    value: float | None
    turn: float
    slip: float
    dt: float
    couplings: tuple[float, ...]
    watched: tuple[float, ...] = ()


class MeasurementClock:
    """
    Turn steps into measurements of the path or the velocity.

    With fixes the measurement is the path along the body axis, which is summed up from the
    mean velocities, from 0 at the first fix; with a velocity sensor it is the velocity. The
    force of the half interval after a fix is known when the next mean velocity is; so a
    filter stands at the fix before the end of a step.

    Parameters
    ----------
    force, velocity : float
        The units.
    couplings, watched : int
        How many there are; those of a step without any are taken as 0.

    Attributes
    ----------
    recent : RecentForce
        The force.
    ahead : float
        [s] from the last measurement to the end of the last step.

    """

    def __init__(self, force: float, velocity: float, couplings: int, watched: int = 0) -> None:
        self._force, self._velocity = force, velocity
        self.couplings = couplings
        self.watched = watched
        self._no_couplings, self._nothing_watched = (0.0,) * couplings, (0.0,) * watched
        self.restart()

    def restart(self) -> None:
        """Begin a new path."""
        self.recent = RecentForce()
        self._path = 0.0
        self._fix = -1.0  # [s] time of the last measurement, by the force's clock
        self.ahead = 0.0

    def add_step(self, step: Step) -> Measurement:
        """Return what a step measures."""
        recent, first, unit = self.recent, self._fix < 0.0, self._force
        at = recent.end + (step.parts[0] if step.interval else step.dt)
        if step.pieces:
            recent.add([(length, force / unit) for length, force in step.pieces], held=True)
        else:
            recent.add([(length, force / unit) for length, force in zip(
                step.parts if step.interval else (step.dt,), step.forces)])
        end = recent.end
        start = end - step.dt if first else self._fix
        self._fix, self.ahead = at, end - at
        couplings = tuple([before for before, _ in step.couplings]) or self._no_couplings
        watched = step.watched or self._nothing_watched
        if not step.interval:
            return Measurement(start, at, VELOCITY, step.mean / self._velocity, 0.0, 0.0, step.dt,
                               couplings, watched)
        path = self._path
        self._path += step.mean * step.interval / self._velocity
        return Measurement(start, at, POSITION, None if first else path, step.turn,
                           step.path_noise / self._velocity, step.dt, couplings, watched)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'recent': self.recent.state(), 'path': self._path, 'fix': self._fix,
                'ahead': self.ahead}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        path, fix, ahead = floats([state[name] for name in ('path', 'fix', 'ahead')], 3)
        self.recent.restore(state['recent'])
        self._path, self._fix, self.ahead = path, fix, ahead
