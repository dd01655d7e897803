"""
The extended Kalman filter on surge and sway together, in water that moves.

It takes the fixes themselves, in the world, and estimates the current beside the parameters.
While the vehicle keeps its heading, current, bias and linear drag are one family: the filter goes
on as in still water, its intervals have in them what a current could do, and nothing has
converged. Once the vehicle has turned, all that was kept is gone through again with the current
free; one that is freed later in a filter that was linearised without it does not find the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from typing import Any, Final

import numpy as np
from rovid_core.identify.ekf.batch_start import (
    BatchStart,
    finish,
    KNOWN,
    PERIOD,
    read_planar_step,
    UNLEARNED,
    USED,
)
from rovid_core.identify.ekf.between_fixes import is_long, led_to, parts, Way
from rovid_core.identify.ekf.evidence.current_status import (
    current_with_status,
    Turning,
    unseen_current,
    why_not_known,
)
from rovid_core.identify.ekf.evidence.innovations import SOON
from rovid_core.identify.ekf.evidence.missing_terms import (
    clocks_in_doubt,
    drifting,
    is_coupling,
    of_thrusters,
    remarks,
)
from rovid_core.identify.ekf.evidence.verdict import Missing, Verdict
from rovid_core.identify.ekf.extended_kalman import (
    CORRELATION,
    FIRST_NOISE,
    FORGET,
    IDLE,
    LARGEST,
    objection,
)
from rovid_core.identify.ekf.filter_bank import BLOCK, FilterBank, LOST, OUTLIER
from rovid_core.identify.ekf.normalised_model import FilterUncertainty, Unmodelled
from rovid_core.identify.ekf.planar.filter_with_current import PlanarFilter
from rovid_core.identify.ekf.planar.layout import AXES, CURRENT, DOFS, PlanarModel
from rovid_core.identify.ekf.planar.member import (
    BothThrusters,
    PlanarClock,
    PlanarMeasurement,
    PlanarMember,
    PlanarPrediction,
)
from rovid_core.identify.ekf.planar.row import PlanarRow
from rovid_core.identify.ekf.single.free_prediction import HELD_FIT
from rovid_core.identify.ekf.thruster_search import (
    Heard,
    read_heard,
    SearchBeside,
    ThrusterSearch,
)
from rovid_core.identify.estimate import Current, KNOWN_CURRENT
from rovid_core.identify.excitation import MIN_EXCITATION
from rovid_core.identify.method import floats
from rovid_core.model.plant import Array
from rovid_core.model.samples import PlanarPiece, PlanarStart, PlanarStep
from rovid_core.model.thrusters import AS_CONFIGURED, read_thrusters, Thrusters
from rovid_core.settings.run import CurrentSettings, Scales

CERTAIN = 5.0
"""Standard deviations from which two signs together are no chance."""

MIRRORED = (
    'as it turns surge and sway push each other the other way than inertia does: the sideways '
    'velocity and the attitude differ in handedness, see velocity.frames and attitude.frames')

WINDOW = 180.0
"""[s] Longest time that is kept to be gone through again."""

BUDGET = 20_000
"""Steps that are gone through at once."""

PACE: Final = 2000.0
"""Those a second that are gone through to look for the thrusters: most of a core."""


class PlanarKalman:
    """
    The extended Kalman filter on surge and sway.

    Parameters
    ----------
    scales : mapping
        As of a ``PlanarModel``.
    settings : CurrentSettings
        What is known of the current.

    Attributes
    ----------
    refused : str
        Why the last step was refused, '' if it was not.
    newest : int or None
        Time of the end of the last step [ns].
    way : Way
        How long before that time [s], and the velocity through the water of surge and of sway
        then [m/s], over ground while nothing is known of a current: along a step that takes long
        in short parts, else at its end alone; empty before ``is_found``.
    current : Current
        What is known of it.
    is_found : bool
        Whether the first data were gone through.
    current_is_new : bool
        Whether the last step made a current known, for the first time and at the start.

    """

    def __init__(self, scales: Mapping[str, Scales], settings: CurrentSettings) -> None:
        self._scales, self._settings = scales, settings
        self._model = PlanarModel(scales, settings.prior)
        self.newest: int | None = None
        self._heard, self._pace = Heard(), PACE
        self._surprise, self._measured = 0.0, 0
        self.rows = {dof: PlanarRow(self, k, self._model.of[k].bounds)
                     for k, dof in enumerate(DOFS) if dof in scales}
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

    def _begin(self, theta: Sequence[float],
               thrusters: BothThrusters = (AS_CONFIGURED, AS_CONFIGURED)) -> None:
        self._take_thrusters(thrusters)
        self._theta = [*list(theta)[:-2], 0.0, 0.0]
        self._variances = list(self._model.variances)
        self._free = self.is_found = self._knew_current = self.current_is_new = False
        self.way: Way = []
        self._bank = FilterBank(lambda unmodelled: self._new(unmodelled, self._theta))
        self._clock = self._new_clock()
        self._start: BatchStart[PlanarMember] | None = self._new_start()
        self._search: SearchBeside[PlanarMember] = SearchBeside(self._new_search, self._pace)
        self._prediction = PlanarPrediction(self._model.rows, self._model.size, thrusters)
        self._time = 0.0
        self._moving = False
        self._usable = [False, False]
        self._published: Verdict | None = None  # what the uncertainties were made of
        self._arranged: tuple[Verdict | None, Array] = None, np.zeros(0)  # and its covariance
        self._idle = 0.0
        self._windows = 0
        self._turning = Turning()
        self._after: Sequence[PlanarPiece] = ()
        self.refused = ''
        self.excitations = [0.0, 0.0]
        for row in self.rows.values():
            row.v_hat = math.nan
        self._publish()

    def _new(self, unmodelled: Unmodelled, theta: Sequence[float]) -> PlanarMember:
        """Return a filter at some parameters that knows the initial ones."""
        free, k = self._free, self._model.size - AXES
        considered = {} if free else dict(enumerate(self._variances[k:], k))
        member = PlanarMember(
            self._model.rows, self._theta,
            self._variances if free else [*self._variances[:k], *[0.0] * AXES], considered,
            self._model.box,
            unmodelled, self._settings.change if free else 0.0,
            FIRST_NOISE * max(row.velocity for row in self._model.rows), self._model.watched,
            tuple(self.rows), self._thrusters)
        if member.filter.theta.tolist() != list(theta):
            member.filter.theta = np.array(theta, dtype=float)
            member.filter.motion[CURRENT] = member.filter.theta[-2:]
        return member

    def _new_clock(self, forgets: bool = True) -> PlanarClock:
        surge, sway = self._model.scales
        return PlanarClock(
            (surge.force, sway.force), self._model.regressors, forgets, self._thrusters)

    def _take_thrusters(self, thrusters: BothThrusters) -> None:
        self._thrusters = thrusters
        for row in self.rows.values():
            scales = self._model.scales[row.k]
            row.thrusters = thrusters[row.k].in_units(scales.force, scales.velocity)

    def _use_thrusters(self, thrusters: BothThrusters) -> list[float]:
        """Let the thrusters work otherwise; return parameters for it."""
        theta: list[float] = self._bank.best.filter.theta.tolist()
        for row, new, old in zip(self._model.rows, thrusters, self._thrusters):
            theta[row.end - 1] -= new.lag - old.lag
        self._take_thrusters(thrusters)
        self._clock.set_thrusters(thrusters)
        if self._start is not None:
            self._start.change_clock()
        return theta

    def _new_start(self) -> BatchStart[PlanarMember]:
        return BatchStart(self._new, lambda: self._new_clock(False), self._read, BUDGET)

    def restart(self, start: PlanarStart) -> None:
        """Take up from a measured velocity over ground, keeping the parameters."""
        self._clock.restart()
        for member in self._bank.members:
            member.restart(start)
        self._prediction.interrupt()
        self._moving, self.way = True, []
        for row in self.rows.values():
            row.v_hat = start.velocity[row.k]
        if self._start is not None:
            self._start.add(start)

    def step(self, step: PlanarStep, adapt: bool = True,
             after: Sequence[PlanarPiece] = ()) -> None:
        """
        Take one step; ``refused`` says whether that went well.

        Parameters
        ----------
        step : PlanarStep
            What was measured.
        adapt : bool
            False leaves the parameters as they are; the current goes on.
        after : sequence of PlanarPiece, optional
            Attitude over equal parts of the time from the measurement to the step's end, where
            that is long.

        """
        self.refused, self.current_is_new, self._after = '', False, after
        if not self._in_range(step):
            self._moving = False
            self.refused, self.way = 'out_of_range', []
            return
        if not self._moving:
            self.restart(_start_of(step))
        adapt = self._has_thrust(step) and adapt
        if adapt and self._idle >= IDLE:
            self.restart(_start_of(step))  # the start has left out what was before
            self._idle = 0.0
        try:
            self._add_step(step, adapt)
        except (ArithmeticError, np.linalg.LinAlgError):
            kept = [p for k, model in enumerate(self._model.of)
                    for p in model.of(model.parameters(self._theta_of(k)))]
            self._begin([*kept, 0.0, 0.0] if np.isfinite(
                self._bank.best.filter.theta).all() else self._model.initial)
            self.refused = 'diverged'

    def _add_step(self, step: PlanarStep, adapt: bool) -> None:
        start = self._start
        changed = self._bank.changed_at > 0.0
        beginning = (start is not None and not self._windows and start.duration < SOON
                     and not changed)
        self._time += step.dt
        span = self._clock.add_step(step)
        found = [0] * len(self._bank.members)
        if span is not None:
            found = self._take(span, adapt, beginning)
        came = found[self._bank.number]
        if adapt and span is not None:
            self._bank.choose()
        if came == LOST and beginning:
            # it began with an outlier
            excitations = self.excitations
            self._begin(self._theta)
            self.restart(_start_of(step))
            self.excitations = excitations
            return
        if start is not None:
            self._go_on_with_start(start, step, came, adapt)
        if adapt and (self._free or changed) and self._bank.is_lost_often(found, self._time):
            self._note_change(step)
        elif BLOCK in found:
            self._end_blocks(found, step)
        is_other = self._search_for(step.dt)
        velocities = self._follow(step)
        for row in self.rows.values():
            row.v_hat = self._over_ground(row.k, step, velocities[-1][1 + row.k])
        self.way = velocities if self.is_found else []
        if is_other or span is not None:
            self._publish()
        if self.current.status == 'known' and not self._knew_current:
            # one that could as well be none changes nothing
            self._knew_current, self.current_is_new = True, self._start is not None and (
                math.hypot(self.current.x, self.current.y) > KNOWN_CURRENT)

    def _take(self, span: PlanarMeasurement, adapt: bool, beginning: bool) -> list[int]:
        """Take a measurement; return what comes of it for each member."""
        if self._start is not None:
            self._turning.add(span.pieces, (span.end - span.start) / len(span.pieces),
                              self._start.duration)
        # between a turn and the solution with a current nothing can be learned without it
        learns = adapt and (self._free or not self._turning.has_turned)
        recent, found = self._clock.recent, []
        self._prediction.move(recent, span)
        for member in self._bank.members:
            member.move(recent, span)
            found.append(0 if span.begins else member.update(span, learns, beginning))
        if not span.begins:
            self._surprise += self._bank.best.surprise
            self._measured += AXES
        return found

    @property
    def surprise(self) -> tuple[float, int]:
        """Return -2 log of the likelihood of what was measured, and how many numbers that was."""
        return self._surprise, self._measured

    def _in_range(self, step: PlanarStep) -> bool:
        return all(abs(force) <= LARGEST * scales.force
                   for scales, forces in zip(self._model.scales, step.forces)
                   for force in forces) and all(
            abs(x) <= LARGEST * scales.velocity
            for scales, x in zip(self._model.scales, step.velocity)) and all(
            abs(x) <= LARGEST * 1e3 for x in step.value)

    def _has_thrust(self, step: PlanarStep) -> bool:
        found = False
        for k, (scales, (one, other)) in enumerate(zip(self._model.scales, step.forces)):
            force = (one * step.parts[0] + other * step.parts[1]) / step.dt / scales.force
            self.excitations[k] -= math.expm1(-step.dt / FORGET) * (
                force * force - self.excitations[k])
            found |= force * force > MIN_EXCITATION or self.excitations[k] > MIN_EXCITATION
        return found

    def _go_on_with_start(self, start: BatchStart[PlanarMember], step: PlanarStep, found: int,
                          adapt: bool) -> None:
        """Keep what was measured, and go through it again once it says something."""
        if adapt:
            self._idle = 0.0
            start.add(step, OUTLIER if found == OUTLIER else USED)
        else:
            self._idle += step.dt
            if self._idle < IDLE:
                start.add(step, OUTLIER if found == OUTLIER else UNLEARNED)
            return
        if found == LOST:
            start.accept_last_outliers(4)
        turning = self._turning
        if not self._free and turning.has_turned and not turning.lacks(start.duration):
            self._free = True
            self._free = finish(self._bank.go_through_again(start, self._theta, True))
            self.is_found |= self._free
            self._search.drop()  # it goes on as in still water
            if not self._free:
                turning.turned_at = start.duration  # what there is has led nowhere
            # once more when there is more of it
            start.wait(False)
            return
        if not self._free and start.duration > WINDOW:
            start.clear()
            self._search.drop()
            start.next = 2.0 * WINDOW  # not before it turns
            start.add(_start_of(step))
            self._windows += 1
            turning.begin()
            return
        if start.duration < start.next or turning.has_turned and not self._free:
            return
        bank = self._bank
        self.is_found |= finish(
            bank.go_through_again(start, self._theta, start.next <= PERIOD))
        if bank.changes_on(self._time):
            self._begin_again(step, bank.changed_at)
            return
        filter = self._bank.best.filter
        known = all(math.sqrt(filter.theta_covariance[i, i]) < KNOWN * filter.theta[i] for i in [
            self._model.rows[row.k].first for row in self.rows.values()])
        start.wait(known)
        if self._free and not self._search.is_on and start.is_enough(known and bank.confirmed):
            self._start = None

    def conclude(self) -> bool:
        """Go through a log that ends before that was done; tell if it changes the filter."""
        found = self._bank.conclude(self._start, self._theta) or self._search_for(math.inf)
        if found:
            self._publish()
        return found

    def _end_blocks(self, found: Sequence[int], step: PlanarStep) -> None:
        """Look at the blocks that are complete."""
        best, ended = self._bank.best, self._bank.ended(found)
        if self._free and self._bank.contradicted(ended):
            self._note_change(step)
            return
        for member in ended:
            member.judge()
        if best in ended:
            # without the current the model is wrong, and a lag may be likelier only for that
            heard = self._heard if self._free else Heard()
            self._search.begin(self._bank, self._start, heard, self.state)
            self._prediction.end_block(best.filter, best.innovations.noise)
            self._judge()

    def _new_search(self, state: Mapping[str, Any]) -> ThrusterSearch[PlanarMember]:
        """Return a search for what the thrusters have besides, on a copy of this filter."""
        copy = PlanarKalman(self._scales, self._settings)
        copy.restore(state)
        return ThrusterSearch(copy._bank, copy._start, copy._use_thrusters, copy._heard)

    def _search_for(self, duration: float) -> bool:
        """Search for so much longer [s]; tell if that changes the filter."""
        if not self._search.go_on(duration, self._bank, self._start, self._use_thrusters):
            return False
        self._prediction.interrupt()  # it goes on with the thrusters that there were
        self._judge()
        return True

    def _judge(self) -> None:
        """Find whether the model may be used."""
        best = self._bank.best
        self.current = self._find_current(self._covariance())
        self._usable = [
            best.verdict is not None and self.current.status == 'known'
            and not self._clocks(k) and not is_coupling(self._missing(k))
            and best.innovations.correlation < CORRELATION[usable] and fit > HELD_FIT[usable]
            for k, (usable, fit) in enumerate(zip(self._usable, self._prediction.fits))]

    def _clocks(self, k: int) -> str:
        best, i = self._bank.best, self._model.rows[k].end - 1
        return clocks_in_doubt(best.verdict, i, self._thrusters[k].lag)

    def _note_change(self, step: PlanarStep) -> None:
        self._usable = [False, False]
        self._begin_again(step, self._time)

    def _begin_again(self, step: PlanarStep, changed_at: float) -> None:
        """Begin with what the parameters may have become; the noise is what it was."""
        _, u, v = self._follow(step)[-1]
        velocity = self._over_ground(0, step, u), self._over_ground(1, step, v)
        filter = self._bank.best.filter
        self._theta = [*filter.theta[:-AXES].tolist(), *filter.motion[CURRENT].tolist()]
        self._variances = self._model.variances_after_change(self._theta)
        self._bank.begin_anew(changed_at)
        self._start = self._new_start()
        self._search.drop()
        self._idle = 0.0
        self.restart(PlanarStart(velocity, step.axes))

    def _over_ground(self, k: int, step: PlanarStep, velocity: float) -> float:
        """Return a velocity through the water at the end of a step over ground [m/s]."""
        current = self._bank.tracker.filter.motion[CURRENT].tolist()
        x, y = step.axes[2 * k:2 * k + 2]
        return velocity + x * float(current[0]) + y * float(current[1])

    def _follow(self, step: PlanarStep) -> Way:
        """Return ``way`` of a step that was taken."""
        if not is_long(step.dt):
            return [(0.0, self._water_velocity(0, step), self._water_velocity(1, step))]
        ahead, found = self._clock.ahead, self._bank.tracker.filter.motion[2:4].tolist()
        way: Way = []
        if self.way:
            way = led_to(self._predicted(step, self.way[-1][1:], step.dt, ahead), found)
        return way + self._predicted(step, found, ahead, 0.0) or [(0.0, *found)]

    def _predicted(self, step: PlanarStep, velocity: Sequence[float], begin: float,
                   end: float) -> Way:
        """Return what becomes of a velocity; both times are before the end of a step [s]."""
        filter, recent = self._bank.tracker.filter, self._clock.recent
        model = PlanarFilter(self._model.rows, filter.theta.tolist(), [0.0] * self._model.size,
                             thrusters=self._thrusters)
        model.motion[2:4], model.motion[6:] = velocity, filter.motion[6:]
        way: Way = []
        for at, then in parts(begin, end):
            piece = self._turning_at(step, 0.5 * (at + then))
            model.move(recent, recent[0].end - at, recent[0].end - then, [piece],
                       step.couplings, 0.0, alone=True)
            way.append((then, *model.motion[2:4].tolist()))
        return way

    def _turning_at(self, step: PlanarStep, before: float) -> PlanarPiece:
        """Return how the body lies and turns so long [s] before the end of a step."""
        ahead, pieces = self._clock.ahead, self._after
        if before < ahead and pieces:
            share = before / ahead
        else:
            # these end with the measurement, and begin with the one before
            pieces = step.pieces
            share = max(before - ahead, 0.0) / (
                (step.dt - ahead) * (2.0 if step.interval else 1.0))
        return pieces[-1 - min(int(share * len(pieces)), len(pieces) - 1)]

    def _water_velocity(self, k: int, step: PlanarStep) -> float:
        """Return the velocity through the water at the end of a short step [m/s]."""
        filter, row = self._bank.tracker.filter, self._model.rows[k]
        theta, motion = filter.theta.tolist(), filter.motion.tolist()
        v, other = motion[2 + k], motion[3 - k]
        ahead, recent = self._clock.ahead, self._clock.recent[k]
        if ahead:
            scale, own = row.velocity, theta[row.first:row.end]
            force = recent.over(recent.end - ahead, recent.end, own[-1])[0] / ahead
            alpha, beta, gamma, delta = self._model.of[k].acting(own, force, v)
            gamma -= alpha * self._thrusters[k].slowing(force)
            rate = alpha * force + (beta * abs(v / scale) + gamma) * v / scale + delta
            rate += math.fsum([theta[i] * step.couplings[k][m] for i, m in row.measured])
            if row.turning >= 0:
                rate += theta[row.turning] * other * step.pieces[-1].rate
            v += ahead * (scale * rate + motion[6 + k])
        return float(v)

    def _covariance(self) -> Array:
        """Return that of the parameters."""
        best = self._bank.best
        verdict = best.verdict
        if verdict is None:
            return best.filter.theta_covariance * best.innovations.inflation
        if verdict is not self._arranged[0]:  # it stays for the whole of a block
            self._arranged = verdict, np.array(verdict.covariance)
        return self._arranged[1]

    def _publish(self) -> None:
        best, covariance = self._bank.best, self._covariance()
        self.current = self._find_current(covariance)
        verdict = best.verdict
        told = verdict is not None and verdict is self._published
        self._published = verdict
        unseen = best.blocks.unseen() if verdict is None else []
        if unseen:
            covariance = covariance + np.array(unseen)
        for published in self.rows.values():
            row, model = self._model.rows[published.k], self._model.of[published.k]
            theta = self._theta_of(published.k)
            published.parameters = model.parameters(theta)
            published.delay = theta[-1] + self._thrusters[published.k].lag
            published.couplings = model.kappas(theta)
            published.excitation = self.excitations[published.k]
            if not told:
                published.uncertainty = FilterUncertainty(
                    covariance[row.first:row.end, row.first:row.end], 1.0, model)

    def _find_current(self, of_theta: Array) -> Current:
        prior, best = self._settings.prior, self._bank.best
        if not self._free:
            return unseen_current(prior, self._turning.advice(
                0.0 if self._start is None else self._start.duration))
        return current_with_status(best.filter.current(of_theta), prior, best.alternative,
                                   self._knew_current)

    def _theta_of(self, k: int) -> list[float]:
        """Return the parameters of surge (0) or sway (1), the delay at the end."""
        row = self._model.rows[k]
        theta: list[float] = self._bank.best.filter.theta[row.first:row.end].tolist()
        return theta

    def fit(self, k: int) -> float:
        """Return how much of the motion the model of surge (0) or sway (1) predicts by itself."""
        fit = self._prediction.fits[k]
        return fit if math.isfinite(fit) else math.nan

    def note(self, k: int) -> str:
        """Return what the filter has to say of surge (0) or sway (1), '' if nothing."""
        said = [self._bank.said_of_change(self._time)]
        if self._is_mirrored:
            said.append(MIRRORED)
        if self.current.advice:
            said.append(why_not_known(self.current))
        if self._clocks(k):
            said.append(self._clocks(k))
        said += of_thrusters(self._thrusters[k], self._model.scales[k].force)
        verdict, row = self._bank.best.verdict, self._model.rows[k]
        said.append(drifting(verdict, self._model.of[k].parameters, self._bank.changed_at > 0.0,
                             row.first, row.end))
        said += remarks(verdict, self._missing(k), self._theta_of(k), self._model.scales[k],
                        self.rows[DOFS[k]].converged_share, f'{DOFS[k]} ', row.first)
        return '; '.join(filter(None, said))

    @property
    def _is_mirrored(self) -> bool:
        """Tell whether both push each other the other way as they turn than their inertia does."""
        verdict, places = self._bank.best.verdict, [row.turning for row in self._model.rows]
        if verdict is None or min(places) < 0:
            return False
        one, other = [sign * verdict.theta[i] / math.sqrt(verdict.covariance[i][i])
                      for sign, i in zip((1.0, -1.0), places)]
        return max(one, other) < 0.0 and one * one + other * other > CERTAIN * CERTAIN

    def _missing(self, k: int) -> Missing | None:
        """Return what the model of surge (0) or sway (1) lacks."""
        verdict = self._bank.best.verdict
        if verdict is None or verdict.missing is None:
            return None
        dof, name = verdict.missing.name.split()
        return replace(verdict.missing, name=name) if dof == DOFS[k] else None

    def doubt(self, k: int) -> str:
        """Return why the model of surge (0) or sway (1) may not be used yet, '' if it may."""
        if self._usable[k]:
            return ''
        if self.current.status != 'known':
            return why_not_known(self.current)
        best = self._bank.best
        return objection(best.verdict, self._clocks(k), self._missing(k),
                         best.innovations.correlation, self._prediction.fits[k])

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {
            'theta': list(self._theta), 'variances': list(self._variances),
            'thrusters': [list(one) for one in self._thrusters],
            'free': self._free, 'found': self.is_found,
            'knew_current': self._knew_current, 'bank': self._bank.state(),
            'clock': self._clock.state(),
            'start': None if self._start is None else self._start.state(),
            'search': self._search.state(), 'heard': list(self._heard),
            'prediction': self._prediction.state(), 'time': self._time,
            'moving': self._moving, 'usable': list(self._usable), 'idle': self._idle,
            'windows': self._windows,
            'heading': self._turning.state(),
            'turned_at': self._turning.turned_at if self._turning.has_turned else None,
            'excitations': list(self.excitations), 'newest': self.newest,
            'way': [list(point) for point in self.way[-1:]]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        theta = floats(state['theta'], self._model.size)
        one, other = state['thrusters']
        self._begin(theta, (read_thrusters(one), read_thrusters(other)))
        self._theta = theta
        self._heard = read_heard(state['heard'])
        self._variances = floats(state['variances'], self._model.size)
        self._free, self.is_found, self._knew_current = (
            bool(state[name]) for name in ('free', 'found', 'knew_current'))
        self._bank = FilterBank(lambda unmodelled: self._new(unmodelled, self._theta))
        self._bank.restore(state['bank'])
        self._clock.restore(state['clock'])
        if state['start'] is None:
            self._start = None
        elif self._start is not None:
            self._start.restore(state['start'])
        self._prediction.restore(state['prediction'])
        self._time, self._idle = floats([state[name] for name in ('time', 'idle')], 2)
        self._moving, self._windows = bool(state['moving']), int(state['windows'])
        one, other = state['usable']
        self._usable = [bool(one), bool(other)]
        self._turning.restore(state['heading'], state['turned_at'])
        self.excitations = floats(state['excitations'], 2)
        self.newest = None if state['newest'] is None else int(state['newest'])
        self.way = [tuple(floats(point, 3)) for point in state['way']]
        self._search.restore(state['search'])
        self._publish()

    def _read(self, values: Any) -> PlanarStep | PlanarStart:
        return read_planar_step(
            values, self._model.regressors, [row.shares for row in self._model.rows])


def _start_of(step: PlanarStep) -> PlanarStart:
    return PlanarStart(step.velocity, step.axes)
