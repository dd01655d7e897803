"""
The layouts for PlotJuggler and Foxglove show series that a replay really writes.

How each tool names a series is written down here from its sources: PlotJuggler's ParserROS
(fields joined by slashes, [i] for entries; a JointState by joint, a DiagnosticArray by status
and key), Foxglove's message paths (topic, dots, [i], [:], {field=="text"}).
"""

from collections import defaultdict
from collections.abc import Iterator
import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

from mcap.reader import make_reader
import pytest
from rovid_ros.commands.main import main
from rovid_ros.messages.types import standard_types

LIVE_ONLY = '/diagnostics'
"""The node's own health: a replay has none."""


@pytest.fixture(scope='module')
def messages(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the last message of each output topic of a replay of the example vehicle."""
    folder = tmp_path_factory.mktemp('layouts')
    config, log, out = repository / 'config' / 'jhurov.yaml', folder / 'a.mcap', folder / 'o.mcap'
    assert main(['simulate', '--params-file', str(config), '--output', str(log),
                 '--duration', '20']) == 0
    assert main(['replay', str(log), '--params-file', str(config), '--output', str(out)]) == 0
    store = standard_types()
    with out.open('rb') as file:
        return {channel.topic: store.deserialize_cdr(message.data, schema.name)
                for schema, channel, message in make_reader(file).iter_messages() if schema}


# --- PlotJuggler


def plotjuggler_series(topic: str, message: Any) -> Iterator[str]:
    """Yield the names of the numeric series that PlotJuggler makes of a message."""
    kind = message.__msgtype__
    if kind == 'sensor_msgs/msg/JointState':
        for field in ('position', 'velocity', 'effort'):
            for name, _ in zip(message.name, getattr(message, field)):
                yield f'{topic}/{name}/{field}'
    elif kind == 'diagnostic_msgs/msg/DiagnosticArray':
        for status in message.status:
            prefix = '/'.join(filter(None, (topic, status.hardware_id, status.name)))
            yield f'{prefix}/level'
            for pair in status.values:
                if is_number(pair.value):
                    yield f'{prefix}/{pair.key}'
    else:
        yield from fields(topic, message)


def fields(name: str, value: Any) -> Iterator[str]:
    if hasattr(value, '__dataclass_fields__'):
        for field in value.__dataclass_fields__:
            if not field.startswith('__'):
                yield from fields(f'{name}/{field}', getattr(value, field))
    elif isinstance(value, str):
        return
    elif hasattr(value, '__len__'):
        for i, entry in enumerate(value):
            yield from fields(f'{name}[{i}]', entry)
    else:
        yield name


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@pytest.fixture(scope='module')
def plotjuggler(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / 'config' / 'plotjuggler_layout.xml').getroot()


def test_plotjuggler_curves_exist(
        plotjuggler: ElementTree.Element, messages: dict[str, Any]) -> None:
    there = {name for topic, message in messages.items()
             for name in plotjuggler_series(topic, message)}
    curves = [curve.attrib['name'] for curve in plotjuggler.iter('curve')]
    assert len(curves) > 30
    assert set(curves) <= there
    assert {'/rov/params', '/rov/identifier_state', '/rov/velocity', '/rov/estimate'} == {
        re.match('/rov/[a-z_]+', curve).group() for curve in curves}  # type: ignore[union-attr]


def test_plotjuggler_structure(plotjuggler: ElementTree.Element) -> None:
    assert plotjuggler.tag == 'root'
    window, = plotjuggler.findall('tabbed_widget')
    assert window.attrib == {'name': 'Main Window', 'parent': 'main_window'}
    names = [tab.attrib['tab_name'] for tab in window.findall('Tab')]
    assert len(names) == len(set(names)) > 3
    for tab in window.findall('Tab'):
        container, = tab
        assert container.tag == 'Container'
        assert [child.tag for child in container] == ['DockSplitter']
    for splitter in plotjuggler.iter('DockSplitter'):
        assert splitter.attrib['orientation'] in ('-', '|')
        # PlotJuggler indexes the children and sizes up to count without a check
        sizes = splitter.attrib['sizes'].split(';')
        assert len(splitter) == int(splitter.attrib['count']) == len(sizes)
        assert sum(map(float, sizes)) == pytest.approx(1.0, abs=1e-3)
        assert {child.tag for child in splitter} <= {'DockSplitter', 'DockArea'}
    for area in plotjuggler.iter('DockArea'):
        plot, = area
        assert plot.attrib['mode'] == 'TimeSeries'
        assert len(plot)


# --- Foxglove


def resolve(path: str, messages: dict[str, Any]) -> list[Any]:
    """Return the values at a Foxglove message path."""
    match = re.match(r'(/[\w/]+)((?:\.\w+|\[[^]]*\]|\{[^}]*\})*)$', path)
    assert match, path
    values = [messages[match[1]]]
    for part in re.findall(r'\.\w+|\[[^]]*\]|\{[^}]*\}', match[2]):
        if part[0] == '.':
            values = [getattr(value, part[1:]) for value in values]
        elif part == '[:]':
            values = [entry for value in values for entry in value]
        elif part[0] == '[':
            values = [value[int(part[1:-1])] for value in values]
        else:
            field, _, text = part[1:-1].partition('==')
            assert re.fullmatch('"[^"]*"', text)
            values = [value for value in values if getattr(value, field) == text[1:-1]]
    return values


@pytest.fixture(scope='module')
def foxglove(repository: Path) -> dict[str, Any]:
    text = (repository / 'config' / 'foxglove_layout.json').read_text(encoding='utf-8')
    layout: dict[str, Any] = json.loads(text)
    return layout


def paths_of(foxglove: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    return [path for panel, config in foxglove['configById'].items()
            if panel.startswith(f'{kind}!') for path in config['paths']]


def test_foxglove_paths_are_one_number_each(
        foxglove: dict[str, Any], messages: dict[str, Any]) -> None:
    paths = paths_of(foxglove, 'Plot')
    assert len(paths) > 30
    for path in paths:
        value, = resolve(path['value'], messages)
        assert is_number(value), path
    topics = {re.match('/rov/[a-z_]+', path['value']).group()  # type: ignore[union-attr]
              for path in paths}
    assert topics == {'/rov/params', '/rov/identifier_state', '/rov/velocity', '/rov/estimate'}


def test_foxglove_states_are_one_text_each(
        foxglove: dict[str, Any], messages: dict[str, Any]) -> None:
    for path in paths_of(foxglove, 'StateTransitions'):
        value, = resolve(path['value'], messages)
        assert isinstance(value, str) and not is_number(value)


def test_foxglove_takes_the_stamp_where_there_is_one(
        foxglove: dict[str, Any], messages: dict[str, Any]) -> None:
    for path in paths_of(foxglove, 'Plot') + paths_of(foxglove, 'StateTransitions'):
        topic = path['value'].partition('.')[0]
        method = 'headerStamp' if hasattr(messages[topic], 'header') else 'receiveTime'
        assert path['timestampMethod'] == method


def test_foxglove_diagnostics_are_diagnostics(
        foxglove: dict[str, Any], messages: dict[str, Any]) -> None:
    topics = defaultdict(list)
    for panel, config in foxglove['configById'].items():
        if panel.startswith('Diagnostic'):
            topics[config['topicToRender']].append(config)
    assert set(topics) == {'/rov/estimate', LIVE_ONLY}
    estimate = messages['/rov/estimate']
    assert estimate.__msgtype__ == 'diagnostic_msgs/msg/DiagnosticArray'
    for config in topics['/rov/estimate']:
        assert config.get('selectedName', 'surge') in [status.name for status in estimate.status]


def test_foxglove_panels_are_all_shown_once(foxglove: dict[str, Any]) -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            assert node['direction'] in ('row', 'column')
            assert 0 < node['splitPercentage'] < 100
            yield from leaves(node['first'])
            yield from leaves(node['second'])
    root = foxglove['layout']
    tabs = foxglove['configById'][root]['tabs']
    titles = [tab['title'] for tab in tabs]
    assert len(titles) == len(set(titles)) > 3
    shown = [panel for tab in tabs for panel in leaves(tab['layout'])]
    assert sorted([root, *shown]) == sorted(foxglove['configById'])
