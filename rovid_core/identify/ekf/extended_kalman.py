"""
The extended Kalman filter on path, velocity, parameters and delay of one DOF.

It takes the fixes themselves, or a velocity sensor's values, and the force before any
low-pass. Its first seconds are gone through again in steps of Gauss-Newton, for a filter
that was linearised far from the truth keeps the mistake for ever. What its parameters are
worth is taken from the scores of blocks of data, and from what it predicts without corrections.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Final

import numpy as np
from rovid_core.identify.ekf.batch_start import (
    BatchStart,
    finish,
    KNOWN,
    KNOWN_WELL,
    LONGEST,
    NEVER,
    read_step,
    UNLEARNED,
    USED,
)
from rovid_core.identify.ekf.between_fixes import is_long, led_to, parts, Way
from rovid_core.identify.ekf.evidence.innovations import SOON
from rovid_core.identify.ekf.evidence.missing_terms import (
    clocks_in_doubt,
    COUPLING_MISSING,
    drifting,
    is_coupling,
    of_thrusters,
    remarks,
)
from rovid_core.identify.ekf.evidence.verdict import Missing, Verdict
from rovid_core.identify.ekf.filter_bank import (
    BLOCK,
    FilterBank,
    LOST,
    Member,
    OUTLIER,
)
from rovid_core.identify.ekf.normalised_model import (
    CHANGE,
    FilterUncertainty,
    NormalisedModel,
    Unmodelled,
)
from rovid_core.identify.ekf.single.free_prediction import HELD_FIT, predicted
from rovid_core.identify.ekf.single.linearised_filter import ALPHA
from rovid_core.identify.ekf.single.measurements import Measurement, MeasurementClock
from rovid_core.identify.ekf.thruster_search import (
    Heard,
    read_heard,
    SearchBeside,
    ThrusterSearch,
)
from rovid_core.identify.excitation import MIN_EXCITATION
from rovid_core.identify.intervals import Uncertainty
from rovid_core.identify.method import check_bounds, floats, Identifier
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED, read_thrusters, Thrusters
from rovid_core.settings.run import Scales

FIRST_NOISE = 0.02
"""Noise of a measurement to begin with, in typical velocities (times 1 s)."""

LARGEST = 1e4
"""In typical forces and velocities; what is larger is a mistake."""

FORGET: Final = 5.0
"""[s] over which the thrust's mean square is taken."""

IDLE: Final = 10.0
"""[s] without thrust after which the start does not keep what goes on."""

UNKNOWN: Final = 0.5
"""Relative std of alpha beyond which what was kept says next to nothing, and may go."""

PACE: Final = 6000.0
"""Measurements a second that are gone through to look for the thrusters: a fifth of a core."""

CORRELATION = (0.6, 0.75)
"""Of innovations, up to which a model may be used: to begin with, and while it is."""


def objection(verdict: Verdict | None, clocks: str, missing: Missing | None, correlation: float,
              fit: float) -> str:
    """
    Return why a model may not be used yet whatever its intervals are.

    Parameters
    ----------
    verdict : Verdict or None
        What the blocks say.
    clocks : str
        What is said of them, '' for nothing.
    missing : Missing or None
        What the model lacks.
    correlation : float
        Of innovations that follow each other.
    fit : float
        Of what is predicted without corrections.

    """
    if verdict is None:
        return 'it takes a minute of thrust before its intervals can be judged'
    if clocks:
        return 'the delay is out of range'
    if is_coupling(missing):
        return COUPLING_MISSING
    if not correlation < CORRELATION[0]:
        return 'the errors of the prediction hang together: the model lacks something'
    return predicted(fit)


