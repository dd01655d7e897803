"""
What a vehicle may have that the data do not tell, and how far that would move the parameters.

In a thrust of one size a dead band of the thrusters looks like a larger mass. No test names it
there, and no block contradicts another. So a vehicle is taken to have, at even odds, one of the
terms of a catalogue, of a size that thrusters and hulls have; the data change the odds and the
size (J. A. Hoeting et al., Bayesian Model Averaging, Statistical Science 14(4), 1999). A term that
they tell adds next to nothing to an interval, one that they do not tell what it may be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.single.linearised_filter import ALPHA, BETA, GAMMA
from rovid_core.identify.ekf.single.watched_lag import LAGS
from rovid_core.identify.intervals import Z95

Array = NDArray[np.float64]

REVERSE_THRUST = 0.25
"""Of alpha: propellers give a tenth to a third less backwards, a T200 at 16 V a fifth."""

REVERSE_DRAG = 0.3
"""Of the drag at the typical speed: a blunt end against a rounded one."""

THRUST_LOSS = 0.25
"""
Of alpha, lost at the typical speed: a propeller that turns at n and moves along at v pushes by
n |n| less a part that grows with |n| v, so by the root of the force times v.
"""

OWN_QUESTIONS = ('thrust_loss', 'reverse_thrust')
"""What a vehicle may have whatever else it has."""

BY_EACH = {'thrust_loss': 'thrust_loss_of_each', 'reverse_thrust': 'reverse_of_each',
           'dead_band': 'dead_band_of_each'}
"""The same of thrusters that drive other DOFs, too: no function of the force of one DOF."""

LESS = ('dead_band', *LAGS, *BY_EACH.values(), 'thrust_loss')
"""What thrusters have that takes of their force: the other way about it is something else."""

SPOKEN = math.log(20.0)
"""Evidence from which data speak for a term: with it they are as much likelier."""

WEIGHTS = dict.fromkeys(LAGS, 0.5)
"""Of terms that are kinds of one thing: how likely each is before any data, beside others of 1."""

LARGEST_Z = 30.0
"""Standard deviations beyond which a coefficient of the wrong sign is as good as excluded."""

CLOSE = 1e-12
"""Relative step at which the end of an interval is found."""

MOST_SECANTS = 100
"""Steps of that search at most; it takes about ten."""


def expected(theta: Sequence[float]) -> dict[str, tuple[float, int]]:
    """
    Return the size that each term may have: its standard deviation and sign, 0 for either.

    Parameters
    ----------
    theta : sequence of p floats
        Parameters of the filter of one degree of freedom.

    """
    alpha, drag = abs(theta[ALPHA]), abs(theta[BETA]) + abs(theta[GAMMA])
    # a dead band is as wide as the one that is looked for (``DEAD_BAND``): a thrust by the square
    # of the command is bent as much. A lag is as long (``LAG``): thrusters spin up in 0.1 to 0.2 s
    return {'reverse_thrust': (REVERSE_THRUST * alpha, 0),
            'reverse_drag': (REVERSE_DRAG * drag, 0),
            'dead_band': (alpha, -1), 'lag': (alpha, -1), 'turns_lag': (alpha, -1),
            'thrust_loss': (THRUST_LOSS * alpha, -1)}


@dataclass(frozen=True)
class UnseenTerm:
    """
    A term that the vehicle may have.

    Attributes
    ----------
    leaning : list of floats
        What a coefficient of 1 that is left out moves the parameters by.
    evidence : float
        Logarithm of the odds that the data give for it.
    mean, variance : float
        Of its coefficient, if it is there.
    weight : float
        How likely it is before any data, beside others of 1.

    """

    leaning: list[float]
    evidence: float
    mean: float
    variance: float
    weight: float = 1.0


def judged(leaning: list[float], coefficient: float, information: float, std: float,
           sign: int) -> UnseenTerm:
    """
    Return what data say of a term.

    Parameters
    ----------
    leaning : list of floats
        What a coefficient of 1 that is left out moves the parameters by.
    coefficient, information : float
        What fits the data best, and the inverse of its variance; 0 where they do not tell.
    std : float
        Of the coefficient before any data, about 0.
    sign : int
        That it has, 0 for either.

    """
    power = std * std * information
    variance, mean = std * std / (1.0 + power), coefficient * power / (1.0 + power)
    evidence = 0.5 * (mean * coefficient * information - math.log1p(power))
    if sign and variance > 0.0:
        # the half of a Gaussian
        sigma = math.sqrt(variance)
        z = max(sign * mean / sigma, -LARGEST_Z)
        inside = 0.5 * math.erfc(-z / math.sqrt(2.0))
        ratio = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) / inside
        evidence += math.log(2.0 * inside)
        mean = sign * sigma * (z + ratio)
        variance *= max(1.0 - ratio * (z + ratio), 0.0)
    return UnseenTerm(leaning, evidence, mean, variance)


def by_question(terms: Mapping[str, UnseenTerm]) -> list[dict[str, UnseenTerm]]:
    """
    Return terms, by name, in groups of which the vehicle is taken to have one or none.

    Whether thrust falls with speed is a question of its own, and whether it is weaker backwards:
    most propellers are made for one way.
    """
    own = [{name: term for name, term in terms.items() if name.endswith(question)}
           for question in OWN_QUESTIONS]
    others = {name: term for name, term in terms.items() if not name.endswith(OWN_QUESTIONS)}
    return [group for group in (others, *own) if group]


def summed(terms: Sequence[UnseenTerm], size: int, there: bool = False) -> Array:
    """Return what terms add to a covariance that are ``there``, or each there at even odds."""
    return _spread(terms, [1.0 if there else 1.0 / (1.0 + math.exp(-min(term.evidence, 500.0)))
                           for term in terms], size)


def averaged(terms: Sequence[UnseenTerm], covariance: Array) -> Array:
    """
    Return what the doubt whether one of some terms is there adds to a covariance.

    It is as much as gives each parameter the 95 % interval that holds 95 % of the average over
    both kinds of vehicles. The variance of that average would say too much where a term that is
    large is unlikely.

    Parameters
    ----------
    terms : sequence of UnseenTerm
        At even odds one of them is there, before any data.
    covariance : ndarray, shape (p, p)
        Of the parameters of a vehicle that has none.

    """
    whole = math.fsum([term.weight for term in terms])
    odds = [term.weight / whole * math.exp(min(term.evidence, 500.0)) for term in terms]
    total = 1.0 + math.fsum(odds)
    shares = [one / total for one in odds]
    found = _spread(terms, shares, len(covariance))
    factors = np.zeros(len(covariance))
    for i in range(len(covariance)):
        own, more = float(covariance[i, i]), float(found[i, i])
        if more > 1e-12 * own > 0.0:
            parts = [(1.0 / total, 0.0, math.sqrt(own)), *[
                (share, abs(term.leaning[i] * term.mean),
                 math.sqrt(own + term.leaning[i]**2 * term.variance))
                for share, term in zip(shares, terms)]]
            wanted = (_half_width(parts) / Z95)**2
            factors[i] = math.sqrt(max(wanted - own, 0.0) / more)
    return factors[:, None] * found * factors


def foremost(terms: Mapping[str, UnseenTerm], i: int) -> str:
    """Return the name of the term that adds most to the variance of parameter ``i``."""
    def size(term: UnseenTerm) -> float:
        square = term.weight * term.leaning[i]**2 * (term.mean**2 + term.variance)
        return term.evidence + math.log(square) if square > 0.0 else -math.inf

    return max(terms, key=lambda name: size(terms[name]))


def _spread(terms: Sequence[UnseenTerm], shares: Sequence[float], size: int) -> Array:
    found = np.zeros((size, size))
    for term, share in zip(terms, shares):
        leaning = np.array(term.leaning)
        found = found + share * (term.mean**2 + term.variance) * np.outer(leaning, leaning)
    return found


def _half_width(parts: Sequence[tuple[float, float, float]]) -> float:
    """Return what 95 % lie within, either way of 0, of Gaussians: share, mean, deviation."""
    low = Z95 * min(std for _, _, std in parts)
    high = max(mean + Z95 * std for _, mean, std in parts)
    tails = [(0.5 * share, mean, std * math.sqrt(2.0)) for share, mean, std in parts]
    # a secant between both sides; of the one that stays twice the error is halved (Illinois)
    above, below, last = _beyond(low, tails) - 0.05, _beyond(high, tails) - 0.05, 0.0
    if not above > 0.0 > below:
        return low
    for _ in range(MOST_SECANTS):
        middle = high - below * (high - low) / (below - above)
        error = _beyond(middle, tails) - 0.05
        step = min(middle - low, high - middle) if error else 0.0
        if step <= CLOSE * high:
            break
        if error > 0.0:
            low, above = middle, error
            below *= 0.5 if last > 0.0 else 1.0
        else:
            high, below = middle, error
            above *= 0.5 if last < 0.0 else 1.0
        last = error
    return middle


def _beyond(width: float, tails: Sequence[tuple[float, float, float]]) -> float:
    """Return the share that lies beyond a width: half a share, mean, deviation times root of 2."""
    beyond = 0.0
    for half, mean, scale in tails:
        beyond += half * (math.erfc((width - mean) / scale) + math.erfc((width + mean) / scale))
    return beyond
