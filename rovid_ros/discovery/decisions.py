"""From what could be and what the data say to the configuration of a vehicle, with reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math

import numpy as np
from rovid_core.identify.ekf.normalised_model import DELAYS
from rovid_core.model.dofs import coupling_prior, DOFS, LINEAR_DOFS
from rovid_ros.discovery.ardupilot import Motors
from rovid_ros.discovery.candidates import (
    Candidate,
    FAST,
    of_one_vehicle,
    too_fast,
    upside_down,
    words_in,
)
from rovid_ros.discovery.handedness import agreed_heave, mirrored
from rovid_ros.discovery.lever_arm import lever_arm, seen_from_middle
from rovid_ros.discovery.moments import Misfit
from rovid_ros.discovery.motion import answer, Motion, motion, Push
from rovid_ros.discovery.signals import Array, Signal
from rovid_ros.discovery.thrusters import (
    answers_to,
    EXPLAINED,
    explained_by,
    find_thrusters,
    force_of,
    misfits_by,
    SURE,
    Thrusters,
    with_delay,
)

_DRIVEN = ('surge', 'sway', 'heave', 'yaw')
_ENOUGH = 50  # times
_SAME = 0.9  # correlation of one thing that is measured twice
_AKAIKE = 2.0  # squared standard errors: a smaller term makes predictions worse
_LATENCIES = tuple(0.25 * k for k in range(1, 13))  # [s] of fixes that are tried
_DELAYS = tuple(0.05 * k for k in range(13))  # [s] of the thrust
_PARTS = 4  # of half an interval between commands, by which they are tried earlier
_SPANS = range(1, 6)  # how much longer means of coarse fixes are than their rate asks for
_DRY = 'dry mass'
_TURNED = 0.25  # [rad] a smaller heading offset is left to rovid tune

Choose = Callable[[str, list[Candidate]], Candidate]


class DiscoveryError(ValueError):
    """A log that no configuration can be made for; the text is the line to print."""


@dataclass
class Known:
    """What is put into the file for a DOF."""

    mass: float
    quadratic_drag: float
    linear_drag: float
    force: float  # typical
    velocity: float
    explained: float  # share of its changes that the command explains
    sign: int  # 1 if it goes where it is pushed, -1 the other way, 0 if the log does not say
    couplings: tuple[str, ...] = ()
    dry_mass: float = 0.0  # [kg or kg m^2]; 0: unknown


@dataclass
class Discovery:
    """A configuration, what was guessed for it, and what the log cannot say."""

    frames: str
    inputs: dict[str, Candidate]
    others: dict[str, list[Candidate]]  # what else each input could be
    thrusters: Thrusters
    dofs: dict[str, Known] = field(default_factory=dict)
    yaw_offset: float = 0.0
    latencies: tuple[float, ...] = ()  # [s] of the fixes that fit as well
    fastest: float = 0.0  # [m/s or rad/s]
    guesses: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    @property
    def open_latency(self) -> str:
        """Return which latencies of the fixes explain the log alike, '' if it tells one."""
        if len({*self.latencies}) < 2:
            return ''
        return f'{min(self.latencies):g} to {max(self.latencies):g} s'

    def know_dry(self, mass: float, inertia: float) -> None:
        """Take the mass [kg] in air and the moment of inertia about z [kg m^2]; 0: unknown."""
        for dof, known in self.dofs.items():
            known.dry_mass = inertia if dof == 'yaw' else mass
        lacking = [dof for dof, known in self.dofs.items() if not known.dry_mass]
        if len(lacking) < len(self.dofs):
            self.unknown = [f'{_DRY} of {", ".join(lacking)}{one.removeprefix(_DRY)}'
                            if one.startswith(_DRY) else one for one in self.unknown
                            if lacking or not one.startswith(_DRY)]


def decide(found: dict[str, list[Candidate]], signals: Sequence[Signal], choose: Choose,
           motors: Motors | None = None, frames: str = '') -> Discovery:
    """
    Decide on every input, the thrusters and the DOFs.

    Parameters
    ----------
    found : dict
        What each input could be, the likeliest first.
    choose : callable
        Decides between several; gets the name of the input and the candidates.
    motors : Motors, optional
        What the autopilot says of them.
    frames : str
        Of the messages, where that is known.

    Raises
    ------
    DiscoveryError
        If there are no commands, or nothing that moves.

    """
    guesses: list[str] = []
    found, other_vehicles = of_one_vehicle(found)
    if other_vehicles:
        guesses.append(f'{other_vehicles}: left out as another vehicle, for it has commands and a '
                       'motion of its own; --namespace takes it')
    found, inputs = _of_one_clock(found, _inputs(found, signals, choose), guesses)
    others = {name: [one for one in found[name] if one is not inputs.get(name)]
              for name in found}
    guesses += _unused(found, inputs)
    if not frames:
        frames, why = _told_frames(signals, inputs) or _likely_frames(inputs, motors)
        guesses.append(f'frames: {frames}{why}')
    if frames == 'ned' and 'position' in inputs:
        inputs['position'] = _in_ned(inputs['position'])
    moved, heading = _moved(inputs, frames, guesses)
    if not len(moved.times):
        raise DiscoveryError(
            'have no time in common: ' + ', '.join(
                f'{one.signal.topic} goes from {one.signal.times[0]:.0f} to '
                f'{one.signal.times[-1]:.0f} s of the log' for one in inputs.values()))
    if 'velocity' in inputs and (why := mirrored(moved, inputs.get('depth'), find_thrusters(
            inputs['thrusters'], frames, moved, motors, []))):
        other, velocity = 'enu' if frames == 'ned' else 'ned', inputs['velocity']
        inputs['velocity'] = replace(velocity, keys={**velocity.keys, 'frames': other})
        guesses.append(f'velocity.frames: {other}, for {why}')
        moved, heading = _moved(inputs, frames, [])
    spans = max(_SPANS if moved.coarse else [1], key=lambda n: _told(inputs, frames, motors, n))
    moved, heading = _moved(inputs, frames, [], spans)
    thrusters = find_thrusters(inputs['thrusters'], frames, moved, motors, guesses)
    late, likely = _latency(inputs, frames, thrusters, moved)
    if late:
        inputs['position'] = _earlier(inputs['position'], late)
        moved, heading = _moved(inputs, frames, [], spans)
        thrusters = find_thrusters(inputs['thrusters'], frames, moved, motors, [])
        guesses.append(
            f'position.latency {late:g} s: what {inputs["position"].signal.topic} shows comes so '
            'much later after its command than what the other inputs show')
    guesses += _too_fast(signals) if 'position' not in inputs else []
    made = Discovery(frames, inputs, others, thrusters, guesses=guesses, latencies=likely)
    if heading and thrusters.how != 'data' and {'surge', 'sway'} <= moved.velocities.keys():
        original = moved
        for _ in range(2):  # what is far off spoils the delay, and that the angle
            made.yaw_offset = _heading_offset(made.thrusters, original)
            moved = _turned(original, made.yaw_offset)
            made.thrusters = with_delay(made.thrusters, moved)
    moved = _from_middle(made, moved, found, choose, lambda middle: with_delay(
        thrusters, middle) if thrusters.how != 'data' else find_thrusters(
            inputs['thrusters'], frames, middle, motors, []))
    made.thrusters = _as_samples(made.thrusters, moved)
    made.inputs['thrusters'] = replace(inputs['thrusters'], signal=made.thrusters.signal)
    _fit(made, moved)
    if not made.dofs:
        raise DiscoveryError(
            f'nothing that {made.thrusters.signal.topic} says moves the vehicle in this log: '
            f'{", ".join(moved.velocities)} were looked at')
    _say(made)
    return made


def _too_fast(signals: Sequence[Signal]) -> list[str]:
    return [f'position: {signal.place} left out, for in metres it moves at {speed:.0f} m/s'
            for signal, speed in too_fast(signals)]


def _list(signals: Sequence[Signal]) -> str:
    return ', '.join(sorted({f'{one.topic} ({one.type})' for one in signals})) or 'no numbers'


def _inputs(found: Mapping[str, list[Candidate]], signals: Sequence[Signal],
            choose: Choose) -> dict[str, Candidate]:
    """Return the inputs, of which there are commands and something that moves."""
    if 'thrusters' not in found:
        raise DiscoveryError('nothing in it that changes is named as thruster commands or a wrench'
                             f'; it has {_list(signals)}')
    inputs = {name: choose(name, found[name]) for name in _wanted(found)}
    if inputs.keys() == {'thrusters'}:
        raise DiscoveryError('nothing in it looks like a position, depth, attitude, velocity or '
                             f'gyro that moves; it has {_list(signals)}')
    return inputs


def _of_one_clock(found: dict[str, list[Candidate]], inputs: Mapping[str, Candidate],
                  guesses: list[str]) -> tuple[dict[str, list[Candidate]], dict[str, Candidate]]:
    """
    Return what could be inputs, and the inputs, by receipt where stamps leave no time in common.

    A simulator's stamps tell its own time, commands without a stamp have the recorder's.
    """
    times = [one.signal.times for one in inputs.values()]
    other = [name for name, one in inputs.items() if one.signal.of_other_clock]
    if not other or max(one[0] for one in times) < min(one[-1] for one in times):
        return found, {**inputs}
    guesses.append(
        f'{", ".join(f"{name}.stamp" for name in other)}: receive, for these stamps are not of '
        'the clock of the log, by which all is taken that has no stamp')
    changed = {id(one): _by_receipt(one) for name in found for one in found[name]}
    return ({name: [changed[id(one)] for one in found[name]] for name in found},
            {name: changed[id(one)] for name, one in inputs.items()})


def _by_receipt(one: Candidate) -> Candidate:
    """Return a candidate by its receipt where what stamps it tells another time."""
    return replace(one, signal=one.signal.by_receipt(), keys={
        **one.keys, 'stamp': 'receive'}) if one.signal.of_other_clock else one


def _wanted(found: Mapping[str, Sequence[Candidate]]) -> list[str]:
    """Return the inputs to use: no second source of what is measured already."""
    wanted = [name for name in ('position', 'depth', 'attitude') if name in found]
    if 'velocity' in found and 'position' in found:
        velocity, position = found['velocity'][0].signal, found['position'][0].signal
        # a DVL sees the ground also under water, and tells more of a motion than fixes between
        # which it goes on unseen
        if position.shape == 'geographic' or (
                'dvl' in velocity.words and velocity.rate > position.rate):
            wanted.remove('position')
    if 'attitude' not in found and 'angular_velocity' in found:
        wanted.append('angular_velocity')
    if 'position' not in wanted and 'velocity' in found:
        wanted.append('velocity')
    return [*wanted, 'thrusters']


def _unused(found: Mapping[str, Sequence[Candidate]],
            inputs: Mapping[str, Candidate]) -> list[str]:
    """Say which sensor of the motion another one stands for."""
    both = [found[name][0].signal for name in ('position', 'velocity') if name in found]
    used = {one.signal.topic for one in inputs.values()}
    return [f'{signal.place} is not used, for one source of the motion is enough'
            for signal in both if len(both) == 2 and signal.topic not in used]


def _from_middle(made: Discovery, moved: Motion, found: Mapping[str, list[Candidate]],
                 choose: Choose, thrusters_of: Callable[[Motion], Thrusters]) -> Motion:
    """
    Return the motion of the middle of the vehicle, where it seems to be measured elsewhere.

    That is taken where with it thrust explains more of sway; what drives the vehicle follows.
    """
    arm = lever_arm(moved, made.thrusters.signal.times, made.thrusters.forces())
    if not arm:
        return moved
    middle = seen_from_middle(moved, arm)
    thrusters = thrusters_of(middle)
    without, with_arm = [one['sway'][0].explained if 'sway' in one else 0.0 for one in (
        answers_to(thrusters, moved), answers_to(thrusters, middle))]
    inputs, name = made.inputs, 'velocity' if 'velocity' in made.inputs else 'position'
    said = (f'{name}.lever_arm: in turns {inputs[name].signal.topic} goes sideways as what is '
            f'{abs(arm):.2g} m {"ahead of" if arm > 0.0 else "behind"} the middle does')
    if with_arm <= without or name == 'velocity' and not found.get('angular_velocity'):
        made.unknown.append(f'{said}, or as the vehicle itself may: measure it')
        return moved
    if name == 'velocity' and 'angular_velocity' not in inputs:  # an arm takes a gyro
        gyro = inputs['angular_velocity'] = choose('angular_velocity', found['angular_velocity'])
        made.others['angular_velocity'].remove(gyro)
    inputs[name] = replace(inputs[name], keys={**inputs[name].keys, 'lever_arm': [arm, 0.0, 0.0]})
    made.guesses.append(f'{said}: measure it')
    made.thrusters = thrusters
    return middle


def _latency(inputs: Mapping[str, Candidate], frames: str, thrusters: Thrusters,
             moved: Motion) -> tuple[float, tuple[float, ...]]:
    """
    Return how much later fixes are stamped than taken [s], where the motion says so, otherwise 0.

    And the latencies that fit as well. A delay of the thrust is seen by all inputs: the DOFs that
    need no fixes tell it, or leave it open, and then it may be what makes fixes look late.
    """
    on_time = {dof: thrusters.rows[dof] for dof, source in (
        ('heave', 'depth'), ('yaw', 'attitude')) if source in inputs and dof in thrusters.rows}
    if 'position' not in inputs or not on_time:
        return 0.0, ()
    without = replace(moved, velocities={
        dof: velocity for dof, velocity in moved.velocities.items() if dof in on_time})
    told = misfits_by([(replace(thrusters, rows=on_time, delay=delay), without)
                       for delay in _DELAYS])
    least = _likeliest(told)
    plane = {dof: row for dof, row in thrusters.rows.items() if dof in ('surge', 'sway')}
    cases = [(delay, 0.0) for delay, one in zip(_DELAYS, told)
             if one.left < told[least].left + told[least].by_chance(SURE**2)]
    punctual = len(cases)
    cases += [(_DELAYS[least], late) for late in _LATENCIES]
    found = misfits_by([(replace(thrusters, rows=plane, delay=delay), _moved(
        {**inputs, 'position': _earlier(inputs['position'], late)}, frames, [])[0])
        for delay, late in cases])
    best = _likeliest(found)
    gained = min(one.left for one in found[:punctual]) - found[best].left
    likely = tuple([late for (_, late), one in zip(cases, found) if one.push > SURE and (
        one.left < found[best].left + found[best].by_chance(SURE**2))])
    return cases[best][1] if gained > found[best].by_chance() else 0.0, likely


def _as_samples(thrusters: Thrusters, moved: Motion) -> Thrusters:
    """
    Return thrusters whose commands are taken earlier, where the motion says that they are samples.

    A log with fewer commands than the vehicle was given has one now and then, which stands as much
    for what was before it as for what came after: it holds from half an interval before its stamp.
    A filter finds what is less than that by itself, but no delay so far below 0.
    """
    times = thrusters.signal.times
    half = 0.5 * float(np.median(np.diff(times)))
    early = [delay for k in range(_PARTS) if (delay := half * (k / _PARTS - 1.0)) < DELAYS[0]]
    if not early:
        return thrusters
    found = misfits_by([(replace(thrusters, delay=delay), moved) for delay in [*_DELAYS, *early]])
    best = _likeliest(found)
    gained = min(one.left for one in found[:len(_DELAYS)]) - found[best].left
    if best < len(_DELAYS) or gained <= found[best].by_chance(SURE**2):
        return thrusters
    latency = float(f'{half:.2g}')
    return with_delay(replace(thrusters, latency=latency, signal=replace(
        thrusters.signal, times=times - latency)), moved)


def _told(inputs: dict[str, Candidate], frames: str, motors: Motors | None, spans: int) -> float:
    """
    Return how much commands tell of the DOFs of coarse fixes: logarithms of standard errors.

    Means over short spans are mostly noise, and those over long ones hardly show the motion.
    """
    moved, _ = _moved(inputs, frames, [], spans)
    answers = answers_to(find_thrusters(inputs['thrusters'], frames, moved, motors, []), moved)
    return math.fsum(math.log(max(abs(push.alphas[0]) / push.errors[0], 1.0))
                     for dof, (push, _) in answers.items() if dof in moved.coarse)


def _likeliest(found: Sequence[Misfit]) -> int:
    """Return which leaves least, of those with which forces push where they point."""
    # the other way at another time: thrust that comes and goes, or that answers to the motion
    return min(((one.left, k) for k, one in enumerate(found) if one.push > SURE),
               default=(0.0, 0))[1]


def _earlier(fixes: Candidate, late: float) -> Candidate:
    """Return fixes that are known to be stamped late [s]."""
    return replace(fixes, keys={**fixes.keys, 'latency': late},
                   signal=replace(fixes.signal, times=fixes.signal.times - late))


def _in_ned(position: Candidate) -> Candidate:
    """Return positions as all others are, where those on the earth are taken east, north, up."""
    signal = position.signal
    if signal.shape != 'geographic':
        return position
    return replace(position, signal=replace(
        signal, values=signal.values[:, (1, 0, 2)] * np.array([1.0, 1.0, -1.0])))


def _told_frames(signals: Sequence[Signal],
                 inputs: Mapping[str, Candidate]) -> tuple[str, str] | None:
    """Return the frames of the messages and what says so, None if nothing does."""
    for signal in signals:
        if signal.path.rpartition('.')[2] == 'linear_acceleration' and signal.shape == 'vector':
            over = any(one.topic == signal.topic and upside_down(one) for one in signals)
            z = float(np.mean(signal.values[:, 2])) * (-1.0 if over else 1.0)
            if abs(z) > 7.0:
                name = 'ned' if z < 0.0 else 'enu'
                return name, (f', for the accelerometer sees {z:+.1f} m/s^2 in z'
                              + (' once it is turned over, as its attitude says' if over else ''))
    gyro = inputs.get('angular_velocity')
    for signal in signals if gyro else ():
        if gyro and signal.topic == gyro.signal.topic and signal.shape == 'array':
            for z in np.median(signal.values, axis=0).tolist():
                if 8.8 < abs(z) < 10.8:
                    name = 'ned' if z < 0.0 else 'enu'
                    return name, f', for the accelerometer beside the gyro sees {z:+.1f} m/s^2'
    by = [why for one in inputs.values() if (why := _named_ned(one.signal))]
    return ('ned', f', {by[0]}') if by else None


def _likely_frames(inputs: Mapping[str, Candidate], motors: Motors | None) -> tuple[str, str]:
    """Return the frames that the motion suggests, and why; ROS's where it cannot tell."""
    if 'attitude' not in inputs or 'position' not in inputs or (
            inputs['position'].signal.shape != 'geographic'):
        return 'enu', (' (ROS); had it been ned everywhere, only the signs of sway, heave and yaw '
                       'and of their biases would change')
    # which way latitude and longitude point is known, so the attitude has to agree with them
    told = {}
    for frames in ('enu', 'ned'):
        used = {**inputs, **({'position': _in_ned(inputs['position'])} if frames == 'ned' else {})}
        moved, _ = _moved(used, frames, [])
        told[frames] = explained_by(
            find_thrusters(used['thrusters'], frames, moved, motors, []), moved)
    if told['ned'] > told['enu'] + EXPLAINED:
        return 'ned', ', for then the attitude agrees with how the fixes move under thrust'
    return 'enu', ' (ROS); with ned the fixes would move no more as the thrust says'


