"""What the data of a log or of a live vehicle say about a configuration, as findings."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
import math
from typing import Any, cast

import numpy as np
from rovid_core.inputs.configuration_check import AGREEING, TIME
from rovid_core.inputs.refusals import REASONS
from rovid_core.inputs.units_and_signs import look_like_pulse_widths
from rovid_core.model.dofs import DOFS, Quaternion
from rovid_core.model.samples import NS
from rovid_core.ordering.cadence import PERIODS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import IdentifierSettings, LEAST_GAP, Settings, WATCHING
from rovid_core.velocity.attitude_history import normalised, rotation_between, yaw_of
from rovid_ros.config.parameters import section, topics_of
from rovid_ros.messages.converter import Converter

OK, WARNING, ERROR = 'OK', 'WARNING', 'ERROR'

# Share of refused samples, or of steps that are too fast, above which something is wrong.
ACCEPTABLE = 0.02
APART = 1.0  # [s] by more than this the clocks of two inputs must not differ
SHARED = 0.5  # share of their time that inputs should have in common
SLOW = 8.0  # [Hz] of commands: half of an interval is more than ekf's delay can be below 0

LEAST_GRAVITY = 7.0  # [m/s^2] along z, or the body does not stand upright
RISE_STEP = 2.0  # [s] over which means of how fast depth and velocity rise are compared
KEPT_EVERY = 100_000_000  # [ns] more often nothing is kept
FEWEST_STEPS, STILL_RISE, ALIKE = 20, 0.02, 0.5  # steps, [m/s], correlation


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    level: str  # OK, WARNING or ERROR
    subject: str  # the key, topic or file that it is about
    text: str  # what was found
    advice: str = ''  # what to change; '' if nothing

    def __str__(self) -> str:
        """Return the line."""
        advice = f'; {self.advice}' if self.advice else ''
        return ' '.join(f'{self.level:<8}{self.subject}: {self.text}{advice}'.split('\n'))


class Findings:
    """All that was found, in the order in which it was looked at."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def ok(self, subject: str, text: str) -> None:
        """Add something that is as it should be."""
        self.all.append(Finding(OK, subject, text))

    def warning(self, subject: str, text: str, advice: str = '') -> None:
        """Add something that looks wrong."""
        self.all.append(Finding(WARNING, subject, text, advice))

    def error(self, subject: str, text: str, advice: str = '') -> None:
        """Add something that cannot work."""
        self.all.append(Finding(ERROR, subject, text, advice))

    def count(self, level: str) -> int:
        """Return how many there are of a level."""
        return sum(one.level == level for one in self.all)

    def verdict(self) -> str:
        """Return how many errors and warnings there are."""
        counts = [(self.count(level), name)
                  for level, name in ((ERROR, 'error'), (WARNING, 'warning'))]
        parts = [f'{count} {name}{"s" if count > 1 else ""}' for count, name in counts if count]
        return ' and '.join(parts) or 'all is well'

    def document(self) -> list[dict[str, Any]]:
        """Return them for a program to read."""
        return [asdict(one) for one in self.all]


