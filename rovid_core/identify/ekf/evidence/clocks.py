"""What an estimated delay of the thrust says of the clocks of thrust and motion."""

from __future__ import annotations

import math

from rovid_core.identify.ekf.evidence.block_fit import Verdict

DELAYS = (-0.05, 0.6)
"""Range of the delay [s]; far below 0 the force would have to be known ahead."""

AT_BOUND, BEYOND = 1.0, 2.0
"""
Standard deviations that the data have to want the delay out of its range, for it to be said that
it stands at the end of it, and for that by how much it is out: its 95 % interval is then.
"""


def clocks_in_doubt(verdict: Verdict | None, k: int, lag: float) -> str:
    """
    Return what is said of a delay out of its range or at its end, '' if it is inside.

    Parameters
    ----------
    verdict : Verdict or None
        What the blocks say.
    k : int
        Where the delay stands among the parameters.
    lag : float
        [s] by which the thrusters follow later besides.

    """
    # what the model lacks may look like a delay
    if verdict is None or verdict.missing is not None:
        return ''
    wanted, std = verdict.theta[k] + lag, math.sqrt(verdict.covariance[k][k])
    early, late = DELAYS[0] - wanted, wanted - DELAYS[1]
    if early > BEYOND * std:
        return (f'clocks disagree: thrust acts about {-wanted:.2g} s sooner than its stamps and '
                'thrusters.delay say: lower that, or raise thrusters.latency')
    if late > BEYOND * std:
        return (f'clocks disagree: motion is stamped about {wanted:.2g} s after its thrust: raise '
                'the latency of what measures it, or thrusters.delay')
    for beyond, bound, key in zip((early, late), DELAYS, (
            'thrusters.delay and thrusters.latency', 'thrusters.delay')):
        if beyond > AT_BOUND * std:
            return f'the delay of the thrust stands at its bound of {bound:g} s: see {key}'
    return ''