def _named_ned(signal: Signal) -> str:
    """Return what in its names says that a signal is in north, east and down, '' for nothing."""
    if signal.type.startswith('px4_msgs/'):
        return 'as all of PX4'
    named = 'ned' in signal.words or 'ned' in words_in(signal.frame)
    return f'by the name of {signal.frame or signal.topic}' if named else ''


def _moved(inputs: dict[str, Candidate], frames: str, guesses: list[str],
           spans: int = 1) -> tuple[Motion, bool]:
    """Return the motion in forward-left-up, and whether it depends on the heading."""
    used = {name: one.signal for name, one in inputs.items()}
    angles = None
    attitude = inputs.get('attitude')
    if attitude is not None and attitude.signal.shape != 'quaternion':
        unit = math.pi / 180.0 if attitude.keys.get('unit') == 'deg' else 1.0
        angles = unit * attitude.signal.values[:, -1]
        if attitude.keys.get('heading') == 'ned' and frames == 'enu':
            angles = 0.5 * math.pi - angles
    depth = inputs.get('depth')
    scale = float(depth.keys.get('scale', 1.0)) if depth else 1.0
    moved = motion(used, angles, scale, spans)
    velocities = dict(moved.velocities)
    body = frames
    if 'velocity' in used:
        depth, body = None, inputs['velocity'].keys.get('frames', frames)
        if _is_turning(velocities):
            del velocities['heave']
            guesses.append(f'heave: left out, for the third number of {used["velocity"].place} is '
                           'how fast the vehicle turns')
    # a depth has its own sign
    for dof, of in (('sway', body), ('yaw', frames), ('heave', 'enu' if depth else body)):
        if of == 'ned' and dof in velocities:
            velocities[dof] = -velocities[dof]
    if frames == 'ned' and moved.turned is not None and moved.upright is not None:
        moved = replace(moved, turned=-moved.turned,
                        upright=moved.upright * np.array([[-1.0], [1.0], [1.0]]))
    if depth and 'position' in used:
        velocities['heave'] = agreed_heave(inputs, depth, frames, moved.times,
                                           velocities['heave'], guesses)
    if depth:
        velocities['heave'] = replace(moved, velocities=velocities).heaving()
    return replace(moved, velocities={
        dof: v for dof, v in velocities.items()
        if np.isfinite(v).sum() > 20 and np.nanstd(v) > 1e-3}), 'position' in used and bool(
            attitude)


