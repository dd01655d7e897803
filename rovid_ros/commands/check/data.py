"""What the data of a log or of a live vehicle say about a configuration."""

from __future__ import annotations

import math
from typing import Any

from rovid_core.inputs.reasons import REASONS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.commands.check.findings import Findings
from rovid_ros.commands.check.samples import NS, Samples
from rovid_ros.config.input_topics import section, topics_of
from rovid_ros.messages.convert import Converter

ACCEPTABLE = 0.02
"""Share of refused samples, or of steps that are too fast, above which something is wrong."""

APART = 1.0
"""[s] By more than this the clocks of two inputs must not differ."""

SHARED = 0.5
"""Share of their time that inputs should have in common."""

PULSES = 900.0
"""Commands that are never below this are lengths of pulses [us]."""

Key = tuple[str, int]


class Observation:
    """
    Take messages as the node would, and keep what they say.

    Parameters
    ----------
    settings : Settings
        The run.

    Attributes
    ----------
    samples : dict
        (input, part) -> Samples.
    steps : int
        Estimates that the node would have published.

    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.stream = Stream(settings)
        self.converter = Converter(settings, self.stream.reject)
        self.samples: dict[Key, Samples] = {
            (name, part): Samples(name, settings.max_speed)
            for name in settings.used_inputs()
            for part in range(len(topics_of(settings, name)))}
        self.steps = 0

    def take(self, topic: str, message: Any, receive_time: int) -> None:
        """Take a message; the topic is as configured, the receive time in ns."""
        for event in self.converter.events(topic, message, receive_time):
            for sample in event.samples:
                self.samples[sample.input, sample.part].take(
                    event.time, receive_time, sample.value)
            self.steps += len(self.stream.receive(event))

    def finish(self) -> None:
        """Take the end of the data."""
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
    for (name, part), one in seen.samples.items():
        if one.count:
            topic = topics_of(seen.settings, name)[part]
            subject = f'{name} {topic}' if part else name
            findings.ok(subject, _summary(one))
            _check_times(seen.settings, subject, one, findings)
            _check_speeds(seen.settings, subject, one, findings)
    _check_standstill(seen, findings)
    _check_commands(seen, findings)
    _check_together(seen, findings)
    _check_refused(seen, findings)


def _summary(one: Samples) -> str:
    stamps = 'stamps at receipt' if one.behind == [0.0, 0.0] else (
        f'stamps {one.behind[0]:.3g} to {one.behind[1]:.3g} s before receipt')
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


def _check_times(settings: Settings, subject: str, one: Samples, findings: Findings) -> None:
    limit, key = settings.max_gap, 'max_gap'
    if one.input == 'thrusters':
        limit, key = settings.thrusters.timeout, 'thrusters.timeout'
    if one.input not in ('reference', 'sign') and 0.0 < limit < one.longest_gap:
        findings.warning(subject, f'the longest gap, {one.longest_gap:.3g} s, is above {key} '
                         f'{limit:g} s', f'raise {key} if such gaps are usual')
    if one.backward:
        findings.warning(subject, f'{one.backward:,} stamps are not after the one before',
                         'such samples are refused; see what stamps them')
    if one.not_finite:
        findings.warning(subject, f'{one.not_finite:,} values are no numbers or no rotations',
                         'they are refused')


def _check_speeds(settings: Settings, subject: str, one: Samples, findings: Findings) -> None:
    if not one.steps or one.fast <= ACCEPTABLE * one.steps:
        return
    text = (f'{100.0 * one.fast / one.steps:.0f} % of its steps are faster than velocity.max '
            f'{settings.max_speed:g} (up to {one.fastest:.3g})')
    if one.fast < 0.5 * one.steps:
        findings.warning(subject, text, 'they are refused: outliers, or velocity.max is too low')
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
    low = [x for one in parts for x in one.low]
    high = [x for one in parts for x in one.high]
    if len(low) != thrusters.count:
        return
    for i, (least, most) in enumerate(zip(low, high)):
        if least == most and any(row[i] for row in thrusters.allocation):
            name = f' ({thrusters.names[i]})' if thrusters.names else ''
            findings.warning('thrusters', f'thruster {i + 1}{name} is always at {least:g}',
                             'what only it drives cannot be identified')
    if min(low) >= thrusters.offset and max(high) > thrusters.offset and 'sign' not in (
            seen.settings.used_inputs()):
        pulses = min(low) >= PULSES and not thrusters.offset
        findings.warning(
            'thrusters', f'no command is below thrusters.offset {thrusters.offset:g} (they are '
            f'{min(low):g} to {max(high):g})', 'pulses in us: set thrusters.offset 1500' if pulses
            else 'if they are magnitudes, give their direction with thrusters.sign')


def _check_together(seen: Observation, findings: Findings) -> None:
    """Compare the inputs with each other: their clocks, and the time that they share."""
    deciding = {section(name): one for (name, _), one in seen.samples.items()
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
        findings.error(', '.join(deciding), 'have no time in common: nothing can be identified',
                       'see whether their stamps are of one clock')
    elif end - begin < SHARED * whole:
        findings.warning(', '.join(deciding), f'have only {(end - begin) * NS:.1f} s of '
                         f'{whole * NS:.1f} s in common')


def _check_refused(seen: Observation, findings: Findings) -> None:
    """Say what the node would refuse, and what it would warn of."""
    for (name, reason), count in sorted(seen.stream.rejected.items()):
        health = seen.stream.inputs.get(name)
        share = count / max(count + (health.count if health else seen.steps), 1)
        text = f'{count:,} ({100.0 * share:.2g} %) refused as {reason}'
        detail = seen.converter.details.get((name, reason), '')
        meaning = detail or REASONS.get(reason, '')
        if share > ACCEPTABLE:
            findings.warning(section(name), text, meaning)
        else:
            findings.ok(section(name), f'{text}: {meaning}')
    for line in seen.stream.take_warnings():
        findings.warning('data', line)
    if seen.steps:
        findings.ok('steps', f'{seen.steps:,} estimates')
    else:
        findings.error('steps', 'none: nothing could be identified')
