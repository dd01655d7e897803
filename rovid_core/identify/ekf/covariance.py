"""
A covariance of position, velocity and five constants, in plain floats.

It is the upper triangle by rows: 28 floats, so symmetric to the last bit. Written out it
takes a tenth of the time that numpy needs for matrices this small.
"""

from __future__ import annotations

from collections.abc import Sequence

from rovid_core.model.dofs import Four

SIZE = 7
Packed = tuple[float, ...]
Seven = tuple[float, float, float, float, float, float, float]
Five = tuple[float, float, float, float, float]

INDICES = tuple([tuple([SIZE * min(i, j) - min(i, j) * (min(i, j) + 1) // 2 + max(i, j)
                        for j in range(SIZE)]) for i in range(SIZE)])
"""Where row i has its columns."""

DIAGONAL = tuple([INDICES[i][i] for i in range(SIZE)])


def diagonal(variances: Sequence[float]) -> Packed:
    """Return a covariance of 7 variances alone."""
    return widened((0.0,) * (SIZE * (SIZE + 1) // 2), variances)


def packed(rows: Sequence[Sequence[float]]) -> Packed:
    """Return a covariance from its rows; raises ValueError unless it is symmetric."""
    if [len(row) for row in rows] != [SIZE] * SIZE or any(
            rows[i][j] != rows[j][i] for i in range(SIZE) for j in range(i)):
        raise ValueError('not a covariance')
    return tuple([float(x) for i, row in enumerate(rows) for x in row[i:]])


def row(p: Packed, i: int) -> Seven:
    """Return row ``i``."""
    return p[:SIZE] if i == 0 else tuple([p[k] for k in INDICES[i]])  # type: ignore[return-value]


def widened(p: Packed, added: Sequence[float]) -> Packed:
    """Return it with variances added, from the first state on."""
    entries = list(p)
    for k, variance in zip(DIAGONAL, added):
        entries[k] += variance
    return tuple(entries)


def still(p: Packed, variance: tuple[float, float]) -> Packed:
    """Return it with new variances of position and velocity, which hang together with nothing."""
    none = (0.0,) * 5
    return (variance[0], 0.0, *none, variance[1], *none, *p[13:])


def updated(p: Packed, r: Seven, adapt: bool) -> Packed:
    """
    Return it less r r', which is what a measurement tells.

    Parameters
    ----------
    p : Packed
        The covariance.
    r : tuple of 7 floats
        Row of what was measured, over the standard deviation of the innovation.
    adapt : bool
        False leaves the constants as uncertain as they are.

    """
    (p00, p01, p02, p03, p04, p05, p06,
     p11, p12, p13, p14, p15, p16,
     p22, p23, p24, p25, p26,
     p33, p34, p35, p36,
     p44, p45, p46,
     p55, p56,
     p66) = p
    a, b, c, d, e, f, g = r
    motion = (
        p00 - a * a, p01 - a * b, p02 - a * c, p03 - a * d, p04 - a * e, p05 - a * f, p06 - a * g,
        p11 - b * b, p12 - b * c, p13 - b * d, p14 - b * e, p15 - b * f, p16 - b * g)
    if not adapt:
        return (*motion, *p[13:])
    return (
        *motion,
        p22 - c * c, p23 - c * d, p24 - c * e, p25 - c * f, p26 - c * g,
        p33 - d * d, p34 - d * e, p35 - d * f, p36 - d * g,
        p44 - e * e, p45 - e * f, p46 - e * g,
        p55 - f * f, p56 - f * g,
        p66 - g * g)


class Transition:
    """
    How position and velocity after a step follow the state before it.

    x + share v + bend phi . c   and   keep v + share phi . c   for constants c.

    Parameters
    ----------
    share, bend : float
        [s], [s^2]
    keep : float
        What is left of a velocity.
    phi : tuple of 4 floats
        Derivatives of the acceleration by the constants: the third but last is 1 and not
        given.

    """

    def __init__(self, share: float, bend: float, keep: float, phi: Four) -> None:
        self._share, self._bend, self._keep, self._phi = share, bend, keep, phi

    def of(self, x: Seven) -> Seven:
        """Return a state, or a row of a covariance, after the step."""
        a, b, c, d, e, f, g = x
        s, t, u, w = self._phi
        moved = s * c + t * d + u * e + f + w * g
        return (a + self._share * b + self._bend * moved, self._keep * b + self._share * moved,
                c, d, e, f, g)

    def covariance(self, p: Packed, noise: tuple[float, float, float]) -> Packed:
        """Return a covariance after the step; ``noise`` comes to that of the motion."""
        (p00, p01, p02, p03, p04, p05, p06,
         p11, p12, p13, p14, p15, p16,
         p22, p23, p24, p25, p26,
         p33, p34, p35, p36,
         p44, p45, p46,
         p55, p56,
         p66) = p
        share, bend, keep, (s, t, u, w) = self._share, self._bend, self._keep, self._phi
        # phi . c with every state
        a0 = s * p02 + t * p03 + u * p04 + p05 + w * p06
        a1 = s * p12 + t * p13 + u * p14 + p15 + w * p16
        a2 = s * p22 + t * p23 + u * p24 + p25 + w * p26
        a3 = s * p23 + t * p33 + u * p34 + p35 + w * p36
        a4 = s * p24 + t * p34 + u * p44 + p45 + w * p46
        a5 = s * p25 + t * p35 + u * p45 + p55 + w * p56
        a6 = s * p26 + t * p36 + u * p46 + p56 + w * p66
        # the new position and velocity with every state of before, or the constants
        x0 = p00 + share * p01 + bend * a0
        x1 = p01 + share * p11 + bend * a1
        x2 = p02 + share * p12 + bend * a2
        x3 = p03 + share * p13 + bend * a3
        x4 = p04 + share * p14 + bend * a4
        x5 = p05 + share * p15 + bend * a5
        x6 = p06 + share * p16 + bend * a6
        v1 = keep * p11 + share * a1
        v2 = keep * p12 + share * a2
        v3 = keep * p13 + share * a3
        v4 = keep * p14 + share * a4
        v5 = keep * p15 + share * a5
        v6 = keep * p16 + share * a6
        x = s * x2 + t * x3 + u * x4 + x5 + w * x6
        v = s * v2 + t * v3 + u * v4 + v5 + w * v6
        return (
            x0 + share * x1 + bend * x + noise[0], keep * x1 + share * x + noise[1],
            x2, x3, x4, x5, x6,
            keep * v1 + share * v + noise[2], v2, v3, v4, v5, v6,
            *p[13:])
