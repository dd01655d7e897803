"""The HTML report as a text: structure, escaping, and what is missing."""

from html.parser import HTMLParser
import json
import math
from pathlib import Path
from random import Random
import re
from typing import Any

from plotly import graph_objects
import pytest
from rovid_ros.report.figures import POINTS, thinned
from rovid_ros.report.report import page, write_report

from test.support.report_data import report_data

HOSTILE = '</script><img src=x onerror=alert(1)>&"\'.mcap'
VOID = {'meta', 'img', 'br', 'hr', 'input', 'link'}


class Document(HTMLParser):
    """What is in a page: every element with its attributes, and its text outside scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ''
        self.scripts: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f'never closed: {self.open}'

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == 'script':
            self.scripts.append(data)
        elif 'style' not in self.open:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def numbers(document: Document) -> dict[str, Any]:
    """Return what the plots are drawn from."""
    found: dict[str, Any] = json.loads(document.scripts[0], parse_constant=pytest.fail)
    return found


def panels(plot: dict[str, Any]) -> list[str]:
    """Return the titles of a plot's panels, from top to bottom."""
    return [note['text'] for note in reversed(plot['layout']['annotations'])]


def without(value: Any, key: str, known: bool = True) -> Any:
    """Return data in which every number at or below a key is None."""
    if isinstance(value, dict):
        return {k: without(v, key, known and k != key) for k, v in value.items()}
    if isinstance(value, list):
        return [without(v, key, known) for v in value]
    return value if known or isinstance(value, str) else None


def test_sections_in_order() -> None:
    document = Document(page(report_data()))
    sections = [attributes.get('id') for attributes in document.all('section')]
    assert [name for name in sections if name] == [
        'found', 'parameters', 'prediction', 'terms', 'plots-surge', 'plots-heave', 'plots-yaw',
        'excitation', 'quality']
    links = {attributes['href'] for attributes in document.all('a')}
    assert links == {f'#{name}' for name in sections if name}
    assert len(document.all('h1')) == 1
    assert {attributes['lang'] for attributes in document.all('html')} == {'en'}


def test_tables_say_everything_without_the_script() -> None:
    text = Document(page(report_data())).text.replace('\u00a0', ' ')
    for said in ('290 kg of effective mass', '290.0 kg', '284.2 to 295.8 kg', '± 2.00 %',
                 'effective mass m', '0.003448 1/kg', '0.004000 m/s', '0.004000 rad/s',
                 'fit 96.0 %', 'Table VII', 'Tables V and VI', '30.0 %', '35.20',
                 'it does not gamma', '10.00 Hz', '3 late', 'thrust: never negative'):
        assert said in text, said


def test_a_unit_that_is_no_newton_is_explained() -> None:
    data = report_data()
    assert 'cmd is what' not in Document(page(data)).text
    data['dofs']['yaw']['units']['force'] = 'cmd'
    assert 'cmd is what a command of 1 pushes' in Document(page(data)).text


def test_best_of_each_method_is_the_one_with_the_lowest_error() -> None:
    data = report_data(('a.mcap',), ('surge',))
    models = data['dofs']['surge']['models']
    for model, mae in zip(models, (0.5, 0.3, 0.7, 0.2, 0.9, 0.1)):
        model['scores'] = {'a.mcap': {'mae': mae, 'fit': None}}
    models[3]['scores']['a.mcap']['mae'] = None  # no score is worse than any
    best = page(data).partition('Tables V and VI')[2].partition('</table>')[0]
    assert re.findall(r'>(0\.\d000)&nbsp;|>(0\.\d000)\xa0', best) == [
        ('', '0.3000'), ('', '0.7000'), ('', '0.1000')]


