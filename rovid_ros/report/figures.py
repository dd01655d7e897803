"""
The plots of the report, as the traces and layouts that plotly.js draws.

Every figure is one plotly plot: panels above each other that share their x axis. A trace's colour
is the name of a colour of ``page/style.css``, so that the plots follow the dark style, and its
``x`` and ``y`` are indices into columns of numbers that are kept once for the whole report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
import math
from typing import Any

from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import PARAMETERS
from rovid_ros.report.markup import capital, finite, Html, join, quantity, SYMBOLS, tag, title

Data = Mapping[str, Any]
Values = Sequence[Any]
Dict = dict[str, Any]
# Of a curve; a longer one keeps the lowest and the highest value of each of its parts.
POINTS = 3000
TIME_DIGITS, DIGITS = 7, 5  # significant
# From the lowest to the highest amplitude shown; below are only rounding errors.
SPECTRUM_SPAN = 1e5
HEIGHT, TALL, SPACE = 110, 190, 32  # [px] of a panel, of the first one, and above each
MEASURED = {'color': 'measured', 'width': 2.8}
REFERENCE = {'color': 'ink', 'dash': 'dash', 'width': 1.2}
LINES = tuple({'color': f'c{1 + i % 6}', 'dash': dash, 'width': 1.4} for i, dash in enumerate(
    ('solid', '8px,3px', '3px,2px', '9px,3px,2px,3px', '14px,3px', '6px,2px,2px,2px', '2px,4px')))


class Plot:
    """A plot that is being put together: its traces, its panels and the link of its x axis."""

    def __init__(self, columns: Columns, x_axis: tuple[str, str], link: str | None = None) -> None:
        self._columns = columns
        self._x_axis = x_axis
        self._link = link
        self._traces: list[Dict] = []
        self._panels: list[Dict] = []
        self._names: set[str] = set()

    def add_panel(self, name: str, unit: str, *, tall: bool = False, hover: str = '',
                  **axis: Any) -> None:
        """
        Begin the next panel.

        ``hover`` stands before the values that the pointer reads; ``axis`` goes into the layout
        of the y axis.
        """
        self._panels.append({'text': _labelled(name, unit), 'unit': escape(unit), 'axis': axis,
                             'hover': hover, 'height': TALL if tall else HEIGHT})

    def add_curve(self, name: str, x: Values, y: Values, line: Mapping[str, Any]) -> None:
        """Add a curve to the last panel; the same name in two panels is one legend entry."""
        x, y = thinned(x, y)
        self._add_line(name, x, y, line)

    def add_points(self, name: str, x: Values, y: Values, low: Values, high: Values,
                   texts: Sequence[str], color: str) -> None:
        """Add points with their intervals and what the pointer says of each."""
        self._add('95 %', [at for at in x for _ in range(3)],
                  [end for pair in zip(low, high) for end in (*pair, None)],
                  {'type': 'scatter', 'mode': 'lines', 'hoverinfo': 'skip',
                   'line': {'color': color, 'width': 1.0, 'simplify': False}})
        self._add(name, x, y, {'type': 'scatter', 'mode': 'markers',
                               'text': [escape(text) for text in texts],
                               'marker': {'color': color, 'size': 5}})
        self._traces[-1]['hovertemplate'] += '<br>%{text}'

    def add_level(self, name: str, x: Values, y: float, line: Mapping[str, Any]) -> None:
        """Add a horizontal line over the whole of ``x`` to the last panel."""
        ends = [x[0], x[-1]] if x else []
        self._add_line(name, ends, [y] * len(ends), line)

    def add_bars(self, name: str, edges: Values, counts: Values, color: str) -> None:
        """Add a histogram to the last panel."""
        self._add(name, [0.5 * (a + b) for a, b in zip(edges, edges[1:])], counts, {
            'type': 'bar', 'marker': {'color': color},
            'width': edges[1] - edges[0] if len(edges) > 1 else 1.0})

    def spec(self) -> Dict:
        """Return the plot as the page's script takes it."""
        shared = [trace['yaxis'] for trace in self._traces]
        told_apart = {trace['name'] for trace in self._traces if shared.count(trace['yaxis']) > 1}
        for trace in self._traces:
            trace['showlegend'] = trace['showlegend'] and trace['name'] in told_apart
        bottom = 0
        heights = [panel['height'] + SPACE for panel in self._panels]
        total = sum(heights)
        x_unit = escape(self._x_axis[1])
        layout: Dict = {'height': total, 'annotations': [], 'xaxis': {
            'anchor': f'y{len(self._panels)}', 'title': {'text': _labelled(*self._x_axis)},
            'unifiedhovertitle': {'text': f'%{{x:.4~g}} {x_unit}'}}}
        for i in reversed(range(len(self._panels))):
            panel = self._panels[i]
            top = bottom + panel['height']
            layout[f'yaxis{i + 1}'] = {
                'anchor': 'x', 'domain': [bottom / total, top / total], **panel['axis']}
            layout['annotations'].append({'text': panel['text'], 'y': top / total})
            bottom += heights[i]
        return {'traces': self._traces, 'layout': layout, 'link': self._link,
                'entries': len(told_apart)}

    def _add_line(self, name: str, x: Values, y: Values, line: Mapping[str, Any]) -> None:
        self._add(name, x, y, {'type': 'scatter', 'mode': 'lines',
                               'line': {'simplify': False, **line}})

    def _add(self, name: str, x: Values, y: Values, look: Dict) -> None:
        panel = self._panels[-1]
        unit = f' {panel["unit"]}' if panel['unit'] else ''
        digits = TIME_DIGITS if self._x_axis[1] == 's' else DIGITS
        self._traces.append({
            'x': self._columns.add(x, digits), 'y': self._columns.add(y, DIGITS),
            'yaxis': f'y{len(self._panels)}', 'name': escape(name), 'legendgroup': escape(name),
            'showlegend': name not in self._names,
            'hovertemplate': f'{panel["hover"]}%{{y:.4~g}}{unit}', **look})
        self._names.add(name)


