"""Why samples and steps are refused: every reason once, with its meaning."""

from __future__ import annotations

REASONS: dict[str, str] = {
    # one message by itself
    'undecodable': 'the bytes are not those of the type',
    'missing_index': 'the array is shorter than the field path asks for',
    'missing_name': 'a name of thrusters.names is not in the message',
    'wrong_length': 'not as many values as there are thrusters',
    'not_numeric': 'the field holds no numbers',
    'non_finite': 'NaN or infinite',
    'not_a_rotation': 'a quaternion of length 0 or of no finite length',
    'force_out_of_range': 'the commands give an impossible force',
    'no_sign': 'no message of thrusters.sign came before the command',
    # its time
    'zero_stamp': 'the stamp is 0; the receive time was taken',
    'no_clock': 'simulated time has not begun',
    'late': 'came more than max_wait after newer ones of other inputs',
    'duplicate': 'has the stamp of the one before',
    'backward': 'the stamp is before that of the one before',
    'future': 'the stamp was far ahead, and nothing agreed with it',
    'discarded': 'was waiting when time jumped back',
    # against the others
    'gap': 'came more than max_gap after the one before',
    'too_fast': 'would be faster than velocity.max',
    'shifted': 'two agree after a leap; taken up from there',
    'no_attitude': 'there is no attitude for that time',
    'no_thrust': 'there is no thruster command yet',
    'stale_thrust': 'the last command is older than thrusters.timeout',
    # in the identifier
    'unstable_step': 'the gains are too high for a step so long',
    'out_of_range': 'the parameters would leave their bounds',
    'diverged': 'the filter no longer follows the data',
}
"""Reason to meaning, each a clause that goes on from the reason's name."""
