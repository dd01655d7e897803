"""Names and order of the degrees of freedom and of the parameters."""

import math

DOFS = ('surge', 'sway', 'heave', 'roll', 'pitch', 'yaw')
LINEAR_DOFS = DOFS[:3]
ANGULAR_DOFS = DOFS[3:]

PARAMETERS = ('alpha', 'beta', 'gamma', 'delta')
PHYSICAL = ('mass', 'quadratic_drag', 'linear_drag', 'bias')

COUPLINGS = {
    'surge': ('vr', 'wq'),
    'sway': ('ur', 'wp'),
    'heave': ('uq', 'vp'),
    'roll': ('sin_roll', 'v', 'qr', 'vw'),
    'pitch': ('sin_pitch', 'pr', 'uw'),
    'yaw': ('v', 'uv', 'pq'),
}
"""
How other DOFs may act on one: by products of their velocities u, v, w, p, q, r, by one of these
alone (the drag of a sideways motion), and by the restoring terms sin(roll) cos(pitch), sin(pitch).
"""

RESTORING = ('sin_roll', 'sin_pitch')
"""Couplings with the attitude; they pull back."""

HEADING = ('cos_heading', 'sin_heading')
"""What a current pushes surge and sway with; watched, for it takes more to estimate a current."""

COUPLING_PRIORS = {
    'sin_roll': 20.0, 'sin_pitch': 20.0, 'v': 5.0, 'uv': 20.0, 'vw': 20.0, 'uw': 20.0}
"""
Standard deviations of couplings before any data, in SI; 2 for the others.

Those of surge, sway and heave are ratios of masses. Those of the angular DOFs have a mass over
a moment of inertia in them, which is some tens for a small vehicle.
"""

Four = tuple[float, float, float, float]
"""Values in the order of ``PARAMETERS`` (or of ``PHYSICAL``)."""

NAN4: Four = (math.nan, math.nan, math.nan, math.nan)

Quaternion = tuple[float, float, float, float]
"""Unit quaternion (x, y, z, w) that turns body axes (x forward, y left, z up) into ENU."""

Vector = tuple[float, float, float]

Three = tuple[float, float, float]