def test_figures_and_their_curves() -> None:
    document = Document(page(report_data()))
    kinds = [attributes['data-kind'] for attributes in document.all('figure')]
    assert {kind: kinds.count(kind) for kind in kinds} == {
        'velocity': 3, 'estimates': 3, 'errors': 3, 'excitation': 24}
    data = numbers(document)
    assert set(data['plots']) == {f['id'] for f in document.all('figure')}
    velocity, estimates, errors = (data['plots'][f'figure{i}'] for i in range(3))
    assert panels(velocity) == ['velocity [m/s]', 'simulated − measured [m/s]', 'thrust [N]']
    named = [trace for trace in velocity['traces'] if trace['showlegend']]
    assert [trace['name'] for trace in named] == [
        'measured', 'least squares', 'adaptive identifier', 'output error']
    assert len({tuple(trace['line'].items()) for trace in named}) == 4
    columns = data['columns']
    assert [columns[trace['y']][0] for trace in estimates['traces']
            if trace['name'] == 'least squares'] == [0.003448, -1.0, -0.15, -0.01]
    assert panels(errors)[-1] == 'W [m²/s²]' and errors['layout']['yaxis6']['type'] == 'log'
    assert {plot['link'] for plot in (velocity, estimates, errors)} == {'surge on a.mcap'}


def test_the_error_is_simulated_less_measured() -> None:
    data = numbers(Document(page(report_data(('a.mcap',), ('surge',)))))
    traces = [trace for trace in data['plots']['figure0']['traces'] if 'output' in trace['name']]
    measured, (simulated, error) = data['plots']['figure0']['traces'][0], traces
    columns = [data['columns'][trace['y']] for trace in (measured, simulated, error)]
    for v, sim, dv in zip(*columns):
        assert dv == (None if v is None else pytest.approx(sim - v, abs=1e-5))


def test_plotly_takes_every_plot() -> None:
    data = numbers(Document(page(report_data())))
    for plot in data['plots'].values():
        for trace in plot['traces']:
            named = {**trace, **{axis: data['columns'][trace[axis]] for axis in 'xy'}}
            key = 'line' if 'line' in trace else 'marker'
            named[key] = {**trace[key], 'color': 'black'}  # the page puts its own
            graph_objects.Figure(data=[named])
        graph_objects.Figure(layout=plot['layout'])


def test_long_curves_keep_their_extremes_and_gaps() -> None:
    t = [0.1 * i for i in range(36_000)]
    v: list[float | None] = [math.sin(0.05 * x) for x in t]
    v[20_001], v[7_777], v[30_000] = 9.0, -9.0, None
    times, values = thinned(t, v)
    assert len(times) == len(values) <= POINTS
    found = dict(zip(times, values))
    assert found[t[20_001]] == 9.0 and found[t[7_777]] == -9.0 and found[t[30_000]] is None
    assert max(b - a for a, b in zip(times, times[1:])) < 2 * 3600 / (POINTS / 3)
    assert thinned(t[:POINTS], v[:POINTS]) == (t[:POINTS], v[:POINTS])


def test_names_of_logs_are_only_text() -> None:
    document = Document(page(report_data((HOSTILE, 'b.mcap'))))
    assert not document.all('img')
    assert HOSTILE in document.text
    assert len(document.scripts) == 3
    assert any(f['data-log'] == HOSTILE for f in document.all('figure'))


def test_hostile_words_everywhere_else() -> None:
    data = report_data(('a.mcap',), ('surge',))
    bad = '</script></style><img src=x>'
    data['logs'][0] |= {'warnings': [bad], 'rejected': {bad: 1}}
    data['logs'][0]['inputs'][0] |= {'input': bad, 'topic': bad}
    surge = data['dofs']['surge']
    surge['sentence'] = surge['models'][0]['note'] = bad
    surge['excitation']['a.mcap']['verdict'] = bad
    surge['units'] = dict.fromkeys(surge['units'], bad)
    surge['series']['a.mcap']['simulated'][bad] = [0.0] * 200
    document = Document(page(data))
    assert not document.all('img')
    assert len(document.scripts) == 3


def test_nothing_is_fetched() -> None:
    document = Document(page(report_data()))
    assert not {'link', 'img', 'iframe', 'object'} & {name for name, _ in document.elements}
    assert not [a for _, a in document.elements if 'src' in a or 'style' in a]
    policy, = (a['content'] for a in document.all('meta') if 'http-equiv' in a)
    assert policy is not None and policy.startswith("default-src 'none'; script-src 'sha256-")
    assert 'http' not in policy and '*' not in policy


