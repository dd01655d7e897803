"""The tables that a replay prints, with the unit beside every number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
import textwrap
from typing import Any

from rovid_core.model.dofs import ANGULAR_DOFS, PARAMETERS, PHYSICAL
from rovid_ros.results.summary import Result

NONE = '-'


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


def quantity(dof: str, name: str, values: Mapping[str, Any]) -> str:
    """Return a named value of a DOF with its unit."""
    text = number(values[name])
    return text if text == NONE else f'{text} {unit(dof, name)}'


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


def report(result: Result) -> str:
    """Return what ``rovid replay`` prints."""
    dofs = result.dofs
    method = result.settings.identifier.method
    if method == 'aid':
        method += f' ({result.settings.identifier.integrator})'
    spanning = 'spanning ' if len(result.logs) > 1 else ''  # the gaps between them count
    parts = [
        f'{_names(result.logs)}: {spanning}{result.duration:,.1f} s, '
        f'{result.messages:,} messages, {result.steps:,} steps of {method}',
        table(_outcome(dofs), left=2),
        _legend(dofs),
        table(_physical(dofs)),
        table(_lumped(dofs)),
        f'refused   {_rejected(result.rejected)}',
    ]
    return '\n\n'.join(part for part in parts if part)


def _names(logs: Sequence[Path]) -> str:
    more = f' and {len(logs) - 2} more' if len(logs) > 2 else ''
    return ', '.join(map(str, logs[:2])) + more


def _outcome(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = [['', 'status', 'steps', 'mae', 'fit']]
    for dof, values in dofs.items():
        rows.append([
            dof, values['status'], f'{values["steps"]:,}', quantity(dof, 'mae', values),
            percent(values['fit'])])
    return rows


def _legend(dofs: Mapping[str, Mapping[str, Any]]) -> str:
    lines = []
    for dof, values in dofs.items():
        verdict = values['verdict']
        reasons = [reason for reason in values['reasons'] if reason not in verdict]
        if reasons:
            lines.append(_filled(f'{dof} is {values["status"]}: {"; ".join(reasons)}'))
        if verdict:
            lines.append(_filled(f'{dof}, from all of the data: {verdict}'))
        delayed = values['delay_s']
        if delayed and abs(delayed['value']) > 3.0 * delayed['std']:  # else it may be 0
            delay, std = (number(delayed[name]) for name in ('value', 'std'))
            lines.append(f'{dof}: the thrust is delayed by {delay} ± {std} s')
    lines.append(
        'mae = mean |v_sim - v|, fit = 1 - rms(v_sim - v) / std(v), where v_sim is what the '
        'model\npredicts from the logged thrust alone.')
    return '\n'.join(lines)


def _filled(line: str) -> str:
    return textwrap.fill(line, 99, subsequent_indent='  ', break_long_words=False)


def _physical(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = [['', 'effective mass', 'quadratic drag', 'linear drag', 'bias']]
    for dof, values in dofs.items():
        rows.append([dof, *(quantity(dof, name, values) for name in PHYSICAL)])
        if values['intervals']:
            rows.append(['95 %', *(_interval(values['intervals'][name]) for name in PHYSICAL)])
    return rows


def _interval(interval: Sequence[float | None] | None) -> str:
    """Return an interval; an end that the data leave open is infinite."""
    if interval is None:
        return NONE
    low, high = interval
    return f'{"-inf" if low is None else number(low)} .. {"inf" if high is None else number(high)}'


def _lumped(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = [['', *PARAMETERS]]
    for dof, values in dofs.items():
        rows.append([dof, *(quantity(dof, name, values) for name in PARAMETERS)])
        if values['std']:
            rows.append(['', *(
                NONE if values['std'][name] is None
                else f'± {quantity(dof, name, values["std"])}' for name in PARAMETERS)])
    return rows


def _rejected(rejected: Mapping[tuple[str, str], int]) -> str:
    by_input: dict[str, list[str]] = {}
    for (name, reason), count in sorted(rejected.items()):
        by_input.setdefault(name, []).append(f'{count:,} {reason}')
    parts = [f'{name}: {", ".join(counts)}' for name, counts in by_input.items()]
    return '\n          '.join(parts) or 'nothing'


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
