"""Filters side by side that take something else each to move the vehicle besides its model."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
import math
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np
from rovid_core.identify.ekf.batch_start import (
    BatchStart,
    finish,
    Learner,
    LONGEST,
    PASSES,
)
from rovid_core.identify.ekf.evidence.innovations import (
    HUBER,
    Innovations,
    LEAST_NOISE,
    surprise,
)
from rovid_core.identify.ekf.evidence.missing_terms import better_thrusters, share_of_lag
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.evidence.vehicle_change import (
    EXPECTED,
    FALSE_ALARM,
    NEWEST,
    SCATTERED,
)
from rovid_core.identify.ekf.evidence.verdict import Verdict
from rovid_core.identify.ekf.normalised_model import UNMODELLED, Unmodelled
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.free_prediction import FreePrediction
from rovid_core.identify.ekf.single.linearised_filter import (
    ALPHA,
    Bounds,
    CANDIDATES,
    LinearisedFilter,
    NONE_OWN,
    POSITION,
)
from rovid_core.identify.ekf.single.measurements import Measurement
from rovid_core.identify.method import floats
from rovid_core.model.dofs import EACH, OWN
from rovid_core.model.plant import Array
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

MARGIN: Final = 10.0
"""By which -2 log of the likelihood has to be lower before the model is taken to be wrong."""

SAID: Final = 60.0
"""[s] after a change in which it is news."""

LOSSES: Final = 3
LOST_WITHIN: Final = 30.0
"""Losses of the vehicle within so many seconds that mean a change of one that was understood."""

RIGHT: Final = 2.0
"""Scatter of the blocks, and growth of the noise, below which a vehicle is understood."""

OUTLIER: Final = 1
LOST: Final = 2
BLOCK: Final = 3
"""What comes of a measurement: it does not count, the vehicle is lost, a block is complete."""


class Member:
    """
    A filter with its innovations and blocks.

    Parameters
    ----------
    theta, variances : sequence of p floats
        Of the parameters at the beginning.
    bounds : Bounds
        Of the parameters.
    unmodelled : Unmodelled
        What moves the vehicle besides its model.
    noise : float
        Of a measurement.
    watched : mapping, optional
        Names of the regressors that steps carry to be watched, and the ``sizes`` that their
        coefficients may have, as of ``ScoreBlocks``.
    own : tuple of 2 ints
        As of a ``LinearisedFilter``.
    thrusters : Thrusters
        How they are taken to work, in typical forces.
    shares : bool
        Whether they drive other DOFs, too.

    Attributes
    ----------
    bounds : Bounds
        As given.
    prediction : FreePrediction
        What its model predicts without corrections.
    surprise : float
        That of the last measurement, before it was taken.

    """

    def __init__(self, theta: Sequence[float], variances: Sequence[float], bounds: Bounds,
                 unmodelled: Unmodelled, noise: float,
                 watched: Mapping[str, float] | None = None,
                 own: tuple[int, int] = NONE_OWN, thrusters: Thrusters = AS_CONFIGURED,
                 shares: bool = False) -> None:
        self.unmodelled, self.thrusters = unmodelled, thrusters
        watched = watched or {}
        self.filter = LinearisedFilter(
            theta, variances, unmodelled.force_std, len(watched), own, thrusters, shares)
        self.innovations = Innovations(noise)
        self.blocks = ScoreBlocks(
            theta, variances, (*CANDIDATES, *(EACH if shares else ()), *watched),
            configured=[name for name, i in zip(OWN, own) if i >= 0], found=thrusters.found,
            lags={'lag': share_of_lag(thrusters.lag)}, sizes=watched)
        self.prediction = FreePrediction(own, thrusters)
        self._verdict: Verdict | None = None
        self._is_judged = True
        self.bounds, self.surprise = bounds, 0.0
        self._slip = unmodelled.slip

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity, in typical ones."""
        # it may be an outlier
        self.filter.set_motion(
            max(-1.0, min(1.0, velocity)), (self.innovations.noise**2, 1.0))
        self.innovations.forget_outliers()
        self.prediction.interrupt()

    def move(self, recent: DelayedForce, span: Measurement) -> None:
        """Predict to the time of a measurement."""
        filter = self.filter
        self.innovations.least = max(span.rounding, LEAST_NOISE)
        self.prediction.move(recent, span)
        if span.end > span.start:
            filter.move(recent, span.start, span.end, span.couplings, span.watched, span.rises)
        # the noise of the fix between two intervals does not cancel when they are turned
        relative, noise = span.turn * span.turn, self.innovations.noise
        if span.i == POSITION and span.value is not None:
            relative += self._slip * self._slip
        if relative or span.slip:
            filter.widen_motion(relative * noise * noise + span.slip * span.slip)

    def update(self, i: int, value: float, dt: float, adapt: bool, beginning: bool) -> int:
        """Take a measurement; return 0 or what comes of it."""
        filter, innovations = self.filter, self.innovations
        found = filter.innovation(i, value, innovations.noise * innovations.noise)
        normalised = found.error / math.sqrt(found.total)
        self.surprise = surprise(normalised, found.total)
        outlier = innovations.is_outlier(normalised)
        if adapt:
            innovations.learn_noise(normalised)
            innovations.add(normalised, found.total)
        if outlier:
            if not innovations.is_lost(beginning):
                return OUTLIER
            filter.widen_motion(found.error**2, found.error**2)
            return LOST
        size = abs(normalised) / HUBER
        added = found.total * (size - 1.0) if size > 1.0 else 0.0
        filter.update(found, added, adapt)
        filter.keep_inside(self.bounds)
        if not (adapt and self.blocks.add(found.told, found.given + added, found.psi, dt)):
            return 0
        self.prediction.end_block(filter, innovations.noise)
        return BLOCK

    def learn(self, span: Measurement, used: bool) -> list[float]:
        """
        Take a measurement at fixed parameters.

        Parameters
        ----------
        span : Measurement
            What is measured.
        used : bool
            Whether it says something of the parameters.

        Returns
        -------
        list of float
            Its size in standard deviations; empty where it was lost.

        """
        filter, innovations = self.filter, self.innovations
        if span.value is None:
            return []
        found = filter.innovation(
            span.i, span.value, innovations.noise * innovations.noise, True)
        normalised = found.error / math.sqrt(found.given)
        if innovations.is_outlier(normalised) and innovations.is_lost(False):
            filter.widen_motion(found.error**2, found.error**2)
            return []
        size = abs(normalised)
        innovations.add(normalised, found.given)
        added = found.given * (size / HUBER - 1.0) if size > HUBER else 0.0
        filter.update_motion(found, added)
        if used and self.blocks.add(found.told, found.given + added, found.psi, span.dt):
            self.prediction.end_block(filter, innovations.noise)
        return [size]

    def settle(self) -> None:
        """Go to the parameters that fit best what was learned."""
        solution, self.filter.theta_covariance = self.blocks.solution()
        self.filter.set_theta(solution)
        self.filter.keep_inside(self.bounds)

    @property
    def better_thrusters(self) -> Thrusters | None:
        """Return thrusters that have what is named besides, None where that is something else."""
        better, verdict, theta = self.thrusters, self.verdict, self.filter.theta
        for missing in [] if verdict is None else verdict.to_find:
            better = better_thrusters(better, missing, theta[ALPHA])
        return None if better == self.thrusters else better

    @property
    def verdict(self) -> Verdict | None:
        """Return what the blocks say, None while there are too few."""
        # of most members nobody asks, and it takes as long as dozens of measurements
        if not self._is_judged:
            self._verdict = self.blocks.verdict(self.unmodelled.is_there)
            self._is_judged = True
        return self._verdict

    def judge(self) -> None:
        """Let the verdict be of the blocks as they are now."""
        self._is_judged = False

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'filter': self.filter.state(), 'innovations': self.innovations.state(),
                'blocks': self.blocks.state(), 'judged': self.verdict is not None,
                'prediction': self.prediction.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self.filter.restore(state['filter'])
        self.innovations.restore(state['innovations'])
        self.blocks.restore(state['blocks'])
        self.prediction.restore(state['prediction'])
        self._verdict, self._is_judged = None, True
        if state['judged']:
            self.judge()


