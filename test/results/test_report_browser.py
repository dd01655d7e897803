"""The HTML report in a real browser: everything is drawn, nothing is fetched."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rovid_ros.report.report import write_report

from test.support.headless_browser import Browser, browser, CHROMIUM
from test.support.report_data import report_data

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason='no chromium, chromium-browser or google-chrome is installed')

HOSTILE = '</script><img src="x.png" onerror="fail()">&.mcap'
AREA = 'document.querySelector("#figure0 .nsewdrag")'


@pytest.fixture(scope='module')
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp('profile')) as made:
        yield made


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a report of three DOFs and two logs; the browser compiles a file only once."""
    path = tmp_path_factory.mktemp('report') / 'report.html'
    write_report(path, report_data((HOSTILE, 'b.mcap'), points=3000))
    return path


@pytest.fixture
def shown(started: Browser, report: Path) -> Browser:
    """Return the browser with the report, loaded anew and 1280 px wide."""
    started.resize(1280)
    started.requests.clear()
    started.complaints.clear()
    started.open(report)
    wait(started, 'document.documentElement.dataset.ready')
    return started


def wait(shown: Browser, condition: str) -> None:
    """Wait until a condition of the page holds."""
    shown.evaluate('new Promise(done => { const look = () => '
                   f'({condition}) ? done(0) : setTimeout(look, 20); look(); }})')


def double_click_until(shown: Browser, condition: str) -> None:
    """Click twice in the first panel, again where a busy machine made two clicks of it."""
    for _ in range(20):
        for count in (1, 2):
            for kind in ('mousePressed', 'mouseReleased'):
                shown.mouse(kind, **place(shown, 0.5), button='left', clickCount=count)
        shown.evaluate('new Promise(done => setTimeout(() => done(0), 600))')
        if shown.evaluate(condition):
            return
    raise AssertionError(f'not after 20 double clicks: {condition}')


def draw(shown: Browser, *figures: int) -> None:
    """Scroll to figures until they are drawn; the first is in the window in the end."""
    for i in reversed(figures):
        shown.evaluate(f'document.getElementById("figure{i}").scrollIntoView()')
        wait(shown, f'document.getElementById("figure{i}").dataset.drawn')
    shown.settle()


def labels(shown: Browser, figure: int) -> list[str]:
    """Return the tick labels and titles of a figure."""
    found: list[str] = shown.evaluate(
        f'[...document.querySelectorAll("#figure{figure} .plot text")]'
        '.map(text => text.textContent)')
    return found


def times(shown: Browser, figure: int) -> list[float]:
    """Return the ends of a figure's x axis."""
    found: list[float] = shown.evaluate(
        f'document.querySelector("#figure{figure} .plot").layout.xaxis.range')
    return found


def place(shown: Browser, share: float) -> dict[str, float]:
    """Return a place in the window at a share of the first panel's width."""
    found: dict[str, float] = shown.evaluate(
        f'(box => ({{x: box.left + {share} * box.width, y: box.top + box.height / 2}}))'
        f'({AREA}.getBoundingClientRect())')
    return found


def drag(shown: Browser, start: float, end: float) -> None:
    for kind, share in (('mousePressed', start), ('mouseMoved', 0.5 * (start + end)),
                        ('mouseMoved', end), ('mouseReleased', end)):
        shown.mouse(kind, **place(shown, share), button='left', buttons=1, clickCount=1)
    shown.settle()


def touch(shown: Browser, fingers: list[list[tuple[float, float]]]) -> None:
    """Move fingers, each step the places in the window of all of them."""
    for i, step in enumerate(fingers):
        shown.call('Input.dispatchTouchEvent', type='touchMove' if i else 'touchStart',
                   touchPoints=[{'x': x, 'y': y, 'id': k} for k, (x, y) in enumerate(step)])
        shown.settle()
    shown.call('Input.dispatchTouchEvent', type='touchEnd', touchPoints=[])
    shown.settle()


@pytest.fixture
def phone(started: Browser, report: Path) -> Iterator[Browser]:
    """Return the browser as a phone, at the first figure of the report, loaded anew."""
    started.complaints.clear()
    started.resize(390, 844, phone=True)
    started.call('Emulation.setTouchEmulationEnabled', enabled=True, maxTouchPoints=2)
    try:
        started.open(report)
        wait(started, 'document.documentElement.dataset.ready')
        draw(started, 0)
        yield started
    finally:
        started.call('Emulation.setTouchEmulationEnabled', enabled=False)


