"""The force on the body over time, with delay and lag, and its exact impulse."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
import math
from typing import Any

from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import ThrusterSettings
from rovid_core.thrust.thruster_curve import dot, thruster_model

NS = 1e-9
LARGEST_FORCE = 1e12
"""[N or N m] Beyond any vehicle in any unit, and far from overflow."""

MOST_KEPT = 65536
"""Commands that are kept, however close their stamps are."""


class Thrust:
    """
    The force on each DOF as a function of time, integrated exactly.

    Commands are held (or joined by straight lines), shifted by ``delay`` and passed
    through a first-order lag; model, lag and allocation are linear in the forces, so the
    lag works on the body forces. ``impulse`` is the closed-form integral of the result,
    hence the mean over any span has no discretisation error.

    Parameters
    ----------
    settings : ThrusterSettings
        The chain.
    dofs : sequence of str
        The DOFs whose forces are wanted.

    """

    def __init__(self, settings: ThrusterSettings, dofs: Sequence[str]) -> None:
        self._settings = settings
        self._rows = [settings.allocation[DOFS.index(d)] for d in dofs]
        self._model = thruster_model(settings)
        self._delay = round(settings.delay / NS)
        self._lag = settings.time_constant
        self._linear = settings.hold == 'linear'
        self._timeout = round(settings.timeout / NS)
        self.restart()

    def change(self, timeout: float) -> None:
        """Take another timeout [s]; it holds for the commands so far as well."""
        later = round(timeout / NS) - self._timeout
        self._timeout += later
        self._good_until[:] = [time + later for time in self._good_until]

    def restart(self) -> None:
        """Forget all commands."""
        n = self._settings.count
        parts = len(self._settings.topics)
        self._raw: list[float | None] = [None] * n
        self._part_times: list[int | None] = [None] * parts
        # one node per command: its time, force, lagged force and impulse so far, per DOF
        self._times: list[int] = []
        self._forces: list[tuple[float, ...]] = []
        self._lagged: list[tuple[float, ...]] = []
        self._impulses: list[tuple[float, ...]] = []
        self._good_until: list[int] = []

    def command(self, time: int, values: Sequence[float], part: int = 0) -> bool:
        """
        Take the commands of one message.

        Parameters
        ----------
        time : int
            Event time [ns], not before that of the last command.
        values : sequence of float
            One raw value per thruster, or the one value of thruster ``part``.
        part : int
            Index of the topic among ``thrusters.topics``.

        Returns
        -------
        bool
            False if the commands give no usable force; they are left out.

        """
        if len(self._part_times) > 1:
            self._raw[part] = values[0]
        else:
            self._raw = list(values)
        self._part_times[part] = time
        raw = [u for u in self._raw if u is not None]
        if len(raw) < len(self._raw):
            return True  # some thruster has not been heard yet
        oldest = min(t for t in self._part_times if t is not None)
        forces = [k * self._model(u) for k, u in zip(self._settings.gain, raw)]
        tau = tuple([dot(row, forces) for row in self._rows])
        if not all(-LARGEST_FORCE < f < LARGEST_FORCE for f in tau):
            return False
        self._append(time + self._delay, tau, oldest + self._delay + self._timeout)
        return True

    def _append(self, time: int, tau: tuple[float, ...], good_until: int) -> None:
        if self._times and time == self._times[-1]:  # another topic of the same instant
            for column in self._columns():
                del column[-1]
        if self._times:
            slope = self._slope(len(self._times) - 1, time, tau)
            lagged, impulse = self._at(len(self._times) - 1, time, slope)
        else:
            lagged, impulse = tau, (0.0,) * len(tau)
        self._times.append(time)
        self._forces.append(tau)
        self._lagged.append(lagged)
        self._impulses.append(impulse)
        self._good_until.append(good_until)

    def _columns(self) -> tuple[list[Any], ...]:
        return (self._times, self._forces, self._lagged, self._impulses, self._good_until)

    def _slope(self, i: int, time: int, tau: tuple[float, ...]) -> tuple[float, ...] | None:
        if not self._linear:
            return None
        dt = (time - self._times[i]) * NS
        return tuple([(b - a) / dt for a, b in zip(self._forces[i], tau)])

    def _at(self, i: int, time: int,
            slope: tuple[float, ...] | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lagged force and impulse at ``time``, after node ``i``."""
        x = (time - self._times[i]) * NS
        lag = self._lag
        if not (lag or slope):  # the usual chain; what is left out below is 0 then
            forces = self._forces[i]
            return forces, tuple([a + f * x for a, f in zip(self._impulses[i], forces)])
        decay = math.exp(-x / lag) if lag > 0.0 else 0.0
        lagged, impulses = [], []
        for j, f in enumerate(self._forces[i]):
            s = slope[j] if slope else 0.0
            transient = self._lagged[i][j] - f + s * lag if lag > 0.0 else 0.0
            lagged.append(f + s * (x - lag) + transient * decay)
            impulses.append(self._impulses[i][j] + f * x + s * x * (0.5 * x - lag)
                            + transient * lag * (1.0 - decay))
        return tuple(lagged), tuple(impulses)

    def newest(self, i: int) -> float:
        """Return the newest commanded force on DOF number ``i``, 0 before the first."""
        return self._forces[-1][i] if self._forces else 0.0

    def known(self, time: int) -> bool:
        """Tell whether the force up to ``time`` [ns] needs no command that is still to come."""
        if not self._linear:
            return True
        return bool(self._times) and self._times[-1] >= time

    def impulse(self, time: int) -> tuple[float, ...]:
        """Return the integral of the force per DOF [N s or N m s] up to ``time`` [ns]."""
        return tuple(self.impulses((time,), range(len(self._rows)))[0])

    def impulses(self, times: tuple[int, ...], dofs: Iterable[int]) -> list[list[float]]:
        """
        Return the integrals of the force [N s or N m s] from the first command.

        Parameters
        ----------
        times : tuple of int
            Up to these [ns], in order.
        dofs : iterable of int
            Of these DOFs, by their numbers.

        """
        nodes, usual = self._times, not (self._lag or self._linear)
        found = []
        i = bisect_right(nodes, times[0])
        for time in times:
            while i < len(nodes) and nodes[i] <= time:
                i += 1
            if usual:  # what ``_at`` gives, of these DOFs alone
                x = (time - nodes[i - 1]) * NS
                so_far, forces = self._impulses[i - 1], self._forces[i - 1]
                found.append([so_far[j] + forces[j] * x for j in dofs])
            else:
                slope = None if i == len(nodes) else self._slope(i - 1, nodes[i], self._forces[i])
                impulses = self._at(i - 1, time, slope)[1]
                found.append([impulses[j] for j in dofs])
        return found

    def missing(self, start: int, end: int) -> str:
        """Return why the force over ``[start, end]`` [ns] is not known, or ''."""
        times, good_until = self._times, self._good_until
        i = bisect_right(times, start) - 1
        if i < 0:
            return 'no_thrust'
        if self._timeout == 0:
            return ''
        while i < len(times) and times[i] < end:
            until = times[i + 1] if i + 1 < len(times) else end
            if (until if until < end else end) > good_until[i]:
                return 'stale_thrust'
            i += 1
        return ''

    def forget(self, time: int) -> None:
        """Drop what is not needed for times from ``time`` [ns] on."""
        i = bisect_right(self._times, time) - 1
        i = max(i, len(self._times) - MOST_KEPT)
        if i < 256:  # in lumps: cutting a list costs as much as a step
            return
        for column in self._columns():
            del column[:i]
        # count from here: a sum over hours loses digits
        first = self._impulses[0]
        self._impulses[:] = [
            tuple([a - b for a, b in zip(impulse, first)]) for impulse in self._impulses]
