"""
What is known of the current, and why no more: no turn yet, or something else that fits better.

Only once the vehicle has turned a current can be told from drag and bias. Then surge and sway see
one current. A pull in the world moves them by their own masses and drags, an offset of the
heading mixes them, of late fixes the path turns after the vehicle has, and a sensor that is not in
the middle swings round with it; all leave a current behind that is not there, and what surge tells
of it contradicts what sway tells. The score of the blocks says what a regressor for each would
explain, beside all parameters and the current.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np
from rovid_core.identify.ekf.batch_start import PERIOD
from rovid_core.identify.ekf.evidence.missing_terms import is_coupling
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.evidence.vehicle_change import f_tail
from rovid_core.identify.ekf.evidence.verdict import Regression, Verdict
from rovid_core.identify.ekf.planar.layout import AXES
from rovid_core.identify.estimate import Current, KNOWN_CURRENT, TURN
from rovid_core.identify.method import floats
from rovid_core.model.dofs import THRUSTS
from rovid_core.model.plant import Array
from rovid_core.model.samples import PlanarPiece

TURNED = 0.8
"""[rad] Range of headings from which the current can be told from bias and drag."""

SEEN = 1.0 / 3.0
"""Standard deviation of a current that is seen, as a share of its prior."""

THRUST_ELSEWHERE = 'thrust on other headings'

COUPLING_FIRST = 'a coupling is missing, which may look like one'

FALSE_ALTERNATIVE = 1e-5
"""Probability that something that fits better is found at the end of a block by chance."""

ARM, PULL, HEADING, LATE = (-6, -5), (-4, -3), (-2,), (-1,)
"""Where the regressors of what may fit better stand."""

LEAST_ARM = 0.1
"""[m] from the middle of the vehicle to the sensor, to be said."""

LEAST_CURRENT = 0.02
"""[m/s] of current that a pull has to pretend, to be said."""

LEAST_OFFSET = math.radians(2.0)
"""[rad] of the headings that is said; less is what a good compass is off by."""

LEAST_LATENCY = 0.1
"""[s] of the fixes that is said; less is what thrusters are late by."""

DOUBTED_LATENCY = 0.25
"""[s] by which fixes may be late at even odds where the data do not tell: it is seldom known."""


class Turning:
    """
    The range of headings since the start began, and when it was wide enough.

    Times are those of thrust: what moves without it says nothing of the vehicle.

    Attributes
    ----------
    turned_at : float
        [s] since the start began; infinite until it has turned.

    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Begin to look whether the vehicle turns."""
        self._heading, self._range = 0.0, (0.0, 0.0)
        self.turned_at = math.inf

    def add(self, pieces: Sequence[PlanarPiece], h: float, duration: float) -> None:
        """Go on by pieces of ``h`` [s] each; ``duration`` [s] is that of the start."""
        low, high = self._range
        for piece in pieces:
            self._heading += h * piece.rate
            low, high = min(low, self._heading), max(high, self._heading)
        self._range = low, high
        if high - low > TURNED and not self.has_turned:
            self.turned_at = duration

    @property
    def has_turned(self) -> bool:
        """Tell whether headings so far apart have been seen."""
        return self.turned_at < math.inf

    def lacks(self, duration: float) -> float:
        """Return how much thrust [s] is still needed after the turn, infinite before."""
        return max(self.turned_at + PERIOD - duration, 0.0)

    def advice(self, duration: float) -> str:
        """Return what to do until the current is looked for."""
        if not self.has_turned:
            return TURN
        # in steps of 5 s, so that it is not another text at each fix
        left = 5.0 * math.ceil(0.2 * self.lacks(duration))
        return f'after the turn, thrust for {left:.0f} s more'

    def state(self) -> list[float]:
        """Return the headings [rad]."""
        return [self._heading, *self._range]

    def restore(self, headings: Sequence[float], turned_at: float | None) -> None:
        """Go on from headings [rad] and the time of the turn [s], None for none."""
        self._heading, low, high = floats(headings, 3)
        self._range = low, high
        self.turned_at = math.inf if turned_at is None else float(turned_at)


def unseen_current(prior: float, advice: str) -> Current:
    """Return one of which nothing but its prior [m/s] is known, and what to do."""
    return Current(0.0, 0.0, (prior * prior, 0.0, prior * prior), math.nan, 'unobservable',
                   advice)


def current_with_status(found: tuple[Array, Array], prior: float, better: Alternative,
                        was_known: bool) -> Current:
    """
    Return a current with its status.

    Parameters
    ----------
    found : pair of ndarrays, shapes (2,) and (2, 2)
        The current [m/s] and its covariance.
    prior : float
        Standard deviation before anything was known [m/s].
    better : Alternative
        What fits better than a current.
    was_known : bool
        Whether it was known before the vehicle changed, if it did.

    """
    (x, y), spread = found
    std = math.sqrt(max(float(np.diag(spread).max()), 0.0))
    current = Current(float(x), float(y), (float(spread[0, 0]), float(spread[0, 1]),
                                           float(spread[1, 1])), better.chi2, 'known')
    if not std < SEEN * prior:
        return current._replace(status='unobservable', advice=better.advice or THRUST_ELSEWHERE)
    if better.advice:
        return current._replace(status='inconsistent', advice=better.advice)
    # before the blocks can say that it is no current its standard deviation takes it for one
    is_judged = was_known or math.isfinite(better.chi2)
    return current if is_judged and std < KNOWN_CURRENT else current._replace(status='converging')


def why_not_known(current: Current) -> str:
    """Return why a current is not known yet, '' if it is."""
    if current.advice:
        return f'the current is {current.status}: {current.advice}'
    if current.status == 'known':
        return ''
    if max(current.std) < KNOWN_CURRENT:
        return 'there is too little motion yet to tell a current from what else may look like one'
    return (f'the current is known to {100.0 * max(current.std):.1f} cm/s, not yet to '
            f'{100.0 * KNOWN_CURRENT:g} cm/s: drive longer, on several headings')


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
    missing = verdict.missing
    # a sensor ahead of the middle moves with the turns that yaw thrust makes
    may_be_an_arm = missing is not None and missing.name.split()[-1] in THRUSTS
    if is_coupling(missing) and not may_be_an_arm:
        return Alternative(math.nan, COUPLING_FIRST)
    best = Alternative(0.0)
    regressions = blocks.regressions((ARM, PULL, HEADING, LATE))
    for found, described in zip(regressions, (_arm, _pull, _offset, _latency)):
        if found is None:
            continue
        chi2, advice = min(found.power, found.t_squared), ''
        # what explains more is another regressor that the model lacks
        share = found.power / (found.power + blocks.measurements)
        least = missing.share if missing is not None else 0.0
        if share > least and _is_significant(found, verdict.count):
            advice = described(found)
        if (advice != '', chi2) > (best.advice != '', best.chi2):
            best = Alternative(chi2, advice)
    return Alternative(math.nan, COUPLING_FIRST) if may_be_an_arm and not best.advice else best


def _is_significant(found: Regression, n: int) -> bool:
    """Tell whether neither chance nor the scatter of ``n`` blocks explains it."""
    k, power = len(found.kappa), max(found.power, 0.0)
    chance = math.exp(-0.5 * power) if k > 1 else math.erfc(math.sqrt(0.5 * power))
    # all four are looked for at the end of each block
    limit = FALSE_ALTERNATIVE / 4.0
    return n > k and chance < limit and f_tail(
        found.t_squared * (n - k) / (k * (n - 1)), k, n - k) < limit


def _arm(found: Regression) -> str:
    ahead, to_port = found.kappa.tolist()
    if not math.hypot(ahead, to_port) > LEAST_ARM:
        return ''
    return (f'fixes of a sensor {abs(ahead):.2f} m {"ahead of" if ahead > 0.0 else "behind"} the '
            f'middle and {abs(to_port):.2f} m to {"port" if to_port > 0.0 else "starboard"} fit '
            'better, see position.lever_arm')


def _pull(found: Regression) -> str:
    if not float(np.linalg.norm(found.moved[-AXES:])) > LEAST_CURRENT:
        return ''
    return (f'a constant pull of {float(np.linalg.norm(found.kappa)):.2g} in units of force fits '
            'better, as of a tether')


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
