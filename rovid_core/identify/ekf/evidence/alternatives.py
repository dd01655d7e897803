"""
What fits better than a current: a pull in the world, headings that are off, or late fixes.

Surge and sway see one current. A pull moves them by their own masses and drags, an offset of the
heading mixes them, and of late fixes the path turns after the vehicle has; all leave a current
behind that is not there, and what surge tells of it contradicts what sway tells. The score of the
blocks says what a regressor for each would explain, beside all parameters and the current.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from rovid_core.identify.ekf.evidence.block_fit import Regression, Verdict
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.evidence.vehicle_change import f_tail
from rovid_core.identify.ekf.planar.layout import AXES

FALSE_ALARM = 1e-5
"""Probability that one of them is found at the end of a block where there is none."""

PULL, HEADING, LATE = (-4, -3), (-2,), (-1,)
"""Where the regressors stand."""

LEAST_CURRENT = 0.02
"""[m/s] of current that a pull has to pretend, to be said."""

LEAST_OFFSET = math.radians(2.0)
"""[rad] of the headings that is said; less is what a good compass is off by."""

LEAST_LATENCY = 0.1
"""[s] of the fixes that is said; less is what thrusters are late by."""

DOUBTED_LATENCY = 0.25
"""[s] by which fixes may be late at even odds where the data do not tell: it is seldom known."""


class Alternative(NamedTuple):
    """
    What fits better than a current alone.

    Attributes
    ----------
    chi2 : float
        By how much -2 log of the likelihood falls with it.
    advice : str
        What it is and its size, '' where nothing fits better.

    """

    chi2: float
    advice: str = ''


NOT_JUDGED = Alternative(math.nan)


def better_than_a_current(blocks: ScoreBlocks, verdict: Verdict) -> Alternative:
    """
    Return what fits better than a current alone.

    Parameters
    ----------
    blocks : ScoreBlocks
        With the regressors at their end, and the current as the last parameters.
    verdict : Verdict
        Of these blocks.

    """
    best = Alternative(0.0)
    regressions = blocks.regressions((PULL, HEADING, LATE))
    for found, described in zip(regressions, (_pull, _offset, _latency)):
        if found is None:
            continue
        chi2, advice = min(found.power, found.t_squared), ''
        # what explains more is another regressor that the model lacks
        share = found.power / (found.power + blocks.measurements)
        least = verdict.missing.share if verdict.missing is not None else 0.0
        if share > least and _is_significant(found, verdict.count):
            advice = described(found)
        if (advice != '', chi2) > (best.advice != '', best.chi2):
            best = Alternative(chi2, advice)
    return best


def _is_significant(found: Regression, n: int) -> bool:
    """Tell whether neither chance nor the scatter of ``n`` blocks explains it."""
    k, power = len(found.kappa), max(found.power, 0.0)
    chance = math.exp(-0.5 * power) if k > 1 else math.erfc(math.sqrt(0.5 * power))
    # all three are looked for at the end of each block
    limit = FALSE_ALARM / 3.0
    return n > k and chance < limit and f_tail(
        found.t_squared * (n - k) / (k * (n - 1)), k, n - k) < limit


def _pull(found: Regression) -> str:
    if not float(np.linalg.norm(found.moved[-AXES:])) > LEAST_CURRENT:
        return ''
    return (f'a constant pull of {float(np.linalg.norm(found.kappa)):.1f} N fits better, as of a '
            'tether')


def _offset(found: Regression) -> str:
    offset = abs(float(found.kappa[0]))
    if not offset > LEAST_OFFSET:
        return ''
    return (f'headings that are off by {math.degrees(offset):.1f} degrees fit better, see '
            'attitude.yaw_offset')


def _latency(found: Regression) -> str:
    late = float(found.kappa[0])
    if not abs(late) > LEAST_LATENCY:
        return ''
    return (f'fixes that come {abs(late):.2g} s {"later" if late > 0.0 else "sooner"} than their '
            'stamps and latency say fit better, see position.latency')
