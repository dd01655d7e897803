"""How far ahead of the middle of a vehicle its motion is measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rovid_ros.discovery.motion import answer, best_delay, held, Motion
from rovid_ros.discovery.signals import Array
from rovid_ros.discovery.thrusters import EXPLAINED, patterns_of, SURE

_ROUNDS = 6  # in which drag and couplings are of the velocity of the middle, too
_LEAST = 0.01  # share of sway below which an arm makes no difference


def lever_arm(moved: Motion, times: Array, commands: Array) -> float:
    """
    Return how far ahead of the middle [m] surge and sway are measured, 0 if the log does not say.

    What is ahead of the middle goes sideways as fast as the vehicle turns times that arm. Where
    it is not known, thrusters that turn the vehicle seem to push it sideways. Of a vehicle that no
    thruster pushes sideways it is not told from how it slips in a turn. ``commands`` have a row
    per time [s].
    """
    if moved.turned is None or not {'sway', 'yaw'} <= moved.velocities.keys():
        return 0.0
    together, *_ = patterns_of(times, commands)
    if not together.shape[1]:
        return 0.0
    delay = best_delay(moved, times, dict.fromkeys(('sway', 'yaw'), together))
    pushing = held(times + delay, together, moved.times, moved.halves['sway'])
    turning, arm, best, error, explained = moved.turning('sway'), 0.0, 0.0, 0.0, 0.0
    for _ in range(_ROUNDS):
        push = answer(seen_from_middle(moved, arm), 'sway', pushing, turning)
        if push is None:
            return 0.0
        if push.explained <= explained:
            break  # it leads away from what the thrust says
        best, explained = arm, push.explained
        more, error = push.swung
        arm += more
    sway = moved.velocities['sway']
    known = np.isfinite(sway) & np.isfinite(turning)
    tells = abs(best) > SURE * error and explained > EXPLAINED and (
        best * best * np.var(turning[known]) > _LEAST * np.var(sway[known]))
    return round(best, 2) if tells else 0.0


def seen_from_middle(moved: Motion, arm: float) -> Motion:
    """Return the motion of the middle of a vehicle that is measured so far ahead of it [m]."""
    sway: Array = moved.velocities['sway'] - arm * moved.turning('sway')
    return replace(moved, velocities={**moved.velocities, 'sway': sway})