def _is_turning(velocities: Mapping[str, Array]) -> bool:
    """Tell whether heave is the rate of yaw, as where a boat's u, v and r are in one vector."""
    if not {'heave', 'yaw'} <= velocities.keys():
        return False
    both = np.column_stack([velocities[dof] for dof in ('heave', 'yaw')])
    both = both[np.isfinite(both).all(axis=1)]
    return len(both) > _ENOUGH and bool(np.ptp(both, axis=0).all()) and (
        abs(float(np.corrcoef(both[:, 0], both[:, 1])[0, 1])) > _SAME)


def _fit(made: Discovery, moved: Motion) -> None:
    """Fit each DOF that is driven, for initial values of the right size."""
    answers = answers_to(made.thrusters, moved)
    for dof in [dof for dof in DOFS if dof in answers]:
        push, force = answers[dof]
        alpha, error = float(push.alphas[0]), float(push.errors[0])
        velocity = moved.velocities[dof]
        sign = 0 if abs(alpha) < SURE * error or (
            push.explained < EXPLAINED and dof not in moved.coarse) else 1 if alpha > 0.0 else -1
        if sign < 0 and _goes_along(made.thrusters, dof, moved) >= push.explained:
            sign = 0
        strong = float(np.sqrt(np.mean(force * force)))
        fast = float(np.sqrt(np.nanmean(velocity * velocity)))
        if dof not in _DRIVEN or strong == 0.0:
            continue
        mass = 1.0 / max(abs(alpha), error, 1e-9)
        quadratic, linear = max(-push.beta * mass, 0.0), max(-push.gamma * mass, 0.0)
        if quadratic == linear == 0.0:  # what stops it at its typical speed
            linear = strong / max(fast, 1e-6)
        made.dofs[dof] = Known(
            mass, quadratic, linear, _amplitude(force), _amplitude(velocity), push.explained,
            sign, _couplings(push))
    still = [dof for dof in moved.velocities if dof in _DRIVEN and dof not in answers]
    for dofs, why in (([dof for dof in still if dof not in moved.coarse],
                       'the commands explain next to nothing of the motion in this log'),
                      ([dof for dof in still if dof in moved.coarse],
                       'the fixes show little but noise, too little to tell what commands do')):
        if dofs:
            made.guesses.append(f'{", ".join(dofs)}: left out, for {why}')
    _leave_out_dependent(made)
    speeds = [float(np.nanpercentile(np.abs(moved.velocities[dof]), 99.0)) for dof in made.dofs]
    made.fastest = max(speeds, default=1.0)


