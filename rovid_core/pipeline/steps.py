"""Measured motion and thrust into steps of the identifiers, one estimate per step."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast

from rovid_core.identify.estimate import Estimate
from rovid_core.inputs.stuck_values import Inlet, TAKEN_ANEW
from rovid_core.model.dofs import Quaternion
from rovid_core.model.samples import Motion, Sample, Step
from rovid_core.pipeline.observers import Scorer
from rovid_core.pipeline.one_dof import Identification
from rovid_core.settings.run import Settings
from rovid_core.thrust.command_intake import Commands
from rovid_core.thrust.force_history import Thrust
from rovid_core.velocity.attitude_history import World
from rovid_core.velocity.lowpass import LowPass
from rovid_core.velocity.quaternions import normalised
from rovid_core.velocity.velocity_source import MotionSource

NS = 1e-9

SOURCES = ('position', 'depth', 'attitude', 'angular_velocity', 'velocity')


class Pipe:
    """
    What turns ordered samples into estimates.

    Parameters
    ----------
    settings : Settings
        The run.
    reject : callable
        Told input and reason of everything that is refused.
    warn : callable
        Told one line about what looks wrong in the data.
    scorer : Scorer, optional
        Told every step.

    """

    def __init__(self, settings: Settings, reject: Callable[[str, str], None],
                 warn: Callable[[str], None], scorer: Scorer | None = None) -> None:
        self._settings = settings
        self._reject = reject
        self._warn = warn
        self._scorer = scorer
        self._max_gap = round(settings.max_gap / NS)
        self._world = World(settings)
        self._thrust = Thrust(settings.thrusters, settings.dofs)
        self._commands = Commands(settings, self._thrust, warn)
        used = settings.used_inputs()
        self._tracks = [  # position and depth need each other, also without a DOF of their own
            track for track in (Track(settings, name, self._world, warn) for name in SOURCES)
            if track.source.dofs or track.source.input in used
            and track.source.input in ('position', 'depth')]
        self._inlets = {name: Inlet(settings, name, self._thrust, warn)
                        for name in SOURCES if name in used}
        self._dofs = [
            Identification(settings, i, reject, warn) for i in range(len(settings.dofs))]
        self.identifiers = [dof.identifier for dof in self._dofs]
        self.adapt = settings.enable

    def verdict(self, i: int) -> str:
        """Return what all data leave open of DOF number ``i``, '' if nothing."""
        return self._dofs[i].verdict()

    def refresh(self) -> None:
        """Let the estimates say what the identifiers hold by now; no step has been made."""
        for dof in self._dofs:
            dof.refresh()

    def change(self, settings: Settings) -> None:
        """Take other gains and limits; filters, histories and parameters stay."""
        gains_change = settings.identifier != self._settings.identifier
        self._settings = settings
        self._max_gap = round(settings.max_gap / NS)
        self._world.change(settings)
        self._thrust.change(settings.thrusters.timeout)
        self._commands.change(settings)
        for inlet in self._inlets.values():
            inlet.change(settings)
        for track in self._tracks:
            track.change(settings)
        if gains_change:
            for dof in self._dofs:
                dof.change(settings)
            self.identifiers[:] = [dof.identifier for dof in self._dofs]
        if self._scorer is not None:
            self._scorer.changed(settings.cutoff)

    def restart(self) -> None:
        """Start times, filters and histories anew and keep the parameters."""
        self._world.restart()
        self._thrust.restart()
        self._commands.restart()
        for inlet in self._inlets.values():
            inlet.restart()
        for track in self._tracks:
            track.source.restart()
            track.interrupt()

    def reset(self) -> None:
        """Go back to the initial parameters; filters and histories stay."""
        for identifier in self.identifiers:
            identifier.reset()
        self.refresh()
        for track in self._tracks:
            track.last = None

    def handle(self, time: int, sample: Sample) -> list[Estimate] | None:
        """
        Take one sample and return the estimates of the steps that it completes.

        None if it was refused.

        Parameters
        ----------
        time : int
            Event time [ns], not before that of the last sample.
        sample : Sample
            What was measured.

        """
        reason = self._take(time, sample)
        if reason:
            self._reject(sample.input, reason)
            return None
        estimates: list[Estimate] = []
        for track in self._tracks:
            self._run(track, time, estimates)
        return estimates

    def estimate(self, time: int, stepped: tuple[int, ...] = ()) -> Estimate:
        """Return all DOFs as they are now."""
        return Estimate(time, tuple([dof.estimate for dof in self._dofs]), stepped)

    def _take(self, time: int, sample: Sample) -> str:
        """Hand a sample to those who use it; return why it was refused, or ''."""
        value, name = sample.value, sample.input
        total = sum(value)
        # most sums say at once that all is finite, whatever they round to
        if total - total != 0.0 and not all(map(
                # a NaN in a reference stands for a DOF that it does not measure
                math.isfinite if name != 'reference' else _is_no_infinity, value)):
            return 'non_finite'
        if name in self._inlets:
            return self._measure(time, name, value)
        if name == 'thrusters':
            return self._commands.take(time, value, sample.part)
        if name == 'sign':
            self._commands.sign(time, value)
        elif self._scorer is not None:
            self._scorer.reference(time, value)
        return ''

    def _measure(self, time: int, name: str, value: tuple[float, ...]) -> str:
        if name == 'attitude':
            try:
                value = rotation = normalised(cast(Quaternion, value))
            except (ValueError, OverflowError):
                return 'not_a_rotation'
        inlet = self._inlets[name]
        reason = inlet.take(time, value)
        anew = reason if reason in TAKEN_ANEW else ''
        if reason and not anew:
            return reason
        if name == 'attitude':
            if anew:
                self._world.attitude.take_up(time, rotation)
            else:
                self._world.attitude.add(time, rotation, inlet.gate.change)
        for track in self._tracks:
            if track.source.input == name:
                return '' if track.source.add(time, value, anew) else 'overflow'
        return anew

    def _run(self, track: Track, now: int, estimates: list[Estimate]) -> None:
        while track.held is not None or track.source.is_waiting:
            motion = track.held or track.source.take(now)
            track.held = None
            if motion is None:
                return
            if isinstance(motion, str):
                self._skip(track, motion)
            elif not track.indices:
                continue  # measured for the other sources only
            elif not self._thrust.known(motion.end) and now - motion.end <= self._max_gap:
                track.held = motion  # the command that ends its span is still to come
                return
            else:
                self._step(track, motion, estimates)

    def _skip(self, track: Track, reason: str) -> None:
        if reason == 'first':
            return
        self._reject(track.source.input, reason)
        if reason == 'gap':
            track.note_gap()
        if reason != 'too_fast':  # one wild fix costs one step; the state is still good
            track.interrupt()

    def _step(self, track: Track, motion: Motion, estimates: list[Estimate]) -> None:
        last = track.last
        if last is not None and motion.time - last.time > track.timeout:
            self._skip(track, 'gap')
            last = None
        time = motion.time
        missing = self._thrust.missing(last.time if last else time, time)
        if missing:
            self._skip(track, missing)
            return
        before = track.velocity.value
        if last is None or before is None:
            self._take_up(track, motion)
            return
        begin = last.time
        middle = min(max(motion.start, begin), time)
        span = begin, middle, time
        dt, lead, rest = (time - begin) * NS, (middle - begin) * NS, (time - middle) * NS
        first, second, third = self._thrust.impulses(span, track.indices)
        after = track.velocity.step(dt, motion.velocity)
        forces = track.force.step(dt, tuple([(q - p) / dt for p, q in zip(first, third)]))
        interval, turn, slips = (motion.end - motion.start) * NS, motion.turn, motion.slips
        for j, i in enumerate(track.indices):
            v, w, f, p, q = before[j], after[j], forces[j], first[j], second[j]
            step = Step._make((
                dt, (v, 0.5 * (v + w), w), (f, f, f), motion.velocity[j], interval, (lead, rest),
                ((q - p) / lead if lead > 0.0 else 0.0,
                 (third[j] - q) / rest if rest > 0.0 else 0.0),
                turn, slips[j] if slips else 0.0))
            self._dofs[i].step(time, step, self.adapt)
            self._commands.one_sided.velocity(i, w)
            if self._scorer is not None:
                self._scorer.stepped(self._settings.dofs[i], span, step)
        track.last = motion
        track.warn_if_clamped()
        estimates.append(self.estimate(time, track.indices))

    def _take_up(self, track: Track, motion: Motion) -> None:
        """Start the filters and v_hat from a measurement."""
        track.interrupt()
        velocity = track.velocity.step(0.0, motion.velocity)
        track.last = motion
        for i, v in zip(track.indices, velocity):
            self.identifiers[i].restart(v)
            if self._scorer is not None:
                self._scorer.restarted(self._settings.dofs[i], motion.time, v)


def _is_no_infinity(x: float) -> bool:
    return not math.isinf(x)


class Track:
    """
    The DOFs of one source: their filters and how far they have come.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        The source.
    world : World
        What the sources know of each other.
    warn : callable
        Told one line if the samples come too slowly.

    """

    def __init__(self, settings: Settings, input: str, world: World,
                 warn: Callable[[str], None]) -> None:
        self.source = MotionSource(settings, input, world)
        self.indices = tuple(settings.dofs.index(d) for d in self.source.dofs)
        self.velocity = LowPass(settings.cutoff)
        self.force = LowPass(settings.cutoff)
        self.held: Motion | None = None  # waits for the force of its span
        self.last: Motion | None = None  # where the next step begins
        self._warn: Callable[[str], None] | None = warn
        self._gaps = 0
        self.change(settings)

    def change(self, settings: Settings) -> None:
        """Take other limits and another cutoff; the filters go on from where they are."""
        self.timeout = round(settings.timeout_of(self.source.input) / NS)  # between two steps
        self.source.change(settings)
        self.velocity.retune(settings.cutoff)
        self.force.retune(settings.cutoff)

    def interrupt(self) -> None:
        """Take up from the next measurement."""
        self.velocity.restart()
        self.force.restart()
        self.held = self.last = None

    def note_gap(self) -> None:
        """Say once that there are nothing but gaps."""
        self._gaps += 1
        if self._warn and self._gaps == 20 and not self.velocity.steps:
            self._warn(f'the messages of {self.source.input} are further apart than max_gap: '
                       'nothing can be identified from them')

    def warn_if_clamped(self) -> None:
        """Say once that the samples come too slowly for the cutoff."""
        taken, clamped = self.velocity.steps, self.velocity.clamped
        if self._warn and taken >= 50 and clamped > taken // 2:
            self._warn(f'velocity.cutoff is above 0.4 of the rate of {self.source.input}, and '
                       'clamped to that')
            self._warn = None
