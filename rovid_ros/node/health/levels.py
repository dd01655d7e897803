"""
The levels of ``/diagnostics``: all of their rules, and the counters that they judge.

==========  =======  ==============================================================
status      level    when
==========  =======  ==============================================================
an input    ERROR    its publishers have another type, another definition of the
                     type or a QoS that does not fit; or all that comes is refused,
                     or begins anew after a gap: somebody has to change it
            WARN     nothing has come yet; or what comes waits for others; or more
                     than 2 % of it was refused recently; or its stamps are further
                     from this clock than it may be silent
            STALE    it came, and has been silent for longer than it may be
a DOF       WARN     no step yet; or the vehicle is not pushed
            STALE    no step for longer than the slowest of its inputs may be silent
            ERROR    its last step was refused (status ``invalid``)
rejected    WARN     more than 2 % of all was refused recently
state       ERROR    a status is ERROR, or the record ended by itself
            WARN     a status is WARN or STALE, or the checkpoint is not written
==========  =======  ==============================================================

All else is OK. While the node is not active, its own status is OK and the others STALE.
An input may be silent for its timeout, and at least for five of its periods.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from rovid_core.identify.estimate import DofEstimate
from rovid_core.inputs.refusals import STILL_USED
from rovid_core.model.samples import Event
from rovid_core.ordering.cadence import PERIODS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import MOST_WAIT, Settings
from rovid_ros.config.parameters import section, topics_of
from rovid_ros.node.health.graph import TopicState
from rovid_ros.results.dof_encoder import dof_message
from rovid_ros.results.outputs import ERROR, LEVELS, OK, STALE, WARN

ACCEPTABLE = 0.02  # share of refused samples above which something is wrong with the data
WINDOW = 10.0  # [s] how far back the recent counts go
RATE_SAMPLES = 30  # messages over which the rate of a topic is measured
Counts = dict[tuple[str, str], int]  # (input or DOF, reason) -> how many
LevelAndMessage = tuple[int, str]  # level and short message of a status


class Arrivals:
    """The messages of each topic as they came, whatever became of them."""

    def __init__(self) -> None:
        self._count: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._times: dict[str, deque[int]] = {}

    def add(self, topic: str, receive_time: int, events: Sequence[Event] = ()) -> None:
        """Count a message by its receive time [ns] and the events that it gave."""
        self._count[topic] = self._count.get(topic, 0) + 1
        self._last[topic] = receive_time
        if events:
            self._times.setdefault(topic, deque(maxlen=RATE_SAMPLES)).append(events[0].time)

    def count(self, topic: str) -> int:
        """Return how many messages came."""
        return self._count.get(topic, 0)

    def last(self, topic: str) -> int:
        """Return the receive time [ns] of the newest message, 0 if there was none."""
        return self._last.get(topic, 0)

    def rate(self, topic: str) -> float:
        """Return the rate [Hz] of the newest messages by their own times, 0 while unknown."""
        times = [*self._times.get(topic, ())]
        gaps = sorted(after - before for before, after in zip(times, times[1:]) if after > before)
        # the median, because neither one wild stamp nor a burst is a rate
        return 1e9 / gaps[len(gaps) // 2] if gaps else 0.0


class RecentCounts:
    """What a stream used and refused over the last ``WINDOW``."""

    def __init__(self, stream: Stream, now: float) -> None:
        self._stream = stream
        self._past: deque[tuple[float, Counts, dict[str, int]]] = deque()
        self.update(now)

    def update(self, now: float) -> None:
        """Read the counters; to be called about once a second."""
        used = {name: health.count for name, health in self._stream.inputs.items()}
        self._past.append((now, dict(self._stream.rejected), used))
        while len(self._past) > 2 and now - self._past[1][0] >= WINDOW:
            self._past.popleft()

    @property
    def span(self) -> float:
        """Return the time [s] that the counts below cover."""
        return self._past[-1][0] - self._past[0][0]

    def refused(self, name: str = '') -> Counts:
        """Return what was refused, of one input or DOF or of all, the most frequent first."""
        found = difference(self._past[0][1], self._past[-1][1], name)
        return {key: count for key, count in found.items() if key[1] not in STILL_USED}

    def used(self, name: str) -> int:
        """Return how many samples of an input were used."""
        return self._past[-1][2][name] - self._past[0][2][name]


def difference(before: Counts, after: Counts, name: str = '') -> Counts:
    """Return what was counted between two readings, the most frequent first."""
    found = {key: count - before.get(key, 0) for key, count in after.items()
             if count > before.get(key, 0) and name in ('', key[0])}
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


def counts_text(counts: Counts, most: int = 8) -> str:
    """Return ``position too_fast 12, depth late 3``; beyond ``most`` only how many more."""
    parts = [f'{name} {reason} {count}' for (name, reason), count in counts.items()]
    more = [f'and {len(parts) - most} other reasons'] if len(parts) > most else []
    return ', '.join(parts[:most] + more)


@dataclass(frozen=True)
class HealthData:
    """Everything that the levels are judged by."""

    stream: Stream
    arrivals: Arrivals
    recent: RecentCounts
    topics: Mapping[str, TopicState]  # what the graph says; empty where the node is fed from a log
    now: int  # time of the node's clock [ns]; 0 before simulated time has begun
    steady: float  # time of a steady clock [s]
    steps: Mapping[str, float]  # when each DOF made its last step, by the steady clock

    @property
    def settings(self) -> Settings:
        """Return the settings of the stream."""
        return self.stream.settings

    def rate(self, name: str) -> float:
        """Return the rate [Hz] of the slowest topic of an input, 0 while one is unknown."""
        return min(self.arrivals.rate(topic) for topic in topics_of(self.settings, name))


def input_level(data: HealthData, name: str) -> LevelAndMessage:
    """Return level and message of an input."""
    topics = topics_of(data.settings, name)
    states = [data.topics[topic] for topic in topics if topic in data.topics]
    for state in states:
        if state.is_wrong:
            return ERROR, state.text
    if not data.now:
        return WARN, 'simulated time has not begun: nothing on /clock'
    for topic in topics:
        if not data.arrivals.count(topic):
            found = data.topics.get(topic)
            name_there = found.name if found else topic
            return WARN, (found.text if found and found.problem
                          else f'no messages on {name_there}')
    limit = allowed_silence(data, name)
    silent = (data.now - min(data.arrivals.last(topic) for topic in topics)) / 1e9
    if silent > limit:
        return STALE, f'silent for {silent:.1f} s'
    if name == 'thrusters' and silent > WINDOW and data.stream.inputs[name].count:
        return OK, f'the last command holds, {silent:.0f} s old'
    return _arriving_level(data, name, limit)


def allowed_silence(data: HealthData, name: str) -> float:
    """Return how long [s] an input may be silent; inf where a command holds for ever."""
    rates = [data.arrivals.rate(topic) for topic in topics_of(data.settings, name)]
    periods = [PERIODS / rate for rate in rates if rate > 0.0]
    return max([data.settings.timeout_of(name), *periods])


def _arriving_level(data: HealthData, name: str, limit: float) -> LevelAndMessage:
    """Judge an input whose messages come."""
    health, refused = data.stream.inputs[name], data.recent.refused(name)
    taken = data.recent.used(name)
    if not taken and refused:
        return ERROR, (f'messages come, none is taken: {counts_text(refused, 3)}'
                       + remedy(data, name, next(iter(refused))[1]))
    if not taken and data.recent.span >= WINDOW / 2.0:
        return WARN, 'messages come, none is taken: they wait for the other inputs'
    if refused.get((name, 'gap'), 0) > 0.5 * taken:
        return ERROR, ('every measurement comes after a gap and begins anew'
                       + remedy(data, name, 'gap'))
    count = sum(refused.values())
    share = count / max(count + taken, 1)
    if share > ACCEPTABLE:  # what is refused is no measurement of the clock
        return WARN, f'{100.0 * share:.0f} % refused of late: {counts_text(refused, 3)}'
    if health.last_time is not None:
        age = (data.now - health.last_time) / 1e9
        if abs(age) > limit + data.settings.wait:
            where = 'behind' if age > 0.0 else 'ahead of'
            return WARN, f'stamps are {abs(age):.1f} s {where} this clock'
    return OK, rate_text(data.rate(name))


def remedy(data: HealthData, name: str, reason: str) -> str:
    """Return what to set so that an input is no longer refused for a reason, '' if unknown."""
    if reason == 'late':
        wait = math.ceil(12.5 * data.stream.lag(name)) / 10.0  # with a margin
        return (f'; set max_wait to {wait:g}, or correct its clock' if wait < MOST_WAIT else
                f'; correct its clock, or set {section(name)}.stamp: receive')
    if reason == 'gap' and (rate := data.rate(name)) > 0.0:
        gap = math.ceil(10.0 * PERIODS / rate) / 10.0
        key = f'{section(name)}.timeout' if data.settings.input(name).timeout else 'max_gap'
        return f'; set {key} to {gap:g}, or leave it out'
    if reason == 'too_fast':
        return f'; is it in m? Otherwise raise velocity.max, which is {data.settings.max_speed:g}'
    return ''


def dof_level(data: HealthData, dof: str) -> LevelAndMessage:
    """Return level and message of a degree of freedom."""
    estimate = last_estimate(data.stream, dof)
    if estimate is None or not (estimate.steps or dof in data.steps):
        why = _obstacle(data, dof)
        return WARN, f'no step yet: {why}' if why else 'no step yet'
    age = data.steady - data.steps.get(dof, data.steady)
    limits = [allowed_silence(data, name) for name in data.settings.needs(dof)]
    limit = max(filter(math.isfinite, limits))
    if age > limit + data.settings.wait:
        why = _obstacle(data, dof)
        return STALE, f'no step for {age:.1f} s' + (f': {why}' if why else '')
    return LEVELS[estimate.status], dof_message(estimate)


def last_estimate(stream: Stream, dof: str) -> DofEstimate | None:
    """Return the last estimate of a DOF, None before there is one."""
    estimates = stream.estimate.dofs if stream.estimate else ()
    return next((one for one in estimates if one.dof == dof), None)


def _obstacle(data: HealthData, dof: str) -> str:
    """Return what keeps a DOF from its steps, '' if nothing seems to."""
    names = data.settings.needs(dof)
    verdicts = {name: input_level(data, name) for name in names}
    silent = [name for name, (level, _) in verdicts.items() if level == STALE]
    if silent:
        return f'{" and ".join(silent)} {"is" if len(silent) == 1 else "are"} silent'
    causes = names[::-1]  # the source comes first, and is refused where another one is missing
    wrong = [name for name in causes if verdicts[name][0] == ERROR]
    absent = [name for name in names if not data.stream.inputs[name].count]
    for name in (*wrong, *absent, *causes):
        if verdicts[name][0] != OK:
            return f'{name}: {verdicts[name][1]}'
    refused = [counts_text(found, 3) for name in (*names, dof)
               if (found := data.recent.refused(name))]
    return 'refused of late: ' + ', '.join(refused) if refused else ''


def rejected_level(data: HealthData) -> LevelAndMessage:
    """Return level and message of all that was refused."""
    refused = sum(data.recent.refused().values())
    taken = sum(data.recent.used(name) for name in data.settings.used_inputs())
    total = sum(data.stream.rejected.values())
    used = sum(health.count for health in data.stream.inputs.values())
    level = WARN if refused > ACCEPTABLE * (refused + taken) else OK
    return level, f'{total} refused, {used} used; of late {refused} and {taken}'


def rate_text(rate: float) -> str:
    """Return a rate as people write it."""
    if rate <= 0.0:
        return 'a message'  # one alone has no rate
    return f'{rate:.0f} Hz' if rate >= 99.95 else f'{rate:.1f} Hz'
