"""What tuning keeps of a log: the measured motion, and the commands before delay and lag."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import DOFS
from rovid_core.model.lag import (
    all_driven,
    all_spun,
    all_turns_of,
    driven_along,
    follow,
    inertia_of,
)
from rovid_core.model.plant import Array, linear_recurrence
from rovid_core.model.samples import Event, NS
from rovid_core.settings.run import Settings, ThrusterSettings
from rovid_core.thrust.thruster_curve import thruster_models
from rovid_core.trials.record import LogWater
from rovid_core.trials.score import ScoreLog

BEFORE = 60.0  # [s] the first command is taken to have stood this long, whatever the delay


class CommandedForce:
    """
    The force that was commanded on each DOF, before delay and lag.

    ``impulse`` is that of ``ForceHistory``, for all times of a log at once. The times of the
    commands [ns] increase; ``propellers`` are the forces of the thrusters, of shape
    (thrusters, n), and ``rows`` what the DOFs have of these, of shape (dofs, thrusters).
    ``linear`` lets the force go in a straight line from one command to the next. With ``of_turns``
    a lag is that of the propellers' turns; above 0, ``lag_at`` is the force [N] of one of them
    about which they lag so, as a torque drives them.
    """

    def __init__(self, times: NDArray[np.int64], propellers: Array, rows: Array, linear: bool,
                 of_turns: bool = False, lag_at: float = 0.0) -> None:
        forces = rows @ propellers
        self._origin = int(times[0])
        self._at = np.concatenate([[-BEFORE], (times - times[0]) * NS])
        self._forces = np.concatenate([forces[:, :1], forces], axis=1)
        rise = np.diff(self._forces) / np.diff(self._at)
        # after the last command its force stays
        self._slopes = np.concatenate([rise * linear, np.zeros((len(forces), 1))], axis=1)
        self._rows = rows if of_turns else None
        self._lag_at = lag_at
        self._propellers = np.concatenate([propellers[:, :1], propellers], axis=1)
        used = propellers[np.any(rows != 0.0, axis=0)]
        self.usual = math.sqrt(float(np.sum(used * used)) / max(used.size, 1))  # [N] of one
        self._followed: dict[tuple[int, float], tuple[Array, Array]] = {}

    def impulse(self, dof: int, times: NDArray[np.int64], delay: float, lag: float) -> Array:
        """
        Return the integral [N s or N m s] of the force on a DOF up to some times [ns].

        It begins at the same time for all of them. Delay and lag are in seconds.
        """
        at, force, slope = self._at, self._forces[dof], self._slopes[dof]
        step = np.diff(at)
        x = (times - self._origin) * NS - delay
        i = np.maximum(np.searchsorted(at, x, 'right') - 1, 0)
        if self._rows is not None and lag > 0.0:
            return np.asarray(sum(share * self._of_turns(k, i, x - at[i], lag)
                                  for k, share in enumerate(self._rows[dof]) if share))
        decay = np.exp(-step / lag) if lag > 0.0 else np.zeros_like(step)
        # what the lagged force is behind its steady response to the ramp
        ends = force[:-1] + slope[:-1] * (step - lag) - force[1:] + slope[1:] * lag
        behind = np.concatenate([[0.0], linear_recurrence(decay, ends)]) if lag > 0.0 else 0.0 * at
        spans = _span(force[:-1], slope[:-1], behind[:-1], step, lag)
        total = np.concatenate([[0.0], np.cumsum(spans)])
        return np.asarray(total[i] + _span(force[i], slope[i], behind[i], x - at[i], lag))

    def _of_turns(self, propeller: int, i: NDArray[np.intp], x: Array, lag: float) -> Array:
        """Return the impulse of a propeller so long after each of some commands [s]."""
        force = self._propellers[propeller]
        turns = all_turns_of(force)
        step, inertia = np.diff(self._at), inertia_of(lag, self._lag_at)
        if (propeller, lag) not in self._followed:  # other delays and DOFs want it, too
            if inertia:
                at = driven_along(force[:-1], step, inertia, float(turns[0]))
                spans = force[:-1] * step - inertia * np.diff(at)
            else:
                at = follow(turns[:-1], step, lag, float(turns[0]))
                spans = all_spun(at[:-1], turns[:-1], step, lag)
            self._followed[propeller, lag] = at, np.concatenate([[0.0], np.cumsum(spans)])
        at, total = self._followed[propeller, lag]
        begin = at[i]
        if inertia:
            gained = all_driven(begin, force[i], x, inertia) - begin
            return np.asarray(total[i] + force[i] * x - inertia * gained)
        return np.asarray(total[i] + all_spun(begin, turns[i], x, lag))


def _span(force: Array, slope: Array, behind: Array, x: Array, lag: float) -> Array:
    """Return the impulse over ``x`` [s] from a command on."""
    transient = -behind * lag * np.expm1(-x / lag) if lag > 0.0 else 0.0
    return np.asarray(force * x + slope * x * (0.5 * x - lag) + transient)


@dataclass(frozen=True)
class Segment:
    """The motion of one DOF between two interruptions."""

    start: int  # time from which the first step goes [ns]
    velocity: float  # measured there [m/s or rad/s]
    # shape (n,); where each step's measurement begins, and the step's end [ns]
    fixes: NDArray[np.int64]
    ends: NDArray[np.int64]
    means: Array  # shape (n,); measured over each step, not filtered [m/s or rad/s]
    # shape (2 k, n); each regressor of the couplings before and after the step's fix
    regressors: Array

    def intervals(self) -> tuple[NDArray[np.int64], Array]:
        """
        Return the times between which mean velocities are known, and the means there.

        Returns
        -------
        nodes : ndarray of int64, shape (m + 1,)
            [ns]
        means : ndarray, shape (1 + k, m)
            Of the velocity [m/s or rad/s] and of each regressor of the couplings.

        """
        before, after = self.regressors[::2], self.regressors[1::2]
        if self.fixes[-1] == self.ends[-1]:  # a velocity sensor: from sample to sample
            samples = np.concatenate([[self.velocity], self.means])
            return (np.concatenate([[self.start], self.ends]),
                    np.concatenate([[0.5 * (samples[:-1] + samples[1:])], before]))
        first, last = self.ends[:-1] - self.fixes[:-1], self.fixes[1:] - self.ends[:-1]
        others = (first * after[:, :-1] + last * before[:, 1:]) / np.maximum(first + last, 1)
        return self.fixes, np.concatenate([[self.means[:-1]], others])


class TuningLog(ScoreLog):
    """
    A score log that also keeps the commands: the stream's recorder and scorer in one.

    ``water`` is what is known of a current of the log; then couplings have to be made of
    velocities through it.
    """

    def __init__(self, settings: Settings, water: LogWater | None = None) -> None:
        super().__init__(settings)
        self.water = water or self.water
        self._settings = settings
        self._times = array('q')
        self._commands = array('d')
        self._attitude_times = array('q')
        self._headings = array('d')
        self.jumped = False

    def released(self, event: Event) -> None:
        """Take an event, in the order of release."""
        for sample in event.samples:
            if sample.input == 'attitude' and all(map(math.isfinite, sample.value)):
                x, y, z, w = sample.value
                self._attitude_times.append(event.time)
                self._headings.append(
                    math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def controlled(self, name: str, value: str) -> None:
        """Take a control; only time counts."""
        self.jumped = self.jumped or name == 'time_jump'

    def add_commands(self, time: int, raw: tuple[float, ...]) -> None:
        """Take the raw commands of all thrusters from ``time`` [ns] on."""
        if self._times and self._times[-1] == time:  # another topic of the same instant
            self._times.pop()
            del self._commands[-len(raw):]
        self._times.append(time)
        self._commands.extend(raw)

    def commands(self) -> Array:
        """Return the raw commands, shape (n, thrusters)."""
        return np.array(self._commands).reshape(-1, self._settings.thrusters.count)

    def commanded(self, thrusters: ThrusterSettings | None = None) -> CommandedForce:
        """Return the force on the DOFs of the run, in their order, with these thrusters."""
        thrusters = thrusters or self._settings.thrusters
        each = []
        for raw, model in zip(self.commands().T, thruster_models(thrusters)):
            told, where = np.unique(raw, return_inverse=True)  # of pulses there are few
            each.append(np.array([model(one) for one in told.tolist()])[where])
        rows = np.array([thrusters.allocation[DOFS.index(dof)] for dof in self._settings.dofs])
        return CommandedForce(np.array(self._times), np.array(each), rows,
                              thrusters.hold == 'linear', thrusters.lag_of_turns,
                              thrusters.lag_at)

    def heading(self, times: NDArray[np.int64]) -> Array:
        """Return the heading of the vehicle at some times [ns], without jumps [rad]."""
        first = self._attitude_times[0]  # absolute times have too many digits for a float
        return np.interp(times - first, np.array(self._attitude_times) - first,
                         np.unwrap(np.array(self._headings)))

    def segments(self, dof: str) -> list[Segment]:
        """Return the motion of a DOF, through the water where its current is known."""
        found = []
        for run in self.runs[dof]:
            if run.count:
                (fixes, ends), values = run.through_water()
                regressors = run.columns[1][4:]
                found.append(Segment(
                    run.start, run.first_velocity, fixes, ends, values[3], regressors))
        return found


def turned(forward: list[Segment], sideways: list[Segment],
           angle: float) -> tuple[list[Segment], list[Segment]]:
    """
    Return surge and sway as they are when ``angle`` [rad] is added to every heading.

    Of a level vehicle; both DOFs come from the same fixes. The regressors of couplings stay.
    """
    return _along([np.full(len(one.means), angle) for one in forward], forward, sideways)


def turned_by_time(log: TuningLog, forward: list[Segment], sideways: list[Segment],
                   late: float) -> tuple[list[Segment], list[Segment]]:
    """Return surge and sway as they are when every heading is of so much [s] earlier."""
    return _along([log.heading(one.ends - round(late / NS)) - log.heading(one.ends)
                   for one in forward], forward, sideways)


def _along(angles: list[Array], forward: list[Segment],
           sideways: list[Segment]) -> tuple[list[Segment], list[Segment]]:
    """Return surge and sway with angles [rad] that are added to the headings of each step."""
    found: tuple[list[Segment], list[Segment]] = [], []
    for angle, u, v in zip(angles, forward, sideways):
        c, s = np.cos(angle), np.sin(angle)
        found[0].append(replace(u, means=c * u.means + s * v.means, velocity=float(
            c[0] * u.velocity + s[0] * v.velocity)))
        found[1].append(replace(v, means=c * v.means - s * u.means, velocity=float(
            c[0] * v.velocity - s[0] * u.velocity)))
    return found


def turnable(settings: Settings) -> tuple[str, str] | None:
    """Return surge and sway where the position is turned by an attitude, else None."""
    there = [dof for dof in DOFS[:2] if dof in settings.dofs]
    if there and all(settings.source(dof) == 'position' for dof in there):
        return DOFS[0], DOFS[1]
    return None