def clean(shown: Browser) -> None:
    """Check that nothing went wrong, by the page's own account and by the browser's."""
    assert shown.complaints == []
    assert shown.evaluate('document.documentElement.dataset.errors') == '0'


def test_everything_is_drawn_and_nothing_fetched(shown: Browser) -> None:
    figures: list[dict[str, Any]] = shown.evaluate(
        '[...document.querySelectorAll("figure")].map(node => ({...node.dataset}))')
    assert len(figures) == 33
    draw(shown, *range(33))
    for i in range(33):
        curves, expected = shown.evaluate(
            f'(box => [box.querySelectorAll(".scatterlayer .trace, .bars .point").length, '
            f'box.data.reduce((sum, trace) => sum + (trace.type === "bar" ? trace.x.length : 1)'
            f', 0)])(document.querySelector("#figure{i} .plot"))')
        assert curves == expected > 0, figures[i]
    clean(shown)
    assert [url for url in shown.requests if not url.startswith(('file:', 'data:'))] == []
    assert shown.evaluate('document.querySelectorAll("[data-title*=loud]").length') == 0


def test_a_mistake_would_be_seen(shown: Browser) -> None:
    shown.evaluate('setTimeout(() => { throw new Error("on purpose"); })')
    shown.evaluate('new Promise(done => setTimeout(() => done(0), 50))')
    assert shown.evaluate('document.documentElement.dataset.errors') == '1'
    shown.evaluate('fetch("https://example.invalid/").catch(() => 0)')
    assert len(shown.complaints) > 1
    assert not [url for url in shown.requests if url.startswith('https')]


def test_axes_have_units(shown: Browser) -> None:
    draw(shown, 0, 1, 2)
    assert {'velocity [m/s]', 'simulated − measured [m/s]', 'thrust [N]', 'time [s]',
            '−0.4', '0', '0.4', '−50', '50', '100', 'measured'} <= set(labels(shown, 0))
    assert 'alpha α [1/kg]' in labels(shown, 1)
    assert 'W [m²/s²]' in labels(shown, 2)


def test_drag_zooms_all_figures_of_the_log_and_double_click_resets(shown: Browser) -> None:
    draw(shown, 0, 1, 3)
    whole = times(shown, 0)
    drag(shown, 0.4, 0.6)
    wait(shown, 'document.querySelector("#figure1 .plot").layout.xaxis.range[0] > 50')
    assert times(shown, 0) == pytest.approx([120.0, 180.0], abs=3.0)
    assert times(shown, 1) == times(shown, 0)
    assert times(shown, 3) == whole  # another DOF
    draw(shown, 2)  # not drawn until now
    assert times(shown, 2) == times(shown, 0)
    draw(shown, 0)
    double_click_until(
        shown, 'document.querySelector("#figure2 .plot").layout.xaxis.range[0] < 50')
    assert times(shown, 0) == times(shown, 1) == times(shown, 2) == whole
    clean(shown)


def test_two_fingers_zoom_and_one_scrolls(phone: Browser) -> None:
    low, high = times(phone, 0)
    where = place(phone, 0.5)
    touch(phone, [[(where['x'] + sign * apart, where['y']) for sign in (-1, 1)]
                  for apart in (30, 60, 100)])
    wait(phone, f'document.querySelector("#figure0 .plot").layout.xaxis.range[0] > {low + 50}')
    zoomed = times(phone, 0)
    assert zoomed[1] - zoomed[0] == pytest.approx(0.3 * (high - low), rel=0.05)
    assert sum(zoomed) == pytest.approx(low + high, rel=0.1)
    before = phone.evaluate('scrollY')
    touch(phone, [[(where['x'], where['y'] - 20 * k)] for k in range(8)])
    wait(phone, f'scrollY > {before + 50}')
    assert times(phone, 0) == zoomed
    clean(phone)


def test_pointer_reads_values_with_units(shown: Browser) -> None:
    draw(shown, 0)
    shown.mouse('mouseMoved', **place(shown, 0.3))
    wait(shown, 'document.querySelector("#figure0 .hoverlayer text")')
    text = shown.evaluate('document.querySelector("#figure0 .hoverlayer").textContent')
    for part in ('measured', 'output error', 'm/s', 'thrust', ' N'):
        assert part in text


