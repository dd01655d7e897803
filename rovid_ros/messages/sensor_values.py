"""
What a sensor reports for a value of the simulator: the frames and units of its messages.

Values come in body FLU, world ENU and SI units, as in :class:`rovid_core.model.samples.Sample`.
Each function undoes one conversion of ``convert.py``.
"""

from __future__ import annotations

import math

from rovid_core.model.dofs import Quaternion
from rovid_core.model.quaternions import from_yaw, product
from rovid_core.settings.run import Settings

Values = tuple[float, ...]

NED_TO_ENU: Quaternion = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # and back: half a turn
FRD_TO_FLU: Quaternion = (1.0, 0.0, 0.0, 0.0)


def vector(settings: Settings, name: str, value: Values) -> Values:
    """Return x, y, z of a position (world) or of a velocity (body) in the message's frame."""
    x, y, z = value[:3]
    if settings.frames == 'enu':
        return (x, y, z)
    return (y, x, -z) if name == 'position' else (x, -y, -z)


def quaternion(settings: Settings, value: Values) -> Quaternion:
    """Return the attitude in the message's frames, before ``yaw_offset`` was added."""
    x, y, z, w = value
    turned = product(from_yaw(-settings.yaw_offset), (x, y, z, w))
    if settings.frames == 'enu':
        return turned
    return product(product(NED_TO_ENU, turned), FRD_TO_FLU)


def heading(settings: Settings, value: Values) -> float:
    """Return the heading in the message's unit and sense."""
    x, y, z, w = value
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)) - settings.yaw_offset
    frames = settings.heading_frames or settings.frames
    angle = math.remainder(0.5 * math.pi - yaw if frames == 'ned' else yaw, 2.0 * math.pi)
    return math.degrees(angle) if settings.heading_unit == 'deg' else angle


def depth(settings: Settings, value: Values) -> float:
    """Return the reading that ``scale`` and ``offset`` turn into this z [m]."""
    return (value[0] - settings.depth_offset) / settings.depth_scale
