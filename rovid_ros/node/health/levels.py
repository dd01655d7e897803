"""
The levels of ``/diagnostics``: all of their rules, and nothing else.

==========  =======  ==============================================================
status      level    when
==========  =======  ==============================================================
an input    ERROR    its publishers have another type, another definition of the
                     type or a QoS that does not fit: somebody has to change it
            WARN     nothing has come yet; or none of what comes is taken; or its
                     stamps are further from this clock than it may be silent; or
                     more than 2 % of it was refused of late
            STALE    it came, and has been silent for longer than it may be
a DOF       WARN     no step yet; or the vehicle is not pushed
            STALE    no step for longer than the slowest of its inputs may be silent
            ERROR    its last step was refused (status ``invalid``)
rejected    WARN     more than 2 % of all was refused of late
state       ERROR    a status is ERROR, or the record ended by itself
            WARN     a status is WARN or STALE, or the checkpoint is not written
==========  =======  ==============================================================

All else is OK. While the node is not active, its own status is OK and the others STALE.
An input may be silent for its timeout, and at least for five of its periods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math

from rovid_core.identify.estimate import DofEstimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.config.input_topics import needs, topics_of
from rovid_ros.node.health.graph import TopicState
from rovid_ros.node.health.recent import Arrivals, in_words, Recent, WINDOW
from rovid_ros.results.outputs import dof_message, ERROR, LEVELS, OK, STALE, WARN

PERIODS = 5.0
"""An input is late when it has been silent for this many of its periods."""

ACCEPTABLE = 0.02
"""Share of refused samples above which something is wrong with the data."""

Verdict = tuple[int, str]
"""Level and short message."""


@dataclass(frozen=True)
class Situation:
    """
    What the levels are told from.

    Attributes
    ----------
    topics : mapping of str to TopicState
        What the graph says; empty where the node is fed from a log.
    now : int
        Time of the node's clock [ns]; 0 before simulated time has begun.
    steady : float
        Time of a steady clock [s].
    steps : mapping of str to float
        When each DOF made its last step, by the steady clock.

    """

    settings: Settings
    stream: Stream
    arrivals: Arrivals
    recent: Recent
    topics: Mapping[str, TopicState]
    now: int
    steady: float
    steps: Mapping[str, float]


def of_input(at: Situation, name: str) -> Verdict:
    """Return level and message of an input."""
    topics = topics_of(at.settings, name)
    states = [at.topics[topic] for topic in topics if topic in at.topics]
    for state in states:
        if state.is_wrong:
            return ERROR, state.text
    if not at.now:
        return WARN, 'simulated time has not begun: nothing on /clock'
    for topic in topics:
        if not at.arrivals.count(topic):
            found = at.topics.get(topic)
            name_there = found.name if found else topic
            return WARN, (found.text if found and found.problem
                          else f'no messages on {name_there}')
    limit = may_be_silent(at, name)
    silent = (at.now - min(at.arrivals.last(topic) for topic in topics)) / 1e9
    if silent > limit:
        return STALE, f'silent for {silent:.1f} s'
    if name == 'thrusters' and silent > WINDOW and at.stream.inputs[name].count:
        return OK, f'the last command holds, {silent:.0f} s old'
    return _of_coming(at, name, limit)


def may_be_silent(at: Situation, name: str) -> float:
    """Return how long [s] an input may be silent; inf where a command holds for ever."""
    rates = [at.arrivals.rate(topic) for topic in topics_of(at.settings, name)]
    periods = [PERIODS / rate for rate in rates if rate > 0.0]
    return max([at.settings.timeout_of(name), *periods])


def _of_coming(at: Situation, name: str, limit: float) -> Verdict:
    """Judge an input whose messages come."""
    health, refused = at.stream.inputs[name], at.recent.refused(name)
    taken = at.recent.taken(name)
    if not taken and (refused or at.recent.span >= WINDOW / 2.0):
        return WARN, 'messages come, none is taken: ' + (
            in_words(refused, 3) or 'they wait for the other inputs')
    if health.last_time is not None:
        age = (at.now - health.last_time) / 1e9
        if abs(age) > limit + at.settings.max_wait:
            where = 'behind' if age > 0.0 else 'ahead of'
            return WARN, f'stamps are {abs(age):.1f} s {where} this clock'
    count = sum(refused.values())
    share = count / max(count + taken, 1)
    if share > ACCEPTABLE:
        return WARN, f'{100.0 * share:.0f} % refused of late: {in_words(refused, 3)}'
    rate = min(at.arrivals.rate(topic) for topic in topics_of(at.settings, name))
    return OK, hertz(rate)


def of_dof(at: Situation, dof: str) -> Verdict:
    """Return level and message of a degree of freedom."""
    estimate = estimate_of(at.stream, dof)
    if estimate is None or not (estimate.steps or dof in at.steps):
        why = _why(at, dof)
        return WARN, f'no step yet: {why}' if why else 'no step yet'
    age = at.steady - at.steps.get(dof, at.steady)
    limits = [may_be_silent(at, name) for name in needs(at.settings, dof)]
    limit = max(filter(math.isfinite, limits))
    if age > limit + at.settings.max_wait:
        why = _why(at, dof)
        return STALE, f'no step for {age:.1f} s' + (f': {why}' if why else '')
    return LEVELS[estimate.status], dof_message(estimate)


def estimate_of(stream: Stream, dof: str) -> DofEstimate | None:
    """Return the last estimate of a DOF, None before there is one."""
    estimates = stream.estimate.dofs if stream.estimate else ()
    return next((one for one in estimates if one.dof == dof), None)


def _why(at: Situation, dof: str) -> str:
    """Return what keeps a DOF from its steps, '' if nothing seems to."""
    names = needs(at.settings, dof)
    verdicts = {name: of_input(at, name) for name in names}
    silent = [name for name, (level, _) in verdicts.items() if level == STALE]
    if silent:
        return f'{" and ".join(silent)} {"is" if len(silent) == 1 else "are"} silent'
    wrong = [name for name, (level, _) in verdicts.items() if level == ERROR]
    absent = [name for name in names if not at.stream.inputs[name].count]
    for name in (*wrong, *absent, *names):  # what others suffer from comes first
        if verdicts[name][0] != OK:
            return f'{name}: {verdicts[name][1]}'
    refused = [in_words(found, 3) for name in (*names, dof)
               if (found := at.recent.refused(name))]
    return 'refused of late: ' + ', '.join(refused) if refused else ''


def of_rejected(at: Situation) -> Verdict:
    """Return level and message of all that was refused."""
    refused = sum(at.recent.refused().values())
    taken = sum(at.recent.taken(name) for name in at.settings.used_inputs())
    total = sum(at.stream.rejected.values())
    used = sum(health.count for health in at.stream.inputs.values())
    level = WARN if refused > ACCEPTABLE * (refused + taken) else OK
    return level, f'{total} refused, {used} used; of late {refused} and {taken}'


def hertz(rate: float) -> str:
    """Return a rate as people write it."""
    if rate <= 0.0:
        return 'a message'  # one alone has no rate
    return f'{rate:.0f} Hz' if rate >= 99.95 else f'{rate:.1f} Hz'
