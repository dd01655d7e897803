"""The tables of the report: models, what a log can determine, and how complete it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
import re
from typing import Any

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_ros.report.markup import (
    bound_to_units,
    capital,
    finite,
    Html,
    join,
    mean_score,
    NONE,
    percent,
    quantity,
    rank,
    score,
    small,
    symbol,
    table,
    tag,
    terms,
    title,
    with_unit,
)
from rovid_ros.results.text import number

Data = Mapping[str, Any]
LEVELS = 7  # of the heat maps; the style has a colour for each
BOUNDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # between the colours of relative bounds


def findings(data: Data) -> Html:
    """Return what was identified, a sentence per DOF."""
    items = []
    for values in data['dofs'].values():
        sentence = re.sub(r' -(?=\d)', ' −', bound_to_units(values['sentence']))
        name, colon, rest = sentence.partition(':')
        items.append(tag('li', tag('b', name + colon), rest))
    return tag('ul', *items, class_='findings')


def parameters(dof: str, values: Data) -> Html:
    """Return the parameters of a DOF's best model with their 95 % intervals."""
    best = values['best']
    bodies = [[_parameter(name, best[form][name]) for name in names]
              for names, form in ((PHYSICAL, 'physical'), (PARAMETERS, 'lumped'))]
    if best['couplings']:
        bodies.append([[join('coupling ', symbol(f'κ_{name}')), *_parameter(name, found)[1:]]
                       for name, found in best['couplings'].items()])
    source = f'{title(best["method"])}, trained on {best["trained_on"]}'
    caption = join(tag('b', capital(dof)), ' ', small(source))
    return table(caption, ('parameter', 'value', '95 % interval'), bodies, class_='parameters')


def _parameter(name: str, values: Data) -> list[str]:
    unit = values.get('unit', '')  # a coupling has none
    value, low, high = (finite(values[key]) for key in ('value', 'low', 'high'))
    interval: str = NONE
    if math.isfinite(low) and math.isfinite(high):
        digits = _decimals(low, high)
        interval = join(with_unit(f'{low:,.{digits}f}', ''), ' to ',
                        with_unit(f'{high:,.{digits}f}', unit))
        if value:
            interval = join(interval, small(f'± {percent(0.5 * abs((high - low) / value))}'))
    return [join(title(name), ' ', symbol(name)), quantity(value, unit), interval]


def _decimals(low: float, high: float) -> int:
    """Return what four significant digits need, or more to tell the ends apart."""
    size = max(abs(low), abs(high), 1e-300)
    digits = max(3 - math.floor(math.log10(size)),
                 -math.floor(math.log10(max(high - low, size * 1e-6))))
    return min(max(digits, 0), 12)


def matrix(dof: str, values: Data, logs: Sequence[Data]) -> Html:
    """Return the heat map of models x logs for a DOF."""
    models, unit = values['models'], values['units']['velocity']
    names = [log['name'] for log in logs]
    maes = [[score(model, name, 'mae') for name in names] for model in models]
    known = [mae for row in maes for mae in row if math.isfinite(mae) and mae > 0.0]
    best = [min((row[j] for row in maes if math.isfinite(row[j])), default=math.nan)
            for j in range(len(names))]
    groups: dict[tuple[str, ...], list[Sequence[str]]] = {}
    together = ''
    for model, row in zip(models, maes):
        cells: list[str] = [_model(model)]
        for j, name in enumerate(names):
            classes = [f'heat{level(row[j], known)}'] if math.isfinite(row[j]) else []
            classes += ['own'] if name == model['trained_on'] else []
            classes += ['best'] if same(row[j], best[j]) else []
            fits = [small(f'fit {percent(score(model, name, "fit"))}')]
            joint = score(model, name, 'fit_joint')
            if math.isfinite(joint):
                fits.append(small(f'all together {percent(joint)}'))  # as a replay calls it
                together = '; all together: with all DOFs simulated'
            cells.append(tag('td', quantity(row[j], unit), *fits,
                             class_=' '.join(classes) or None))
        if len(names) > 1:
            mae, mean_fit = mean_score(model)
            cells.append(join(quantity(mae, unit), small(f'fit {percent(mean_fit)}')))
        groups.setdefault(tuple(model['terms']), []).append(cells)
    caption = join(tag('b', capital(dof)), ' ', small(
        f'mean |v_sim − v| [{unit}] and fit of each model (rows) on each log (columns){together}'))
    head = ['model', *(join(log['name'], small(_role(log))) for log in logs),
            *(['mean'] if len(names) > 1 else [])]
    return table(caption, head, list(groups.values()), class_='matrix')


def same(a: float, b: float) -> bool:
    """Tell whether two errors are equal as they are shown."""
    return number(a) == number(b) != number(math.nan)


def level(value: float, known: Sequence[float]) -> int:
    """Return 0 (the least of the known values) to ``LEVELS`` - 1, by ratio."""
    low, high = min(known, default=1.0), max(known, default=1.0)
    if not value > low:
        return 0
    # half a decade at least, so that equally good models look equally good
    span = max(math.log(high / low), math.log(3.0))
    return min(LEVELS - 1, int(LEVELS * math.log(value / low) / span))


def heat_legend() -> Html:
    """Return what the colours of the matrix mean."""
    steps = [tag('span', Html('&nbsp;'), class_=f'heat{i}') for i in range(LEVELS)]
    return tag(
        'p', 'smallest error ', tag('span', *steps, class_='ramp', aria_hidden='true'),
        ' largest error of the DOF. ', tag('b', 'Bold'), ': the best on that log. ',
        tag('span', 'Framed', class_='own key'), ': the log that the model was trained on; '
        'all others are predictions of data that it has not seen.', class_='legend-note')