class SampleStatistics:
    """Times, gaps, speeds and ranges of the samples of one topic of an input, in one pass."""

    def __init__(self, input: str, max_speed: float, latency: float) -> None:
        self.input = input
        self._latency = round(latency / NS)  # [ns] that was subtracted from the stamps
        self.count = 0
        self.backward = 0  # samples stamped no later than the one before
        self.not_finite = 0  # samples with a NaN or infinity
        self.first = self.last = 0  # event times [ns]
        self.longest_gap = 0.0  # [s]
        self.low_lag, self.high_lag = math.inf, -math.inf  # [s] from the stamp to the receipt
        # range of each value; of an attitude that of the heading [rad], unwrapped
        self.low: list[float] = []
        self.high: list[float] = []
        self.steps = self.fast = 0  # from one sample to the next, and those above max_speed
        self.fastest = 0.0  # [m/s or rad/s]
        self._max_speed = max_speed
        self._lag_sum = 0.0
        self._previous: tuple[int, tuple[float, ...]] | None = None
        self._heading = 0.0

    @property
    def rate(self) -> float:
        """Return the mean rate [Hz], 0 for less than two samples."""
        span = (self.last - self.first) * NS
        return (self.count - 1) / span if span > 0.0 else 0.0

    @property
    def lag(self) -> float:
        """Return the mean time [s] from the stamp to the receipt."""
        return self._lag_sum / max(self.count, 1)

    def add_sample(self, time: int, receive_time: int, value: tuple[float, ...]) -> None:
        """Add a sample with its event time and the receive time of its message [ns]."""
        lag = (receive_time - time - self._latency) * NS
        self._lag_sum += lag
        self.low_lag, self.high_lag = min(self.low_lag, lag), max(self.high_lag, lag)
        if not self.count:
            self.first = self.last = time
        elif time <= self.last:
            self.backward += 1
        self.longest_gap = max(self.longest_gap, (time - self.last) * NS)
        self.first, self.last = min(self.first, time), max(self.last, time)
        self.count += 1
        if self.input == 'attitude':
            try:
                value = normalised(cast(Quaternion, value))
            except (ValueError, OverflowError):
                self.not_finite += 1
                return
        elif not all(map(math.isfinite, value)):
            # in a reference, a NaN is a DOF that it does not have
            self.not_finite += self.input != 'reference'
            return
        self._add_step(time, value)
        shown = self._unwrapped_heading(value) if self.input == 'attitude' else value
        self.low = list(map(min, self.low or shown, shown))
        self.high = list(map(max, self.high or shown, shown))

    def _add_step(self, time: int, value: tuple[float, ...]) -> None:
        previous = self._previous
        if previous is not None and time <= previous[0]:
            return
        self._previous = (time, value)
        if previous is None:
            return
        dt = (time - previous[0]) * NS
        if self.input in ('position', 'depth'):
            speed = math.dist(previous[1], value) / dt
        elif self.input == 'attitude':
            speed = math.hypot(*rotation_between(
                cast(Quaternion, previous[1]), cast(Quaternion, value))) / dt
        elif self.input in ('velocity', 'angular_velocity'):
            speed = math.hypot(*value)
        else:
            return
        self.steps += 1
        self.fast += speed > self._max_speed
        self.fastest = max(self.fastest, speed)

    def _unwrapped_heading(self, value: tuple[float, ...]) -> tuple[float, ...]:
        x, y, z, w = value
        yaw = yaw_of((x, y, z, w))
        self._heading += math.remainder(yaw - self._heading, 2.0 * math.pi)
        return (self._heading,)


