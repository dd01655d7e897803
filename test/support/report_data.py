"""A small input of the HTML report, with all parts filled in."""

import math
from typing import Any

UNITS = {
    'velocity': 'm/s', 'force': 'N', 'alpha': '1/kg', 'beta': '1/m', 'gamma': '1/s',
    'delta': 'm/s²', 'mass': 'kg', 'quadratic_drag': 'N s²/m²', 'linear_drag': 'N s/m',
    'bias': 'N',
}
ANGULAR = {
    **UNITS, 'velocity': 'rad/s', 'force': 'N m', 'alpha': '1/(kg m²)', 'mass': 'kg m²',
    'bias': 'N m',
}
TRUTH = {'alpha': 0.003448, 'beta': -1.0, 'gamma': -0.15, 'delta': -0.01}
HISTOGRAM = {'edges': [-1.0, -0.5, 0.0, 0.5, 1.0], 'counts': [3, 8, 9, 2]}


def report_data(logs: tuple[str, ...] = ('a.mcap', 'b.mcap'),
                dofs: tuple[str, ...] = ('surge', 'heave', 'yaw'), points: int = 200,
                ) -> dict[str, Any]:
    """Return what ``rovid compare`` hands over: the last of several logs is for validation."""
    roles = ['train'] * len(logs)
    if len(logs) > 1:
        roles[-1] = 'validate'
    return {
        'rovid_version': '0.1.0', 'current': {},
        'logs': [{
            'name': name, 'role': role, 'duration_s': 0.1 * points, 'messages': 42001,
            'inputs': [{'input': 'position', 'topic': '/sharps/position', 'rate_hz': 10.0,
                        'count': points, 'longest_gap_s': 0.1}],
            'rejected': {'late': 3}, 'warnings': ['thrust: never negative'],
        } for name, role in zip(logs, roles)],
        'dofs': {dof: _dof(dof, logs, roles, points) for dof in dofs},
    }


def _dof(dof: str, logs: tuple[str, ...], roles: list[str], points: int) -> dict[str, Any]:
    train = [name for name, role in zip(logs, roles) if role == 'train']
    units = ANGULAR if dof == 'yaw' else UNITS
    physical = {'mass': 290.0, 'quadratic_drag': 290.0, 'linear_drag': 43.5, 'bias': 2.9}

    def intervals(values: dict[str, float]) -> dict[str, Any]:
        return {name: {'value': value, 'low': value - 0.02 * abs(value),
                       'high': value + 0.02 * abs(value), 'unit': units.get(name, '')}
                for name, value in values.items()}

    return {
        'sentence': f'{dof.capitalize()}: 290 {units["mass"]} of effective mass.',
        'best': {'method': 'output_error', 'trained_on': train[0],
                 'physical': intervals(physical), 'lumped': intervals(TRUTH), 'couplings': {}},
        'models': [
            {'method': method, 'trained_on': name, 'terms': list(terms), 'selected': selected,
             'parameters': TRUTH, 'physical': physical,
             'std': dict.fromkeys(TRUTH, 0.001) if method == 'output_error' else None,
             'note': '', 'couplings': [],
             'scores': {log: {'mae': 0.004 * (1 + i + j), 'fit': 0.96 - 0.01 * i}
                        for j, log in enumerate(logs)}}
            for name in train
            for i, method in enumerate(('output_error', 'aid', 'least_squares'))
            for terms, selected in ((('alpha', 'beta', 'delta'), True), (tuple(TRUTH), False))],
        'series': {name: _series(points) for name in train},
        'adaptation': {name: _adaptation(points) for name in train},
        'excitation': {name: {
            'force_histogram': HISTOGRAM, 'velocity_histogram': HISTOGRAM,
            'spectrum': {'frequency': [0.01, 0.1, 1.0], 'force': [5.0, 90.0, 0.2],
                         'velocity': [0.02, 0.4, 0.001]},
            'relative_bound': {'alpha': 0.004, 'beta': 0.02, 'gamma': 0.3, 'delta': 0.01},
            'condition': 35.2, 'verdict': 'This log determines alpha; it does not gamma.',
        } for name in logs},
        'units': units,
    }


def _series(points: int) -> dict[str, Any]:
    t = [0.1 * i for i in range(points)]
    v: list[float | None] = [0.4 * math.sin(0.5 * x) for x in t]
    v[points // 2] = None  # a gap
    return {'t': t, 'velocity': v, 'force': [90.0 * math.cos(0.5 * x) for x in t],
            'simulated': {method: [None if x is None else x * (1.0 + 0.01 * i) for x in v]
                          for i, method in enumerate(('least_squares', 'aid', 'output_error'))}}


def _adaptation(points: int) -> dict[str, Any]:
    t = [0.1 * i for i in range(points)]
    v = [0.4 * math.sin(0.5 * x) for x in t]
    fade = [math.exp(-0.05 * x) for x in t]
    return {'t': t, 'velocity': v, 'v_hat': [x + 0.02 * y for x, y in zip(v, fade)],
            'dv': [0.02 * y for y in fade], 'W': [0.1 * y * y for y in fade],
            **{name: [value * (1.0 + 0.5 * y) for y in fade] for name, value in TRUTH.items()},
            'reference': TRUTH}
