"""Names and order of the degrees of freedom and of the parameters."""

from collections.abc import Sequence
import math

DOFS = ('surge', 'sway', 'heave', 'roll', 'pitch', 'yaw')
LINEAR_DOFS = DOFS[:3]
ANGULAR_DOFS = DOFS[3:]

PARAMETERS = ('alpha', 'beta', 'gamma', 'delta')
PHYSICAL = ('mass', 'quadratic_drag', 'linear_drag', 'bias')

OWN = ('reverse_thrust', 'reverse_drag')
"""
Couplings that are made of a DOF's own force and velocity: min(tau, 0), and v|v| where v < 0.

Whoever simulates a model makes them of the force and the velocity that it has there.
"""

THRUSTS = {f'{dof}_thrust': dof for dof in ('surge', 'sway', 'heave', 'yaw')}
"""
Couplings that are the force on another DOF, and that DOF: thrust whose line does not go through
the centre of mass turns the vehicle, and so does what moves a mass beside the axes.
"""

EACH = ('reverse_of_each', 'dead_band_of_each', 'thrust_loss_of_each')
"""
What the thrusters of a DOF do, each by itself: how much of the force is of those that push
backwards, what a dead band takes, and what is lost per speed. Watched where they drive other
DOFs, too: then none of these is a function of the DOF's own force.
"""

COUPLINGS = {
    'surge': ('vr', 'wq', *OWN),
    'sway': ('ur', 'wp', 'yaw_thrust', *OWN),
    'heave': ('uq', 'vp', *OWN),
    'roll': ('sin_roll', 'v', 'qr', 'vw', 'sway_thrust', *OWN),
    'pitch': ('sin_pitch', 'pr', 'uw', 'surge_thrust', 'heave_thrust', *OWN),
    'yaw': ('v', 'uv', 'pq', 'sway_thrust', 'surge_thrust', *OWN),
}
"""
What else may act on a DOF. Others do by products of their velocities u, v, w, p, q, r, by one of
these alone (the drag of a sideways motion), and by ``THRUSTS``; the attitude does by the
restoring terms sin(roll) cos(pitch), sin(pitch); its own force and velocity do by ``OWN``.
"""

RESTORING = ('sin_roll', 'sin_pitch')
"""Couplings with the attitude; they pull back."""

HEADING = ('cos_heading', 'sin_heading')
"""What a current pushes surge and sway with; watched, for it takes more to estimate a current."""

_PRIORS = {'sin_roll': 20.0, 'sin_pitch': 20.0, 'v': 5.0, 'uv': 20.0, 'vw': 20.0, 'uw': 20.0}


def coupling_prior(name: str) -> float:
    """
    Return the standard deviation of a coupling before any data, in SI.

    Those of surge, sway and heave are ratios of masses. Those of the angular DOFs have a mass
    over a moment of inertia in them, which is some tens for a small vehicle.
    """
    return _PRIORS.get(name, 2.0)


Four = tuple[float, float, float, float]
"""Values in the order of ``PARAMETERS`` (or of ``PHYSICAL``)."""

Own = tuple[float, float]
"""Coefficients of ``OWN``, 0 for one that a model does not have."""

NAN4: Four = (math.nan, math.nan, math.nan, math.nan)

Quaternion = tuple[float, float, float, float]
"""Unit quaternion (x, y, z, w) that turns body axes (x forward, y left, z up) into ENU."""

Vector = tuple[float, float, float]

Three = tuple[float, float, float]


def velocity_factors(coupling: str) -> tuple[str, ...]:
    """Return the DOFs whose velocities a coupling is a product of; () for one of the others."""
    if coupling in RESTORING or coupling in OWN or coupling in THRUSTS:
        return ()
    return tuple([DOFS['uvwpqr'.index(letter)] for letter in coupling])


def own_coefficients(names: Sequence[str], coefficients: Sequence[float]) -> Own:
    """Return those of ``OWN`` among the couplings ``names`` of a DOF."""
    of = dict(zip(names, coefficients))
    thrust, drag = [float(of.get(name, 0.0)) for name in OWN]
    return thrust, drag