class Judged(Learner, Protocol):
    """What a bank needs of a member."""

    bounds: Bounds
    thrusters: Any

    @property
    def verdict(self) -> Verdict | None:
        """Return what the blocks say, None while there are too few."""

    @property
    def better_thrusters(self) -> Any:
        """Return thrusters that have what is named besides, None where that is something else."""

    def judge(self) -> None:
        """Let the verdict be of the blocks as they are now."""

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""


def stands_at_bound(theta: Sequence[float] | Array, spread: Sequence[Sequence[float]] | Array,
                    bounds: Bounds) -> bool:
    """
    Tell whether a parameter that is identified stands at one of its bounds.

    Parameters
    ----------
    theta : sequence of p floats
        The parameters.
    spread : p by p floats
        Their covariance; 0 for what is left out, which stands there, too.
    bounds : Bounds
        Index, lowest and highest value of each that has bounds.

    """
    return any(spread[i][i] > 0.0 and not low < theta[i] < high for i, low, high in bounds)


M = TypeVar('M', bound=Judged)


class FilterBank(Generic[M]):
    """
    Members that each take something else of ``UNMODELLED`` to be there.

    Parameters
    ----------
    new : callable
        Makes a member from that.

    Attributes
    ----------
    number : int
        Of the best member.
    changed_at : float
        Time at which the vehicle changed last [s], 0 if it never did.
    confirmed : bool
        Whether going through all data again, not for the first time, led to where the best member
        was already.

    """

    def __init__(self, new: Callable[[Unmodelled], M]) -> None:
        self._new = new
        self.members = [new(unmodelled) for unmodelled in UNMODELLED]
        self.number = 0
        self.changed_at = 0.0
        self.confirmed = False
        self._expecting = 0  # blocks of the best member that may be of a changed vehicle yet
        self._losses: list[float] = []
        self._noises = [math.inf for _ in UNMODELLED]  # least before a change

    @property
    def best(self) -> M:
        """Return the member that explains the innovations best."""
        return self.members[self.number]

    @property
    def tracker(self) -> M:
        """
        Return the member whose velocity follows the measurements.

        Where the path slips by itself they say nothing of it, and it is what the model makes of
        the thrust alone; with an unknown force it follows them whatever the model is worth.
        """
        best = self.best
        return best if not best.unmodelled.slip else next(
            member for member in self.members if member.unmodelled.force_std)

    def choose(self) -> None:
        """Choose the likeliest member, one that takes the model to be wrong only if it has to."""
        values = [member.innovations.likelihood for member in self.members]
        likeliest = values.index(min(values))
        # who is chosen needs to be beaten clearly, by a model that is right less so
        if values[likeliest] < values[self.number] - MARGIN:
            self.number = likeliest
        if values[0] < values[self.number] + 0.5 * MARGIN:
            self.number = 0

    def go_through_again(self, start: BatchStart[M], first_guess: Sequence[float],
                         early: bool) -> Generator[int, None, bool]:
        """
        Replace the members by those that went through all data so far; tell if it went well.

        It is done in parts, as ``BatchStart.solve``.

        Parameters
        ----------
        start : BatchStart
            The data.
        first_guess : sequence of p floats
            Parameters to begin with besides those of each member, the first time and where these
            stand at a bound; empty for none.
        early : bool
            Whether this is the first time.

        """
        filter = self.best.filter
        # what stands at a bound may be the wrong one of two optima
        anew = early or stands_at_bound(
            filter.theta, filter.theta_covariance, self.best.bounds)
        guesses = [filter.theta, *([first_guess] if anew and len(first_guess) else [])]
        went_well = yield from self.solve(
            start, guesses, PASSES if early else 2, early, True)
        self.confirmed = self.confirmed and not early
        return went_well

    def solve(self, start: BatchStart[M], guesses: Sequence[Sequence[float]], passes: int,
              from_best: bool, from_own: bool) -> Generator[int, None, bool]:
        """Let the best member begin at guesses, and the others where it ends or at their own."""
        best, members = self.best, self.members
        self.confirmed = False
        with suppress(ArithmeticError, np.linalg.LinAlgError):
            first = yield from start.solve(best, guesses, passes)
            noise, was_there = first.innovations.noise, start.was_there
            for k, member in enumerate(members):
                if member is not best:
                    # one that went astray has taken that for noise
                    member.innovations.noise = min(member.innovations.noise, noise)
                    members[k] = yield from start.solve(
                        member, [*([first.filter.theta] if from_best else []),
                                 *([member.filter.theta] if from_own else [])], passes)
            members[self.number] = first
            for member in members:
                member.judge()
            self.choose()
            self.confirmed = was_there and self.best is first
            return True
        return False

    def way_back(self) -> Callable[[], None]:
        """Return what brings the members back that there are now."""
        members, number = list(self.members), self.number
        noises = [member.innovations.noise for member in members]

        def back() -> None:
            self.members, self.number = list(members), number
            for member, noise in zip(members, noises):
                member.innovations.noise = noise

        return back

    @property
    def least(self) -> float:
        """Return -2 log of the likelihood of the likeliest member."""
        return min(member.innovations.likelihood for member in self.members)

    def conclude(self, start: BatchStart[M] | None, first_guess: Sequence[float]) -> bool:
        """Go through data that end before that was done for the first time; as above."""
        return start is not None and start.is_new and (
            finish(self.go_through_again(start, first_guess, True)))

    def is_lost_often(self, found: Sequence[int], time: float) -> bool:
        """
        Tell if members that understood the vehicle lose it so often that it must have changed.

        Parameters
        ----------
        found : sequence of int
            What came of a measurement, by member.
        time : float
            [s]

        """
        # after a change there is no verdict for a minute, and what changed may change back
        if LOST in found and any(came == LOST and (self.changed_at > 0.0 if member.verdict is None
                                 else member.verdict.scatter < RIGHT)
               for member, came in zip(self.members, found)):
            self._losses = [t for t in self._losses if t > time - LOST_WITHIN] + [time]
            return len(self._losses) >= LOSSES
        return False

    def ended(self, found: Sequence[int]) -> list[M]:
        """Return the members whose block is complete."""
        return [member for member, came in zip(self.members, found) if came == BLOCK]

    def contradicted(self, ended: Sequence[M]) -> bool:
        """Tell whether the newest blocks contradict the older ones."""
        false_alarm = EXPECTED if self._expecting else FALSE_ALARM
        if self._expecting and self.best in ended:
            self._expecting -= 1
        # a filter that is not the best one tells only while it understands the vehicle
        return True in [member.blocks.has_changed(
            math.inf if member is self.best else SCATTERED, false_alarm) for member in ended]

    def expect_change(self) -> None:
        """Look closer at the blocks to come: another DOF has shown that the vehicle changed."""
        self._expecting = NEWEST[-1]

    def said_of_change(self, time: float) -> str:
        """Return what is to be said of the last change of the vehicle, '' if there was none."""
        since = time - self.changed_at
        if self.changed_at <= 0.0:
            return ''
        return (f'the vehicle changed {since:.0f} s ago: its parameters are found anew'
                if since < SAID else
                f'all is of the last {since / 60.0:.0f} min, since the vehicle seemed to change')

    def begin_anew(self, changed_at: float) -> None:
        """Begin with new members at the noise of before the vehicle changed."""
        # while it goes on to change the noise is only larger
        self._noises = [min(before, member.innovations.noise)
                        for before, member in zip(self._noises, self.members)]
        self.members = [self._new(unmodelled) for unmodelled in UNMODELLED]
        for member, noise in zip(self.members, self._noises):
            member.innovations.noise = noise
        self.number, self.changed_at, self._losses, self._expecting = 0, changed_at, [], 0

    def changes_on(self, time: float) -> bool:
        """Tell whether what came since the vehicle changed is of more than one vehicle."""
        return self.best.innovations.noise > RIGHT * self._noises[self.number] and (
            time < self.changed_at + LONGEST)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'members': [member.state() for member in self.members], 'best': self.number,
                'changed_at': self.changed_at, 'losses': list(self._losses),
                'expecting': self._expecting,
                'noises': None if math.inf in self._noises else list(self._noises)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        best = int(state['best'])
        if len(state['members']) != len(self.members) or not 0 <= best < len(self.members):
            raise ValueError('another bank of filters')
        for member, one in zip(self.members, state['members']):
            member.restore(one)
        self.changed_at, *self._losses = floats(
            [state['changed_at'], *state['losses']], 1 + len(state['losses']))
        if state['noises'] is not None:
            self._noises = floats(state['noises'], len(self.members))
        self.number, self._expecting = best, min(max(int(state['expecting']), 0), NEWEST[-1])
