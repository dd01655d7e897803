"""What is known of the current, in a status and in words."""

from __future__ import annotations

import math

import numpy as np
from rovid_core.identify.ekf.evidence.alternatives import Alternative
from rovid_core.identify.estimate import Current
from rovid_core.model.trajectory import Array

KNOWN, SEEN = 0.02, 1.0 / 3.0
"""Standard deviation [m/s] of a known current, and share of the prior of one that is seen."""

THRUST_ELSEWHERE = 'thrust on other headings'


def unseen_current(prior: float, advice: str) -> Current:
    """Return one of which nothing but its prior [m/s] is known, and what to do."""
    return Current(0.0, 0.0, (prior * prior, 0.0, prior * prior), math.nan, 'unobservable',
                   advice)


def current_with_status(found: tuple[Array, Array], prior: float, better: Alternative) -> Current:
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

    """
    (x, y), spread = found
    std = math.sqrt(max(float(np.diag(spread).max()), 0.0))
    current = Current(float(x), float(y), (float(spread[0, 0]), float(spread[0, 1]),
                                           float(spread[1, 1])), better.chi2, 'known')
    if not std < SEEN * prior:
        return current._replace(status='unobservable', advice=THRUST_ELSEWHERE)
    if better.advice:
        return current._replace(status='inconsistent', advice=better.advice)
    return current if std < KNOWN else current._replace(status='converging')


def why_not_known(current: Current) -> str:
    """Return why a current is not known, '' if it is."""
    if current.advice:
        return f'the current is {current.status}: {current.advice}'
    if current.status == 'known':
        return ''
    return (f'the current is known to {100.0 * max(current.std):.1f} cm/s, not yet to '
            f'{100.0 * KNOWN:g} cm/s: drive longer, on several headings')
