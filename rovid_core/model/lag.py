"""
First-order lag of thrusters: of the force, or of the turns of propellers.

The force of a propeller goes with n |n| of its turns n, so that a lag of its turns is none of its
force: it gives way fast, and comes up slowly from rest. All here is exact where a force is held.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from rovid_core.model.plant import Array, linear_recurrence

SLOWEST: Final = 1e-9
"""Steady turns, in the root of a force, that are none."""


def turns_of(force: float) -> float:
    """Return the turns of propellers that give a force, in the root of its unit."""
    return math.copysign(math.sqrt(abs(force)), force)


def spun(turns: float, steady: float, length: float, lag: float) -> tuple[float, float, float]:
    """
    Return what propellers give while they go from some turns to steady ones, in roots of a force.

    Parameters
    ----------
    turns, steady : float
        At the start, and those that are asked for.
    length, lag : float
        [s]

    Returns
    -------
    impulse, moment, end : float
        The integral of the force, that of the force times the time that is left, and the turns
        at the end.

    """
    off = turns - steady
    end = steady + off * math.exp(-length / lag)
    if turns * end >= 0.0:
        impulse, moment = _one_way(steady, off, length, lag)
        return math.copysign(impulse, turns + end), math.copysign(moment, turns + end), end
    still = min(lag * math.log(-off / steady), length)  # [s] after which they stand still
    before, way = _one_way(steady, off, still, lag)
    after, way_after = _one_way(steady, -steady, length - still, lag)
    sign = math.copysign(1.0, end)
    return (sign * (after - before),
            sign * (way_after - way - before * (length - still)), end)


def _one_way(steady: float, off: float, length: float, lag: float) -> tuple[float, float]:
    """Return the integral of the square of turns that keep their sign, and its moment."""
    gone, twice = -lag * math.expm1(-length / lag), -0.5 * lag * math.expm1(-2.0 * length / lag)
    return (steady * steady * length + 2.0 * steady * off * gone + off * off * twice,
            0.5 * steady * steady * length * length + 2.0 * steady * off * lag * (length - gone)
            + 0.5 * off * off * lag * (length - twice))


def inertia_of(lag: float, force: float) -> float:
    """Return what ``driven`` takes for propellers that lag so [s] about a force."""
    return 2.0 * lag * math.sqrt(force)


def driven(turns: float, force: float, length: float,
           inertia: float) -> tuple[float, float, float]:
    """
    Return what propellers give while a torque turns them, in roots of a force.

    The torque is told as the force that it ends at. Against it is the drag of the propeller,
    which goes with n |n| as its force does: inertia n' = F - n |n| (Yoerger, Cooke & Slotine, The
    Influence of Thruster Dynamics on Underwater Vehicle Behavior, IEEE J. Oceanic Eng. 15(3),
    1990). The solution is a hyperbolic tangent, a tangent while they still turn the other way.

    Parameters
    ----------
    turns, force : float
        At the start, and what they end at.
    length : float
        [s]
    inertia : float
        [s times the root of a force]

    Returns
    -------
    impulse, moment, end : float
        As of ``spun``.

    """
    sign = 1.0 if turns > 0.0 or turns == 0.0 <= force else -1.0
    begin, steady = abs(turns), sign * force
    root = math.sqrt(abs(steady))
    x = root * length / inertia
    if root < SLOWEST:
        end = begin / (1.0 + begin * length / inertia)
        way = inertia * math.log1p(begin * length / inertia)
    elif steady > 0.0:
        tanh, ratio = math.tanh(x), begin / root
        end = root * (ratio + tanh) / (1.0 + ratio * tanh)
        way = inertia * (x + math.log1p(0.5 * math.expm1(-2.0 * x) * (1.0 - ratio)))
    else:
        angle = math.atan2(root, begin)
        still = 0.5 * math.pi - angle  # as far as it is to rest
        if x <= still:
            end = root / math.tan(angle + x)
            way = inertia * math.log(math.sin(angle + x) / math.sin(angle))
        else:
            end = -root * math.tanh(x - still)
            # ln cosh
            back = x - still + math.log1p(0.5 * math.expm1(-2.0 * (x - still)))
            way = -inertia * (math.log(math.sin(angle)) + back)
    # by n' itself, once and twice integrated
    impulse = steady * length - inertia * (end - begin)
    moment = 0.5 * steady * length * length - inertia * (way - begin * length)
    return sign * impulse, sign * moment, sign * end


def all_turns_of(forces: Array) -> Array:
    """Return ``turns_of`` many forces."""
    return np.copysign(np.sqrt(np.abs(forces)), forces)


def all_spun(turns: Array, steady: Array, lengths: Array, lag: float) -> Array:
    """Return the impulses of ``spun`` for many spans at once."""
    off = turns - steady
    end = steady + off * np.exp(-lengths / lag)
    reverses = turns * end < 0.0
    ratio = np.where(reverses, -off / np.where(reverses, steady, 1.0), 1.0)
    still = np.where(reverses, np.minimum(lag * np.log(ratio), lengths), 0.0)
    before = _squares(steady, off, still, lag)
    after = _squares(steady, np.where(reverses, -steady, off), lengths - still, lag)
    return np.copysign(after, np.where(reverses, end, turns + end)) + np.copysign(before, turns)


def _squares(steady: Array, off: Array, lengths: Array, lag: float) -> Array:
    """Return the integrals of the squares of turns that keep their sign."""
    return (steady * steady * lengths - 2.0 * lag * steady * off * np.expm1(-lengths / lag)
            - 0.5 * lag * off * off * np.expm1(-2.0 * lengths / lag))


def all_driven(turns: Array, forces: Array, lengths: Array, inertia: float) -> Array:
    """Return the turns at the end that ``driven`` gives for many spans at once."""
    sign = np.where((turns > 0.0) | ((turns == 0.0) & (forces >= 0.0)), 1.0, -1.0)
    begin, steady = np.abs(turns), sign * forces
    root = np.maximum(np.sqrt(np.abs(steady)), SLOWEST)
    x = root * lengths / inertia
    tanh = np.tanh(x)
    onward = root * (begin + root * tanh) / (root + begin * tanh)
    angle = np.arctan2(root, begin)
    still = 0.5 * math.pi - angle
    back = np.where(x <= still, root / np.tan(np.minimum(angle + x, 0.5 * math.pi)),
                    -root * np.tanh(np.maximum(x - still, 0.0)))
    slowing = begin / (1.0 + begin * lengths / inertia)
    return np.asarray(sign * np.where(
        root <= SLOWEST, slowing, np.where(steady > 0.0, onward, back)))


def driven_along(forces: Array, lengths: Array, inertia: float, begin: float) -> Array:
    """
    Return the turns of propellers that a torque turns, span after span.

    Parameters
    ----------
    forces, lengths : ndarray, shape (n,)
        What the turns end at in each span, and how long that is [s].
    inertia, begin : float
        As of ``driven``, and the turns at the start.

    Returns
    -------
    ndarray, shape (n + 1,)
        At the start of each span, and at the end of the last one. What a span gives is its force
        times its length, less the inertia times what the turns gain.

    """
    turns = [begin]
    for force, length in zip(forces.tolist(), lengths.tolist()):
        turns.append(driven(turns[-1], force, length, inertia)[2])
    return np.array(turns)


def follow(steady: Array, lengths: Array, lag: float, begin: float) -> Array:
    """
    Return what follows with a lag what is held.

    Parameters
    ----------
    steady : ndarray, shape (..., n)
        What is held over each span.
    lengths : ndarray, shape (n,)
        Of the spans [s].
    lag : float
        [s], above 0.
    begin : float
        Where it is before the first span.

    Returns
    -------
    ndarray, shape (..., n + 1)
        Where it is at the start of each span, and at the end of the last one.

    """
    decay = np.exp(-lengths / lag)
    added = -steady * np.expm1(-lengths / lag)
    added[..., :1] += decay[:1] * begin
    return np.concatenate([np.full((*steady.shape[:-1], 1), begin),
                           linear_recurrence(decay, added)], axis=-1)
