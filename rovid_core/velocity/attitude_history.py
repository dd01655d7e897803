"""What the velocity sources know of each other: attitude, and velocity in the world."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
import math

from rovid_core.model.dofs import Quaternion, Vector
from rovid_core.settings.run import Settings
from rovid_core.velocity.quaternions import between, rotation_between

NS = 1e-9


MOST_KEPT = 65536
"""Attitudes and depths that are kept, however close their stamps are."""

HEEDING = ('ekf',)
"""Methods that ask how the noise of the attitude bends the path."""

SHARE = 0.01
"""Of a new sample in the mean that tells the noise of the attitude."""


class AttitudeHistory:
    """
    The attitudes of the last moments, interpolated.

    Attributes
    ----------
    noisy : bool
        Somebody asks for ``wander``.
    wander : float
        Spectral density of their noise on one axis [rad^2 s]: times speed squared it is how
        fast the variance grows of a path that is turned by them.

    """

    def __init__(self, timeout: int, memory: int, noisy: bool = True) -> None:
        self.noisy = noisy
        self.change(timeout, memory)
        self.restart()

    def change(self, timeout: int, memory: int) -> None:
        """Take other limits [ns]."""
        self._timeout = timeout  # further apart, nothing is known between two
        self._memory = memory

    def restart(self) -> None:
        """Forget all attitudes."""
        self._times: list[int] = []
        self._values: list[Quaternion] = []
        self._turn: Vector = (0.0, 0.0, 0.0)
        self.wander = 0.0

    def add(self, time: int, q: Quaternion, turn: Vector | None = None) -> None:
        """
        Take an attitude.

        Parameters
        ----------
        time : int
            After that of the last one [ns].
        q : Quaternion
            Body to world.
        turn : Vector, optional
            Rotation from the last one [rad], if it is known already.

        """
        if len(self._times) > 1024:
            cut = max(bisect_left(self._times, time - self._memory),
                      len(self._times) - MOST_KEPT)
            del self._times[:cut], self._values[:cut]
        # a gap says nothing
        if self.noisy and self._times and 0 < time - self._times[-1] <= self._timeout:
            self._note_noise((time - self._times[-1]) * NS,
                             turn or rotation_between(self._values[-1], q))
        self._times.append(time)
        self._values.append(q)

    def take_up(self, time: int, q: Quaternion) -> None:
        """Take an attitude that has jumped: between the last one and it nothing is known."""
        del self._times[:], self._values[:]
        self.add(time, q)

    def _note_noise(self, dt: float, turn: Vector) -> None:
        # the second difference of white noise has six times its variance, on three axes
        square = math.dist(turn, self._turn) ** 2 / 18.0
        self._turn = turn
        self.wander += (square * dt - self.wander) * (SHARE if self.wander else 1.0)

    def missing(self, time: int) -> str:
        """Return '' if the attitude at ``time`` is known, 'later' if it may become so."""
        i = bisect_left(self._times, time)
        if i == len(self._times):
            return 'later'
        if self._times[i] == time:
            return ''
        if i == 0 or self._times[i] - self._times[i - 1] > self._timeout:
            return 'no_attitude'
        return ''

    def at(self, time: int) -> Quaternion:
        """Return the attitude at a ``time`` for which ``missing`` is ''."""
        i = bisect_left(self._times, time)
        if self._times[i] == time:
            return self._values[i]
        before, after = self._times[i - 1], self._times[i]
        return between(
            self._values[i - 1], self._values[i], (time - before) / (after - before))


class World:
    """What the sources know of each other: the attitude and the world velocity."""

    def __init__(self, settings: Settings) -> None:
        self.attitude = AttitudeHistory(0, 0, settings.identifier.method in HEEDING)
        self.change(settings)
        self.restart()

    def change(self, settings: Settings) -> None:
        """Take other timeouts."""
        self._memory = 2 * round(settings.longest_timeout / NS)
        self._position_timeout, self._depth_timeout, attitude = (
            round(settings.timeout_of(name) / NS) for name in ('position', 'depth', 'attitude'))
        self.attitude.change(attitude, self._memory)

    def restart(self) -> None:
        """Forget everything."""
        self.attitude.restart()
        self._depths: deque[tuple[int, float]] = deque(maxlen=MOST_KEPT)
        self._horizontal: tuple[int, float, float] | None = None

    def forget_depths(self) -> None:
        """Forget the depths: what comes next has jumped."""
        self._depths.clear()

    def note_depth(self, time: int, z: float) -> None:
        """Take a depth [m, up] that is good."""
        self._depths.append((time, z))
        while self._depths[0][0] < time - self._memory:
            self._depths.popleft()

    def note_horizontal(self, time: int, velocity: Vector) -> None:
        """Take the rate of the position [m/s] where it is good."""
        self._horizontal = (time, velocity[0], velocity[1])

    def vertical(self, time: int, span: int) -> float | None:
        """
        Return the mean rate of the depth [m/s] over ``span`` [ns] up to its newest value.

        As long a span as that of the position with which it is turned into the body, so that
        one is no noisier than the other; None where the depth is too old.
        """
        if len(self._depths) < 2 or time - self._depths[-1][0] > self._depth_timeout:
            return None
        end, z = self._depths[-1]
        start, before = self._depths[0]
        for then, x in reversed(self._depths):
            if then <= end - span:
                start, before = then, x
                break
        return (z - before) / ((end - start) * NS)

    def horizontal(self, time: int) -> tuple[float, float]:
        """Return the newest rate of the position [m/s]; 0 where it is too old."""
        if self._horizontal is None or time - self._horizontal[0] > self._position_timeout:
            return (0.0, 0.0)
        return self._horizontal[1:]
