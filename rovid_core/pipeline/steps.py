"""Ordered samples into steps of the identifiers, one estimate per step."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast, Protocol

from rovid_core.identify.estimate import Current, Estimate
from rovid_core.inputs.configuration_check import ConfigurationCheck
from rovid_core.inputs.stuck_sensor import InputCheck, RESTARTS
from rovid_core.inputs.units_and_signs import LONG, SHORT
from rovid_core.model.dofs import LINEAR_DOFS, Quaternion, Vector
from rovid_core.model.samples import Motion, NS, Sample, Step
from rovid_core.ordering.cadence import Cadence
from rovid_core.pipeline.filtered_source import FilteredSource
from rovid_core.pipeline.identification import Identification
from rovid_core.pipeline.planar_steps import PlanarSteps
from rovid_core.settings.run import Scales, Settings, WITH_CURRENT
from rovid_core.thrust.force_history import CommandIntake, ForceHistory
from rovid_core.thrust.thruster_curve import thruster_models
from rovid_core.velocity.attitude_history import normalised, rotate, rotate_back, SharedMotion
from rovid_core.velocity.couplings import CouplingRegressors, own_regressors

SOURCES = ('position', 'depth', 'attitude', 'angular_velocity', 'velocity')
"""Inputs that velocities are made of."""

SOON = 40.0
"""
[s] of motion under thrust within which a DOF begins anew when the velocities that it is coupled
with are known better.
"""

AXES: dict[str, Vector] = {'surge': (1.0, 0.0, 0.0), 'sway': (0.0, 1.0, 0.0)}
"""Axes of the body that a current of the water acts along."""


Water = Callable[[int], tuple[float, float]]
"""The current of the water in the world [m/s] at a time [ns]."""


class Scorer(Protocol):
    """Keeps what a score needs."""

    def begin_run(self, dof: str, time: int, velocity: float,
                  axis: tuple[float, ...] = ()) -> None:
        """Note the velocity from which the steps of a DOF go on after an interruption."""

    def add_step(self, dof: str, span: tuple[int, int, int], step: Step,
                 axes: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())) -> None:
        """Add a step and its times [ns]: start, start of the measurement, end."""

    def begin_anew(self, dof: str) -> None:
        """Forget the steps of a DOF so far: their couplings are not those of what follows."""

    def add_commands(self, time: int, raw: tuple[float, ...]) -> None:
        """Add the raw commands of all thrusters."""

    def add_current(self, time: int, x: float, y: float) -> None:
        """Add the current of the water that is known by now."""

    def add_reference(self, time: int, value: tuple[float, ...]) -> None:
        """Add a reference velocity (six values)."""

    def restart(self) -> None:
        """Expect times that have nothing to do with those so far."""

    def set_cutoff(self, cutoff: float) -> None:
        """Note the cutoff [Hz] of the steps from now on."""


class Pipeline:
    """
    Turn ordered samples into estimates.

    Parameters
    ----------
    settings : Settings
        The run.
    reject : callable
        Called with input (or DOF) and reason for everything that is refused.
    warn : callable
        Called with one line about what looks wrong in the data.
    hint : callable
        Called with one line about what could be better, but is no mistake.
    scorer : Scorer, optional
        Gets every step.
    water : callable, optional
        Returns the current in the world [m/s] at a time [ns], where it is known beforehand;
        couplings are then those with velocities through the water.
    whole : bool
        Whether typical sizes are judged by all data, at their end: a DOF may be driven late.

    Attributes
    ----------
    dofs : list of Identification
        In the order of ``settings.dofs``.
    adapt : bool
        Whether the parameters are adapted; it can be changed between two samples.

    """

    def __init__(self, settings: Settings, reject: Callable[[str, str], None],
                 warn: Callable[[str], None], hint: Callable[[str], None],
                 scorer: Scorer | None = None, water: Water | None = None,
                 whole: bool = False) -> None:
        self._water = water
        self._whole = whole
        self._hint = hint
        self._sizes_told = False
        self._settings = settings
        self._reject = reject
        self._scorer = scorer
        used = settings.used_inputs()
        self._cadences = {name: Cadence() for name in used if name in SOURCES}
        self._patience = round(settings.longest_timeout / NS)
        self._sees_current = settings.sees_current
        self._shared = SharedMotion(settings)
        self._forces = ForceHistory(settings.thrusters, settings.dofs, {
            dof: Scales.of(settings.dof[dof]).force for dof in settings.sharing})
        self._commands = CommandIntake(settings, self._forces, warn)
        self._configuration = ConfigurationCheck(
            settings, thruster_models(settings.thrusters), warn)
        self._couplings = CouplingRegressors(settings, self._shared.attitude)
        needed = ('position', 'depth', *self._couplings.inputs)
        self._planar = PlanarSteps(settings, self._shared.attitude, self._couplings) if (
            settings.estimates_current) else None
        sources = [FilteredSource(settings, name, self._shared, hint, self._planar)
                   for name in SOURCES]
        # position and depth need each other, and couplings their inputs, also without a DOF
        self._sources = [one for one in sources if one.dofs or one.input in used
                         and one.input in needed]
        by_input = {one.input: one for one in self._sources}
        self._checks = {name: InputCheck(settings, name, warn) for name in self._cadences}
        self._measured = {
            name: (self._cadences[name], check, by_input.get(name))
            for name, check in self._checks.items()}
        self._waits_for_commands = settings.thrusters.hold == 'linear'
        self._watches = settings.watches
        rows = self._planar.filter.rows if self._planar is not None else {}
        weaker: dict[str, float] = {}
        family: list[Identification] = []
        self.dofs = [Identification(settings, dof, reject, rows.get(dof), weaker, family)
                     for dof in settings.dofs]
        self._tells_velocity = settings.identifier.method in WITH_CURRENT and any(
            self._couplings.has_velocity(one.couplings)
            for one in self._sources if not self._is_linear(one))
        self.adapt = settings.enable

    def change(self, settings: Settings) -> None:
        """Use other gains and limits; filters, histories and parameters stay."""
        gains_change = settings.identifier != self._settings.identifier
        cutoff_changes = settings.cutoff != self._settings.cutoff
        self._settings = settings
        self._take(self._with_gaps(), gains_change)
        if self._scorer is not None and cutoff_changes:
            self._scorer.set_cutoff(settings.cutoff)

    def _with_gaps(self) -> Settings:
        """Return the settings with the gap of each input that follows its rate."""
        return self._settings if self._settings.max_gap else self._settings.with_timeouts(
            {name: cadence.gap for name, cadence in self._cadences.items()
             if not self._settings.input(name).timeout})

    def _take(self, settings: Settings, gains_change: bool = False) -> None:
        """Hand other settings to all that depends on them."""
        self._patience = round(settings.longest_timeout / NS)
        self._shared.change(settings)
        self._couplings.change(settings)
        self._forces.change(settings.thrusters.timeout)
        self._commands.change(settings)
        for check in self._checks.values():
            check.change(settings)
        for source in self._sources:
            source.change(settings)
        for dof in self.dofs:
            dof.change(settings, gains_change)

    def restart(self) -> None:
        """Forget filters and histories, and keep the parameters."""
        self._shared.restart()
        self._couplings.restart()
        self._forces.restart()
        self._commands.restart()
        self._configuration.restart()
        if self._scorer is not None:
            self._scorer.restart()
        for cadence in self._cadences.values():
            cadence.restart()
        for check in self._checks.values():
            check.restart()
        for source in self._sources:
            source.restart()
            source.interrupt()
        for dof in self.dofs:
            dof.interrupt()

    def reset(self) -> None:
        """Go back to the initial parameters; filters and histories stay."""
        for dof in self.dofs:
            dof.identifier.reset()
        self._couplings.forget_filtered()
        self.refresh()
        for source in self._sources:
            source.last = None

    def conclude(self, last: Estimate) -> Estimate | None:
        """Return the last estimate with the best of data that end here, None if it has it."""
        better = [dof.identifier.conclude() for dof in self.dofs] if self.adapt else []
        if not any(better):
            return None
        for dof in self.dofs:
            dof.take_up()
        return last.replaced(dofs=tuple([dof.at(last.now) for dof in self.dofs]),
                             current=self._current())

    def refresh(self) -> None:
        """Let the estimates say what the identifiers hold by now, without a step."""
        for dof in self.dofs:
            dof.refresh()

    def estimate(self, time: int, now: int, stepped: tuple[int, ...]) -> Estimate:
        """Return all DOFs after a step to ``time`` that was completed at ``now`` [ns]."""
        return Estimate(
            time, tuple([dof.at(now) for dof in self.dofs]), stepped, self._current(), now)

    def silent_estimate(self, now: int, ended: bool) -> Estimate:
        """Return all DOFs as they are at ``now`` [ns] if nothing has come for a while."""
        silent = ended or self._commands.silent(now)
        return Estimate(now, tuple([dof.at(now, silent) for dof in self.dofs]), (),
                        current=self._current(), now=now)

    def _current(self) -> Current | None:
        return self._planar.filter.current if self._planar is not None else None

    def finish(self) -> None:
        """Look at what the data say about the configuration: there may be no more of them."""
        self._configuration.look()
        self._compare_sizes(SHORT)

    def _compare_sizes(self, after: float) -> None:
        """Say once which typical sizes are far off, when there are steps enough [s]."""
        if self._sizes_told:
            return
        known = [dof.sizes for dof in self.dofs if dof.sizes.duration >= after]
        if known:
            self._sizes_told = True
            advice = [line for sizes in known for line in sizes.advice(sizes.duration >= LONG)]
            if advice:
                self._hint('typical sizes, which decide what is rest and what are enough data, '
                           f'are far off: set {", ".join(advice)}')

    def add_sample(self, time: int, sample: Sample) -> list[Estimate] | None:
        """
        Add one sample and return the estimates of the steps that it completes.

        None if the sample was refused.

        Parameters
        ----------
        time : int
            Event time [ns], not before that of the last sample.
        sample : Sample
            What was measured.

        """
        reason = self._add(time, sample)
        if reason:
            self._reject(sample.input, reason)
            return None
        estimates: list[Estimate] = []
        for source in self._sources:
            while source.held is not None or source.waiting:
                if not self._make_step(source, time, estimates):
                    break  # the next one waits for another input
        return estimates

    def _add(self, time: int, sample: Sample) -> str:
        """Hand a sample to what uses it; return why it was refused, or ''."""
        value, name = sample.value, sample.input
        total = sum(value)
        # most sums say at once that all is finite, whatever they round to
        if total - total != 0.0 and (any(map(math.isinf, value)) or (
                # in a reference a NaN stands for a DOF that it does not measure
                name != 'reference' and any(map(math.isnan, value)))):
            return 'non_finite'
        if name in self._measured:
            return self._add_measurement(time, name, value)
        if name == 'thrusters':
            refused = self._commands.add_commands(time, value, sample.part)
            raw = () if refused else self._forces.raw
            if raw and self._configuration.active:
                self._configuration.add_commands(time, raw)
            if raw and self._scorer is not None:
                self._scorer.add_commands(time, raw)
            return refused
        if name == 'sign':
            self._commands.add_signs(time, value)
        elif self._scorer is not None:
            self._scorer.add_reference(time, value)
        return ''

    def _add_measurement(self, time: int, name: str, value: tuple[float, ...]) -> str:
        """Check a measurement and hand it to its velocity source, or to the attitudes."""
        cadence, check, source = self._measured[name]
        if cadence.add_time(time) and not self._settings.max_gap:
            self._take(self._with_gaps())
        if name == 'attitude':
            try:
                value = rotation = normalised(cast(Quaternion, value))
            except (ValueError, OverflowError):
                return 'not_a_rotation'
        reason = check.check(time, value, self._forces.newest)
        jumped = reason if reason in RESTARTS else ''
        if reason and not jumped:
            return reason
        if name == 'attitude':
            self._note_attitude(time, rotation, check.gate.change, jumped != '')
        elif name == 'angular_velocity':
            self._note_rates(time, (value[0], value[1], value[2]), jumped != '')
        if source is None:
            return jumped
        return '' if source.add_sample(time, value, jumped) else 'overflow'

    def _note_attitude(self, time: int, rotation: Quaternion, change: Vector | None,
                       jumped: bool) -> None:
        """Hand an attitude to all that turns; ``change`` is from the one before, if known."""
        if jumped:
            self._shared.attitude.restart_from(time, rotation)
        else:
            self._shared.attitude.add_sample(time, rotation, change)
        self._couplings.add_turn(time, None if jumped else change)

    def _note_rates(self, time: int, rates: Vector, jumped: bool) -> None:
        """Hand what a gyro says to the couplings, and to a sensor with a lever arm."""
        self._couplings.add_rates(time, rates, jumped)
        if self._shared.needs_rates:
            if jumped:
                self._shared.rates.restart()
            self._shared.rates.add_sample(time, rates)

    def _make_step(self, source: FilteredSource, now: int, estimates: list[Estimate]) -> bool:
        """Make the next step of a source, or none of its next measurement; False: not yet."""
        motion = source.held
        source.held = None
        if motion is None:
            found = source.next_velocity(now)
            if found is None:
                return False
            if isinstance(found, str):
                self._interrupt(source, found)
                return True
            motion = found
            self._note_motion(source.input, motion)
            if not source.indices:
                return True  # measured for the other sources only
        if self._waits_for_commands and not self._forces.known(motion.end) and (
                now - motion.end <= self._patience):
            source.held = motion  # the command that ends its span is still to come
            return False
        missing, reason = self._lacking(source, motion) if source.needs_others else ('', '')
        if missing == 'later' and now - motion.end <= self._patience:
            source.held = motion
            return False
        if missing:
            self._interrupt(source, reason)
        else:
            self._add_step(source, motion, now, estimates)
        return True

    def _note_motion(self, input: str, motion: Motion) -> None:
        """Hand a motion to what looks at all of them, whatever steps they make."""
        if self._couplings.are_there:
            self._couplings.add_velocity(input, self._through_water(motion))
        if self._configuration.active:
            self._configuration.add_motion(input, motion, self._shared.heading(
                motion.time) if input == self._configuration.linear else None)

    def _through_water(self, motion: Motion) -> Motion:
        """Return a motion relative to the water, where its current is known beforehand."""
        attitude = self._shared.attitude.known_at(motion.time) if self._water else None
        if self._water is None or attitude is None:
            return motion
        (u, v, w), (x, y) = motion.body, self._water(motion.time)
        a, b, c = rotate_back(attitude, (x, y, 0.0))
        return motion.replaced(body=(u - a, v - b, w - c))

    def _lacking(self, source: FilteredSource, motion: Motion) -> tuple[str, str]:
        """
        Return what is missing of the other inputs over a motion, '' if nothing is.

        ``later`` or why it will not come, and the reason of refusal if it does not.
        """
        span = source.coupling_span(motion)
        if source.couplings and span is not None:
            missing = self._couplings.missing(
                source.couplings, *span, self._is_linear(source))
            if missing:
                return missing, 'no_coupling'
        missing = source.planar.missing(motion) if source.planar is not None else ''
        return missing, 'no_attitude'

    def _is_linear(self, source: FilteredSource) -> bool:
        """Tell whether the filters of linear velocities wait for the regressors of a source."""
        return source.input == self._couplings.linear_input

    def _coupling_regressors(self, source: FilteredSource, motion: Motion) -> tuple[float, ...]:
        """Return the regressors of all DOFs of a source over a motion; () at a first point."""
        span = source.coupling_span(motion)
        if span is None:
            return ()
        measured = self._couplings.mean(source.couplings, *span, self._is_linear(source))
        return (*measured, *self._forces.means(*span, source.thrusts))

    def _coupling_means(self, source: FilteredSource, motion: Motion) -> list[tuple[float, float]]:
        """Return the regressors over both parts of the step that a motion ends."""
        new = self._coupling_regressors(source, motion)
        old, source.last_regressors = source.last_regressors, new
        return list(zip(old if motion.end > motion.start else new, new))

    def _interrupt(self, source: FilteredSource, reason: str) -> None:
        """Count why there is no step, and let the next measurement begin anew where it must."""
        if reason == 'first':
            return
        self._reject(source.input, reason)
        if reason == 'gap':
            source.note_gap()
        if reason not in ('too_fast', 'burst'):  # it costs one step; the state is still good
            source.interrupt()
            if self._is_linear(source):
                self._couplings.forget_filtered()

    def _add_step(self, source: FilteredSource, motion: Motion, now: int,
                  estimates: list[Estimate]) -> None:
        """Make one step of all DOFs of a source, from the velocity before to this one."""
        last = source.last
        if last is not None and motion.time - last.time > source.timeout:
            self._interrupt(source, 'gap')
            last = None
        time = motion.time
        missing = self._forces.missing(last.time if last else time, time)
        if missing:
            self._interrupt(source, missing)
            return
        if last is None:
            self._begin(source, motion)
            return
        middle = min(max(motion.start, last.time), time)
        span = last.time, middle, time
        steps = self._steps_of(source, last, motion, span)
        was_found = self._is_found(source)
        if source.planar is not None:
            source.planar.add(span, last, motion, dict(zip(source.dofs, steps)), self.adapt)
            self._tell_current(source.planar, time)
        delay, unsigned = source.velocity.delay, self._commands.unsigned
        for i, step in zip(source.indices, steps):
            self.dofs[i].add_step(time, step, self.adapt, delay)
            if unsigned.active:
                unsigned.add_velocity(i, step.velocity[2])
            if not self._sizes_told:
                self.dofs[i].sizes.add_step(step)
            if self._scorer is not None:
                dof = self._settings.dofs[i]
                self._scorer.add_step(dof, span, step, (
                    self._axis(dof, middle), self._axis(dof, time)
                    ) if self._sees_current else ((), ()))
        self._tell_velocity(source, motion, was_found)
        source.last = motion
        source.warn_if_clamped()
        if not (self._whole or self._sizes_told):
            self._compare_sizes(LONG)
        estimates.append(self.estimate(time, now, source.indices))

    def _steps_of(self, source: FilteredSource, last: Motion, motion: Motion,
                  span: tuple[int, int, int]) -> list[Step]:
        """Return what was measured over a step, for each DOF of a source; its filters go on."""
        before = source.velocity.value
        assert before is not None
        begin, middle, time = span
        # the integral of each force from the first command to each of these times
        first, second, third = self._forces.integrals(span, source.indices)
        dt, lead, rest = (time - begin) * NS, (middle - begin) * NS, (time - middle) * NS
        after = source.velocity.step(dt, motion.velocity)
        forces = source.force.step(dt, tuple([(q - p) / dt for p, q in zip(first, third)]))
        interval = (motion.end - motion.start) * NS
        couplings: list[tuple[float, float]] = []
        filtered: tuple[float, ...] = ()
        if source.has_couplings:
            couplings = [
                *self._coupling_means(source, motion), *own_regressors(
                    source.own, (last, motion), (first, second, third), (lead, rest))]
            filtered = source.regressors.step(
                dt, tuple([(lead * x + rest * y) / dt for x, y in couplings]))
        pieces = self._forces.pieces(begin, time, source.indices) if self._watches else ()
        split = middle if interval else time
        watched: tuple[float, ...] = ()
        if source.watched or source.watched_thrusts:
            seen = (last.start, last.end) if interval else (begin, time)
            watched = (*self._couplings.as_known(source.watched, *seen),
                       *self._forces.means(*seen, source.watched_thrusts))
        path_noise, turn, none = motion.path_noise, motion.turn, not source.has_couplings
        steps = []
        for j in range(len(source.indices)):
            v, w, f, p, q = before[j], after[j], forces[j], first[j], second[j]
            # in the order of the fields: by their names it would take three times as long
            steps.append(Step(
                dt, (v, 0.5 * (v + w), w), (f, f, f), motion.velocity[j], interval, (lead, rest),
                ((q - p) / lead if lead > 0.0 else 0.0,
                 (third[j] - q) / rest if rest > 0.0 else 0.0),
                turn,
                path_noise[j] if path_noise else 0.0,
                () if none else tuple([couplings[k] for k in source.coupling_indices[j]]),
                () if none else tuple([filtered[k] for k in source.coupling_indices[j]]),
                pieces[j].held if pieces else (),
                tuple([watched[k] for k in source.watched_indices[j]]) if watched else (),
                pieces[j].each if pieces and pieces[j].held else
                self._forces.each(begin, split, time, source.indices[j])))
        return steps

    def _begin(self, source: FilteredSource, motion: Motion) -> None:
        """Start the filters and v_hat from a measurement."""
        source.interrupt()
        velocity = source.velocity.step(0.0, motion.velocity)
        source.last_regressors = self._coupling_regressors(source, motion)
        if source.has_couplings and len(source.last_regressors) == (
                len(source.couplings) + len(source.thrusts)):
            still = [0.0] * len(source.indices)
            own = own_regressors(source.own, (motion, motion), (still, still, still), (0.0, 0.0))
            source.regressors.step(0.0, (*source.last_regressors, *[x for x, _ in own]))
        source.last = motion
        if source.planar is not None:
            source.planar.begin(motion)
        for i, v in zip(source.indices, velocity):
            self.dofs[i].identifier.restart(v)
            if self._scorer is not None:
                dof = self._settings.dofs[i]
                self._scorer.begin_run(dof, motion.time, v, self._axis(dof, motion.time))

    def _tell_current(self, planar: PlanarSteps, time: int) -> None:
        """Tell the scorer the current, and what is coupled with velocities that it is known."""
        current = planar.filter.current
        if self._scorer is not None and current.is_seen:
            self._scorer.add_current(time, current.x, current.y)
        if planar.filter.current_is_new:
            anew = self._begin_coupled_anew(math.inf)
            if anew:
                self._hint(f'{", ".join(anew)}: begun anew now that the current is known, for '
                           'what is coupled is the velocity through the water; what was measured '
                           'before does not count')

    def _tell_velocity(self, source: FilteredSource, motion: Motion, was_found: bool) -> None:
        """
        Tell the couplings of other sources the velocity that the filters of this one have.

        ``was_found`` tells whether it was that before this step, too.
        """
        if not (self._tells_velocity and self._is_linear(source)):
            return
        if self._is_found(source) and not was_found:
            self._begin_coupled_anew(SOON)
        ways = {LINEAR_DOFS.index(dof): self.dofs[i].identifier.way
                for i, dof in zip(source.indices, source.dofs) if dof in LINEAR_DOFS}
        if source.planar is not None:
            both = source.planar.filter.way or [(0.0, math.nan, math.nan)]
            ways[0], ways[1] = [(at, u) for at, u, _ in both], [(at, v) for at, _, v in both]
        velocity = list(motion.body)
        longest = max(ways.values(), key=len, default=[(0.0, math.nan)])
        for k, (before, _) in enumerate(longest):
            for axis, way in ways.items():
                velocity[axis] = way[k if len(way) == len(longest) else -1][1]
            if any(map(math.isnan, velocity)):
                self._couplings.forget_filtered()
                return
            self._couplings.add_filtered(
                motion.time - round(before / NS), (velocity[0], velocity[1], velocity[2]))

    def _is_found(self, source: FilteredSource) -> bool:
        """Tell whether couplings get the velocity of a source as filters that know it have it."""
        return self._tells_velocity and self._is_linear(source) and False not in [
            self.dofs[i].identifier.is_found for i, dof in zip(source.indices, source.dofs)
            if dof in LINEAR_DOFS]

    def _begin_coupled_anew(self, kept: float) -> list[str]:
        """
        Forget what DOFs have learned that were coupled with a velocity that was not known.

        Those of which no more than ``kept`` [s] is kept; returns which.
        """
        anew = []
        for source in self._sources:
            for i in source.indices if not self._is_linear(source) else ():
                dof = self._settings.dofs[i]
                if self._couplings.has_velocity(self._settings.couplings(dof)) and (
                        self.dofs[i].identifier.kept <= kept):
                    self.dofs[i].begin_anew()
                    anew.append(dof)
                    source.last = None
                    if self._scorer is not None:
                        self._scorer.begin_anew(dof)
        return anew

    def _axis(self, dof: str, time: int) -> tuple[float, ...]:
        """Return x and y of the axis of surge or sway in the world, () where no current shows."""
        if dof not in AXES or not self._sees_current:
            return ()
        attitude = self._shared.attitude.known_at(time)
        return rotate(attitude, AXES[dof])[:2] if attitude is not None else ()
