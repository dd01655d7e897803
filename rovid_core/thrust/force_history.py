"""The force on the body over time, from thruster commands: direction, curve, delay and lag."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
import math
from operator import mul
from typing import Any, Final, NamedTuple

from rovid_core.inputs.units_and_signs import (
    NeutralCheck,
    PulseWidthCheck,
    TwoSendersCheck,
    UnsignedCommandCheck,
)
from rovid_core.model.dofs import DOFS, EACH, Three
from rovid_core.model.lag import driven, inertia_of, spun, turns_of
from rovid_core.model.samples import equal_parts, NS
from rovid_core.settings.run import Settings, ThrusterSettings
from rovid_core.thrust.thruster_curve import (
    are_commands,
    thruster_model,
    thruster_models,
    wrench_model,
)

MAX_FORCE: Final = 1e12
"""[N or N m] Beyond any vehicle in any unit, and far from overflow."""

MAX_PIECES: Final = 16
"""Pieces of a held force above which it is as good as smooth."""

PART: Final = 50_000_000
"""[ns] Parts over which a smooth force is as good as its mean."""

MAX_PARTS: Final = 100
"""Parts of a span at most."""

SHORT: Final = 4
"""Parts of a span of which the means over both halves will do."""

MAX_KEPT: Final = 65536
"""Commands that are kept, however close their stamps are."""


class Pieces(NamedTuple):
    """
    A force over a span, as it is held.

    Attributes
    ----------
    held : tuple of (float, float)
        Length [s] and force of each piece.
    each : tuple of tuples of 3 floats
        ``EACH`` over each piece, where that is wanted.

    """

    held: tuple[tuple[float, float], ...]
    each: tuple[Three, ...]


NO_PIECES: Final = Pieces((), ())


class ForceHistory:
    """
    The force on each DOF as a function of time, integrated exactly.

    Commands are held (or joined by straight lines), shifted by ``delay`` and passed
    through a first-order lag. Lag and allocation are linear in the thrusters' forces, so the
    lag works on the body forces; one of the turns, which a torque may drive, works on each
    propeller's, of which the forces are summed. ``integrals`` are those of the result in closed
    form, hence the mean over any span has no discretisation error.

    Parameters
    ----------
    settings : ThrusterSettings
        The chain.
    dofs : sequence of str
        The DOFs whose forces are wanted.
    units : mapping of str to float, optional
        Typical forces of DOFs of which ``EACH`` is wanted, too.

    Attributes
    ----------
    newest : tuple of float
        The newest commanded force on every DOF [N or N m], without delay and lag; 0 before
        the first command.
    raw : tuple of float
        The newest commands that it is made of; () while some are still to come.

    """

    def __init__(self, settings: ThrusterSettings, dofs: Sequence[str],
                 units: Mapping[str, float] | None = None) -> None:
        self._settings = settings
        self._dofs = range(len(dofs))
        self._wrench = wrench_model(settings, dofs, units)
        behind = {dof: len(dofs) + len(EACH) * k for k, dof in enumerate(units or {})}
        self._each = [tuple(range(behind[d], behind[d] + len(EACH))) if d in behind else ()
                      for d in dofs]
        self._delay = round(settings.delay / NS)
        self._lag = settings.time_constant
        turn = settings.lag_of_turns and self._lag > 0.0
        self._propellers = thruster_models(settings) if turn else []
        self._inertia = inertia_of(self._lag, settings.lag_at)
        self._rows = [settings.allocation[DOFS.index(dof)] for dof in dofs]
        self._linear = settings.hold == 'linear'
        self._timeout = round(settings.timeout / NS)
        self.restart()

    def change(self, timeout: float) -> None:
        """Use another timeout [s]; it holds for the commands so far as well."""
        later = round(timeout / NS) - self._timeout
        self._timeout += later
        self._good_until[:] = [time + later for time in self._good_until]

    def restart(self) -> None:
        """Forget all commands."""
        n = self._settings.count
        parts = len(self._settings.topics)
        self._raw: list[float | None] = [None] * n
        self._part_times: list[int | None] = [None] * parts
        # one node per command: its time, force, lagged force and integral so far, per DOF, and
        # behind them each propeller's force and turns, where these lag
        self._times: list[int] = []
        self._forces: list[tuple[float, ...]] = []
        self._lagged: list[tuple[float, ...]] = []
        self._integrals: list[tuple[float, ...]] = []
        self._good_until: list[int] = []
        self.newest = (0.0,) * len(self._dofs)
        self.raw: tuple[float, ...] = ()

    def add_commands(self, time: int, values: Sequence[float], part: int = 0) -> bool:
        """
        Add the commands of one message.

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
        self.raw = ()
        raw = [u for u in self._raw if u is not None]
        if len(raw) < len(self._raw):
            return True  # some thruster has not been heard yet
        oldest = min(t for t in self._part_times if t is not None)
        tau = self._wrench(raw)
        if self._propellers:
            tau += tuple([force(u) for force, u in zip(self._propellers, raw)])
        if not all(-MAX_FORCE < f < MAX_FORCE for f in tau):
            return False
        self.raw = tuple(raw)
        self._append(time + self._delay, tau, oldest + self._delay + self._timeout)
        return True

    def _append(self, time: int, tau: tuple[float, ...], good_until: int) -> None:
        if self._times and time == self._times[-1]:  # another topic of the same instant
            for column in self._columns():
                del column[-1]
        if self._times:
            slope = self._slope(len(self._times) - 1, time, tau)
            lagged, integral = self._at(len(self._times) - 1, time, slope)
        else:
            bodies = len(tau) - len(self._propellers)
            lagged = tau[:bodies] + tuple(map(turns_of, tau[bodies:]))
            integral = (0.0,) * len(tau)
        self._times.append(time)
        self._forces.append(tau)
        self.newest = tau[:len(self._dofs)]
        self._lagged.append(lagged)
        self._integrals.append(integral)
        self._good_until.append(good_until)

    def _columns(self) -> tuple[list[Any], ...]:
        return (self._times, self._forces, self._lagged, self._integrals, self._good_until)

    def _slope(self, i: int, time: int, tau: tuple[float, ...]) -> tuple[float, ...] | None:
        if not self._linear:
            return None
        dt = (time - self._times[i]) * NS
        return tuple([(b - a) / dt for a, b in zip(self._forces[i], tau)])

    def _at(self, i: int, time: int,
            slope: tuple[float, ...] | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lagged force and integral at ``time``, after node ``i``."""
        x = (time - self._times[i]) * NS
        lag = self._lag
        if not (lag or slope):  # the usual chain; what is left out below is 0 then
            forces = self._forces[i]
            return forces, tuple([a + f * x for a, f in zip(self._integrals[i], forces)])
        decay = math.exp(-x / lag) if lag > 0.0 else 0.0
        lagged, integrals = [], []
        for j, f in enumerate(self._forces[i]):
            s = slope[j] if slope else 0.0
            transient = self._lagged[i][j] - f + s * lag if lag > 0.0 else 0.0
            lagged.append(f + s * (x - lag) + transient * decay)
            integrals.append(self._integrals[i][j] + f * x + s * x * (0.5 * x - lag)
                            + transient * lag * (1.0 - decay))
        if self._propellers:
            self._spin(i, x, lagged, integrals)
        return tuple(lagged), tuple(integrals)

    def _spin(self, i: int, elapsed: float, lagged: list[float], integrals: list[float]) -> None:
        """Take the turns of propellers and integrals of their forces, so long [s] after a node."""
        first = len(integrals) - len(self._propellers)
        pushes = []
        for k in range(first, len(integrals)):
            turns, force = self._lagged[i][k], self._forces[i][k]
            push, _, lagged[k] = driven(turns, force, elapsed, self._inertia) if (
                self._inertia) else spun(turns, turns_of(force), elapsed, self._lag)
            pushes.append(push)
        for j, row in enumerate(self._rows):
            integrals[j] = self._integrals[i][j] + math.fsum(map(mul, row, pushes))

    def known(self, time: int) -> bool:
        """Tell whether the force up to ``time`` [ns] needs no command that is still to come."""
        if not self._linear:
            return True
        return bool(self._times) and self._times[-1] >= time

    def integrals(self, times: tuple[int, ...],
                  dofs: Iterable[int] | None = None) -> list[list[float]]:
        """
        Return the integrals of the force [N s or N m s] from the first command.

        Parameters
        ----------
        times : tuple of int
            Up to these [ns], in order.
        dofs : iterable of int
            Of these DOFs, by their numbers; of all unless given.

        """
        dofs = self._dofs if dofs is None else dofs
        nodes, usual = self._times, not (self._lag or self._linear)
        found = []
        i = bisect_right(nodes, times[0])
        for time in times:
            while i < len(nodes) and nodes[i] <= time:
                i += 1
            if usual:  # what ``_at`` gives, of these DOFs alone
                x = (time - nodes[i - 1]) * NS
                so_far, forces = self._integrals[i - 1], self._forces[i - 1]
                found.append([so_far[j] + forces[j] * x for j in dofs])
            else:
                slope = None if i == len(nodes) else self._slope(i - 1, nodes[i], self._forces[i])
                integrals = self._at(i - 1, time, slope)[1]
                found.append([integrals[j] for j in dofs])
        return found

    def means(self, start: int, end: int, dofs: tuple[int, ...]) -> list[float]:
        """
        Return the mean force on some DOFs over a span [ns] up to now, longer than 0.

        Of what was before the first command nothing is known.
        """
        if not dofs:
            return []
        if not self._times or self._times[0] >= end:
            return [0.0] * len(dofs)
        start = max(start, self._times[0])
        first, last = self.integrals((start, end), dofs)
        dt = (end - start) * NS
        return [(q - p) / dt for p, q in zip(first, last)]

    def each(self, start: int, middle: int, end: int, dof: int) -> tuple[Three, ...]:
        """Return the means of ``EACH`` of a DOF over both parts of a span [ns]; () for none."""
        numbers, found = self._each[dof], []
        sums = self.integrals((start, middle, end), numbers) if numbers else []
        for a, b, before, after in zip((start, middle), (middle, end), sums, sums[1:]):
            length = max((b - a) * NS, NS)
            p, q, r = [(y - x) / length for x, y in zip(before, after)]
            found.append((p, q, r))
        return tuple(found)

    def pieces(self, start: int, end: int, dofs: Iterable[int]) -> list[Pieces]:
        """
        Return in which pieces the force is held over ``[start, end]`` [ns], per DOF.

        Where a force is not held, or has more than ``MAX_PIECES``, these are the means over equal
        parts of the span, and none where that is short. The span begins after the first command.
        """
        if self._lag or self._linear:
            return [self._parts(start, end, j) for j in dofs]
        times, forces = self._times, self._forces
        first, last = bisect_right(times, start) - 1, bisect_left(times, end)
        found = []
        for j in dofs:
            pieces, each, numbers = [], [], self._each[j]
            since, held = start, forces[first]
            for i in range(first + 1, last + 1):
                new = forces[i] if i < last else ()
                if new and new[j] == held[j] and not any(new[k] != held[k] for k in numbers):
                    continue
                until = times[i] if new else end
                pieces.append(((until - since) * NS, held[j]))
                if numbers:
                    each.append((held[numbers[0]], held[numbers[1]], held[numbers[2]]))
                since, held = until, new
            found.append(Pieces(tuple(pieces), tuple(each)) if len(pieces) <= MAX_PIECES
                         else self._parts(start, end, j))
        return found

    def _parts(self, start: int, end: int, dof: int) -> Pieces:
        """Return the means over equal parts of a span [ns], nothing where that is short."""
        count = min(-((start - end) // PART), MAX_PARTS)
        if count <= SHORT:
            return NO_PIECES
        parts = equal_parts(start, end, count)
        sums = self.integrals((start, *[b for _, b in parts]), (dof, *self._each[dof]))
        held, each = [], []
        for (a, b), before, after in zip(parts, sums, sums[1:]):
            h = (b - a) * NS
            mean, *others = [(y - x) / h for x, y in zip(before, after)]
            held.append((h, mean))
            if others:
                p, q, r = others
                each.append((p, q, r))
        return Pieces(tuple(held), tuple(each))

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
        i = max(i, len(self._times) - MAX_KEPT)
        if i < 256:  # in lumps: cutting a list costs as much as a step
            return
        for column in self._columns():
            del column[:i]
        # count from here: a sum over hours loses digits
        first = self._integrals[0]
        self._integrals[:] = [
            tuple([a - b for a, b in zip(integral, first)]) for integral in self._integrals]


class CommandIntake:
    """
    Decide which thruster commands are used, and in which direction.

    Parameters
    ----------
    settings : Settings
        The run.
    history : ForceHistory
        Gets the commands with their signs.
    warn : callable
        Called with one line about what looks wrong in the data.

    Attributes
    ----------
    unsigned : UnsignedCommandCheck
        Needs the velocities as well.

    """

    def __init__(self, settings: Settings, history: ForceHistory,
                 warn: Callable[[str], None]) -> None:
        self._history = history
        self._is_signed = not settings.sign.topic
        self.unsigned = UnsignedCommandCheck(settings, warn)
        self._two_senders = TwoSendersCheck(warn)
        self._pulse_widths = PulseWidthCheck(settings, warn)
        self._neutral = NeutralCheck(
            settings.thrusters, thruster_model(settings.thrusters), warn)
        self.change(settings)
        self.restart()

    def change(self, settings: Settings) -> None:
        """Use other timeouts."""
        self._settings = settings.thrusters
        self._timeout = round(settings.timeout_of('sign') / NS)
        # a span begins at most a timeout before a measurement that waited as long for the rest
        self._memory = 3 * round(settings.longest_timeout / NS)

    def restart(self) -> None:
        """Forget the direction."""
        self._signs: tuple[int, tuple[float, ...]] | None = None

    def add_signs(self, time: int, value: tuple[float, ...]) -> None:
        """Add the direction of the commands from ``time`` [ns] on."""
        self._signs = time, value

    def silent(self, now: int) -> bool:
        """Tell whether nothing is known of the force at ``now`` [ns] if no command comes."""
        if self._signs is not None and now - self._signs[0] > self._timeout:
            return True
        return bool(self._history.missing(now, now))

    def add_commands(self, time: int, value: tuple[float, ...], part: int) -> str:
        """Add commands at ``time`` [ns]; return why they were refused, or ''."""
        if not self._is_signed:
            if self._signs is None:
                return 'no_sign'
            since, signs = self._signs
            if time - since > self._timeout:
                return 'stale_sign'
            signs = signs if len(signs) > 1 else signs * len(value)
            if len(signs) > len(value):
                signs = signs[part:part + 1]
            offset = self._settings.offset
            value = tuple([offset + math.copysign(abs(u) - offset, s)
                           for u, s in zip(value, signs)])
        self._pulse_widths.add_commands(value)  # what is beyond the limit, too
        if not are_commands(self._settings, value, part):
            return 'not_a_command'
        self.unsigned.add_commands(value)
        self._two_senders.add_commands(value, part)
        self._neutral.add_commands(value)
        self._history.forget(time - self._memory)
        return '' if self._history.add_commands(time, value, part) else 'force_out_of_range'
