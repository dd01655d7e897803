"""Numbers as people read them, each with its unit, and tables of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from rovid_core.model.dofs import ANGULAR_DOFS

NONE = '-'

COMMAND = 'cmd'
"""The unit of force where it is not in newtons."""

NO_NEWTONS = (
    f'{COMMAND} is what a command of 1 pushes: masses, drags and biases are relative to it, not '
    'in kg and N, for thrusters.newtons is false')


def number(value: float | None) -> str:
    """Return four significant digits, without an exponent where that is readable."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0.0:
        return '0'
    if not 1e-5 <= abs(value) < 1e7:
        return f'{value:.3e}'
    digits = 3 - math.floor(math.log10(abs(value)))
    return f'{value:,.{max(digits, 0)}f}'


def quantity(dof: str, name: str, values: Mapping[str, Any], newtons: bool = True) -> str:
    """Return a named value of a DOF with its unit."""
    text = number(values[name])
    return text if text == NONE else f'{text} {unit(dof, name, newtons)}'


def told_delay(delay: float, std: float) -> str:
    """Return in words how late the thrust acts [s], and the standard deviation of that [s]."""
    if delay < 0.0:
        return f'the thrust acts {number(-delay)} ± {number(std)} s sooner than its stamps say'
    return f'the thrust is delayed by {number(delay)} ± {number(std)} s'


def percent(fit: float | None) -> str:
    """Return a fit, 1 for perfect, in percent."""
    if fit is None or not math.isfinite(fit):
        return NONE
    return f'{round(100.0 * fit, 1) + 0.0:.1f} %'  # + 0.0: no -0.0


def table(rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Return rows in columns, the first ``left`` of them left-aligned, the others right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return '\n'.join(
        '   '.join(
            cell.ljust(width) if i < left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths))).rstrip()
        for row in rows)


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


_PER_COMMAND = {
    'alpha': f'{{}}/s²/{COMMAND}', 'mass': f'{COMMAND} s²/{{}}',
    'quadratic_drag': f'{COMMAND} s²/{{}}²', 'linear_drag': f'{COMMAND} s/{{}}', 'bias': COMMAND,
}


def unit(dof: str, quantity: str, newtons: bool = True) -> str:
    """Return the unit of a quantity of a DOF, as it is printed; of commands for no newtons."""
    angular = dof in ANGULAR_DOFS
    if not newtons and quantity in _PER_COMMAND:
        return _PER_COMMAND[quantity].format('rad' if angular else 'm')
    return (_ANGULAR if angular else _LINEAR)[quantity]
