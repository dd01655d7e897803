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
FIRST = 'document.querySelector("#figure0 svg[role]")'


@pytest.fixture(scope='module')
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp('profile')) as made:
        yield made


@pytest.fixture
def shown(started: Browser, tmp_path: Path) -> Browser:
    """Return the browser with a report of three DOFs and two logs, 1280 px wide."""
    path = tmp_path / 'report.html'
    write_report(path, report_data((HOSTILE, 'b.mcap'), points=3000))
    started.resize(1280)
    started.requests.clear()
    started.complaints.clear()
    started.open(path)
    return started


def labels(shown: Browser, figure: str) -> list[str]:
    """Return the tick labels and titles of a figure."""
    found: list[str] = shown.evaluate(
        f'[...document.querySelectorAll("#{figure} text")].map(text => text.textContent)')
    return found


def place(shown: Browser, share: float) -> dict[str, float]:
    """Return a place in the window at a share of the first panel's width."""
    found: dict[str, float] = shown.evaluate(
        f'(box => ({{x: box.left + {share} * box.width, y: box.top + box.height / 2}}))'
        f'({FIRST}.getBoundingClientRect())')
    return found


def drag(shown: Browser, start: float, end: float) -> None:
    shown.evaluate(f'{FIRST}.scrollIntoView({{block: "center"}})')
    for kind, share in (('mousePressed', start), ('mouseMoved', end), ('mouseReleased', end)):
        shown.mouse(kind, **place(shown, share), button='left', clickCount=1)
    shown.settle()


def clean(shown: Browser) -> None:
    """Check that nothing went wrong, by the page's own account and by the browser's."""
    assert shown.complaints == []
    assert shown.evaluate('document.documentElement.dataset.errors') == '0'
    assert shown.evaluate('document.documentElement.dataset.ready') == 'true'


def test_everything_is_drawn_and_nothing_fetched(shown: Browser) -> None:
    figures: list[dict[str, Any]] = shown.evaluate(
        '[...document.querySelectorAll("figure")].map(node => ({...node.dataset}))')
    assert len(figures) == 15
    for figure in figures:
        panels = [int(points) for points in figure['panels'].split()]
        least = 3 if figure['kind'] == 'excitation' else 500
        assert panels and min(panels) >= least, figure
        assert int(figure['drawn']) == sum(panels)
    clean(shown)
    assert len(shown.requests) == 1 and shown.requests[0].startswith('file://')


def test_a_mistake_would_be_seen(shown: Browser) -> None:
    shown.evaluate('setTimeout(() => { throw new Error("on purpose"); })')
    shown.evaluate('new Promise(done => setTimeout(() => done(0), 50))')
    assert shown.evaluate('document.documentElement.dataset.errors') == '1'
    shown.evaluate('fetch("https://example.invalid/").catch(() => 0)')
    assert len(shown.complaints) > 1
    assert not [url for url in shown.requests if url.startswith('https')]


def test_axes_have_units_and_round_ticks(shown: Browser) -> None:
    texts = labels(shown, 'figure0')
    assert {'velocity [m/s]', 'simulated − measured [10⁻³ m/s]', 'thrust [N]', 'time [s]',
            '−0.4', '0.0', '0.4', '−50', '0', '50', '100'} <= set(texts)
    assert not [text for text in texts if len(text.lstrip('−')) > 6 and '[' not in text]
    assert 'alpha α [10⁻³ 1/kg]' in labels(shown, 'figure1')
    assert 'W [m²/s²]' in labels(shown, 'figure2')


def test_drag_zooms_all_figures_of_the_log_and_double_click_resets(shown: Browser) -> None:
    before = {name: labels(shown, name) for name in ('figure0', 'figure2', 'figure3')}
    drag(shown, 0.4, 0.6)
    assert labels(shown, 'figure0') != before['figure0']
    assert labels(shown, 'figure2') != before['figure2']
    assert labels(shown, 'figure3') == before['figure3']  # another DOF
    assert shown.evaluate('!document.querySelector("#figure2 .whole").hidden')
    for count in (1, 2):
        for kind in ('mousePressed', 'mouseReleased'):
            shown.mouse(kind, **place(shown, 0.5), button='left', clickCount=count)
    shown.settle()
    assert {name: labels(shown, name) for name in before} == before
    assert shown.evaluate('document.querySelector("#figure0 .whole").hidden')
    clean(shown)