def _goes_along(thrusters: Thrusters, dof: str, moved: Motion) -> float:
    """
    Return how much of a DOF's motion commands explain at most if they push where they point.

    The thrust of a controller brakes what it has set in motion: a tenth of a second too late it
    seems to push against its command, and that much are commands stamped early or late.
    """
    alone = replace(thrusters, rows={dof: thrusters.rows[dof]})
    return max(explained_by(replace(alone, delay=sign * delay), moved)
               for delay in _DELAYS[:5] for sign in (1.0, -1.0))


def _couplings(push: Push) -> tuple[str, ...]:
    """Return the couplings that a log knows, and that predict better than none."""
    return tuple([name for name, (kappa, error) in push.coupled.items()
                  if SURE * error < coupling_prior(name) and kappa**2 > _AKAIKE * error**2])


def _amplitude(values: Array) -> float:
    """Return the size of what comes and goes, as ``rovid check`` judges typical sizes by."""
    squares = np.minimum(np.abs(values), np.nanpercentile(np.abs(values), 99.0)) ** 2  # no spikes
    return math.sqrt(4.0 / 3.0 * float(np.nanmean(squares * squares) / np.nanmean(squares)))


def _leave_out_dependent(made: Discovery) -> None:
    """Leave out DOFs that no command drives apart from those that it explains better."""
    apart: list[str] = []
    for dof in sorted(made.dofs, key=lambda dof: -made.dofs[dof].explained):
        rows = np.array([made.thrusters.rows[one] for one in (*apart, dof)])
        if np.linalg.matrix_rank(rows) == len(rows):
            apart.append(dof)
    others = [dof for dof in made.dofs if dof not in apart]
    made.dofs = {dof: known for dof, known in made.dofs.items() if dof in apart}
    if others:
        made.guesses.append(f'{", ".join(others)}: left out, for no command drives it apart from '
                            f'{", ".join(made.dofs)} in this log')


