"""Why samples and steps are refused: every reason that is counted, and what it means."""

from __future__ import annotations

REASONS = {
    # messages
    'undecodable': 'the bytes are no message of the type',
    'too_large': 'longer than any message of a sensor',
    'lost': 'the middleware gave it up before the node took it',
    'incompatible_qos': 'a publisher offers less than the qos of the input asks for',
    'missing_index': 'the array is shorter than thrusters.field or another field asks for',
    'missing_name': 'a name of thrusters.names is not in the message',
    'wrong_length': 'the array has not one value per thruster',
    'not_numeric': 'the field holds something that is no number',
    'not_estimated': 'the sensor has none: a covariance of -1 (Imu) or no fix (NavSatFix)',
    'no_clock': 'unstamped, and the clock of the node stands at zero',
    'zero_stamp': 'unstamped; taken at the time of its arrival',
    # order in time
    'late': 'its stamp is further behind the other inputs than max_wait',
    'duplicate': 'its stamp is that of the message before',
    'backward': 'its stamp is before that of the message before',
    'future': 'its stamp was far ahead and no other input came as far',
    'overload': 'more came than could be taken, or waited for the slowest input',
    'discarded': 'it waited for the other inputs when time jumped back',
    # values
    'non_finite': 'not a number, or infinite',
    'not_a_rotation': 'a quaternion of no length',
    'force_out_of_range': 'the commands give a force that no vehicle has',
    'not_a_command': 'beyond twice thrusters.limit: no command, such as an unused channel',
    'no_sign': 'a command before the first message of thrusters.sign',
    'stale_sign': 'thrusters.sign has been silent for its timeout',
    'too_fast': 'it would mean a speed beyond velocity.max',
    'burst': 'ten times sooner than the one before: their difference is mostly noise',
    'outlier': 'it does not follow from the measurements before (velocity.gate)',
    'stuck': 'the sensor repeats the very same value under thrust',
    'overflow': 'too many measurements wait for their attitude',
    # steps that were not made
    'shifted': 'the measurement has jumped, and is followed from there',
    'gap': 'the first after a pause or a stuck sensor: it starts anew',
    'no_attitude': 'the attitude at its time is not known',
    'no_rate': 'the angular velocity at its time is not known, which its lever arm needs',
    'no_coupling': 'the velocities that its couplings need are not known',
    'no_thrust': 'there was no command before it',
    'stale_thrust': 'the last command is older than thrusters.timeout',
    'unstable_step': 'the gains are too high for so long a step',
    'out_of_range': 'force or velocity is absurd beside the typical ones',
    'diverged': 'the filter lost its way and starts from its last good parameters',
}
"""Reason -> what it means. Those from ``shifted`` on lose a step, not the measurement."""

STILL_USED = frozenset({'zero_stamp'})
"""Reasons that are counted although the sample is used."""
