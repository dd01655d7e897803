"""Which way round sensors are mounted or count: what two of them see of one motion."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
from rovid_ros.discovery.candidates import Candidate
from rovid_ros.discovery.lever_arm import seen_from_middle
from rovid_ros.discovery.motion import answer, held, Motion, motion, noise_of, STEP
from rovid_ros.discovery.signals import Array
from rovid_ros.discovery.thrusters import patterns_of, SURE, Thrusters

_ENOUGH, _STILL, _ALIKE = 50, 0.02, 0.5  # times; [m/s]; correlation of depth and position


def agreed_heave(inputs: dict[str, Candidate], depth: Candidate, frames: str, times: Array,
                 heave: Array, guesses: list[str]) -> Array:
    """Return the heave of the depth as the position agrees with it, or that of the position."""
    fixes = motion({'position': inputs['position'].signal, 'thrusters': depth.signal})
    own = np.interp(fixes.times, times, heave)
    up = fixes.velocities['heave'] * (-1.0 if frames == 'ned' else 1.0)
    both = np.isfinite(own) & np.isfinite(up)
    if both.sum() < _ENOUGH or np.std(up[both]) < _STILL:
        return heave
    alike = float(np.corrcoef(own[both], up[both])[0, 1])
    half = fixes.halves['heave']
    noisy = np.std(up[both]) < math.sqrt(2.0) * noise_of(
        inputs['position'].signal.values[:, 2]) / half
    if abs(alike) < _ALIKE and not noisy:
        guesses.append(f'depth: {depth.signal.place} does not move as the position does, so the '
                       'position is used for heave')
        del inputs['depth']
        return np.asarray(np.interp(times, fixes.times, up))
    if abs(alike) < SURE / math.sqrt(both.sum() * STEP / (2.0 * half)):
        return heave  # so noisy that it does not even tell the direction
    if alike > 0.0:
        return heave
    scale = -float(depth.keys.get('scale', 1.0))
    inputs['depth'] = replace(depth, keys={**depth.keys, 'scale': scale})
    guesses.append('depth.scale: negative, for the depth moves against the position' if scale < 0.0
                   else 'depth.scale: positive, for the depth moves with the position')
    return -heave


def mirrored(moved: Motion, depth: Candidate | None, thrusters: Thrusters) -> str:
    """
    Return why y and z of a measured velocity are the other way round than the attitude, or ''.

    ``moved`` takes them to be the same way round. In turns the inertia of a vehicle pushes it
    outwards, sideways by -u r, whatever its thrusters do; where a log does not show that, a depth
    tells.
    """
    push = None
    if moved.turned is not None and {'surge', 'sway', 'yaw'} <= moved.velocities.keys():
        together, *_ = patterns_of(thrusters.signal.times, thrusters.forces())
        pushing = held(thrusters.signal.times, together, moved.times, moved.halves['sway'])
        # of the middle, which is not known where it is not known how fast the vehicle turns
        push = answer(seen_from_middle(moved, 0.0), 'sway', pushing, moved.turning('sway'))
    kappa, error = push.coupled['ur'] if push else (0.0, 0.0)
    if abs(kappa) > SURE * error:
        return '' if kappa < 0.0 else 'otherwise inertia would push the vehicle inwards in turns'
    heave = moved.velocities.get('heave')
    if depth is None or heave is None:
        return ''
    rising = motion({'depth': depth.signal, 'thrusters': thrusters.signal}, None,
                    float(depth.keys.get('scale', 1.0)))
    own = np.interp(moved.times, rising.times, rising.velocities['heave'], np.nan, np.nan)
    both = np.isfinite(own) & np.isfinite(heave)
    against = both.sum() > _ENOUGH and min(np.std(own[both]), np.std(heave[both])) > 0.0 and (
        float(np.corrcoef(own[both], heave[both])[0, 1]) < -_ALIKE)
    return f'its third number goes against that of {depth.signal.place}' if against else ''