def _heading_offset(thrusters: Thrusters, moved: Motion) -> float:
    """Return the heading offset [rad] with which most of surge and sway is explained."""
    plane = replace(thrusters, rows={
        dof: row for dof, row in thrusters.rows.items() if dof in ('surge', 'sway')})

    def explained(angle: float) -> float:
        return explained_by(plane, _turned(moved, angle))

    coarse = max(np.arange(-15, 17) * math.pi / 16.0, key=explained)
    fine = max(coarse + np.arange(-10, 11) * 0.02, key=explained)
    if abs(fine) < _TURNED or explained(fine) < explained(0.0) + EXPLAINED or not _all_turned(
            thrusters, moved, float(fine)):
        return 0.0
    return round(math.remainder(float(fine), 2.0 * math.pi), 2)


def _all_turned(thrusters: Thrusters, moved: Motion, angle: float) -> bool:
    """
    Tell whether each force in the plane that moves the vehicle moves it aside by an angle [rad].

    A heading offset turns the answers to all of them. Where one DOF is hardly driven, an angle
    that lends it a part of the other's motion explains more too, and is none.
    """
    forces = np.column_stack([force_of(thrusters, dof, moved) for dof in ('surge', 'sway')])
    surge, sway = [answer(moved, dof, forces) for dof in ('surge', 'sway')]
    if surge is None or sway is None:
        return False
    answers = (surge.alphas + 1j * sway.alphas) * np.array([1.0, -1j])  # from where it is pushed
    told = np.abs(answers) > SURE * np.hypot(surge.errors, sway.errors)
    aside = np.angle(answers[told])
    off = np.angle(answers[told] * np.exp(-1j * angle))
    return bool(told.any() and np.all(np.abs(off) < np.abs(aside)))


