"""
What changes from dive to dive, as plain values by name.

::

    rovid_version
    dives       how many there are
    failed      a list of: log, error
    axis        name and unit of what the dives are laid out along; from, where it is a time
    tests       how many tests were made together
    dofs        by name of the DOF:
      left_out    how many dives say nothing of it
      parameters  by name (mass, quadratic_drag, linear_drag, bias):
        unit
        points      x, value, low, high, log: columns, of the dives that say something
        trend       None, or count, mean, scatter, change, change_low, change_high (from the first
                    dive to the last), p, p_together (Holm's, for all tests), drifts, and the
                    line's two ends, x and y
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
import math
from typing import Any

from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import DOFS, PHYSICAL
from rovid_core.trials.drift import holm, LEVEL, Trend, trend
from rovid_ros import __version__
from rovid_ros.results.text import unit
from rovid_ros.survey.table import FAILED, Row

DAY = 86400.0  # [s]
JUDGED = ('converged', 'converging')  # of other dives the numbers are not from their data

Data = dict[str, Any]


def survey_data(rows: Sequence[Row], newtons: bool = True) -> Data:
    """
    Return the parameters of all dives over time, and whether they drift.

    ``newtons`` tells whether forces are in newtons.
    """
    failures = [{'log': row['log'], 'error': row['error']} for row in rows
                if row['status'] == FAILED]
    good = [row for row in rows if row['status'] != FAILED]
    axis, places = _axis(good)
    found = {dof: _dof(dof, [row for row in good if row['dof'] == dof], places, newtons)
             for dof in DOFS if any(row['dof'] == dof for row in good)}
    trends = [values['trend'] for dof in found.values() for values in dof['parameters'].values()
              if values['trend']]
    for values, p in zip(trends, holm([values['p'] for values in trends])):
        values['p_together'], values['drifts'] = p, p < LEVEL
    return {'rovid_version': __version__, 'dives': len({row['log'] for row in rows}),
            'failed': failures, 'axis': axis, 'tests': len(trends), 'dofs': found}


def _axis(rows: Sequence[Row]) -> tuple[Data, dict[str, float]]:
    """Return the axis and each log's place: days, or dive after dive where a start is unknown."""
    starts = {row['log']: row.get('start') for row in rows}
    known = [start for start in starts.values() if start]
    if len(known) < len(starts) or len(set(known)) < 2:
        return ({'name': 'dive', 'unit': '', 'from': ''},
                {log: float(k) for k, log in enumerate(starts, 1)})
    first = min(known)
    begin = datetime.fromisoformat(first)
    return ({'name': 'time', 'unit': 'days', 'from': first},
            {log: (datetime.fromisoformat(start) - begin).total_seconds() / DAY
             for log, start in starts.items() if start})


def says_something(row: Row) -> bool:
    """Tell whether a dive moved the DOF, and its model predicts better than a constant."""
    return row['status'] in JUDGED and (row.get('fit') or 0.0) > 0.0


def _dof(dof: str, rows: Sequence[Row], places: Mapping[str, float], newtons: bool) -> Data:
    judged = sorted([row for row in rows if says_something(row)],
                    key=lambda row: places[row['log']])
    return {'left_out': len(rows) - len(judged), 'parameters': {
        name: _parameter(unit(dof, name, newtons), name, judged, places) for name in PHYSICAL}}


def _parameter(unit: str, name: str, rows: Sequence[Row], places: Mapping[str, float]) -> Data:
    stds = [_std(row, name) for row in rows]
    kept = [(places[row['log']], row[name], std, row) for row, std in zip(rows, stds)
            if row[name] is not None and math.isfinite(std)]
    found = trend(*zip(*[(x, value, std) for x, value, std, _ in kept])) if kept else None
    return {'unit': unit, 'trend': None if found is None else _document(found, kept),
            'points': {'x': [x for x, *_ in kept], 'value': [value for _, value, *_ in kept],
                       'low': [row.get(f'{name}_low') for *_, row in kept],
                       'high': [row.get(f'{name}_high') for *_, row in kept],
                       'log': [row['log'] for *_, row in kept]}}


def _std(row: Row, name: str) -> float:
    """
    Return the standard deviation that an interval tells by its longer side.

    The shorter one may have been cut at 0. It is 0 for a method without intervals, and infinite
    where the data leave an end open.
    """
    if row.get('alpha_std') is None:
        return 0.0
    low, high, value = row.get(f'{name}_low'), row.get(f'{name}_high'), row[name]
    if low is None or high is None or value is None:
        return math.inf
    return float(max(high - value, value - low)) / Z95


def _document(found: Trend, kept: Sequence[tuple[Any, ...]]) -> Data:
    first, last = kept[0][0], kept[-1][0]
    span = last - first
    ends = [found.mean + found.slope * (x - found.time) for x in (first, last)]
    return {**{key: value for key, value in asdict(found).items()
               if key in ('count', 'mean', 'scatter', 'p')},
            'change': found.slope * span, 'change_low': found.low * span,
            'change_high': found.high * span, 'x': [first, last], 'y': ends}