class Upwards:
    """
    What an accelerometer and the depth say of which way is up, in one pass.

    Frames that are wrong throughout contradict no motion: masses stay, and the signs of the
    biases of sway, heave and yaw turn.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._gravity: dict[str, tuple[int, float]] = {}  # by topic: count and sum [m/s^2]
        # [ns] and height [m], or velocity upwards [m/s] in the body
        self._tracks: dict[str, list[tuple[int, float]]] = {'depth': [], 'velocity': []}

    def add_message(self, topic: str, message: Any) -> None:
        """Add a message as it came."""
        z = getattr(getattr(message, 'linear_acceleration', None), 'z', None)
        if isinstance(z, float):
            count, total = self._gravity.get(topic, (0, 0.0))
            self._gravity[topic] = count + 1, total + z

    def add_sample(self, name: str, time: int, value: tuple[float, ...]) -> None:
        """Add a sample, in body FLU and world ENU."""
        track = self._tracks.get(name)
        if track is not None and (not track or time >= track[-1][0] + KEPT_EVERY):
            track.append((time, value[-1]))

    def warnings(self) -> list[tuple[str, str, str]]:
        """Return subject, finding and advice of what is upside down."""
        found = []
        for topic, (count, total) in self._gravity.items():
            mean = total / count
            frames = 'ned' if mean < 0.0 else 'enu'
            wrong = [name for name in ('attitude', 'angular_velocity')
                     if self._settings.input(name).topic == topic
                     and self._settings.frames_of(name) != frames]
            if wrong and abs(mean) > LEAST_GRAVITY:
                found.append((
                    wrong[0], f'the accelerometer of {topic} sees {mean:+.1f} m/s^2 in z, as '
                    f'with frames: {frames}, but they are {self._settings.frames_of(wrong[0])}',
                    'with wrong ones sway, heave and yaw and their biases have the wrong sign'))
        alike = self._correlation()
        if alike < -ALIKE:
            found.append(('velocity', 'its z moves against the depth (correlation '
                          f'{alike:.2f})', 'frames, or the sign of depth.scale, is wrong'))
        return found

    def _correlation(self) -> float:
        """Return that of how fast the depth and the velocity rise, 0 where they do not tell."""
        if not all(self._tracks.values()):
            return 0.0
        (times, heights), (others, speeds) = [
            np.array(track).T * np.array([[NS], [1.0]]) for track in self._tracks.values()]
        steps = np.arange(max(times[0], others[0]), min(times[-1], others[-1]), RISE_STEP)
        ways = np.cumsum(np.diff(others, prepend=others[0]) * speeds)
        rates = [np.diff(np.interp(steps, *track)) / RISE_STEP
                 for track in ((times, heights), (others, ways))]
        if len(steps) <= FEWEST_STEPS or min(map(np.std, rates)) < STILL_RISE:
            return 0.0
        return float(np.corrcoef(*rates)[0, 1])


class Observation:
    """Run messages through the pipeline as the node would, and keep statistics of samples."""

    def __init__(self, settings: Settings, all_at_hand: bool = False) -> None:
        self.settings = settings
        if all_at_hand:
            # of a whole log the method says most that looks for what a model lacks, which is a
            # current where the configured one takes the water to be still
            still = replace(settings.current, prior=0.0)
            settings = replace(
                settings, identifier=replace(IdentifierSettings(), method=WATCHING[0]),
                current=settings.current if settings.estimates_current else still)
        self.stream = Stream(settings, whole=all_at_hand)
        self.converter = Converter(settings, self.stream.reject)
        # by input and number of the topic
        self.samples: dict[tuple[str, int], SampleStatistics] = {
            (name, part): SampleStatistics(name, settings.max_speed, latency)
            for name, latency in settings.latencies().items()
            for part in range(len(topics_of(settings, name)))}
        self.upwards = Upwards(settings)
        self.steps = 0  # estimates that the node would have published

    def add_message(self, topic: str, message: Any, receive_time: int) -> None:
        """Add a message; the topic is as configured, the receive time in ns."""
        self.upwards.add_message(topic, message)
        for event in self.converter.events(topic, message, receive_time):
            for sample in event.samples:
                self.upwards.add_sample(sample.input, event.time, sample.value)
                self.samples[sample.input, sample.part].add_sample(
                    event.time, receive_time, sample.value)
            self.steps += len(self.stream.receive(event))

    def finish(self) -> None:
        """Release what is still held back at the end of the data."""
        self.steps += len(self.stream.finish())

    def document(self) -> dict[str, Any]:
        """Return what was measured for a program to read."""
        return {
            'steps': self.steps,
            'rejected': {f'{name}.{reason}': count
                         for (name, reason), count in sorted(self.stream.rejected.items())},
            'inputs': {topics_of(self.settings, name)[part] if part else name: {
                'topic': topics_of(self.settings, name)[part], 'count': one.count,
                'rate_hz': one.rate, 'longest_gap_s': one.longest_gap, 'backward': one.backward,
                'lag_s': one.lag, 'low': one.low, 'high': one.high, 'fastest': one.fastest,
            } for (name, part), one in self.samples.items()}}


def check_data(seen: Observation, findings: Findings) -> None:
    """Say what an observation shows: of each input, of all together, and what is refused."""
    _check_stamps(seen, findings)
    warnings = seen.stream.take_warnings()
    for line in warnings:  # the likeliest cause of all that follows comes first
        findings.warning('data', line)
    for finding in seen.upwards.warnings():
        findings.warning(*finding)
    for (name, part), one in seen.samples.items():
        if one.count:
            topic = topics_of(seen.settings, name)[part]
            subject = f'{name} {topic}' if part else name
            findings.ok(subject, _summary(one))
            _check_times(seen.settings, subject, one, findings)
            _check_speeds(seen.settings, subject, one, findings,
                          any(line.startswith(f'{name} moves') for line in warnings))
    _check_standstill(seen, findings)
    _check_commands(seen, findings)
    _check_together(seen, findings)
    _check_refused(seen, findings)
    # of a model that pushes the wrong way nothing that it lacks makes sense
    if seen.steps and not any(
            line.endswith(AGREEING) and not line.startswith(TIME) for line in warnings):
        _check_models(seen, findings)


def _summary(one: SampleStatistics) -> str:
    stamps = 'stamps at receipt' if one.low_lag == one.high_lag == 0.0 else (
        f'stamps {one.low_lag:.3g} to {one.high_lag:.3g} s before receipt')
    ranges = ''
    if one.low:
        if one.input == 'attitude':
            ranges = (f', heading {math.degrees(one.low[0]):.0f} to '
                      f'{math.degrees(one.high[0]):.0f} deg')
        else:
            ranges = ', from ' + ' '.join(f'{x:.4g}' for x in one.low) + ' to ' + ' '.join(
                f'{x:.4g}' for x in one.high)
    return (f'{one.count:,} samples at {one.rate:.3g} Hz, longest gap {one.longest_gap:.3g} s, '
            f'{stamps}{ranges}')


def _check_stamps(seen: Observation, findings: Findings) -> None:
    """Name the inputs whose clock is ahead: whatever its messages need, they come too early."""
    for (name, part), one in seen.samples.items():
        given = seen.settings.latencies()[name]
        if one.count and one.high_lag + given < -NS:  # not by rounding
            topic = topics_of(seen.settings, name)[part]
            findings.warning(
                f'{section(name)}.latency', f'all messages of {topic} are stamped '
                f'{-one.high_lag:.2g} s or more after their receipt, which cannot be: its clock '
                'is ahead', f'set that clock, or this to {-one.low_lag:.2g} or more')


def _check_times(settings: Settings, subject: str, one: SampleStatistics,
                 findings: Findings) -> None:
    usual = PERIODS / one.rate if one.rate else 0.0
    limit, key = settings.max_gap or max(LEAST_GAP, usual), 'max_gap'
    if one.input == 'thrusters':
        limit, key = settings.thrusters.timeout, 'thrusters.timeout'
    elif own := settings.input(one.input).timeout:
        limit, key = own, f'{section(one.input)}.timeout'
    if one.input not in ('reference', 'sign') and 0.0 < limit < one.longest_gap:
        follows = ', which follows the rate' if key == 'max_gap' and not settings.max_gap else ''
        findings.warning(
            subject, f'the longest gap, {one.longest_gap:.3g} s, is above {key} {limit:.3g} s'
            f'{follows}', f'{"set" if follows else "raise"} {key} if such gaps are usual')
    if one.backward:
        findings.warning(subject, f'{one.backward:,} stamps are not after the one before',
                         'such samples are refused; see what stamps them')
    if one.not_finite:
        findings.warning(subject, f'{one.not_finite:,} values are no numbers or no rotations',
                         'they are refused')


def _check_speeds(settings: Settings, subject: str, one: SampleStatistics,
                  findings: Findings, told: bool) -> None:
    """Say what is too fast, unless its unit was ``told`` to be the cause."""
    if not one.steps or one.fast <= ACCEPTABLE * one.steps:
        return
    text = (f'{100.0 * one.fast / one.steps:.0f} % of its steps are faster than velocity.max '
            f'{settings.max_speed:g} (up to {one.fastest:.3g})')
    if one.fast < 0.5 * one.steps:
        if told:
            return
        findings.warning(subject, text, 'outliers, stamps that come in bursts, or velocity.max '
                         'is too low; what of it is refused is said below')
        return
    units = {'attitude': 'is it in the unit of attitude.unit?',
             'angular_velocity': 'is it in rad/s?', 'velocity': 'is it in m/s?',
             'depth': 'does depth.scale give m?'}
    findings.warning(subject, text, units.get(one.input, 'is it in m?'))


def _check_standstill(seen: Observation, findings: Findings) -> None:
    for (name, _), one in seen.samples.items():
        if name in ('position', 'depth', 'attitude') and one.count > 10 and one.low == one.high:
            findings.warning(name, 'never changes', 'is the sensor stuck, or the field right?')
    depth = seen.samples.get(('depth', 0))
    if depth and depth.low and depth.low[0] > 0.5 and seen.settings.depth_scale > 0.0:
        findings.warning('depth', f'z is always above 0 ({depth.low[0]:.3g} to '
                         f'{depth.high[0]:.3g} m)', 'z counts upwards: if the sensor counts '
                         'downwards, depth.scale has to be negative')


def _check_commands(seen: Observation, findings: Findings) -> None:
    thrusters = seen.settings.thrusters
    parts = [one for (name, _), one in seen.samples.items() if name == 'thrusters' and one.low]
    slowest = min([one.rate for one in parts], default=SLOW)
    if slowest < SLOW:
        findings.warning(
            'thrusters', f'commands come at {slowest:.2g} Hz', 'right if the thrusters get no '
            'others in between; else log all: thrust that acts before its command is logged '
            'makes masses wrong')
    low = [x for one in parts for x in one.low]
    high = [x for one in parts for x in one.high]
    if len(low) != thrusters.count:
        return
    rows = [thrusters.allocation[DOFS.index(dof)] for dof in seen.settings.dofs]
    for i, (least, most) in enumerate(zip(low, high)):
        if least == most and any(row[i] for row in rows):
            name = f' ({thrusters.names[i]})' if thrusters.names else ''
            findings.warning('thrusters', f'thruster {i + 1}{name} is always at {least:g}',
                             'what only it drives cannot be identified')
    if min(low) >= thrusters.offset and max(high) > thrusters.offset and 'sign' not in (
            seen.settings.used_inputs()):
        pulses = look_like_pulse_widths(thrusters, min(low), max(high))
        findings.warning(
            'thrusters', f'no command is below thrusters.offset {thrusters.offset:g} (they are '
            f'{min(low):g} to {max(high):g})', 'pulses in us: set thrusters.offset to what '
            'gives no thrust, such as 1500' if pulses
            else 'if they are magnitudes, give their direction with thrusters.sign')


def _check_together(seen: Observation, findings: Findings) -> None:
    """Compare the inputs with each other: their clocks, and the time that they share."""
    topics = seen.settings.thrusters.topics
    deciding = {f'thrusters of {topics[part]}' if name == 'thrusters' and len(topics) > 1
                else section(name): one for (name, part), one in seen.samples.items()
                if one.count and name != 'reference'}
    if len(deciding) < 2:
        return
    order = sorted(deciding, key=lambda name: deciding[name].lag)
    apart = deciding[order[-1]].lag - deciding[order[0]].lag
    if apart > APART:
        findings.warning(
            order[-1], f'its stamps are {apart:.1f} s older than those of {order[0]}, against '
            'the time of receipt', 'one of their clocks is wrong: set it, or use latency')
    begin = max(one.first for one in deciding.values())
    end = min(one.last for one in deciding.values())
    whole = max(one.last for one in deciding.values()) - min(
        one.first for one in deciding.values())
    if end <= begin:
        other_clock = list(dict.fromkeys(
            f'{name.partition(" ")[0]}.stamp' for name, one in deciding.items()
            if abs(one.lag) > (one.last - one.first) * NS))
        findings.error(', '.join(deciding), 'have no time in common: nothing can be identified',
                       f'{", ".join(other_clock)}: receive takes the times at which the log got '
                       'them, as where a simulator stamps them' if other_clock else
                       'see whether their stamps are of one clock')
    elif end - begin < SHARED * whole:
        findings.warning(', '.join(deciding), f'have only {(end - begin) * NS:.1f} s of '
                         f'{whole * NS:.1f} s in common')


def _check_refused(seen: Observation, findings: Findings) -> None:
    """Say what the node would refuse."""
    for (name, reason), count in sorted(seen.stream.rejected.items()):
        health = seen.stream.inputs.get(name)
        share = count / max(count + (health.count if health else seen.steps), 1)
        text = f'{count:,} ({100.0 * share:.3g} %) refused as {reason}'
        detail = seen.converter.details.get((name, reason), '')
        meaning = detail or REASONS.get(reason, '')
        if share > ACCEPTABLE:
            findings.warning(section(name), text, meaning)
        else:
            findings.ok(section(name), f'{text}: {meaning}')
    if seen.steps:
        findings.ok('steps', f'{seen.steps:,} estimates')
    else:
        findings.error('steps', 'none: nothing could be identified')


def _check_models(seen: Observation, findings: Findings) -> None:
    """Say what the data show of each DOF that its model does not have."""
    for dof in seen.settings.dofs:
        if note := seen.stream.identifier(dof).note:
            findings.warning(dof, note)
