"""Wrong values, bytes and messages, which the faults put in the place of the right ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import atan2, degrees

from rovid_core.velocity.attitude_history import from_yaw
from rovid_ros.logs.log import LogMessage
from rovid_ros.messages.types import standard_types

from test.support.fault_edits import (
    added,
    changed,
    Edit,
    Messages,
    Moment,
    Recording,
    shifted,
    Span,
    valued,
    Values,
)

Wrong = Callable[[Values, Moment], Values]


def moved(*by: float, share: float = 1.0) -> Wrong:
    """Return a shift; of a share of the values only, to either side."""
    def move(values: Values, moment: Moment) -> Values:
        if moment.random.random() >= share:
            return values
        side = 1.0 if share == 1.0 else float(moment.random.choice([-1.0, 1.0]))
        return [value + side * x for value, x in zip(values, by)]

    return move


def fixed_at(number: float) -> Wrong:
    """Return one number for all values."""
    return lambda values, moment: [number] * len(values)


def times(factor: float, share: float = 1.0) -> Wrong:
    """Return a multiple of a share of the values."""
    return lambda values, moment: [factor * value for value in values] \
        if moment.random.random() < share else values


def multipath(agreeing: bool) -> Wrong:
    """Return bursts of 3 to 6 wrong fixes, one every 40."""
    shift = [0.0, 0.0]

    def move(values: Values, moment: Moment) -> Values:
        burst, number = divmod(moment.count, 40)
        if number >= 3 + burst % 4:
            return values
        if number == 0 or not agreeing:
            shift[:] = moment.random.uniform(-4.0, 4.0, 2).tolist()
        return [values[0] + shift[0], values[1] + shift[1], *values[2:]]

    return move


def drift(values: Values, moment: Moment) -> Values:
    """Return x after a drift of 2 m in a minute."""
    return [values[0] + 2.0 * min(moment.since / 60.0, 1.0), *values[1:]]


def half_turned(q: Values, moment: Moment) -> Values:
    """Return the attitude after half a turn about the vertical, in 5 % of the cases."""
    return [-q[1], q[0], q[3], -q[2]] if moment.random.random() < 0.05 else q


def as_degrees(q: Values, moment: Moment) -> Values:
    """Return the attitude of a heading in degrees that is taken for radians."""
    return [*from_yaw(degrees(2.0 * atan2(q[2], q[3])))]


def upside_down(recording: Recording, span: Span) -> Messages:
    """Return depths with the wrong sign."""
    scale, offset = recording.settings.depth_scale, recording.settings.depth_offset
    return valued('depth', lambda values, moment: [
        (-(scale * values[0] + offset) - offset) / scale])(recording, span)


def damaged(make: Callable[[bytes, Moment], bytes]) -> Edit:
    """Return the edit that damages the bytes of the position's messages."""
    store = standard_types()
    return changed('position', lambda message, moment: [message._replace(data=make(
        bytes(store.serialize_cdr(message.data, message.type)), moment))])


def garbage(cdr: bytes, moment: Moment) -> bytes:
    """Return random bytes behind the right beginning."""
    return cdr[:4] + moment.random.bytes(len(cdr) - 4)


def without_name(message: LogMessage, moment: Moment) -> Messages:
    """Return the message without its last joint."""
    return [message._replace(data=replace(
        message.data, name=message.data.name[:-1], effort=message.data.effort[:-1]))]


def other(input: str, change: Callable[[Values], Values], delay: float) -> Edit:
    """Return the edit in which somebody else publishes as well, a little later [s]."""
    return added(input, lambda recording, message, moment: [shifted(
        recording.put(message, input, change(recording.get(message, input))), delay)])


def repeated(input: str, count: int, period: float) -> Edit:
    """Return the edit in which each message comes several times, with new stamps."""
    return added(input, lambda recording, message, moment: [
        shifted(message, k * period) for k in range(1, count)])


def until_next(period: float) -> Callable[[LogMessage, Moment], float]:
    """Return for how long a message is held, if all are let go once in a period [s]."""
    return lambda message, moment: period - moment.since % period
