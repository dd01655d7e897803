"""Which position a message of parameters is the answer to."""

from __future__ import annotations

from collections.abc import Sequence

STEPPING = ('position', 'depth', 'attitude')
"""The inputs that make the steps of the DOFs, in their order."""

UNANSWERED = 2
"""Measurements of each that make the first velocity, which a filter starts from."""

ROW = 32
"""[bytes] The parameters of one DOF, at the end of the message."""

BACK = 6
"""So far back that of an answer is looked for."""


def delays_between(positions: Sequence[int], arrivals: Sequence[int]) -> list[int]:
    """Return how long answers to nothing but positions took [ns]."""
    if len(arrivals) == len(positions):
        return [arrival - moment for arrival, moment in zip(arrivals, positions)]
    return _delays_of_some([('position', moment) for moment in positions],
                           [(arrival, 'position') for arrival in arrivals])


def delays_of(sent: Sequence[tuple[str, int]], came: Sequence[tuple[int, bytes]]) -> list[int]:
    """
    Return how long each answer to a position took [ns].

    Parameters do not say what they come of, but only a position changes those of surge, a depth
    those of heave, an attitude those of yaw. Where there are as many answers as positions they
    belong together in their order. Otherwise what has no answer (it was lost, or left out) is
    found by the order of the other inputs, from the last back: at the beginning it is not
    certain which measurement makes the first step.
    """
    rows = [[cdr[start:start + ROW] for start in range(len(cdr) - 3 * ROW, len(cdr), ROW)]
            for _, cdr in came]
    steps = []
    for (arrival, _), before, after in zip(came[1:], rows, rows[1:]):
        changed = [name for name, one, other in zip(STEPPING, before, after) if one != other]
        steps.append((arrival, changed[0] if len(changed) == 1 else ''))
    arrivals = [arrival for arrival, name in steps if name == 'position']
    positions = [moment for name, moment in sent if name == 'position'][UNANSWERED:]
    if len(arrivals) == len(positions):
        return delays_between(positions, arrivals)
    return _delays_of_some([(name, moment) for name, moment in sent if name in STEPPING], steps)


def _delays_of_some(expected: list[tuple[str, int]], steps: list[tuple[int, str]]) -> list[int]:
    delays = []
    for arrival, changed in reversed(steps):
        while expected and expected[-1][1] > arrival:
            expected.pop()
        for back in range(1, min(BACK, len(expected)) + 1):
            name, moment = expected[-back]
            if name == changed:
                del expected[-back:]
                if name == 'position':
                    delays.append(arrival - moment)
                break
    return delays
