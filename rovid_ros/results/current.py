"""The current of the water as it is told: in the world frame of the messages."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from rovid_core.identify.estimate import Current, TURN
from rovid_core.settings.run import Settings
from rovid_ros.results.text import number

UNSEEN = Current(math.nan, math.nan, (math.nan, math.nan, math.nan), status='unobservable',
                 advice=TURN)


def told(current: Current | None, frames: str) -> Current:
    """Return a current in the ``frames`` of the messages, NaN while it cannot be seen."""
    if current is None:
        return UNSEEN
    if not current.is_seen:
        return UNSEEN._replace(status=current.status, advice=current.advice)
    if frames == 'enu':
        return current
    xx, xy, yy = current.covariance
    return current._replace(x=current.y, y=current.x, covariance=(yy, xy, xx))


def still_water(settings: Settings) -> str:
    """Return that the method takes water to be still that may move, '' where it does not."""
    if settings.sees_current and not settings.estimates_current:
        return f'{settings.identifier.method} takes the water to be still; ekf estimates it'
    return ''


def current_values(current: Current) -> dict[str, float | str]:
    """Return all numbers of a current by name [m/s], and its status."""
    x_std, y_std = current.std
    return {'x': current.x, 'y': current.y, 'x_std': x_std, 'y_std': y_std,
            'chi2': current.chi2, 'status': current.status}


def current_message(current: Current) -> str:
    """Return status and advice in one line."""
    return f'{current.status}: {current.advice}' if current.advice else current.status


def current_text(values: Mapping[str, Any]) -> str:
    """Return the line about a current in the summary of a replay, from its JSON."""
    status, advice = values['status'], values['advice']
    numbers = [f'{axis} {number(values[axis])} ± {number(values[f"{axis}_std"])} m/s'
               for axis in 'xy' if values[axis] is not None]
    return f'current of the water: {", ".join([*numbers, status])}' + (
        f' ({advice})' if advice else '')