def _model(model: Data) -> Html:
    chosen = ''.join(f' {name}' for name in model['couplings'])
    chosen += ' (selected)' if model['selected'] else ''
    note = [small(model['note'], class_='note')] if model['note'] else []
    return tag('th', capital(title(model['method'])),
               small(f'{model["trained_on"]} · {terms(model["terms"])}{chosen}'),
               *note, scope='row')


def _role(log: Data) -> str:
    return {'train': 'training', 'validate': 'validation'}[log['role']]


def _row(first: str, model: Data, units: Mapping[str, str], best: bool) -> list[str]:
    std = model['std'] or {}
    mae, fit = mean_score(model)
    cells: list[str] = [first]
    for name in PARAMETERS:
        if name not in model['terms']:
            cells.append(NONE)
            continue
        sigma, unit = finite(std.get(name)), units[name]
        spread = [small('σ ', quantity(sigma, unit))] if math.isfinite(sigma) else []
        cells.append(tag('td', quantity(model['parameters'][name], unit), *spread))
    cells.append(tag('td', quantity(mae, units['velocity']), class_='best' if best else None))
    return [*cells, percent(fit), model['trained_on']]


HEAD = (*(symbol(name) for name in PARAMETERS), 'mean mae', 'mean fit', 'trained on')


def equal_terms(data: Data) -> Html:
    """Return the methods beside each other on equal parameter sets (the paper's Table VII)."""
    bodies: list[list[list[str]]] = []
    for dof, values in data['dofs'].items():
        models = values['models']
        for used in dict.fromkeys(tuple(model['terms']) for model in models):
            best = _best([m for m in models if tuple(m['terms']) == used])
            if len(best) < 2:
                continue
            lowest = mean_score(min(best.values(), key=rank))[0]
            group = tag('th', f'{capital(dof)}: {terms(used)}', colspan='8', scope='rowgroup',
                        class_='group')
            bodies.append([[group], *(
                _row(title(method), model, values['units'], same(mean_score(model)[0], lowest))
                for method, model in best.items())])
    if not bodies:
        return tag('p', 'No two methods identified the same terms.')
    return table('Equal parameter sets: the methods compared on the same terms (the paper’s '
                 'Table VII)', ('method', *HEAD), bodies, class_='models')


def best_terms(data: Data) -> Html:
    """Return each method's best model per DOF (the paper's Tables V and VI)."""
    methods = dict.fromkeys(model['method'] for values in data['dofs'].values()
                            for model in values['models'])
    bodies = []
    for method in methods:
        body: list[Sequence[str]] = [[tag(
            'th', capital(title(method)), colspan='8', scope='rowgroup', class_='group')]]
        for dof, values in data['dofs'].items():
            model = _best(values['models'])[method]
            chosen = 'selected' if model['selected'] else 'all configured'
            name = join(dof, small(f'{terms(model["terms"])} ({chosen})'))
            body.append(_row(name, model, values['units'], False))
        bodies.append(body)
    return table('The best terms of each method (the paper’s Tables V and VI)',
                 ('DOF', *HEAD), bodies, class_='models')


def _best(models: Sequence[Data]) -> dict[str, Data]:
    """Return the best model of each method."""
    found: dict[str, Data] = {}
    for model in models:
        method = model['method']
        if method not in found or rank(model) < rank(found[method]):
            found[method] = model
    return found


def excitation(dof: str, values: Data) -> Html:
    """Return which parameters of a DOF each log can determine."""
    found = values['excitation']
    names = [name for name in PARAMETERS
             if any(name in log['relative_bound'] for log in found.values())]
    rows = [[log, *(_bound(measured['relative_bound'].get(name)) for name in names),
             quantity(measured['condition'], '')] for log, measured in found.items()]
    caption = join(tag('b', capital(dof)), ' ', small(
        'lowest standard deviation that any method can reach, relative to the parameter '
        '(Cramér-Rao bound), and condition number of the normalised regressors [–]'))
    verdicts = [tag('li', tag('b', f'{log}: '), bound_to_units(measured['verdict']))
                for log, measured in found.items()]
    return join(table(caption, ('log', *map(symbol, names), 'condition'), [rows], class_='bounds'),
                tag('ul', *verdicts, class_='verdicts'))


def _bound(value: Any) -> Html:
    share = finite(value)
    if not math.isfinite(share):
        return tag('td', NONE)
    return tag('td', percent(share), class_=f'heat{sum(share > edge for edge in BOUNDS)}')


def quality(log: Data) -> Html:
    """Return rates, gaps, what was refused and warnings of a log."""
    about = f'{_role(log)}, {log["duration_s"]:,.1f} s, {log["messages"]:,} messages'
    rows = [[entry['input'], tag('code', entry['topic']), quantity(entry['rate_hz'], 'Hz'),
             f'{entry["count"]:,}', quantity(entry['longest_gap_s'], 's')]
            for entry in log['inputs']]
    parts: list[str] = [tag('h3', log['name'])]
    caption = join(tag('b', 'Inputs'), ' ', small(about))
    parts.append(table(caption, ('input', 'topic', 'rate', 'samples', 'longest gap'),
                       [rows], class_='inputs'))
    listed = ', '.join(f'{n:,} {reason.replace("_", " ")}'
                       for reason, n in log['rejected'].items())
    parts.append(tag('p', tag('b', 'Refused samples and steps: '), listed or 'none'))
    parts.append(_warnings(log['warnings']))
    return tag('section', *parts, class_='log')


def _warnings(lines: Sequence[str]) -> Html:
    if not lines:
        return tag('p', tag('b', 'Warnings: '), 'none')
    return join(tag('p', tag('b', 'Warnings:')),
                tag('ul', *(tag('li', line) for line in lines), class_='warnings'))