def test_legend_switches_a_curve_off_and_on_in_all_panels(shown: Browser) -> None:
    draw(shown, 0)
    curves = 'document.querySelectorAll("#figure0 .scatterlayer .trace").length'
    before = shown.evaluate(curves)
    assert before == 8  # measured and thrust once, three methods twice
    for expected in (6, 8):
        where = shown.evaluate(
            '(box => ({x: box.left + box.width / 2, y: box.top + box.height / 2}))'
            '(document.querySelectorAll("#figure0 .legendtoggle")[1].getBoundingClientRect())')
        for kind in ('mousePressed', 'mouseReleased'):
            shown.mouse(kind, **where, button='left', clickCount=1)
        wait(shown, f'{curves} === {expected}')
        shown.evaluate('new Promise(done => setTimeout(() => done(0), 400))')


def test_exports_a_picture(shown: Browser) -> None:
    draw(shown, 0)
    picture = shown.evaluate('Plotly.toImage(document.querySelector("#figure0 .plot"))')
    assert picture.startswith('data:image/png;base64,') and len(picture) > 10_000
    clean(shown)


def test_tables_are_there_before_plotly(started: Browser, tmp_path: Path) -> None:
    path = tmp_path / 'report.html'
    write_report(path, report_data(('a.mcap',), points=6000))
    started.open(path)
    assert started.evaluate('document.querySelectorAll("table").length') > 5
    wait(started, 'document.documentElement.dataset.ready')


@pytest.mark.parametrize('width', [360, 390, 768])
def test_fits_a_phone(phone: Browser, width: int) -> None:
    phone.resize(width, phone=True)
    draw(phone, 0, 1, 2, 32)
    wait(phone, f'document.querySelector("#figure0 .main-svg").clientWidth <= {width}')
    assert phone.evaluate('document.documentElement.scrollWidth') == width
    widest = phone.evaluate('Math.max(...[...document.querySelectorAll(".main-svg")]'
                            '.map(svg => svg.getBoundingClientRect().right))')
    assert widest <= width
    clean(phone)


def test_a_phone_shows_two_logs_of_coupled_dofs(started: Browser, tmp_path: Path) -> None:
    data = report_data(('all_axes.mcap', 'surge_sway_heave.mcap'), points=1000)
    for dof in data['dofs'].values():
        for model in dof['models']:
            for score in model['scores'].values():
                score['fit_joint'] = 0.766
    path = tmp_path / 'report.html'
    write_report(path, data)
    started.resize(390, 844, phone=True)
    started.open(path)
    wait(started, 'document.documentElement.dataset.ready')
    widest = started.evaluate('Math.max(...[...document.querySelectorAll('
                              '".matrix tr > :nth-child(3)")]'
                              '.map(cell => cell.getBoundingClientRect().right))')
    assert 300 < widest <= 390


def test_dark_and_print(shown: Browser) -> None:
    colour = 'getComputedStyle(document.body).backgroundColor'
    dark = [{'name': 'prefers-color-scheme', 'value': 'dark'}]
    shown.call('Emulation.setEmulatedMedia', features=dark)
    assert shown.evaluate(colour) == 'rgb(20, 24, 28)'
    draw(shown, 0)
    paper = 'getComputedStyle(document.querySelector("#figure0 .main-svg")).backgroundColor'
    wait(shown, f'{paper} === "rgb(20, 24, 28)"')
    shown.call('Emulation.setEmulatedMedia', media='print', features=dark)
    assert shown.evaluate(colour) == 'rgb(255, 255, 255)'
    shown.call('Emulation.setEmulatedMedia', media='', features=[])
    assert shown.call('Page.printToPDF')['data']
    clean(shown)


def test_without_script_the_tables_stay(started: Browser, tmp_path: Path) -> None:
    path = tmp_path / 'report.html'
    write_report(path, report_data())
    started.call('Emulation.setScriptExecutionDisabled', value=True)
    try:
        started.open(path)
        text = started.evaluate('document.body.innerText')
        visible = started.evaluate('[...document.querySelectorAll("figure")]'
                                   '.filter(node => node.offsetHeight).length')
    finally:
        started.call('Emulation.setScriptExecutionDisabled', value=False)
    assert 'The plots need JavaScript' in text and 'effective mass' in text
    assert visible == 0