def test_wheel_zooms_after_a_click_only(shown: Browser) -> None:
    shown.evaluate(f'{FIRST}.scrollIntoView({{block: "center"}})')
    before = labels(shown, 'figure0')
    wheel = {'deltaX': 0, 'deltaY': -300}
    shown.mouse('mouseWheel', **place(shown, 0.5), **wheel, modifiers=0)
    shown.settle()
    assert labels(shown, 'figure0') == before
    drag(shown, 0.5, 0.5)  # a click
    for _ in range(3):
        shown.mouse('mouseWheel', **place(shown, 0.5), **wheel)
    shown.settle()
    assert labels(shown, 'figure0') != before


def test_pinch_zooms(shown: Browser) -> None:
    shown.resize(390, phone=True)
    shown.call('Emulation.setTouchEmulationEnabled', enabled=True, maxTouchPoints=2)
    try:
        shown.settle()
        shown.evaluate(f'{FIRST}.scrollIntoView({{block: "center"}})')
        before = labels(shown, 'figure0')
        for kind, apart in (('touchStart', 0.1), ('touchMove', 0.2), ('touchMove', 0.35)):
            shown.call('Input.dispatchTouchEvent', type=kind, touchPoints=[
                {**place(shown, 0.5 + sign * apart), 'id': i}
                for i, sign in enumerate((-1, 1))])
        shown.call('Input.dispatchTouchEvent', type='touchEnd', touchPoints=[])
        shown.settle()
        assert labels(shown, 'figure0') != before
    finally:
        shown.call('Emulation.setTouchEmulationEnabled', enabled=False)
    clean(shown)


def test_pointer_reads_values_with_units(shown: Browser) -> None:
    shown.evaluate(f'{FIRST}.scrollIntoView({{block: "center"}})')
    shown.mouse('mouseMoved', **place(shown, 0.3))
    shown.settle()
    text = shown.evaluate('document.querySelector(".readout").innerText')
    for part in ('time', ' s', 'measured', 'output error', 'm/s'):
        assert part in text
    shown.mouse('mouseMoved', x=1, y=1)
    assert shown.evaluate('document.querySelector(".readout").hidden')


def test_legend_switches_a_curve_off_and_on(shown: Browser) -> None:
    drawn = 'Number(document.querySelector("#figure0").dataset.drawn)'
    before = shown.evaluate(drawn)
    for state in ('false', 'true'):
        shown.evaluate('document.querySelector("#figure0 button").click()')
        shown.settle()
        assert shown.evaluate('document.querySelector("#figure0 button").ariaPressed') == state
        assert (shown.evaluate(drawn) < before) == (state == 'false')


@pytest.mark.parametrize('width', [360, 390, 768])
def test_fits_a_phone(shown: Browser, width: int) -> None:
    shown.resize(width, phone=True)
    shown.evaluate('dispatchEvent(new Event("resize"))')
    shown.settle()
    assert shown.evaluate('document.documentElement.scrollWidth') == width
    widest = shown.evaluate('Math.max(...[...document.querySelectorAll("svg[role]")]'
                            '.map(svg => svg.getBoundingClientRect().right))')
    assert widest <= width
    clean(shown)


def test_dark_and_print(shown: Browser) -> None:
    colour = 'getComputedStyle(document.body).backgroundColor'
    dark = [{'name': 'prefers-color-scheme', 'value': 'dark'}]
    shown.call('Emulation.setEmulatedMedia', features=dark)
    assert shown.evaluate(colour) == 'rgb(20, 24, 28)'
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
