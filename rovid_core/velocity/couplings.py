"""
How the other degrees of freedom act on one: measured regressors of the coupled plant.

    v_i' = alpha tau + beta v|v| + gamma v + delta + sum kappa_j x_j

A regressor x_j is a product of the *other* DOFs' mean velocities over the interval between two
measurements, or a restoring term of the attitude. The means are not low-passed, because a
low-pass of v r is not the product of the low-passed v and r, and because the noise of one mean
is independent of that of the other. DOFs of other inputs are coupled with the linear velocities
that the Kalman filters of these DOFs have: they are through the water as far as the current is
known, and have a small part of the noise of a difference of fixes, which a single velocity such
as ``v`` of yaw would hand on to the parameters as a bias. What is only watched takes the measured
ones.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from rovid_core.model.dofs import HEADING, OWN, RESTORING, THRUSTS, Vector
from rovid_core.model.samples import Motion, NS
from rovid_core.settings.run import Settings
from rovid_core.velocity.attitude_history import (
    AttitudeHistory,
    MAX_KEPT,
    rotate,
    rotate_back,
    rotation_between,
)
from rovid_core.velocity.turning_rate import TurningRate

LINEAR, ANGULAR = 'uvw', 'pqr'
OF_ATTITUDE = (*RESTORING, *HEADING)
FACTORS = (*LINEAR, *ANGULAR, *OF_ATTITUDE, '')  # the last one is 1
OF_FORCES = (*OWN, *THRUSTS)
NO_PRODUCTS = (*OF_ATTITUDE, *OF_FORCES)


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

    def begins_by(self, time: int) -> bool:
        """Tell whether velocities are known from a time [ns] on, or from before it."""
        return bool(self._means) and self._means[0][0] <= time

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
        x = y = z = 0.0
        for a, b, velocity in reversed(self._means):
            if a >= end:
                continue
            share = (min(b, end) - max(a, start)) / (end - start)
            x += share * velocity[0]
            y += share * velocity[1]
            z += share * velocity[2]
            if a <= start:
                break
        return (x, y, z)


class Needed(NamedTuple):
    """
    What some regressors are made of.

    Attributes
    ----------
    linear, turns : bool
        Whether linear velocities, and angular ones.
    points : bool
        Whether the attitude itself.
    early : tuple of str
        Those that need no linear velocity.
    factors : tuple of (int, int)
        Where the two factors of each stand in ``FACTORS``.

    """

    linear: bool
    turns: bool
    points: bool
    early: tuple[str, ...]
    factors: tuple[tuple[int, int], ...]


class CouplingRegressors:
    """
    The regressors of all DOFs that have couplings.

    Parameters
    ----------
    settings : Settings
        The run; ``couplings`` of a DOF names its regressors.
    attitude : AttitudeHistory
        The attitudes that were accepted.

    Attributes
    ----------
    are_there : bool
        Whether a DOF has couplings, or some are watched.
    inputs : tuple of str
        Those whose velocities couplings are made of; what is only watched asks for none.
    linear_input : str
        That of linear velocities; its own DOFs are coupled with them as they are measured.

    """

    def __init__(self, settings: Settings, attitude: AttitudeHistory) -> None:
        self._attitude = attitude
        self.are_there = any(
            settings.couplings(dof) or settings.watched(dof) for dof in settings.dofs)
        self.linear_input = 'velocity' if settings.velocity.topic else 'position'
        self._has_attitude = bool(settings.attitude.topic)
        self._rates_input = 'angular_velocity' if settings.angular_velocity.topic else 'attitude'
        letters = {x for dof in settings.dofs for name in settings.couplings(dof)
                   if name not in NO_PRODUCTS for x in name}
        self.inputs = (self.linear_input if letters & set(LINEAR) else '',
                       self._rates_input if letters & set(ANGULAR) else '')
        self._linear, self._rates = MeanVelocities(), MeanVelocities()
        self._filtered = MeanVelocities()
        self._turning, self._turned_at = TurningRate(), 0
        self._known_needs: dict[tuple[str, ...], Needed] = {}
        self.change(settings)

    def change(self, settings: Settings) -> None:
        """Use other timeouts."""
        self._linear.memory = self._rates.memory = self._filtered.memory = (
            2 * round(settings.longest_timeout / NS))
        self._timeouts = {name: round(settings.timeout_of(name) / NS)
                          for name in (self.linear_input, self._rates_input)}

    def restart(self) -> None:
        """Forget all velocities."""
        self._linear.restart()
        self._rates.restart()
        self._filtered.restart()
        self._turning.interrupt()

    def add_filtered(self, time: int, velocity: Vector) -> None:
        """Add a velocity through the water, as the filters of its DOFs have it [m/s]."""
        self._filtered.add_point(time, velocity, self._timeouts[self.linear_input])

    def add_velocity(self, input: str, motion: Motion) -> None:
        """Add a linear velocity as it is measured, whether it is needed or not."""
        if input != self.linear_input:
            return
        if motion.start == motion.end:
            self._linear.add_point(motion.end, motion.body, self._timeouts[input])
        else:
            self._linear.add_mean(motion.start, motion.end, motion.body)

    def add_rates(self, time: int, rates: Vector, jumped: bool) -> None:
        """
        Add what a gyro has measured [rad/s], as soon as it came.

        Its own steps may wait for linear velocities that wait for these.
        """
        if jumped:
            self._rates.restart()
        self._rates.add_point(time, rates, self._timeouts['angular_velocity'])

    def add_turn(self, time: int, rotation: Vector | None) -> None:
        """Add the rotation [rad] from one attitude to the next; None after a pause or a jump."""
        if self._rates_input == 'attitude' and self.are_there:
            dt = (time - self._turned_at) * NS
            if rotation is None or dt <= 0.0:
                self._turning.interrupt()
            else:
                self._rates.add_mean(self._turned_at, time, self._turning.add(rotation, dt))
            self._turned_at = time

    def forget_filtered(self) -> None:
        """Go back to velocities as they are measured: the filters have none for now."""
        self._filtered.restart()

    def _linear_from(self, start: int, measured: bool) -> MeanVelocities:
        """Return the linear velocities that count from a time [ns] on."""
        filtered = self._filtered
        return filtered if not measured and filtered.begins_by(start) else self._linear

    def missing(self, names: tuple[str, ...], start: int, end: int, measured: bool = True) -> str:
        """
        Return '' if they are known over a span [ns], 'later' if they may become so.

        ``measured`` is for linear velocities as they are measured, also where there are filtered
        ones.
        """
        needed = self._needed(names)
        found = self._linear_from(start, measured).missing(start, end) if needed.linear else ''
        by_gyro = needed.turns and self._has_gyro(end)
        if not found and by_gyro:
            found = self._rates.missing(start, end)
        if not found and (needed.points or needed.turns and not by_gyro):
            found = self._attitude.missing(start) or self._attitude.missing(end)
        return 'no_coupling' if found == 'no_attitude' else found

    def _has_gyro(self, end: int) -> bool:
        """Tell whether rates up to a time [ns] come from a gyro, or attitudes stand in for it."""
        return self._rates_input != 'attitude' and (
            not self._has_attitude or end - self._rates.end <= self._timeouts[self._rates_input])

    def has_velocity(self, names: tuple[str, ...]) -> bool:
        """Tell whether a linear velocity of another DOF is in any of some regressors."""
        return self._needed(tuple([name for name in names if name not in OF_FORCES])).linear

    def _needed(self, names: tuple[str, ...]) -> Needed:
        known = self._known_needs.get(names)
        if known is None:
            letters = set(''.join([name for name in names if name not in NO_PRODUCTS]))
            points = any(name in OF_ATTITUDE for name in names)
            known = self._known_needs[names] = Needed(
                bool(letters & set(LINEAR)), bool(letters & set(ANGULAR)), points,
                tuple([name for name in names if name in OF_ATTITUDE
                       or not set(name) & set(LINEAR)]),
                tuple([(FACTORS.index(name if name in OF_ATTITUDE else name[0]),
                        FACTORS.index('' if name in OF_ATTITUDE else name[1:]))
                       for name in names]))
        return known

    def mean(self, names: tuple[str, ...], start: int, end: int,
             measured: bool = True) -> tuple[float, ...]:
        """
        Return the regressors over a span, longer than 0, for which ``missing`` is ''.

        Parameters
        ----------
        names : tuple of str
            Products of velocities, such as ``vr``, single velocities, or restoring terms.
        start, end : int
            [ns]
        measured : bool
            As for ``missing``.

        Returns
        -------
        tuple of float, length len(names)
            [m/s rad/s and so on]; sin(roll) cos(pitch) and sin(pitch) have no unit.

        """
        needed = self._needed(names)
        linear = rates = up = ahead = (0.0, 0.0, 0.0)
        if needed.linear:
            linear = self._linear_from(start, measured).mean(start, end)
        if needed.turns:
            rates = self.mean_rates(start, end)
        if needed.points:
            q = self._attitude.at((start + end) // 2)
            up, ahead = rotate_back(q, (0.0, 0.0, 1.0)), rotate(q, (1.0, 0.0, 0.0))
        values = (*linear, *rates, up[1], -up[0], ahead[0], ahead[1], 1.0)
        return tuple([values[i] * values[j] for i, j in needed.factors])

    def as_known(self, names: tuple[str, ...], start: int, end: int) -> tuple[float, ...]:
        """
        Return regressors over a span as far as they are known by now, 0 where they are not.

        Where the linear velocities end before the span does, all are taken as much earlier.
        """
        needed = self._needed(names)
        early = needed.early
        late = max(end - self._linear.end, 0) if needed.linear else 0
        if late <= self._timeouts[self.linear_input] and not (
                self.missing(names, start - late, end - late)):
            return self.mean(names, start - late, end - late)
        if self.missing(early, start, end):
            return (0.0,) * len(names)
        values = dict(zip(early, self.mean(early, start, end)))
        return tuple([values.get(name, 0.0) for name in names])

    def mean_rates(self, start: int, end: int) -> Vector:
        """Return the mean angular velocity [rad/s] over a span [ns] whose attitudes are known."""
        if not self._rates.missing(start, end):
            return self._rates.mean(start, end)
        x, y, z = self._attitude.known_rotation(start, end) or rotation_between(
            self._attitude.at(start), self._attitude.at(end))
        dt = (end - start) * NS
        return (x / dt, y / dt, z / dt)


def own_regressors(own: Sequence[tuple[int, str]], motions: tuple[Motion, Motion],
                   integrals: Sequence[Sequence[float]],
                   parts: tuple[float, float]) -> list[tuple[float, float]]:
    """
    Return those of ``OWN`` over both parts of a step, as they are measured.

    Parameters
    ----------
    own : sequence of (int, str)
        Number of the DOF among those of its source, and name.
    motions : pair of Motion
        At which the step begins and ends.
    integrals : 3 sequences of floats
        Of the force on each DOF, up to the start, the middle and the end.
    parts : pair of floats
        Lengths of the parts [s].

    """
    found = []
    for j, name in own:
        if name == OWN[0]:
            one, other = [min((b[j] - a[j]) / dt, 0.0) if dt > 0.0 else 0.0
                          for a, b, dt in zip(integrals, integrals[1:], parts)]
        else:
            one, other = [min(motion.velocity[j], 0.0) * abs(motion.velocity[j])
                          for motion in motions]
            if motions[1].start == motions[1].end:  # velocities at both ends of the step
                one = other = 0.5 * (one + other)
        found.append((one, other))
    return found
