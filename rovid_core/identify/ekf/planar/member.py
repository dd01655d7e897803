"""What a filter of surge and sway makes of steps: measurements, innovations, free prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from typing import Any, Final, NamedTuple

import numpy as np
from rovid_core.identify.ekf.evidence.current_status import (
    Alternative,
    better_than_a_current,
    COUPLING_FIRST,
    DOUBTED_LATENCY,
    LATE,
    NOT_JUDGED,
)
from rovid_core.identify.ekf.evidence.innovations import (
    HUBER,
    Innovations,
    LEAST_NOISE,
    surprise,
)
from rovid_core.identify.ekf.evidence.missing_terms import (
    better_thrusters,
    is_coupling,
    share_of_lag,
)
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.evidence.verdict import Verdict
from rovid_core.identify.ekf.filter_bank import BLOCK, LOST, OUTLIER
from rovid_core.identify.ekf.normalised_model import Unmodelled
from rovid_core.identify.ekf.planar.filter_with_current import PlanarFilter
from rovid_core.identify.ekf.planar.layout import (
    ALTERNATIVES,
    AXES,
    DOFS,
    Looks,
    PlanarInnovation,
    Row,
)
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.free_prediction import BlockFits, SPAN
from rovid_core.identify.ekf.single.linearised_filter import ALPHA, Bounds
from rovid_core.identify.ekf.single.measurements import Along, LEAST_INTERVAL, Resolution
from rovid_core.identify.ekf.single.watched_lag import LAGS
from rovid_core.identify.method import DivergenceError, floats
from rovid_core.model.dofs import OWN
from rovid_core.model.samples import PlanarPiece, PlanarStart, PlanarStep
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

Recent = tuple[DelayedForce, DelayedForce]
"""The force on surge and on sway."""

BothThrusters = tuple[Thrusters, Thrusters]
"""How those of surge and of sway are found to work, with the same lag; in typical forces."""

PIECE: Final = len(PlanarPiece._fields)
"""Numbers of a ``PlanarPiece``."""


class PlanarMeasurement(NamedTuple):
    """
    The span that a filter moves over, and what is measured at its end.

    Attributes
    ----------
    start, end : float
        [s] on the clock of the forces.
    value : tuple of 2 floats
        Position in the world [m], or velocity of surge and sway over ground [m/s].
    looks : ndarray, shape (2, 8), or None
        What that is of the motion; None for the position.
    begins : bool
        Whether the position begins with it.
    pieces : tuple of PlanarPiece
        Attitude over equal parts of the span.
    heading_noise : float
        Spectral density [rad^2 s].
    dt : float
        [s] since the last measurement.
    couplings : pair of tuples of floats
        The mean of each measured regressor over the span.
    rounding : float
        ``Resolution.noise`` of what measures it, the lesser of both values.

    """

    start: float
    end: float
    value: tuple[float, float]
    looks: Looks
    begins: bool
    pieces: tuple[PlanarPiece, ...]
    heading_noise: float
    dt: float
    couplings: tuple[tuple[float, ...], tuple[float, ...]]
    rounding: float


class PlanarClock:
    """
    Turn steps into measurements of the position or the velocity; see ``MeasurementClock``.

    Fixes that come fast are taken together there as well as here.

    Parameters
    ----------
    forces : pair of floats
        The units of the forces [N].
    regressors : sequence of 2 ints
        How many a step brings along for surge and for sway.
    forgets : bool
        Whether the force may go when it is old.
    thrusters : BothThrusters
        How they work.

    Attributes
    ----------
    recent : pair of DelayedForce
        On surge and sway.
    ahead : float
        [s] from the last measurement to the end of the last step.

    """

    def __init__(self, forces: tuple[float, float], regressors: Sequence[int],
                 forgets: bool = True, thrusters: BothThrusters = (
                     AS_CONFIGURED, AS_CONFIGURED)) -> None:
        self._forces, self._regressors, self._forgets = forces, regressors, forgets
        self._thrusters = thrusters
        self._resolutions = [Resolution() for _ in range(AXES)]
        self.restart()

    def restart(self) -> None:
        """Begin a new path."""
        one, other = self._thrusters
        self.recent = DelayedForce(self._forgets, one), DelayedForce(self._forgets, other)
        self._fix = self._last = -1.0  # [s] time of the last measurement, and of its last fix
        self._group: list[list[float]] = []
        self._along = Along()
        self.ahead = 0.0

    def set_thrusters(self, thrusters: BothThrusters) -> None:
        """Let them work otherwise."""
        self._thrusters = thrusters
        for recent, one in zip(self.recent, thrusters):
            recent.set_thrusters(one)

    def add_step(self, step: PlanarStep) -> PlanarMeasurement | None:
        """Return what a step measures, None where more fixes come into the measurement."""
        first = self._fix < 0.0
        spans = step.parts if step.interval else (step.dt,)
        end = self.recent[0].end + step.dt
        at = self.recent[0].end + spans[0]
        for recent, unit, forces, held, each in zip(
                self.recent, self._forces, step.forces, step.held, step.each):
            recent.add(held or tuple(zip(spans, forces)), bool(held), unit, each)
        for resolution, value in zip(self._resolutions, step.value):
            resolution.add_value(value)
        start = end - step.dt if first else self._fix
        if first or self._along.is_empty and at - self._last >= LEAST_INTERVAL:
            self._fix, self._last, self.ahead = at, at, end - at
            return PlanarMeasurement(
                start, at, step.value, _looks(step.axes) if not step.interval else None,
                first and step.interval > 0.0, step.pieces, step.heading_noise, step.dt,
                step.couplings, self._rounding)
        before = self._group[-1][0] if self._group else self._last
        for piece in step.pieces:
            self._along.add((at - before) / len(step.pieces),
                            [*piece, *step.couplings[0], *step.couplings[1]])
        self._group.append([at, step.dt, step.heading_noise, *step.value, *step.axes])
        if at - self._last < LEAST_INTERVAL:
            self.ahead = end - self._fix
            return None
        found = self._mean(start, step)
        self._fix, self._last, self.ahead = found.end, at, end - found.end
        if found.end == at:
            self._along.clear()  # but for rounding
        return found

    def _mean(self, start: float, step: PlanarStep) -> PlanarMeasurement:
        """Return the mean of the fixes that came together, the last of them with a step."""
        group, self._group = self._group, []
        sums = [math.fsum(column) for column in zip(*group)]
        end, _, noise, x, y, a, b, c, d = [total / len(group) for total in sums]
        count, (of_surge, _) = len(step.pieces), self._regressors
        parts = [self._along.take((end - start) / count) for _ in range(count)]
        couplings = [math.fsum(column) / count for column in zip(*parts)][PIECE:]
        return PlanarMeasurement(
            start, end, (x, y), _looks((a, b, c, d)) if not step.interval else None, False,
            tuple([PlanarPiece(*part[:PIECE]) for part in parts]), noise, sums[1],
            (tuple(couplings[:of_surge]), tuple(couplings[of_surge:])), self._rounding)

    @property
    def _rounding(self) -> float:
        # one of them may never change
        return min(*[one.noise for one in self._resolutions])

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'recent': [recent.state() for recent in self.recent], 'fix': self._fix,
                'last': self._last, 'ahead': self.ahead,
                'group': [list(row) for row in self._group],
                'resolutions': [one.state() for one in self._resolutions],
                'along': self._along.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        fix, last, ahead = floats([state[name] for name in ('fix', 'last', 'ahead')], 3)
        group = [floats(row, 9) for row in state['group']]
        self._along.restore(state['along'], PIECE + sum(self._regressors))
        one, other = state['recent']
        for recent, found in zip(self.recent, (one, other)):
            recent.restore(found)
        for resolution, seen in zip(self._resolutions, state['resolutions']):
            resolution.restore(seen)
        self._fix, self._last, self.ahead, self._group = fix, last, ahead, group


def _looks(axes: Sequence[float]) -> Looks:
    """Return what velocities of surge and sway over ground are of the motion."""
    a, b, c, d = axes
    return np.array(((0.0, 0.0, 1.0, 0.0, a, b, 0.0, 0.0),
                     (0.0, 0.0, 0.0, 1.0, c, d, 0.0, 0.0)))


class PlanarMember:
    """
    A filter of surge and sway with its innovations and blocks; see ``Member``.

    Parameters
    ----------
    rows : pair of Row
        Surge and sway.
    theta, variances : sequence of p floats
        Of the parameters at the beginning.
    considered : mapping
        Index and variance of parameters that are not found, but not known either.
    bounds : Bounds
        Of the parameters.
    unmodelled : Unmodelled
        What moves the vehicle besides its model.
    current_change : float
        Spectral density of the current's change, per axis [m^2/s^3].
    noise : float
        Of a measurement [m or m/s].
    watched : sequence of str
        Names of all regressors that are watched, each behind that of its DOF.
    identified : sequence of str
        Names of the DOFs that have thrust.
    thrusters : BothThrusters
        How they are taken to work.

    """

    def __init__(self, rows: tuple[Row, Row], theta: Sequence[float],
                 variances: Sequence[float], considered: Mapping[int, float], bounds: Bounds,
                 unmodelled: Unmodelled, current_change: float, noise: float,
                 watched: Sequence[str], identified: Sequence[str],
                 thrusters: BothThrusters) -> None:
        self.unmodelled, self.thrusters = unmodelled, thrusters
        self.filter = PlanarFilter(
            rows, theta, variances, unmodelled.force_std, current_change, thrusters)
        self.innovations = Innovations(noise, AXES)
        self.blocks = ScoreBlocks(
            theta, variances, watched, considered, len(ALTERNATIVES),
            [(f'{dof} ', row.first) for dof, row in zip(DOFS, rows) if dof in identified],
            [f'{dof} {name}' for dof, row in zip(DOFS, rows)
             for name, i in zip(OWN, row.own) if i >= 0], dict.fromkeys(LATE, DOUBTED_LATENCY),
            [f'{dof} {name}' for dof, one in zip(DOFS, thrusters) if dof in identified
             for name in one.found],
            {f'{dof} lag': share_of_lag(one.lag) for dof, one in zip(DOFS, thrusters)})
        self._rows = rows
        self._verdict: Verdict | None = None
        self._alternative = NOT_JUDGED
        self._is_judged = True
        self._current_is_free = not considered
        self.bounds, self.surprise = bounds, 0.0
        self._fastest = max(row.velocity for row in rows)

    def restart(self, start: PlanarStart) -> None:
        """Take up from a measured velocity over ground."""
        v = self._fastest
        # it may be an outlier
        self.filter.set_motion([max(-2.0 * v, min(2.0 * v, x)) for x in start.velocity],
                               start.axes, v * v, start.gap)
        self.innovations.forget_outliers()

    def move(self, recent: Recent, span: PlanarMeasurement) -> None:
        """Predict to the time of a measurement."""
        self.innovations.least = max(span.rounding, LEAST_NOISE * self._fastest)
        if span.end > span.start:
            self.filter.move(recent, span.start, span.end, span.pieces,
                             span.couplings, span.heading_noise)
        if self.unmodelled.slip and span.looks is None:
            self.filter.widen_motion((self.unmodelled.slip * self.innovations.noise)**2, 0.0)
        if span.begins:
            self.filter.set_position(span.value, self.innovations.noise**2)

    def _found(self, span: PlanarMeasurement, known: bool) -> tuple[
            PlanarInnovation, float, float]:
        """Return the first innovation, the second error, and the size of both in deviations."""
        filter, variance = self.filter, self.innovations.noise**2
        x, y = span.value
        one = filter.innovation(0, span.looks, x, variance, known)
        error, own, shared = filter.beside(one, span.looks, y, variance, known)
        rest = error - shared / one.total * one.error
        square = one.error**2 / one.total + rest * rest / max(
            own - shared * shared / one.total, variance)
        return one, error, math.sqrt(0.5 * square)

    def update(self, span: PlanarMeasurement, adapt: bool, beginning: bool) -> int:
        """Take a measurement; return 0 or what comes of it."""
        filter, innovations = self.filter, self.innovations
        one, error, size = self._found(span, False)
        self.surprise = 0.0
        outlier = innovations.is_outlier(size)
        if outlier:
            self.surprise = AXES * surprise(size, one.total)
            if adapt:
                innovations.learn_noise(size)
                innovations.add(size, one.total)
            if not innovations.is_lost(beginning):
                return OUTLIER
            square = one.error**2 + error**2
            filter.widen_motion(square, square)
            return LOST
        ended = False
        for axis, value in enumerate(span.value):
            found = one if axis == 0 else filter.innovation(
                axis, span.looks, value, innovations.noise**2)
            normalised = found.error / math.sqrt(found.total)
            self.surprise += surprise(normalised, found.total)
            if adapt:
                innovations.add(normalised, found.total, axis)
            size = abs(normalised) / HUBER
            added = found.total * (size - 1.0) if size > 1.0 else 0.0
            filter.update(found, added, adapt)
            if adapt:
                innovations.learn_noise(normalised)
                ended = self.blocks.add(found.told, found.given + added, found.psi.tolist(),
                                        span.dt if axis else 0.0)
        filter.keep_inside(self.bounds)
        return BLOCK if ended else 0

    def learn(self, span: PlanarMeasurement, used: bool) -> list[float]:
        """Take a measurement at fixed parameters; return its sizes in standard deviations."""
        if span.begins:
            return []
        filter, innovations = self.filter, self.innovations
        one, error, size = self._found(span, True)
        if innovations.is_outlier(size) and innovations.is_lost(False):
            square = one.error**2 + error**2
            filter.widen_motion(square, square)
            return []
        sizes = []
        for axis, value in enumerate(span.value):
            found = one if axis == 0 else filter.innovation(
                axis, span.looks, value, innovations.noise**2, True)
            normalised = found.error / math.sqrt(found.given)
            size = abs(normalised)
            sizes.append(size)
            innovations.add(normalised, found.given, axis)
            added = found.given * (size / HUBER - 1.0) if size > HUBER else 0.0
            filter.update_motion(found, added)
            if used:
                self.blocks.add(found.told, found.given + added, found.psi.tolist(),
                                span.dt if axis else 0.0)
        return sizes

    def settle(self) -> None:
        """Go to the parameters that fit best what was learned."""
        solution, covariance = self.blocks.solution()
        self.filter.theta_covariance = np.array(covariance)
        self.filter.set_theta(solution)
        self.filter.keep_inside(self.bounds)

    @property
    def verdict(self) -> Verdict | None:
        """Return what the blocks say, None while there are too few."""
        if not self._is_judged:
            self._verdict, self._alternative = None, NOT_JUDGED
            found = self.blocks.verdict(self.unmodelled.is_there)
            if found is not None and self._current_is_free:
                self._alternative = better_than_a_current(self.blocks, found)
                if is_coupling(found.missing) and self._alternative.advice != COUPLING_FIRST:
                    found = replace(found, missing=None)  # it only looks like the coupling
            self._verdict, self._is_judged = found, True
        return self._verdict

    @property
    def better_thrusters(self) -> BothThrusters | None:
        """Return thrusters that have what is named besides, None where that is something else."""
        better, verdict, theta = list(self.thrusters), self.verdict, self.filter.theta
        for missing in [] if verdict is None else verdict.to_find:
            dof, name = missing.name.split()
            k = DOFS.index(dof)
            if name in LAGS and better[k].follows != self.thrusters[k].follows:
                continue  # that of both is known better from the other DOF
            row = self._rows[k]
            better[k] = better_thrusters(
                better[k], replace(missing, name=name), float(theta[row.first + ALPHA]))
            better[1 - k] = better[1 - k]._replace(
                lag=better[k].lag, turns=better[k].turns, lag_at=better[k].lag_at)
        one, other = better
        return None if (one, other) == self.thrusters else (one, other)

    @property
    def alternative(self) -> Alternative:
        """Return what fits better than a current."""
        return self._alternative if self.verdict is not None else NOT_JUDGED

    def judge(self) -> None:
        """Let the verdict be of the blocks as they are now."""
        self._is_judged = False

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'filter': self.filter.state(), 'innovations': self.innovations.state(),
                'blocks': self.blocks.state(), 'judged': self.verdict is not None}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self.filter.restore(state['filter'])
        self.innovations.restore(state['innovations'])
        self.blocks.restore(state['blocks'])
        self._verdict, self._alternative, self._is_judged = None, NOT_JUDGED, True
        if state['judged']:
            self.judge()


class PlanarPrediction:
    """
    A model that runs beside the filter and is set to its state at the end of each block.

    Parameters
    ----------
    rows : pair of Row
        Surge and sway.
    size : int
        Number of parameters.
    thrusters : BothThrusters
        How they are taken to work until the first block ends.

    Attributes
    ----------
    fits : list of 2 floats
        1 - rms(error) / std(measured) of the velocity of surge and sway over the last blocks with
        motion, without what the noise of the fixes has in both.

    """

    def __init__(self, rows: tuple[Row, Row], size: int, thrusters: BothThrusters) -> None:
        self._model = PlanarFilter(rows, [0.0] * size, [0.0] * size, thrusters=thrusters)
        self._noise = 0.0
        self._fits = BlockFits(clean=True), BlockFits(clean=True)
        self.interrupt()

    @property
    def fits(self) -> list[float]:
        """Return how well the model predicts surge and sway."""
        return [one.fit for one in self._fits]

    def interrupt(self) -> None:
        """Wait for the end of the block: the path begins anew."""
        self._runs = False
        self._mark: list[float] = []  # time, position of the model, measured position

    def move(self, recent: Recent, span: PlanarMeasurement) -> None:
        """Go on to the next measurement and compare."""
        if not self._runs:
            return
        model = self._model
        try:
            model.move(recent, span.start, span.end, span.pieces, span.couplings, 0.0,
                       alone=True)
        except DivergenceError:
            self.interrupt()
            return
        if span.looks is not None:
            self._add((span.looks @ model.motion).tolist(), span.value, self._noise**2)
            return
        now = [span.end, *model.motion[:2].tolist(), *span.value]
        if not self._mark:
            self._mark = now
            return
        dt = now[0] - self._mark[0]
        if dt < SPAN:
            return
        a, b, x, y = [(p - q) / dt for p, q in zip(now[1:], self._mark[1:])]
        sx, sy, wx, wy, *_ = span.pieces[-1]
        self._add((sx * a + sy * b, wx * a + wy * b), (sx * x + sy * y, wx * x + wy * y),
                  2.0 * (self._noise / dt)**2)
        self._mark = now

    def _add(self, model: Sequence[float], measured: Sequence[float], noise: float) -> None:
        for one, a, b in zip(self._fits, model, measured):
            one.add(a, b, noise)

    def end_block(self, filter: PlanarFilter, noise: float) -> None:
        """Take the fit of the block and begin the next one at the state of a filter."""
        for one in self._fits:
            one.end_block()
        self._noise = noise
        self._model.theta, self._model.thrusters = filter.theta, filter.thrusters
        self._model.motion[:] = filter.motion
        self._mark, self._runs = [], True

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self._model.theta.tolist(), 'motion': self._model.motion.tolist(),
                'runs': self._runs, 'mark': self._mark, 'noise': self._noise,
                'fits': [one.state() for one in self._fits]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self._model.restore({**self._model.state(), 'theta': state['theta'],
                             'motion': state['motion']})
        self._runs, self._mark = bool(state['runs']), floats(state['mark'], len(state['mark']))
        self._noise, = floats([state['noise']], 1)
        for one, fits in zip(self._fits, state['fits']):
            one.restore(fits)
        if len(self._mark) not in (0, 5):
            raise ValueError('a prediction that does not fit')
