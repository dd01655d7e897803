"""
How the other degrees of freedom act on one: measured regressors of the coupled plant.

    v_i' = alpha tau + beta v|v| + gamma v + delta + sum kappa_j x_j

A regressor x_j is a product of the *other* DOFs' mean velocities over the interval between two
measurements, or a restoring term of the attitude. The means are not low-passed, because a
low-pass of v r is not the product of the low-passed v and r, and because the noise of one mean
is independent of that of the other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rovid_core.model.dofs import HEADING, RESTORING, Vector
from rovid_core.model.samples import Motion
from rovid_core.settings.run import Settings
from rovid_core.velocity.attitude_history import (
    AttitudeHistory,
    MAX_KEPT,
    rotate,
    rotate_back,
    rotation_between,
)

NS = 1e-9

LINEAR, ANGULAR = 'uvw', 'pqr'
OF_ATTITUDE = (*RESTORING, *HEADING)


class MeanVelocities:
    """
    The mean of a velocity over any span, from means over intervals that follow each other.

    Attributes
    ----------
    memory : int
        [ns] How far back velocities are needed.

    """

    def __init__(self) -> None:
        self.memory = 0
        self.restart()

    def restart(self) -> None:
        """Forget all velocities."""
        self._means: deque[tuple[int, int, Vector]] = deque(maxlen=MAX_KEPT)
        self._point: tuple[int, Vector] | None = None

    @property
    def end(self) -> int:
        """Return up to when velocities are known [ns]; 0 if none is."""
        return self._means[-1][1] if self._means else 0

    def add_mean(self, start: int, end: int, velocity: Vector) -> None:
        """Add the mean velocity from ``start`` to ``end`` [ns]."""
        means = self._means
        if means and means[-1][1] != start:
            means.clear()  # an interval is missing: nothing is known across it
        means.append((start, end, velocity))
        while means[0][1] < end - self.memory:
            means.popleft()

    def add_point(self, time: int, velocity: Vector, timeout: int) -> None:
        """Add a velocity at one time [ns]; between two points it is a straight line."""
        last, self._point = self._point, (time, velocity)
        if last is None or time - last[0] > timeout:
            self._means.clear()
        elif time > last[0]:
            a, b = last[1], velocity
            self.add_mean(last[0], time, (
                0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])))

    def missing(self, start: int, end: int) -> str:
        """Return '' if the velocity over a span is known, 'later' if it may become so."""
        if not self._means or self._means[-1][1] < end:
            return 'later'
        return '' if self._means[0][0] <= start else 'no_coupling'

    def mean(self, start: int, end: int) -> Vector:
        """Return the mean over a span [ns], longer than 0, for which ``missing`` is ''."""
        total = [0.0, 0.0, 0.0]
        for a, b, velocity in reversed(self._means):
            if a >= end:
                continue
            share = (min(b, end) - max(a, start)) / (end - start)
            for k in range(3):
                total[k] += share * velocity[k]
            if a <= start:
                break
        return (total[0], total[1], total[2])


class CouplingRegressors:
    """
    The regressors of all DOFs that have couplings.

    ``inputs`` are those whose velocities couplings are made of; what is only watched asks for
    none.

    Parameters
    ----------
    settings : Settings
        The run; ``couplings`` of a DOF names its regressors.
    attitude : AttitudeHistory
        The attitudes that were accepted.

    """

    def __init__(self, settings: Settings, attitude: AttitudeHistory) -> None:
        self._attitude = attitude
        self._linear_input = 'velocity' if settings.velocity.topic else 'position'
        self._rates_input = 'attitude' if settings.attitude.topic else 'angular_velocity'
        letters = {x for dof in settings.dofs for name in settings.couplings(dof)
                   if name not in OF_ATTITUDE for x in name}
        self.inputs = (self._linear_input if letters & set(LINEAR) else '',
                       self._rates_input if letters & set(ANGULAR) else '')
        self._linear, self._rates = MeanVelocities(), MeanVelocities()
        self.change(settings)

    def change(self, settings: Settings) -> None:
        """Use other timeouts."""
        self._linear.memory = self._rates.memory = 2 * round(settings.longest_timeout / NS)
        self._timeouts = {name: round(settings.timeout_of(name) / NS)
                          for name in (self._linear_input, self._rates_input)}

    def restart(self) -> None:
        """Forget all velocities."""
        self._linear.restart()
        self._rates.restart()

    def add_velocity(self, input: str, motion: Motion) -> None:
        """Add what an input has measured, whether it is needed or not."""
        if input == self._linear_input:
            history = self._linear
        elif input == self._rates_input:
            history = self._rates
        else:
            return
        if motion.start == motion.end:
            history.add_point(motion.end, motion.body, self._timeouts[input])
        else:
            history.add_mean(motion.start, motion.end, motion.body)

    def missing(self, names: tuple[str, ...], start: int, end: int) -> str:
        """Return '' if they are known over a span [ns], 'later' if they may become so."""
        found = ''
        for needed, missing in self._needed(names):
            if needed and not found:
                found = missing(start, end)
        return 'no_coupling' if found == 'no_attitude' else found

    def _needed(self, names: tuple[str, ...]
                ) -> tuple[tuple[bool, Callable[[int, int], str]], ...]:
        letters = ''.join([name for name in names if name not in OF_ATTITUDE])
        turns = any(x in ANGULAR for x in letters)
        by_attitude = self._rates_input == 'attitude'
        return (
            (any(x in LINEAR for x in letters), self._linear.missing),
            (turns and not by_attitude, self._rates.missing),
            (turns and by_attitude or any(name in OF_ATTITUDE for name in names),
             self._missing_attitude))

    def _missing_attitude(self, start: int, end: int) -> str:
        return self._attitude.missing(start) or self._attitude.missing(end)

    def mean(self, names: tuple[str, ...], start: int, end: int) -> tuple[float, ...]:
        """
        Return the regressors over a span, longer than 0, for which ``missing`` is ''.

        Parameters
        ----------
        names : tuple of str
            Products of velocities, such as ``vr``, single velocities, or restoring terms.
        start, end : int
            [ns]

        Returns
        -------
        tuple of float, length len(names)
            [m/s rad/s and so on]; sin(roll) cos(pitch) and sin(pitch) have no unit.

        """
        values: dict[str, float] = {}
        needed = [on for on, _ in self._needed(names)]
        if needed[0]:
            values.update(zip(LINEAR, self._linear.mean(start, end)))
        if needed[1]:
            values.update(zip(ANGULAR, self._rates.mean(start, end)))
        elif needed[2] and self._rates_input == 'attitude':
            values.update(zip(ANGULAR, self._mean_rates(start, end)))
        if any(name in OF_ATTITUDE for name in names):
            q = self._attitude.at((start + end) // 2)
            up, ahead = rotate_back(q, (0.0, 0.0, 1.0)), rotate(q, (1.0, 0.0, 0.0))
            values['sin_roll'], values['sin_pitch'] = up[1], -up[0]
            values['cos_heading'], values['sin_heading'] = ahead[0], ahead[1]
        return tuple([values[name] if name in OF_ATTITUDE else _product(values, name)
                      for name in names])

    def as_known(self, names: tuple[str, ...], start: int, end: int) -> tuple[float, ...]:
        """
        Return regressors over a span as far as they are known by now, 0 where they are not.

        Where the linear velocities end before the span does, all are taken as much earlier.
        """
        of_attitude = tuple([name for name in names if name in OF_ATTITUDE
                             or not set(name) & set(LINEAR)])
        late = max(end - self._linear.end, 0) if of_attitude != names else 0
        if late <= self._timeouts[self._linear_input] and not (
                self.missing(names, start - late, end - late)):
            return self.mean(names, start - late, end - late)
        if self.missing(of_attitude, start, end):
            return (0.0,) * len(names)
        values = dict(zip(of_attitude, self.mean(of_attitude, start, end)))
        return tuple([values.get(name, 0.0) for name in names])

    def _mean_rates(self, start: int, end: int) -> Vector:
        x, y, z = rotation_between(self._attitude.at(start), self._attitude.at(end))
        dt = (end - start) * NS
        return (x / dt, y / dt, z / dt)


def _product(values: dict[str, float], name: str) -> float:
    product = 1.0
    for letter in name:
        product *= values[letter]
    return product