class ExtendedKalman(Identifier):
    """
    The extended Kalman filter on one DOF.

    Filters that take something else each to move the vehicle besides the model run side by side;
    the noise of the measurements is learned from the innovations of each. Its status does not
    become ``converged`` before the intervals from blocks are narrow, the innovations white
    enough and the model predicts the last minute without corrections.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.

    """

    converged_share = 0.1
    judges_errors = True
    filtered = False

    def __init__(self, scales: Scales) -> None:
        self._scales = scales
        self._heard, self._pace = Heard(), PACE
        self._surprise, self._measured = 0.0, 0
        self._model = NormalisedModel(scales)
        self.bounds = self._model.bounds
        self._largest = (LARGEST * scales.force, LARGEST * scales.velocity)
        self._begin(self._model.initial)

    def reset(self) -> None:
        """Go back to the initial values."""
        self._heard = Heard()
        self._begin(self._model.initial)

    @property
    def changed_at(self) -> float:
        """Return after how long [s] the vehicle was found to have changed last, 0 for never."""
        return self._bank.changed_at

    def hear_of_change(self) -> None:
        """Learn that another DOF has shown that the vehicle changed."""
        self._bank.expect_change()

    def hear(self, thrusters: Thrusters) -> None:
        """Learn how another DOF of the vehicle shows that its thrusters work."""
        self._heard = self._heard.and_of(thrusters)

    def trust_thrusters(self) -> None:
        """Begin with thrusters as configured, and look for nothing else."""
        self._pace = 0.0
        self.reset()

    def begin_anew(self) -> None:
        """Forget the data; begin with the parameters as they are."""
        self._begin(self._model.of(self.parameters))

    def _begin(self, theta: Sequence[float],
               thrusters: Thrusters = AS_CONFIGURED) -> None:
        self._take_thrusters(thrusters)
        self._theta, self._prior = list(theta), list(self._model.prior)
        self._bank = FilterBank(lambda unmodelled: self._new(unmodelled, self._theta))
        self._clock = self._new_clock()
        self._start: BatchStart[Member] | None = self._new_start()
        self._search: SearchBeside[Member] = SearchBeside(self._new_search, self._pace)
        self._time = 0.0
        self._moving = self._usable = False
        self._idle = 0.0  # [s] without anything to learn, during the start
        self._is_later = False  # whether what was kept first was left behind, as it said nothing
        self._is_solved = False  # whether what is kept was gone through
        self.v_hat = math.nan
        self._way: Way = []
        self.excitation = 0.0
        self._published: Verdict | None = None  # what ``uncertainty`` was made of
        self._publish()

    def _new(self, unmodelled: Unmodelled, theta: Sequence[float]) -> Member:
        """Return a filter at some parameters that knows those to begin with."""
        member = Member(self._theta, self._prior, self._model.box, unmodelled, FIRST_NOISE,
                        self._model.watched, self._model.own, self._thrusters,
                        self._scales.shares)
        member.filter.theta = list(theta)
        return member

    def _new_clock(self, forgets: bool = True) -> MeasurementClock:
        scales = self._scales
        return MeasurementClock(scales.force, scales.velocity, len(scales.couplings),
                                len(scales.watched), self._model.own, forgets, self._thrusters)

    def _take_thrusters(self, thrusters: Thrusters) -> None:
        self._thrusters = thrusters  # in typical forces
        self.thrusters = thrusters.in_units(self._scales.force, self._scales.velocity)

    def _use_thrusters(self, thrusters: Thrusters) -> list[float]:
        """Let the thrusters work otherwise; return parameters for it."""
        theta = self._bank.best.filter.theta
        theta[-1] -= thrusters.lag - self._thrusters.lag
        self._take_thrusters(thrusters)
        self._clock.set_thrusters(thrusters)
        if self._start is not None:
            self._start.change_clock()
        return theta

    def _new_start(self) -> BatchStart[Member]:
        couplings, watched = len(self._scales.couplings), len(self._scales.watched)
        return BatchStart(self._new, lambda: self._new_clock(False),
                          lambda values: read_step(
                              values, couplings, watched, self._scales.shares))

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity [m/s or rad/s], keeping the parameters."""
        self._clock.restart()
        for member in self._bank.members:
            member.restart(velocity / self._scales.velocity)
        self._moving, self._way = True, []
        self.v_hat = velocity
        if self._start is not None:
            self._start.add(velocity / self._scales.velocity)

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Take one step; return '' or why it was refused.

        Parameters
        ----------
        step : Step
            What was measured.
        adapt : bool
            False leaves the parameters as they are.

        """
        if not self._in_range(step):
            self._moving = False  # the path goes on from the next step
            return 'out_of_range'
        if not self._moving:
            self.restart(step.velocity[0])
        # what moves without thrust is moved by something that the model does not know
        adapt = self._has_thrust(step) and adapt
        if adapt and self._idle >= IDLE:
            self.restart(step.velocity[0])  # the start has left out what was before
            self._idle = 0.0
        try:
            self._add_step(step, adapt)
        except (ArithmeticError, np.linalg.LinAlgError):
            # a number out of range on the way is no better than a divergence
            self.begin_anew()
            return 'diverged'
        return ''

    def _add_step(self, step: Step, adapt: bool) -> None:
        start, clock = self._start, self._clock
        changed = self._bank.changed_at > 0.0
        beginning = start is not None and start.duration < SOON and not changed
        self._time += step.dt
        span = clock.add_step(step)
        found = [0] * len(self._bank.members)
        if span is not None:
            found = self._take(span, adapt, beginning)
            if adapt:
                self._bank.choose()
        came = found[self._bank.number]
        if came == LOST and beginning:
            # it began with an outlier
            excitation = self.excitation
            self._begin(self._theta)
            self.restart(step.velocity[0])
            self.excitation = excitation
            return
        if start is not None:
            self._go_on_with_start(start, step, came, adapt)
        if adapt and self._bank.is_lost_often(found, self._time):
            self._note_change(step)
        elif BLOCK in found:
            self._end_blocks(found, step)
        is_other = self._search_for(step.dt)
        self._way = self._follow(step)
        self.v_hat = self._way[-1][1]
        if is_other or adapt and span is not None:
            self._publish()

    def _take(self, span: Measurement, adapt: bool, beginning: bool) -> list[int]:
        """Take a measurement; return what comes of it for each member."""
        found = []
        for member in self._bank.members:
            member.move(self._clock.recent, span)
            found.append(0 if span.value is None else member.update(
                span.i, span.value, span.dt, adapt, beginning))
        if span.value is not None:
            self._surprise += self._bank.best.surprise
            self._measured += 1
        return found

    @property
    def surprise(self) -> tuple[float, int]:
        """Return -2 log of the likelihood of what was measured, and how much that was."""
        return self._surprise, self._measured

    @property
    def is_found(self) -> bool:
        """Tell whether the first data were gone through."""
        return self._is_solved

    @property
    def way(self) -> Way:
        """Return the velocity along the last step, as of an ``Identifier``."""
        return self._way or [(0.0, self.v_hat)]

    @property
    def kept(self) -> float:
        """Return of how much motion under thrust all data are kept [s], inf if they are not."""
        return math.inf if self._start is None else self._start.duration

    @property
    def fit(self) -> float:
        """Return how much of the motion the model predicts without corrections."""
        fit = self._bank.best.prediction.fit
        return fit if math.isfinite(fit) else math.nan

    @property
    def note(self) -> str:
        """Return what the filter has to say of the vehicle and its model, '' if nothing."""
        said = [self._bank.said_of_change(self._time)]
        if self._clocks:
            said.append(self._clocks)
        said += of_thrusters(self._thrusters, self._scales.force)
        verdict = self._bank.best.verdict
        said.append(drifting(verdict, self._model.parameters, self._bank.changed_at > 0.0))
        said += remarks(verdict, None if verdict is None else verdict.missing,
                        self._bank.best.filter.theta, self._scales, self.converged_share)
        return '; '.join(filter(None, said))

    @property
    def _clocks(self) -> str:
        return clocks_in_doubt(self._bank.best.verdict, len(self._theta) - 1, self._thrusters.lag)

    @property
    def doubt(self) -> str:
        """Return why the model may not be used yet whatever its intervals are, '' if it may."""
        if self._usable:
            return ''
        best = self._bank.best
        missing = None if best.verdict is None else best.verdict.missing
        return objection(best.verdict, self._clocks, missing, best.innovations.correlation,
                         best.prediction.fit)

    def _judge(self) -> None:
        """Find whether the model may be used."""
        k, verdict = (1 if self._usable else 0), self._bank.best.verdict
        self._usable = (
            verdict is not None and not self._clocks and not is_coupling(verdict.missing)
            and self._bank.best.innovations.correlation < CORRELATION[k]
            and self._bank.best.prediction.fit > HELD_FIT[k])

    def _in_range(self, step: Step) -> bool:
        f, v = self._largest
        one, other = step.forces
        return (abs(step.force[1]) <= f and abs(one) <= f and abs(other) <= f
                and abs(step.mean) <= v and abs(step.velocity[0]) <= v)

    def _has_thrust(self, step: Step) -> bool:
        square = (step.force[1] / self._scales.force)**2
        self.excitation -= math.expm1(-step.dt / FORGET) * (square - self.excitation)
        return square > MIN_EXCITATION or self.excitation > MIN_EXCITATION

    def _go_on_with_start(self, start: BatchStart[Member], step: Step, found: int,
                          adapt: bool) -> None:
        """Keep the first seconds, and go through them again once they say something."""
        if adapt:
            self._idle = 0.0
            start.add(step, OUTLIER if found == OUTLIER else USED)
        else:
            self._idle += step.dt
            if self._idle < IDLE:
                start.add(step, OUTLIER if found == OUTLIER else UNLEARNED)
            elif start.next == NEVER and not self._search.is_on:
                self._start, self._idle = None, 0.0
            return
        if found == LOST:
            start.accept_last_outliers(4)
        if start.duration < start.next:
            if start.next == NEVER and start.duration > LONGEST and not self._search.is_on:
                self._start = None
            return
        bank = self._bank
        if not self._is_later or self._is_known(UNKNOWN, (ALPHA,)):
            finish(bank.go_through_again(start, self._theta, not self._is_solved))
            self._is_solved = True
            if bank.changes_on(self._time):
                self._begin_again(step, bank.changed_at)
                return
        self._wait(start, step)

    def _wait(self, start: BatchStart[Member], step: Step) -> None:
        """Find when to go through all of it again, or that this is not needed any more."""
        known = self._is_known(KNOWN, (ALPHA,))
        if self._bank.confirmed and self._is_known(KNOWN_WELL):
            start.next = NEVER  # it is only kept for a lag that may be named yet
        elif start.is_enough(known) and not self._search.is_on:
            self._start = None
        elif start.is_much() and not self._is_known(UNKNOWN, (ALPHA,)):
            # at rest, say, under thrust that carries a weight: what comes may tell more
            start.clear()
            self._search.drop()
            start.add(self._follow(step)[-1][1] / self._scales.velocity)
            self._is_later, self._is_solved = True, False
        else:
            start.wait(known)

    def _is_known(self, share: float, terms: Sequence[int] | None = None) -> bool:
        """
        Tell whether parameters, all by default, are known to a share.

        That is of alpha, in typical forces and velocities, and of a second for the delay.
        """
        filter = self._bank.best.filter
        alpha, last = filter.theta[ALPHA], len(self._theta) - 1
        return all(filter.theta_covariance[i][i] < (share * (alpha if i < last else 1.0))**2
                   for i in terms or range(last + 1))

    def conclude(self) -> bool:
        """Go through a log that ends before that was done; tell if it changes the filter."""
        found = self._bank.conclude(self._start, self._theta) or self._search_for(math.inf)
        if found:
            self._publish()
        return found

    def _end_blocks(self, found: Sequence[int], step: Step) -> None:
        """Look at the blocks that are complete."""
        bank = self._bank
        ended = bank.ended(found)
        if bank.contradicted(ended):
            self._note_change(step)
            return
        for member in ended:
            member.judge()
        if bank.best in ended:
            self._search.begin(bank, self._start, self._heard, self.state)
            self._judge()

    def _new_search(self, state: Mapping[str, Any]) -> ThrusterSearch[Member]:
        """Return a search for what the thrusters have besides, on a copy of this filter."""
        copy = ExtendedKalman(self._scales)
        copy.restore(state)
        return ThrusterSearch(copy._bank, copy._start, copy._use_thrusters, copy._heard)

    def _search_for(self, duration: float) -> bool:
        """Search for so much longer [s]; tell if that changes the filter."""
        if not self._search.go_on(duration, self._bank, self._start, self._use_thrusters):
            return False
        self._judge()
        return True

    def _note_change(self, step: Step) -> None:
        self._usable = False
        self._begin_again(step, self._time)

    def _begin_again(self, step: Step, changed_at: float) -> None:
        """Begin with what the parameters may have become; the noise is what it was."""
        velocity = self._follow(step)[-1][1]
        self._theta = list(self._bank.best.filter.theta)
        # a parameter that a fault has led to 0 must find its way back, too; the wrong model has
        # moved the delay by more than it was uncertain
        *prior, delay = self._model.prior
        self._prior = [
            *[(CHANGE * max(abs(p), abs(q)))**2 if v else 0.0
              for p, q, v in zip(self._theta, self._model.initial, prior)], delay]
        self._bank.begin_anew(changed_at)
        self._start = self._new_start()
        self._search.drop()
        self._idle, self._is_later, self._is_solved = 0.0, False, False
        self.restart(velocity)

    def _rate(self, step: Step, part: int, force: float, v: float) -> float:
        """Return the acceleration at a velocity, under a force and the couplings of a part."""
        filter = self._bank.tracker.filter
        theta = filter.theta
        alpha, beta, gamma, delta = self._model.acting(theta, force, v)
        gamma -= alpha * self._thrusters.slowing(force)
        coupled = self._model.coupled(
            theta, [means[part] for means in step.couplings]) if step.couplings else 0.0
        return (alpha * force + (beta * abs(v) + gamma) * v + delta + filter.motion[2]
                + coupled)

    def _follow(self, step: Step) -> Way:
        """Return ``way`` of a step that was taken."""
        ahead = self._clock.ahead
        found = self._scales.velocity * self._bank.tracker.filter.motion[1]
        way: Way = []
        if is_long(step.dt) and self._way:
            way = led_to(self._predicted(step, 0, self._way[-1][1], step.dt, ahead), [found])
        return way + self._predicted(step, 1, found, ahead, 0.0) or [(0.0, found)]

    def _predicted(self, step: Step, part: int, velocity: float, begin: float,
                   end: float) -> Way:
        """Return what becomes of a velocity; both times are before the end of a step [s]."""
        recent, delay = self._clock.recent, self._bank.tracker.filter.theta[-1]
        v = velocity / self._scales.velocity
        way: Way = []
        for at, then in parts(begin, end):
            h = at - then
            force = recent.over(recent.end - at, recent.end - then, delay)[0] / h
            v += h * self._rate(step, part, force, v + 0.5 * h * self._rate(step, part, force, v))
            way.append((then, self._scales.velocity * v))
        return way

    def _publish(self) -> None:
        best, model = self._bank.best, self._model
        theta = best.filter.theta
        self.parameters, self.couplings = model.parameters(theta), model.kappas(theta)
        self.delay = theta[-1] + self._thrusters.lag
        verdict = best.verdict
        if verdict is None:
            self.uncertainty: Uncertainty = FilterUncertainty(
                best.filter.theta_covariance, best.innovations.inflation, model,
                best.blocks.unseen())
        elif verdict is not self._published:  # it stays for the whole of a block
            self.uncertainty = FilterUncertainty(verdict.covariance, 1.0, model)
        self._published = verdict

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {
            'parameters': list(self.parameters), 'theta': list(self._theta),
            'prior': list(self._prior),
            'thrusters': list(self._thrusters), 'bank': self._bank.state(),
            'clock': self._clock.state(),
            'start': None if self._start is None else self._start.state(),
            'search': self._search.state(), 'heard': list(self._heard),
            'time': self._time, 'moving': self._moving, 'usable': self._usable,
            'idle': self._idle, 'later': self._is_later, 'solved': self._is_solved,
            'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
            'goes_on': bool(self._way), 'excitation': self.excitation}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        check_bounds(PARAMETERS, floats(state['parameters'], 4), *self.bounds)
        self._begin(floats(state['theta'], len(self._theta)), read_thrusters(state['thrusters']))
        self._heard = read_heard(state['heard'])
        self._prior = floats(state['prior'], len(self._prior))
        self._bank.restore(state['bank'])
        self._clock.restore(state['clock'])
        if state['start'] is None:
            self._start = None
        elif self._start is not None:
            self._start.restore(state['start'])
        self._time, self._idle, self.excitation = floats(
            [state[name] for name in ('time', 'idle', 'excitation')], 3)
        self._moving, self._usable = bool(state['moving']), bool(state['usable'])
        self._is_later, self._is_solved = bool(state['later']), bool(state['solved'])
        self.v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        self._way = [(0.0, self.v_hat)] if state['goes_on'] else []
        self._search.restore(state['search'])
        self._publish()
