"""The report's tables of data: what a log can determine, and how complete it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from rovid_core.model.dofs import PARAMETERS
from rovid_ros.report.markup import (
    bound_to_units,
    capital,
    finite,
    Html,
    join,
    NONE,
    percent,
    quantity,
    small,
    symbol,
    table,
    tag,
)

Data = Mapping[str, Any]
BOUNDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # between the colours of relative bounds


def excitation(dof: str, values: Data) -> Html:
    """Return which parameters of a DOF each log can determine."""
    found = values.get('excitation') or {}
    if not found:
        return tag('p', f'{capital(dof)}: no log moved it.')
    names = [name for name in PARAMETERS
             if any(name in (log.get('relative_bound') or {}) for log in found.values())]
    rows = []
    for log, measured in found.items():
        bounds = measured.get('relative_bound') or {}
        rows.append([
            log, *(_bound(bounds.get(name)) for name in names),
            quantity(measured.get('condition'), '')])
    caption = join(tag('b', capital(dof)), ' ', small(
        'lowest standard deviation that any method can reach, relative to the parameter '
        '(Cramér-Rao bound), and condition number of the normalised regressors [–]'))
    verdicts = [tag('li', tag('b', f'{log}: '), bound_to_units(measured['verdict']))
                for log, measured in found.items() if measured.get('verdict')]
    return join(
        table(caption, ('log', *map(symbol, names), 'condition'), [rows], class_='bounds'),
        tag('ul', *verdicts, class_='verdicts'))


def _bound(value: Any) -> Html:
    share = finite(value)
    if not math.isfinite(share):
        return tag('td', NONE)
    return tag('td', percent(share), class_=f'heat{sum(share > edge for edge in BOUNDS)}')


def quality(log: Data) -> Html:
    """Return rates, gaps, what was refused and warnings of a log."""
    role = {'train': 'training', 'validate': 'validation'}.get(log.get('role', ''), '')
    count = log.get('messages')
    about = ', '.join(part for part in (
        role, f'{finite(log.get("duration_s")):,.1f} s', f'{count:,} messages' if count else '')
        if part and 'nan' not in part)
    rows = [[entry['input'], tag('code', entry.get('topic') or NONE),
             quantity(entry.get('rate_hz'), 'Hz'), _count(entry.get('count')),
             quantity(entry.get('longest_gap_s'), 's')] for entry in log.get('inputs') or []]
    parts: list[str] = [tag('h3', log['name'])]
    caption = join(tag('b', 'Inputs'), ' ', small(about))
    parts.append(table(caption, ('input', 'topic', 'rate', 'samples', 'longest gap'),
                       [rows], class_='inputs'))
    rejected = log.get('rejected') or {}
    listed = ', '.join(f'{n:,} {reason.replace("_", " ")}' for reason, n in rejected.items())
    parts.append(tag('p', tag('b', 'Refused samples and steps: '), listed or 'none'))
    parts.append(_warnings(log.get('warnings') or []))
    return tag('section', *parts, class_='log')


def _count(value: Any) -> str:
    return f'{value:,}' if isinstance(value, int) else NONE


def _warnings(lines: Sequence[str]) -> Html:
    if not lines:
        return tag('p', tag('b', 'Warnings: '), 'none')
    return join(tag('p', tag('b', 'Warnings:')),
                tag('ul', *(tag('li', line) for line in lines), class_='warnings'))
