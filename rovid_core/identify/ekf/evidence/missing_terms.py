"""What is wrong with a model, in words: a regressor that it lacks, or clocks that disagree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from rovid_core.identify.ekf.evidence.verdict import (
    LAG_SHAPE,
    Missing,
    OTHERWISE,
    Verdict,
)
from rovid_core.identify.ekf.normalised_model import DELAY_STD, DELAYS
from rovid_core.identify.ekf.single.linearised_filter import (
    ALPHA,
    BETA,
    CANDIDATES,
    GAMMA,
)
from rovid_core.identify.ekf.single.watched_lag import LAG, LAGS
from rovid_core.identify.estimate import KNOWN_CURRENT
from rovid_core.identify.last_minute import KEYS, lacking, share_of_error, UNTOLD_DEAD_BAND
from rovid_core.model.dofs import EACH, Four
from rovid_core.model.thrusters import DEAD_BAND, Thrusters
from rovid_core.settings.inputs import LONGEST_LAG
from rovid_core.settings.run import Scales

COUPLING_MISSING = 'without that coupling nothing else can be judged'
"""Why a model may not be used that ``is_coupling`` says something of."""

UNTOLD = {
    'reverse_thrust': 'weaker thrust in reverse cannot be told from the mass yet: push both ways',
    'reverse_drag': 'other drag in reverse cannot be told from the mass yet: move both ways',
    'dead_band': UNTOLD_DEAD_BAND,
    **dict.fromkeys(LAGS, 'a lag of the thrusters cannot be told from the mass yet: change the '
                          'thrust more often'),
    LAG_SHAPE: 'whether the thrusters lag or what measures the motion cannot be told, which '
               'leaves the mass open: if it is the thrusters, set thrusters.time_constant',
    OTHERWISE: 'the thrust comes and goes otherwise than with a delay and a lag, which leaves the '
               'mass open: take measured turns or currents in place of commands',
    'thrust_loss': 'thrust that falls with speed cannot be told from the drag yet: coast now and '
                   'then'}
"""What to do about a term that a log does not tell, by its name."""

ODD = {
    'dead_band': 'small commands, which push more than the model of the thrusters says',
    'dead_band_of_each': 'small commands, which push more than the model of each thruster says',
    **dict.fromkeys(LAGS, 'quick changes of the thrust, which move it more than the model says'),
    'thrust_loss': 'fast motion under thrust, which is faster than the model says',
    'thrust_loss_of_each': 'fast motion under thrust, which is faster than the model says'}
"""What the error follows where a term has the sign that no thruster gives it."""

ALIKE = 'about 1.00 of the forward one'
"""Of what makes no difference, as it would be printed: it is not named."""

MOST = 2.0
"""Of the forward thrust, from which on none of thrusters is as strong backwards."""

EMPTY = 0.5
"""Share of its thrust that a vehicle with a battery does not lose."""

UNEXPLAINED, MANY_BLOCKS = 3.0, 12
"""Scatter of the blocks, and their number, from which it is worth a word."""

AT_BOUND, BEYOND = 1.0, 2.0
"""
Standard deviations that the data have to want the delay out of its range, for it to be said that
it stands at the end of it, and for that by how much it is out: its 95 % interval is then.
"""

HARDLY = 3.0 * DELAY_STD
"""
[s] of delay from which on it is rather something else that acts late, such as an inertia that slow
motion hardly shows.
"""


def is_coupling(missing: Missing | None) -> bool:
    """
    Tell whether a coupling of the DOF is missing.

    Until it is added nothing can be said of what else the model lacks: what is found first hides
    the rest.
    """
    # in the filter of two DOFs the name begins with that of one
    name = missing.name.split()[-1] if missing is not None else 'current'
    return name != 'current' and name not in CANDIDATES and name not in EACH


def described(missing: Missing, theta: Sequence[float], scales: Scales) -> str:
    """
    Return a missing regressor in words, '' where it makes no difference that could be told.

    Parameters
    ----------
    missing : Missing
        The regressor.
    theta : sequence of p floats
        Parameters of the filter.
    scales : Scales
        Of the degree of freedom.

    """
    kappa, alpha = missing.coefficient, theta[ALPHA]
    if missing.name == 'reverse_of_each':
        if not 0.0 <= 1.0 + kappa / alpha < MOST:
            return (f'{share_of_error(missing.share)} of the error follows which of the thrusters '
                    'run backwards')
        said = ('the reverse thrust of each thruster: about '
                f'{1.0 + kappa / alpha:.2f} of the forward one')
    elif missing.name == 'reverse_thrust':
        said = f'reverse thrust: about {max(1.0 + kappa / alpha, 0.0):.2f} of the forward one'
    elif missing.name == 'reverse_drag':
        drag = 1.0 + kappa / theta[BETA] if theta[BETA] else 0.0
        said = 'reverse drag' + (f': about {drag:.2f} of the forward one' if drag > 0.0 else '')
    elif missing.name in ODD:
        if kappa >= 0.0:  # the other way about it is none of thrusters
            return f'{share_of_error(missing.share)} of the error follows {ODD[missing.name]}'
        said = _of_force(missing.name, kappa / alpha, scales.force)
        if not said:
            return (f'{share_of_error(missing.share)} of the error follows the thrust more slowly '
                    'than thrusters do: is what is measured smoothed?')
    elif missing.name == 'current':
        # it is dragged along at the slope of the drag at half of the typical velocity
        slope = abs(theta[BETA]) + abs(theta[GAMMA])
        size = kappa / slope if slope > 0.0 else math.inf  # in typical velocities
        if size * scales.velocity < KNOWN_CURRENT:
            return ''  # nobody would call it one
        said = 'the heading' + ('' if size > 1.0 else (
            f', as with a current of about {size * scales.velocity:.2g} m/s'))
    else:
        name = missing.name
        written = name.replace('_', ' ') if '_' in name else ' '.join(name)
        return (f'{share_of_error(missing.share)} of the error follows {written} with a '
                f'coefficient of about {kappa * scales.velocity:.2g}: add couplings: '
                f'[{", ".join([*scales.couplings, name])}]')
    return '' if ALIKE in said else lacking(
        missing.share, missing.name, said, scales.couplings)


def _of_force(name: str, share: float, force: float) -> str:
    """Return what the thrusters do, for a coefficient relative to alpha; '' if none do so."""
    if name in ('dead_band', 'dead_band_of_each'):
        width, whose = -share * DEAD_BAND * force, 'the thrusters' if name == 'dead_band' else (
            'each thruster, together')
        return f'a dead band of {whose} of about {width:.2g} in units of force'
    if name == 'thrust_loss_of_each':
        return ('the thrust of each thruster, which falls with speed, by about '
                f'{-100.0 * share:.0f} %')
    if name == 'thrust_loss':
        return f'thrust that falls with speed, by about {-100.0 * share:.0f} %'
    lag = math.sqrt(_square_of_lag(share))
    whose = "thrusters' turns" if name == 'turns_lag' else 'thrusters'
    return f'a lag of the {whose} of about {lag:.2f} s' if lag <= LONGEST_LAG else ''


def of_thrusters(thrusters: Thrusters, force: float) -> list[str]:
    """Return what is said of what was found of thrusters, in units of a force."""
    ahead, astern = thrusters.shares
    weaker = f'reverse thrust is about {astern:.2f} of the forward' if ahead > astern else (
        f'forward thrust is about {ahead:.2f} of the reverse')
    said = {
        'lag': f'the thrusters lag by about {thrusters.lag:.2f} s more than the model says, or '
               'what measures the motion does',
        'turns_lag': f"the thrusters' turns lag by about {thrusters.lag:.2f} s more than the "
                     'model says' + (
                         f' at a force of {thrusters.lag_at * force:.2g}, and longer at smaller '
                         'ones, as a current or torque drives them' if thrusters.lag_at else ''),
        'dead_band': 'the thrusters have a dead band of about '
                     f'{thrusters.dead_band * force:.2g} in units of force',
        'reverse_thrust': f'{weaker} one',
        'thrust_loss': f'thrust falls with speed, by about {100.0 * thrusters.loss:.0f} % at the '
                       'typical one'}
    return [f'{said[name]}, which is taken into account'
            + KEYS['torque' if name == 'turns_lag' and thrusters.lag_at else name]
            for name in thrusters.found]


def drifting(verdict: Verdict | None, parameters: Callable[[Sequence[float]], Four],
             changed: bool, begin: int = 0, end: int | None = None) -> str:
    """
    Return what is said of thrust that falls while the data go on, '' if it does not.

    Parameters
    ----------
    verdict : Verdict or None
        What the blocks say.
    parameters : callable
        Makes those of the vehicle from those of the filter.
    changed : bool
        Whether the data begin where the vehicle changed, which is not with a full battery.
    begin, end : int
        Where the latter stand.

    """
    if verdict is None or not verdict.drift:
        return ''
    alpha = parameters(verdict.begin[begin:end])[0]
    mass = '' if changed or not alpha > 0.0 else (
        f' (with the thrust of the beginning the mass is {1.0 / alpha:.4g})')
    what = 'as with a battery that runs down' if -verdict.drift < EMPTY else (
        'which is more than a battery makes of it')
    return (f'thrust falls by {-100.0 * verdict.drift:.0f} % from the beginning to the end of the '
            f'data, {what}; the interval of the mass takes it into account{mass}')


def remarks(verdict: Verdict | None, missing: Missing | None, theta: Sequence[float],
            scales: Scales, limit: float, prefix: str = '', first: int = 0) -> list[str]:
    """
    Return what is said of a model that lacks something, or may lack what the data do not tell.

    Parameters
    ----------
    verdict : Verdict or None
        What the blocks say.
    missing : Missing or None
        What the model lacks.
    theta : sequence of p floats
        Parameters of the filter.
    scales : Scales
        Of the degree of freedom.
    limit : float
        Standard deviation of alpha, relative to it, from which on it is worth a word what the
        data do not tell.
    prefix : str
        Of the names of what they do not tell, which is about this DOF.
    first : int
        Where its parameters stand among those of the verdict.

    """
    if verdict is None:
        return []
    if missing is not None:
        return [described(missing, theta, scales)]
    if verdict.scatter > UNEXPLAINED and verdict.count >= MANY_BLOCKS:
        return ['the model does not explain all of the motion: the intervals are wider']
    i = first + ALPHA
    if verdict.covariance[i][i] <= (limit * theta[ALPHA])**2:
        return []
    return [UNTOLD[name.removeprefix(prefix)] for name in verdict.untold
            if name.startswith(prefix)]


def better_thrusters(now: Thrusters, missing: Missing, alpha: float) -> Thrusters:
    """
    Return thrusters that also have what is missing, the same where that is something else.

    ``alpha`` is that of the filter, which lacks it.
    """
    if not missing.alpha > 0.0:
        return now
    share = missing.coefficient / missing.alpha
    if missing.name in LAGS:
        turns = missing.name == LAGS[1]
        if now.lag and now.turns != turns:
            return now._replace(turns=turns, lag_at=0.0)
        lag = math.sqrt(max(
            now.lag * now.lag + _square_of_lag(missing.coefficient / alpha), 0.0))
        if lag > DELAYS[1]:
            return now
        return now._replace(lag=lag, turns=turns and lag > 0.0,
                            lag_at=now.lag_at if lag > 0.0 else 0.0)
    if missing.name == 'dead_band':
        return now._replace(dead_band=max(now.dead_band - share * DEAD_BAND, 0.0))
    if missing.name == 'thrust_loss':
        return now._replace(loss=max(now.loss - share, 0.0))
    if missing.name == 'reverse_thrust' and share > -1.0:
        return now._replace(reverse=now.reverse * (1.0 + share))
    return now


def _square_of_lag(share: float) -> float:
    """
    Return the square of the lag that is missing [s^2], below 0 where it is too long.

    The delay has taken a part of it: what is left is told by the bend of the response, the
    variance of when a thrust acts. The variances of lags that follow each other add up.
    """
    late = -share
    return LAG * LAG * (late * (2.0 - late) if late < 1.0 else late * late)


def share_of_lag(lag: float) -> float:
    """Return the share of alpha that a lag [s] has as a coefficient, the delay taken off."""
    late = lag / LAG
    return late if late > 1.0 else 1.0 - math.sqrt(1.0 - late * late)


def clocks_in_doubt(verdict: Verdict | None, k: int, lag: float) -> str:
    """
    Return what is said of a delay that is hardly one, or none that there can be; '' for others.

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
    if verdict.theta[k] > HARDLY:
        return (f'the thrust seems to act {verdict.theta[k]:.2f} s late, as it hardly ever does: '
                'set thrusters.delay if it does, else drive with quicker changes of thrust')
    return ''