class Columns:
    """Columns of numbers, each kept once."""

    def __init__(self) -> None:
        self.values: list[list[float | None]] = []
        self._known: dict[tuple[float | None, ...], int] = {}

    def add(self, values: Values, digits: int) -> int:
        """Return the index of a column of these values, rounded to significant digits."""
        rounded = tuple(_rounded(finite(value), digits) for value in values)
        if rounded not in self._known:
            self._known[rounded] = len(self.values)
            self.values.append(list(rounded))
        return self._known[rounded]


class Figures:
    """Collects the figures of a report."""

    def __init__(self, data: Data) -> None:
        self._columns = Columns()
        self._plots: dict[str, Dict] = {}
        methods = dict.fromkeys(
            method for values in data['dofs'].values()
            for log in values['series'].values() for method in log['simulated'])
        self._line = {method: LINES[i % len(LINES)] for i, method in enumerate(methods)}

    def document(self) -> Dict:
        """Return all that the page's script needs."""
        return {'columns': self._columns.values, 'plots': self._plots}

    def of_log(self, dof: str, values: Data, entry: Data) -> list[Html]:
        """
        Return the figures of one DOF on one log; their time axes are linked.

        ``values`` is the DOF's part of the report's input. What it has no data for is left out.
        """
        units, log = values['units'], entry['name']
        trained = ' trained on this log' if entry['role'] == 'train' else ''
        series, found = values['series'].get(log), values['adaptation'].get(log)
        link = f'{dof} on {log}'
        out = []
        if series:
            out.append(self._figure(
                'velocity', dof, log, self._velocity(series, units, link), 'Prediction.',
                f'Measured velocity and what the models{trained} simulate from the thrust '
                'alone; the error (the paper’s Fig. 3); the thrust.'))
        if found:
            out.append(tag('div', self._figure(
                'estimates', dof, log, self._estimates(found, units, link),
                'Adaptive identifier.', 'v̂ and the parameter estimates, with the '
                'least-squares values dashed (the paper’s Fig. 4).'), self._figure(
                'errors', dof, log, self._errors(found, units, link), 'Errors of the identifier.',
                join('Velocity error, parameter errors against least squares, and the Lyapunov '
                     'function W (the paper’s Fig. 5).',
                     _fall(found['W'], _squared(units['velocity'])))),
                class_='pair'))
        return out

    def of_current(self, found: Data, log: str) -> Html:
        """Return the figure of the current of the water over one log, with its 95 % band."""
        t = found['t']
        plot = Plot(self._columns, ('time', 's'), f'current on {log}')
        for axis, color in (('x', 'c1'), ('y', 'c2')):
            plot.add_panel(f'current, {axis}', 'm/s')
            for name, sign in (('lower', -Z95), ('upper', Z95)):
                plot.add_curve(name, t, [finite(v) + sign * finite(std) for v, std in zip(
                    found[axis], found[f'{axis}_std'])], {'color': color, 'dash': 'dot',
                                                          'width': 1.0})
            plot.add_curve('current', t, found[axis], {'color': color, 'width': 1.6})
        x, y = finite(found['x'][-1]), finite(found['y'][-1])
        degrees = math.degrees(math.atan2(y, x))
        arrow = tag('span', '\u2192',
                    style=f'display:inline-block;transform:rotate({-degrees:.0f}deg)')
        return self._figure(
            'current', 'current', log, plot, f'Current of the water on {log}.', join(
                'Where the water goes to in the world of the messages, with its 95 % band. In the '
                f'end {found["status"]}: ', arrow, ' ', quantity(math.hypot(x, y), 'm/s'),
                f', {degrees:.0f} degrees from x to y.'))

    def of_survey(self, dof: str, values: Data, axis: Data) -> Html:
        """Return the figure of the parameters of one DOF over all dives, and their lines."""
        plot = Plot(self._columns, (axis['name'], axis['unit']), f'{dof} over the dives')
        for name, found in values['parameters'].items():
            points, trend = found['points'], found['trend']
            plot.add_panel(title(name), found['unit'], tall=True)
            plot.add_points('dive', points['x'], points['value'], points['low'], points['high'],
                            points['log'], 'c1')
            if trend:
                plot.add_curve('trend', trend['x'], trend['y'],
                               {**REFERENCE, 'color': 'c2', 'width': 2.0})
        begin = axis['from'][:16].replace('T', ' ')
        since = f' Days since {begin} UTC.' if begin else ''
        return self._figure('survey', dof, 'all dives', plot, f'{capital(dof)}, dive by dive.',
                            f'Each with its 95 % interval; the line is the trend.{since}')

    def of_excitation(self, dof: str, values: Data, log: str) -> Html:
        """Return the figures of what moved one DOF on one log: histograms and spectra."""
        found = values['excitation'][log]
        frequency = found['spectrum']['frequency']
        figures = []
        for name, color in (('force', 'c1'), ('velocity', 'c2')):
            label, unit = _label(name), values['units'][name]
            histogram = found[f'{name}_histogram']
            bars = Plot(self._columns, (label, unit))
            bars.add_panel('samples', '', tall=True)
            bars.add_bars('samples', histogram['edges'], histogram['counts'], color)
            figures.append(self._figure('excitation', dof, log, bars,
                                        f'How often each {label} occurred.'))
            if frequency:
                amplitudes = found['spectrum'][name]
                lines = Plot(self._columns, ('frequency', 'Hz'))
                high = max(map(finite, amplitudes))
                low = min((a for a in map(finite, amplitudes) if a > high / SPECTRUM_SPAN),
                          default=0.0)
                axis: Dict = {'range': [math.log10(low / 1.3), math.log10(high * 1.3)],
                        'dtick': 1 if high > 100.0 * low else 'D2'} if low else {}
                lines.add_panel(f'{label} amplitude', unit, tall=True, type='log', **axis)
                lines.add_curve('amplitude', frequency, amplitudes, {'color': color, 'width': 1.4})
                figures.append(self._figure('excitation', dof, log, lines,
                                            f'Spectrum of the {label}.', log_x=True))
        return join(tag('h3', f'{capital(dof)} on {log}'), tag('div', *figures, class_='pair'))

    def _velocity(self, series: Data, units: Mapping[str, str], link: str) -> Plot:
        t, measured, unit = series['t'], series['velocity'], units['velocity']
        simulated = series['simulated']
        plot = Plot(self._columns, ('time', 's'), link)
        plot.add_panel('velocity', unit, tall=True)
        plot.add_curve('measured', t, measured, MEASURED)
        for method, values in simulated.items():
            plot.add_curve(title(method), t, values, self._line[method])
        if simulated:
            plot.add_panel('simulated − measured', unit, hover='Δ ')
        for method, values in simulated.items():
            error = [finite(y) - finite(v) for y, v in zip(values, measured)]
            plot.add_curve(title(method), t, error, self._line[method])
        if series['force']:
            plot.add_panel('thrust', units['force'])
            plot.add_curve('thrust', t, series['force'], {'color': 'ink', 'width': 1.2})
        return plot

    def _estimates(self, found: Data, units: Mapping[str, str], link: str) -> Plot:
        t = found['t']
        plot = Plot(self._columns, ('time', 's'), link)
        plot.add_panel('velocity', units['velocity'])
        for name, label, line in (('velocity', 'measured v', MEASURED), ('v_hat', 'v̂', LINES[0])):
            if found[name]:
                plot.add_curve(label, t, found[name], line)
        for name, reference in _estimated(found):
            plot.add_panel(_label(name), units[name])
            plot.add_curve('estimate', t, found[name], {'color': 'c2', 'width': 1.4})
            if math.isfinite(reference):
                plot.add_level('least squares', t, reference, REFERENCE)
        return plot

    def _errors(self, found: Data, units: Mapping[str, str], link: str) -> Plot:
        t, unit = found['t'], units['velocity']
        plot = Plot(self._columns, ('time', 's'), link)
        if found['dv']:
            plot.add_panel('Δv = v̂ − v', unit)
            plot.add_curve('Δv', t, found['dv'], LINES[0])
        for name, reference in _estimated(found):
            if math.isfinite(reference):
                label = f'Δ{SYMBOLS[name]}'
                plot.add_panel(label, units[name])
                plot.add_curve(label, t, [finite(y) - reference for y in found[name]],
                               {'color': 'c2', 'width': 1.4})
        if any(math.isfinite(finite(value)) for value in found['W']):
            plot.add_panel('W', _squared(unit), type='log')
            plot.add_curve('W', t, found['W'], {'color': 'c3', 'width': 1.4})
        return plot

    def _figure(self, kind: str, dof: str, log: str, plot: Plot, heading: str, text: str = '', *,
                log_x: bool = False) -> Html:
        spec = plot.spec()
        if log_x:
            spec['layout']['xaxis']['type'] = 'log'
        if not spec['traces']:
            return Html('')
        name = f'figure{len(self._plots)}'
        self._plots[name] = spec
        panels = ', '.join(a['text'] for a in reversed(spec['layout']['annotations']))
        return tag('figure', tag('figcaption', tag('b', heading), ' ' if text else '', text),
                   tag('div', class_='plot', role='img', aria_label=f'{heading} {panels}'),
                   id=name, data_kind=kind, data_dof=dof, data_log=log)


