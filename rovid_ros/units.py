"""The units of the quantities of a degree of freedom, as they are printed."""

from __future__ import annotations

from rovid_core.dofs import ANGULAR_DOFS

_LINEAR = {
    'alpha': '1/kg', 'beta': '1/m', 'gamma': '1/s', 'delta': 'm/s²',
    'mass': 'kg', 'quadratic_drag': 'N s²/m²', 'linear_drag': 'N s/m', 'bias': 'N',
    'mae': 'm/s',
}
_ANGULAR = {
    'alpha': '1/(kg m²)', 'beta': '1/rad', 'gamma': '1/s', 'delta': 'rad/s²',
    'mass': 'kg m²', 'quadratic_drag': 'N m s²/rad²', 'linear_drag': 'N m s/rad',
    'bias': 'N m', 'mae': 'rad/s',
}


def unit(dof: str, quantity: str) -> str:
    """Return the unit of a quantity of a DOF, as it is printed."""
    return (_ANGULAR if dof in ANGULAR_DOFS else _LINEAR)[quantity]