def _turned(moved: Motion, angle: float) -> Motion:
    """Return the motion in the plane with another heading."""
    plane = (moved.velocities['surge'] + 1j * moved.velocities['sway']) * np.exp(-1j * angle)
    return replace(moved, velocities={
        **moved.velocities, 'surge': plane.real, 'sway': plane.imag})


def _say(made: Discovery) -> None:
    """Say what was guessed and what the log cannot tell."""
    thrusters = made.thrusters
    if made.yaw_offset:
        made.guesses.append(
            f'attitude.yaw_offset {made.yaw_offset:g} rad: the vehicle accelerates '
            f'{math.degrees(made.yaw_offset):.0f} deg aside of where it is pushed')
    against = [dof for dof, known in made.dofs.items() if known.sign < 0]
    if against and thrusters.how != 'data':
        made.guesses.append(f'{", ".join(against)} accelerates against its command: look at the '
                            'sign in thrusters (or at frames) before you believe a mass')
    for dof, known in made.dofs.items():
        if dof in LINEAR_DOFS and known.velocity > FAST:
            made.guesses.append(f'{dof} moves at {known.velocity:.0f} m/s: is what measures it in '
                                'metres?')
    if thrusters.latency:
        made.guesses.append(
            f'thrusters.latency {thrusters.latency:g} s, half the time between two commands: the '
            'vehicle follows them so early that they are samples of faster ones')
    weak = [dof for dof, known in made.dofs.items() if known.sign == 0]
    if weak:
        made.guesses.append(f'{", ".join(weak)}: the log hardly says how the command moves it')
    if made.open_latency:
        made.unknown.append(
            f'how late the fixes are stamped: a position.latency of {made.open_latency} explains '
            'this log alike. Measure it: masses may be wrong by 10 % with 0.25 s too little or '
            'too much, which their intervals do not tell')
    if thrusters.how == 'wrench':
        made.unknown.append('whether the wrench is in newtons: all masses and drags are wrong by '
                            'the same factor')
    elif thrusters.how == 'frame' and thrusters.frame is not None:
        frame = thrusters.frame
        by = 'says the autopilot' if thrusters.sure_frame else (
            f'as in ArduSub, for there are {len(frame.factors)} motors and it explains the motion')
        turned = [str(k) for k, gain in enumerate(thrusters.chain.gain, start=1) if gain < 0.0]
        which = '' if thrusters.sure_frame or not turned else (
            f' with motor{"s" if turned[1:] else ""} {", ".join(turned)} reversed')
        made.guesses.append(f'thrusters.allocation: frame {frame.name}{which}, {by}')
        levers = f'the levers are those of {frame.vehicle}' if frame.vehicle else (
            'the levers are guessed')
        made.unknown.append('thrust scale (a T200 near 12 V is taken) and allocation geometry '
                            f'({levers})')
    else:
        made.guesses.append('thrusters.allocation: from what each command does to each DOF in '
                            'this log; masses and drags are per unit of the command')
        made.unknown.append('thrust scale and allocation geometry: where the thrusters are and '
                            'what they push in newtons')
    made.unknown.append(f'{_DRY}, which most formats of rovid export need')