def thinned(x: Values, y: Values) -> tuple[Values, Values]:
    """
    Return a curve of at most ``POINTS`` points that looks the same.

    Of each of ``POINTS / 3`` equal parts it has the points with the lowest and the highest
    value, and the first missing one, where the curve breaks.

    """
    if len(y) <= POINTS:
        return x, y
    values = [finite(value) for value in y]
    kept: set[int] = set()
    parts = POINTS // 3
    for i in range(parts):
        part = range(i * len(y) // parts, (i + 1) * len(y) // parts)
        known = [k for k in part if math.isfinite(values[k])]
        if known:
            kept |= {min(known, key=values.__getitem__), max(known, key=values.__getitem__)}
        if len(known) < len(part):
            kept.add(next(k for k in part if not math.isfinite(values[k])))
    order = sorted(kept)
    return [x[k] for k in order], [y[k] for k in order]


def _rounded(value: float, digits: int) -> float | None:
    return float(f'{value:.{digits}g}') if math.isfinite(value) else None


def _label(name: str) -> str:
    return f'{name} {SYMBOLS[name]}' if name in SYMBOLS else name.replace('force', 'thrust')


def _labelled(name: str, unit: str) -> str:
    return escape(f'{name} [{unit}]' if unit else name)


def _estimated(found: Data) -> list[tuple[str, float]]:
    """Return the parameters that were estimated, with their reference; one left out is 0."""
    return [(name, finite(found['reference'][name])) for name in PARAMETERS
            if any(value != 0.0 for value in found[name] if value is not None)]


def _squared(unit: str) -> str:
    return '/'.join(f'{part}²' for part in unit.split('/'))


def _fall(values: Values, unit: str) -> Html:
    known = [value for value in map(finite, values) if math.isfinite(value)]
    if len(known) < 2:
        return Html('')
    return join(' W goes from ', quantity(known[0], unit), ' to ', quantity(known[-1], unit), '.')
