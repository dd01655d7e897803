"""Unit quaternions (x, y, z, w) in plain floats: the online path needs no arrays."""

from __future__ import annotations

import math

from rovid_core.model.dofs import Quaternion, Vector


def normalised(q: Quaternion) -> Quaternion:
    """Return ``q`` at unit length; raises ValueError when it has none (zero or non-finite)."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not 0.0 < length < math.inf:
        raise ValueError(f'a quaternion of length {length}')
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def from_yaw(yaw: float) -> Quaternion:
    """Return the attitude of a level body with this heading [rad], counter-clockwise."""
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product ``p q``: first ``q``, then ``p``."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Turn a body vector into the world."""
    x, y, z, w = q
    # v + 2 u x (u x v + w v), with u the vector part of q
    cx = y * v[2] - z * v[1] + w * v[0]
    cy = z * v[0] - x * v[2] + w * v[1]
    cz = x * v[1] - y * v[0] + w * v[2]
    return (
        v[0] + 2.0 * (y * cz - z * cy),
        v[1] + 2.0 * (z * cx - x * cz),
        v[2] + 2.0 * (x * cy - y * cx),
    )


def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """Turn a world vector into the body."""
    return rotate((-q[0], -q[1], -q[2], q[3]), v)


def rotation_between(p: Quaternion, q: Quaternion) -> Vector:
    """
    Return the rotation vector [rad] in body axes that takes attitude ``p`` to ``q``.

    ``q`` and ``-q`` are the same attitude; the short way round is taken, so headings
    never wrap.
    """
    x, y, z, w = product((-p[0], -p[1], -p[2], p[3]), q)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    # the limit of angle / sin(angle / 2) for small angles is 2
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (x * scale, y * scale, z * scale)


def between(p: Quaternion, q: Quaternion, fraction: float) -> Quaternion:
    """Return the attitude ``fraction`` of the way from ``p`` to ``q`` (slerp)."""
    rx, ry, rz = rotation_between(p, q)
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < 1e-12:
        return p
    half = 0.5 * angle * fraction
    scale = math.sin(half) / angle
    return product(p, (rx * scale, ry * scale, rz * scale, math.cos(half)))