def test_ten_minutes_are_at_most_ten_megabytes(tmp_path: Path) -> None:
    data = report_data(('a.mcap',), points=6000)
    for values in data['dofs'].values():  # seven methods, and noise that repeats nowhere
        series = values['series']['a.mcap']
        noise = Random(1)
        series['velocity'] = [noise.gauss(0.0, 1.0) for _ in series['t']]
        series['simulated'] = {
            f'method {i}': [noise.gauss(0.0, 1.0) for _ in series['t']] for i in range(7)}
    path = tmp_path / 'report.html'
    write_report(path, data)
    assert path.stat().st_size < 10e6


def test_numbers_are_rounded() -> None:
    data = report_data(('a.mcap',), ('surge',), points=3)
    data['dofs']['surge']['series']['a.mcap'] |= {
        't': [0.0, 12345.678, 12345.778], 'velocity': [1 / 3, math.nan, math.inf]}
    columns = numbers(Document(page(data)))['columns']
    assert [0.0, 12345.68, 12345.78] in columns and [0.33333, None, None] in columns


@pytest.mark.long
@pytest.mark.parametrize('key', [
    'best', 'std', 'low', 'high', 'value', 'scores', 'mae', 'fit', 'W', 'reference', 'dv',
    'v_hat', 'gamma', 'velocity', 'force', 'relative_bound', 'condition', 'series', 'adaptation',
    'physical', 'parameters', 'lumped', 'simulated'])
def test_any_number_can_be_missing(key: str) -> None:
    document = Document(page(without(report_data(), key)))
    assert not re.search(r'\bnan\b|None|\binf\b', document.text)
    assert numbers(document)


@pytest.mark.parametrize(('logs', 'dofs'), [
    (('a.mcap',), ('surge',)), ((), ('surge',)), (('a.mcap',), ())])
def test_little(logs: tuple[str, ...], dofs: tuple[str, ...]) -> None:
    data = report_data(logs or ('a.mcap',), dofs)
    if not logs:
        data['logs'] = []
    document = Document(page(data))
    assert 'Cross-validation' in document.text


def test_left_out_terms_have_no_panel() -> None:
    data = report_data(('a.mcap',), ('surge',))
    data['dofs']['surge']['adaptation']['a.mcap']['gamma'] = [0.0] * 200
    plots = numbers(Document(page(data)))['plots']
    assert panels(plots['figure1']) == [
        'velocity [m/s]', 'alpha α [1/kg]', 'beta β [1/m]', 'delta δ [m/s²]']


def test_same_data_gives_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / 'report.html'
    write_report(path, report_data())
    first = path.read_bytes()
    write_report(path, report_data())
    assert path.read_bytes() == first
    assert [*tmp_path.iterdir()] == [path]


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / 'report.html'
    path.write_text('old')
    with pytest.raises(KeyError):
        write_report(path, {})
    assert path.read_text() == 'old' and [*tmp_path.iterdir()] == [path]


def test_the_current_of_the_water_is_drawn_with_its_band() -> None:
    data = report_data(points=20)
    assert 'Current of the water' not in page(data)
    data['current'] = {'a.mcap': {
        't': [0.0, 1.0], 'x': [0.1, 0.3], 'y': [0.0, 0.3], 'x_std': [0.1, 0.01],
        'y_std': [0.1, 0.01], 'status': 'known'}}
    document = Document(page(data))
    assert 'In the end known: \u2192 0.4243' in document.text
    assert '45 degrees from x to y' in document.text
    found = numbers(document)
    plot, = [plot for plot in found['plots'].values() if plot['link'] == 'current on a.mcap']
    lower, upper, middle = (found['columns'][trace['y']] for trace in plot['traces'][:3])
    assert middle == [0.1, 0.3]
    assert (lower[1], upper[1]) == (0.2804, 0.3196)
