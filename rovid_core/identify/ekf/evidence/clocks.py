"""What an estimated delay of the thrust says of the clocks of thrust and motion."""

from __future__ import annotations

import math

from rovid_core.identify.ekf.evidence.block_fit import Verdict

DELAYS = (-0.05, 0.6)
"""Range of the delay [s]; far below 0 the force would have to be known ahead."""

BEYOND = 3.0
"""Standard deviations that data have to want the delay beyond its range, to mean it."""

AT_BOUND = 1e-3
"""[s] from the end of the range within which the delay stands at it."""


def clocks_in_doubt(verdict: Verdict | None, k: int, delay: float) -> str:
    """
    Return what is said of a delay out of its range or at its end, '' if it is inside.

    Parameters
    ----------
    verdict : Verdict or None
        What the blocks say.
    k : int
        Where the delay stands among the parameters.
    delay : float
        Of the filter, inside of its range [s].

    """
    # what the model lacks may look like a delay
    if verdict is None or verdict.missing is not None:
        return ''
    wanted, beyond = verdict.theta[k], BEYOND * math.sqrt(verdict.covariance[k][k])
    if wanted < DELAYS[0] - beyond:
        return (f'clocks disagree: thrust acts about {-wanted:.2g} s sooner than its stamps and '
                'thrusters.delay say: lower that, or raise thrusters.latency')
    if wanted > DELAYS[1] + beyond:
        return f'clocks disagree: motion is stamped about {wanted:.2g} s after its thrust'
    for bound, key in zip(DELAYS, ('thrusters.delay and thrusters.latency', 'thrusters.delay')):
        if abs(delay - bound) < AT_BOUND:
            return f'the delay of the thrust stands at its bound of {bound:g} s: see {key}'
    return ''
