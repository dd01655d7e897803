"""
What the report's plots show, as plain values that ``page/*.js`` draws.

A figure is a list of panels; a panel has one x column and several curves. Columns of
numbers are kept once and named by their index.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from rovid_core.model.dofs import PARAMETERS
from rovid_ros.report.markup import capital, finite, Html, join, quantity, SYMBOLS, tag, title

Data = Mapping[str, Any]
Spec = dict[str, Any]
TIME_DIGITS, DIGITS = 7, 5  # significant
INK, REFERENCE = 0, 'reference'  # styles of curves; methods take 1 to STYLES
STYLES = 6


class Figures:
    """
    Collects the figures of a report.

    Parameters
    ----------
    data : mapping
        The report's input.

    """

    def __init__(self, data: Data) -> None:
        self.columns: list[list[float | None]] = []
        self.figures: dict[str, Spec] = {}
        methods = dict.fromkeys(
            method for values in data['dofs'].values()
            for log in (values.get('series') or {}).values()
            for method in log.get('simulated') or {})
        self._style = {method: 1 + i % STYLES for i, method in enumerate(methods)}

    def document(self) -> Spec:
        """Return all that the page's script needs."""
        return {'columns': self.columns, 'figures': self.figures}

    def of_log(self, dof: str, values: Data, entry: Data, group: str) -> list[Html]:
        """
        Return the figures of one DOF on one log; their time axes are linked.

        Parameters
        ----------
        dof : str
            Its name.
        values : mapping
            The DOF's part of the report's input.
        entry : mapping
            The log; figures that it has no data for are left out.
        group : str
            Name of the linked axes.

        """
        units, log = values.get('units') or {}, entry['name']
        trained = ' trained on this log' if entry.get('role') != 'validate' else ''
        series = (values.get('series') or {}).get(log)
        found = (values.get('adaptation') or {}).get(log)
        out = []
        if series:
            out.append(self._figure(
                'velocity', dof, log, self._velocity(series, units, group), 'Prediction.',
                f'Measured velocity and what the models{trained} simulate from the thrust '
                'alone; the error (the paper’s Fig. 3); the thrust.'))
        if found:
            out.append(self._figure(
                'estimates', dof, log, self._estimates(found, units, group),
                'Adaptive identifier.', 'v̂ and the parameter estimates, with the '
                'least-squares values dashed (the paper’s Fig. 4).'))
            out.append(self._figure(
                'errors', dof, log, self._errors(found, units, group), 'Errors of the identifier.',
                join('Velocity error, parameter errors against least squares'
                     ', and the Lyapunov function W (the paper’s Fig. 5).',
                     _fall(found.get('W') or (), _squared(units.get('velocity', ''))))))
        return out

    def of_excitation(self, dof: str, values: Data, log: str, group: str) -> Html:
        """Return the figure of what moved one DOF on one log."""
        units = values.get('units') or {}
        found = values['excitation'][log]
        panels = []
        for i, name in enumerate(('force', 'velocity')):
            unit, histogram = units.get(name, ''), found.get(f'{name}_histogram')
            if histogram:
                curve = {'y': self._add(histogram['counts']), 'bars': True, 'style': 1 + i,
                         'label': 'samples'}
                panels.append(self._panel(
                    f'{group}/{name}', (_label(name), unit),
                    self._add(histogram['edges']), ('samples', ''), [curve]))
        spectrum = found.get('spectrum') or {}
        if spectrum.get('frequency'):
            x = self._add(spectrum['frequency'])
            for i, name in enumerate(('force', 'velocity')):
                if spectrum.get(name):
                    curve = {'y': self._add(spectrum[name]), 'style': 1 + i,
                             'label': 'amplitude'}
                    panels.append(self._panel(
                        f'{group}/spectrum', ('frequency', 'Hz'), x,
                        (f'{_label(name)} amplitude', units.get(name, '')), [curve],
                        x_log=True, y_log=True))
        return self._figure(
            'excitation', dof, log, panels, f'{capital(dof)} on {log}.',
            'How often each thrust and each velocity occurred, and their spectra.')

    def _velocity(self, series: Data, units: Mapping[str, str], group: str) -> list[Spec]:
        t = self._add(series['t'], TIME_DIGITS)
        measured = self._add(series['velocity'])
        curves: list[Spec] = [{'y': measured, 'style': INK, 'label': 'measured'}]
        errors: list[Spec] = []
        for method, values in (series.get('simulated') or {}).items():
            curve = {'y': self._add(values), 'style': self._style[method],
                     'label': title(method)}
            curves.append(curve)
            errors.append({**curve, 'minus': measured})
        unit = units.get('velocity', '')
        panels = [self._time(group, t, ('velocity', unit), curves, tall=True),
                  self._time(group, t, ('simulated − measured', unit), errors)]
        if series.get('force'):
            force: Spec = {'y': self._add(series['force']), 'style': 'thrust', 'label': 'thrust'}
            panels.append(self._time(group, t, ('thrust', units.get('force', '')), [force]))
        return panels

    def _estimates(self, found: Data, units: Mapping[str, str], group: str) -> list[Spec]:
        t = self._add(found['t'], TIME_DIGITS)
        velocity: list[Spec] = []
        for name, label, style in (('velocity', 'measured v', INK), ('v_hat', 'v̂', 1)):
            if found.get(name):
                velocity.append({'y': self._add(found[name]), 'style': style, 'label': label})
        panels = [self._time(group, t, ('velocity', units.get('velocity', '')), velocity)]
        for name in _known(found):
            curves: list[Spec] = [{'y': self._add(found[name]), 'style': 2,
                                   'label': 'estimate'}]
            reference = finite((found.get('reference') or {}).get(name))
            if math.isfinite(reference):
                curves.append({'constant': reference, 'style': REFERENCE,
                               'label': 'least squares'})
            panels.append(self._time(group, t, (_label(name), units.get(name, '')), curves,
                                     half=True))
        return panels

    def _errors(self, found: Data, units: Mapping[str, str], group: str) -> list[Spec]:
        t = self._add(found['t'], TIME_DIGITS)
        unit = units.get('velocity', '')
        panels = []
        if found.get('dv'):
            panels.append(self._time(group, t, ('Δv = v̂ − v', unit), [
                {'y': self._add(found['dv']), 'style': 1, 'label': 'Δv'}]))
        for name in _known(found):
            reference = finite((found.get('reference') or {}).get(name))
            if math.isfinite(reference):
                label = f'Δ{SYMBOLS[name]}'
                panels.append(self._time(group, t, (label, units.get(name, '')), [
                    {'y': self._add(found[name]), 'less': reference, 'style': 2,
                     'label': label}], half=True))
        if _any(found.get('W')):
            panels.append(self._time(group, t, ('W', _squared(unit)), [
                {'y': self._add(found['W']), 'style': 3, 'label': 'W'}], y_log=True))
        return panels

    def _time(self, group: str, t: int, y: tuple[str, str], curves: Sequence[Spec],
              **options: bool) -> Spec:
        return self._panel(group, ('time', 's'), t, y, curves, **options)

    def _panel(self, group: str, x_axis: tuple[str, str], x: int, y_axis: tuple[str, str],
               curves: Sequence[Spec], **options: bool) -> Spec:
        return {'group': group, 'x': x, 'xAxis': x_axis, 'yAxis': y_axis, 'curves': curves,
                **{key: True for key, on in options.items() if on}}

    def _add(self, values: Sequence[Any], digits: int = DIGITS) -> int:
        """Keep a column, rounded; return its index."""
        self.columns.append([
            float(f'{value:.{digits}g}') if math.isfinite(value) else None
            for value in map(finite, values)])
        return len(self.columns) - 1

    def _figure(self, kind: str, dof: str, log: str, panels: list[Spec],
                start: str, caption: str) -> Html:
        name = f'figure{len(self.figures)}'
        self.figures[name] = {'panels': panels}
        return tag(
            'figure', tag('figcaption', tag('b', start), ' ', caption),
            tag('div', class_='plot'), id=name, class_=kind, data_kind=kind, data_dof=dof,
            data_log=log, aria_label=f'{capital(dof)} on {log}: {kind}')


def _label(name: str) -> str:
    return f'{name} {SYMBOLS[name]}' if name in SYMBOLS else name.replace('force', 'thrust')


def _any(values: Sequence[Any] | None) -> bool:
    return any(math.isfinite(finite(value)) for value in values or ())


def _known(found: Data) -> list[str]:
    """Return the parameters that were estimated; one that is left out is 0 throughout."""
    return [name for name in PARAMETERS if any(
        finite(value) != 0.0 for value in found.get(name) or () if value is not None)]


def _squared(unit: str) -> str:
    return '/'.join(f'{part}²' for part in unit.split('/')) if unit else ''


def _fall(values: Sequence[Any], unit: str) -> Html:
    known = [value for value in map(finite, values) if math.isfinite(value)]
    if len(known) < 2:
        return Html('')
    return join(' W goes from ', quantity(known[0], unit), ' to ', quantity(known[-1], unit), '.')
