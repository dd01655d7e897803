"""What drives the vehicle: the thrusters whose allocation explains most of its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import ThrusterSettings
from rovid_core.thrust.thruster_curve import are_commands, thruster_model
from rovid_ros.discovery.ardupilot import allocation, Frame, FRAMES, Motors
from rovid_ros.discovery.candidates import Candidate, driven, NEUTRAL
from rovid_ros.discovery.moments import Misfit, misfits, moments_of
from rovid_ros.discovery.motion import answer, best_delay, DELAYS, held, Motion, Push
from rovid_ros.discovery.signals import Array, part, Signal

# A T200 near 12 V: force [N] of a command of -1 to 1 (J. Mar. Sci. Eng. 10(12), 2022, 1898).
T200 = (0.0, 8.9, 0.0, 176.0, 0.0, -404.1, 0.0, 389.9, 0.0, -140.3)
PULSES = {'scale': 0.0025, 'limit': 1.0, 'deadband': 0.0625, 'model': 'polynomial',
          'polynomial': T200}
SURE = 3.0  # standard errors
EXPLAINED = 0.1  # share of a DOF's changes below which nothing is known of what drives it
_SMALL = 0.15  # share of the strongest thruster of a DOF below which another does nothing
# Of what an allocation from the data explains, a frame has to explain this share; one with motors
# that are turned fits by chance more easily.
_LIKE, _LIKE_TURNED = 0.5, 0.8
_TOGETHER = 0.1  # of the strongest pattern of commands; a weaker one is chance
_FORCES = {'force', 'forces', 'thrust'}
_SPEEDS = {'rpm', 'rps', 'speed', 'speeds'}  # of propellers


@dataclass
class Thrusters:
    """What drives the vehicle."""

    signal: Signal
    how: str  # wrench; frame: a known vehicle's; data: the allocation is estimated
    chain: ThrusterSettings
    rows: dict[str, tuple[float, ...]]  # of the allocation, by DOF
    frame: Frame | None = None
    sure_frame: bool = False  # the autopilot itself says so
    delay: float = 0.0  # [s]
    latency: float = 0.0  # [s] by which the signal has been taken earlier than it is stamped

    def forces(self) -> Array:
        """Return what each thruster gives, or the wrench, at the times of the signal."""
        values = self.signal.values
        if self.how == 'wrench':
            return values
        model = thruster_model(self.chain)
        told, where = np.unique(values, return_inverse=True)
        made = [model(raw) if are_commands(self.chain, [raw]) else 0.0 for raw in told.tolist()]
        each = np.array(made)[where].reshape(values.shape)
        return np.asarray(each * np.array(self.chain.gain))


def find_thrusters(candidate: Candidate, frames: str, moved: Motion, motors: Motors | None,
               guesses: list[str]) -> Thrusters:
    """Return what drives the vehicle, with the allocation that explains most of its motion."""
    signal, count = candidate.signal, candidate.signal.values.shape[1]
    if signal.shape == 'wrench':
        flip = np.array([1, -1, -1, 1, -1, -1]) if frames == 'ned' else np.ones(6)
        turned = replace(signal, values=signal.values * flip)
        rows = {dof: tuple(float(i == k) for k in range(6)) for i, dof in enumerate(DOFS)}
        made = Thrusters(turned, 'wrench', _chain((1.0,) * 6), rows)
        return with_delay(made, moved)
    pulses = bool(candidate.keys.get('pwm'))
    columns = driven(signal.values)
    used = [n - 1 for n in motors.outputs] if motors else list(range(columns[-1] + 1))
    if motors and max(used) >= count:
        motors, used = None, list(range(columns[-1] + 1))
    path = _path(signal, used)
    gain = motors.directions if motors else (1.0,) * len(used)
    narrow = part(signal, used, path, 'array')
    if pulses:
        from_data = max((_by_data(narrow, _chain(gain, offset=offset, **PULSES), moved)
                         for offset in _neutrals(narrow.values)),
                        key=lambda made: round(explained_by(made, moved), 1))
        if from_data.chain.offset != NEUTRAL:
            guesses.append(f'thrusters.offset {from_data.chain.offset:g}: taken for the pulses of '
                           'no thrust, as it explains more than 1500')
    else:
        names = signal.names if len(used) == count else ()
        from_data = _forces_or_speeds([
            _by_data(narrow, _chain(gain, names=names, model=model), moved)
            for model in ('linear', 'quadratic')], moved, guesses)
    from_data = with_delay(from_data, moved)
    if motors:
        return with_delay(replace(from_data, how='frame', frame=motors.frame, sure_frame=True,
                                  rows=allocation(motors.frame)), moved)
    active = {k for k in columns if k in used}
    fitting = [frame for frame in (FRAMES[2], FRAMES[1], FRAMES[0])
               if pulses and len(frame.factors) == len(used) and active == set(used)]
    best = explained_by(from_data, moved)
    found, most = None, EXPLAINED
    for reversed_too, share in ((False, _LIKE), (True, _LIKE_TURNED)):
        for frame in fitting:
            rows = allocation(frame)
            signs = _signs(from_data, rows) if reversed_too else gain
            made = replace(from_data, how='frame', frame=frame, rows=rows,
                           chain=replace(from_data.chain, gain=signs))
            ours = explained_by(made, moved)
            if ours > max(share * best, most):
                found, most = made, ours + EXPLAINED  # the next has to be clearly better
    return with_delay(found, moved) if found else _without_idle(from_data, signal, used, guesses)


def _signs(from_data: Thrusters, rows: Mapping[str, Sequence[float]]) -> tuple[float, ...]:
    """Return for each thruster whether what it does in the data is as in these rows: 1 or -1."""
    alike = np.zeros(len(from_data.chain.gain))
    for dof, row in from_data.rows.items():
        alike += np.array(row) * np.array(rows[dof]) / max(*map(abs, rows[dof]), 1e-9)
    return tuple([-1.0 if one < 0.0 else 1.0 for one in alike.tolist()])


def _forces_or_speeds(models: Sequence[Thrusters], moved: Motion,
                      guesses: list[str]) -> Thrusters:
    """
    Return thrusters whose force goes as the command, or with its square as a propeller's speed.

    The square has to leave less than four fifths unexplained of what the command leaves: a curve
    that is neither, or a mean of few thrusters, favours one of both a little. Where a name says
    that it is a force it takes half, and where one says that it is a speed, twice as much.
    """
    forces, speeds = models
    driven = len(forces.rows.keys() | speeds.rows.keys())
    lacks = [driven - explained_by(made, moved) for made in models]
    words = forces.signal.words
    if lacks[1] < lacks[0] * (2.0 if words & _SPEEDS else 0.5 if words & _FORCES else 0.8):
        guesses.append('thrusters.model quadratic: ' + (
            'as speeds of propellers the commands explain more of the motion than as forces'
            if lacks[1] < lacks[0] else 'by their name the commands are speeds of propellers'))
        return speeds
    return forces


def _without_idle(made: Thrusters, signal: Signal, used: Sequence[int],
                  guesses: list[str]) -> Thrusters:
    """Return thrusters without those that do nothing to any DOF that is measured."""
    active = [k for k in range(len(used)) if any(row[k] for row in made.rows.values())]
    if not active or len(active) == len(used):
        return made

    def of(values: Sequence[Any]) -> tuple[Any, ...]:
        return tuple([values[k] for k in active])
    idle = ', '.join(made.chain.names[k] if made.chain.names else f'number {used[k] + 1}'
                     for k in range(len(used)) if k not in active)
    guesses.append(f'thrusters: left out, for they move nothing that is measured in this log: '
                   f'{idle}, of {len(used)} in all')
    path = signal.path if made.chain.names else _path(signal, of(used))
    return replace(
        made, signal=part(made.signal, active, path, made.signal.shape),
        chain=replace(made.chain, names=of(made.chain.names) if made.chain.names else (),
                      gain=of(made.chain.gain), allocation=tuple(map(of, made.chain.allocation))),
        rows={dof: of(row) for dof, row in made.rows.items()})


def _chain(gain: tuple[float, ...], **more: Any) -> ThrusterSettings:
    """Return the chain up to the force of each thruster; rows are kept apart."""
    return ThrusterSettings(
        topics=('/thrusters',), gain=gain, allocation=((1.0,) * len(gain),) * len(DOFS), **more)


def _path(signal: Signal, used: Sequence[int]) -> str:
    """Return the path to some columns of an array."""
    if signal.topics or list(used) == list(range(signal.values.shape[1])):
        return signal.path
    if ',' in signal.path:
        names = [name.strip() for name in signal.path.split(',')]
        return ', '.join(names[k] for k in used)
    if list(used) == list(range(used[0], used[-1] + 1)):
        return f'{signal.path}[{used[0]}:{used[-1] + 1}]'
    return ', '.join(f'{signal.path}[{k}]' for k in used)


def _neutrals(values: Array) -> list[float]:
    """Return what pulse width [us] could stand for no thrust: the usual, and where all rest."""
    rests = []
    for column in np.round(values[:, driven(values)]).T:
        told, counts = np.unique(column, return_counts=True)
        rests.append(float(told[counts.argmax()]))
    rest = float(np.median(rests))
    shared = max(rests) - min(rests) <= 6.0 and 5.0 < abs(rest - NEUTRAL) < 120.0
    return [NEUTRAL, rest] if shared else [NEUTRAL]


def _by_data(signal: Signal, chain: ThrusterSettings, moved: Motion) -> Thrusters:
    """Return thrusters whose allocation is what each command does to each DOF in the log."""
    made = Thrusters(signal, 'data', chain, {})
    commands = made.forces()
    together, patterns, apart, strength = patterns_of(signal.times, commands)
    if not together.shape[1]:
        return made
    shares = _shares(signal.times)
    spread = np.sqrt(np.sum(shares * (commands - np.sum(shares * commands, axis=0))**2, axis=0))
    made.delay = best_delay(moved, signal.times, dict.fromkeys(moved.velocities, together))
    answers = {dof: push for dof in moved.velocities if (push := answer(moved, dof, held(
        signal.times + made.delay, together, moved.times, moved.halves[dof])))}
    told = {dof: push for dof, push in answers.items() if np.any(
        np.abs(push.alphas) > SURE * push.errors) and (
            # of what is mostly noise no command explains much
            push.explained > EXPLAINED or dof in moved.coarse)}
    if answers and not told:
        best = max(answers, key=lambda dof: answers[dof].explained)
        told = {best: answers[best]}
    for dof, push in told.items():
        sizes, doubts = np.abs(push.alphas), SURE * push.errors
        known = sizes > doubts
        if not known.any():
            known[:] = True
        # what may push much or not at all says more of chance than of the thrusters in it; of
        # thrusters that are so not told apart those that are driven most push most
        may_push = ~known & (doubts > _SMALL * sizes.max())
        alphas = patterns[:, known] @ push.alphas[known] / strength
        free = np.column_stack([patterns[:, may_push], apart]) / strength[:, np.newaxis]
        alphas -= free @ np.linalg.lstsq(free, alphas, rcond=None)[0]
        moves = np.abs(alphas) * spread
        alphas[moves < _SMALL * moves.max()] = 0.0
        if alphas.any():
            made.rows[dof] = tuple(
                round(float(x), 2) + 0.0 for x in alphas / np.abs(alphas).max())
    return made


def patterns_of(times: Array, commands: Array) -> tuple[Array, Array, Array, Array]:
    """
    Return commands as patterns of what is driven together.

    Each command counts for as long as it holds: where every thruster has its own topic, those that
    are heard one after the other are driven together all the same. A push that hardly changes, as
    one that holds a depth, is not told from the bias.

    Returns
    -------
    together : array, shape (n, k)
        How strong each pattern is at each time; k is 0 where nothing changes.
    patterns, apart : array, shapes (commands, k) and (commands, commands - k)
        The share of each command in these, and in those that hardly come, in terms of its
        strength: commands that are driven together are not told apart.
    strength : array, shape (commands,)
        The root mean square of each command, 1 for one that is not used.

    """
    shares = _shares(times)
    strength = np.sqrt(np.sum(shares * commands**2, axis=0))
    strength[strength == 0.0] = 1.0
    changes = (commands - np.sum(shares * commands, axis=0)) / strength
    squares, patterns = np.linalg.eigh(changes.T @ (shares * changes))
    there = squares > max(_TOGETHER ** 2 * squares[-1], 0.0)
    seen, apart = patterns[:, there], patterns[:, ~there]
    return commands / strength @ seen, seen, apart, strength


def _shares(times: Array) -> Array:
    """Return the share of the time for which what came at each time held, shape (n, 1)."""
    held_for = np.diff(times, append=times[-1])
    return np.asarray(held_for[:, np.newaxis] / (times[-1] - times[0]))


def force_of(made: Thrusters, dof: str, moved: Motion) -> Array:
    """Return the force on a DOF at the times of the motion."""
    forces = held(made.signal.times + made.delay, made.forces(), moved.times, moved.halves[dof])
    return np.asarray(forces @ np.array(made.rows[dof]))


def answers_to(made: Thrusters, moved: Motion) -> dict[str, tuple[Push, Array]]:
    found = {}
    for dof in moved.velocities:
        force = force_of(made, dof, moved) if dof in made.rows else np.zeros(len(moved.times))
        if np.ptp(force) > 1e-9:
            push = answer(moved, dof, force[:, np.newaxis])
            if push is not None:
                found[dof] = push, force
    return found


def misfits_by(cases: Sequence[tuple[Thrusters, Motion]]) -> list[Misfit]:
    """Return what the forces leave of the motion of all DOFs that they drive, in each case."""
    total = [Misfit(math.inf, 0.0, 0)] * len(cases)
    for dof in dict.fromkeys(dof for made, _ in cases for dof in made.rows):
        told = [moments_of(moved, dof, force_of(made, dof, moved))
                for made, moved in cases if dof in moved.velocities]
        if len(told) == len(cases) and all(told):
            total = [whole.and_of(one) for whole, one in zip(total, misfits(
                [one for one in told if one]))]
    return total


def explained_by(made: Thrusters, moved: Motion) -> float:
    """Return how much of the motion is explained, if forces push the way they point."""
    return math.fsum(math.copysign(push.explained, push.alphas[0])
                     for push, _ in answers_to(made, moved).values())


def with_delay(made: Thrusters, moved: Motion) -> Thrusters:
    """Return thrusters with the delay at which they explain most of the motion."""
    if not made.rows:
        return made
    if made.sure_frame:  # a controller's thrust a moment later would go against the motion
        return max([replace(made, delay=delay) for delay in DELAYS],
                   key=lambda case: explained_by(case, moved))
    commands = made.forces()
    forces = {dof: commands @ np.array(made.rows[dof])[:, np.newaxis]
              for dof in moved.velocities if dof in made.rows}
    return replace(made, delay=best_delay(moved, made.signal.times, forces))
