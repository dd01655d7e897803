"""Parameters that are set while the node runs: all or nothing, told, and repeated in a replay."""

from collections.abc import Iterator
import json
import math
from pathlib import Path
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import get_parameter_value, Parameter
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import SettingsError
from rovid_ros.config.keys import KEYS
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import changed as changed_settings, settings_from
from rovid_ros.logs.log import Log
from rovid_ros.logs.player import change_parameters, repeat_control
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.parameters import own_values
from std_srvs.srv import SetBool, Trigger
import yaml

from test.support.live_drive import (
    assert_same,
    drive,
    replayed_record,
    Start,
    UNSTAMPED,
    UNSTAMPED_TYPES,
)
from test.support.live_node import changed, heard, Peer

LIVE = {
    'enable', 'identifier.adaptation_time', 'identifier.feedback_gain',
    'identifier.adaptation_gains', 'velocity.cutoff', 'velocity.gate', 'velocity.max',
    'max_gap', 'max_wait', 'thrusters.timeout', 'checkpoint.period'}
RAW = {'identifier.feedback_gain': -2.0, 'identifier.adaptation_gains': [1e-5, 5.0, 1.0, 0.1]}
NAME = '/identifier_node'


@pytest.fixture
def given(tmp_path: Path) -> dict[str, Any]:
    return changed({'checkpoint.path': str(tmp_path / 'checkpoint.json'),
                    'checkpoint.period': 86400.0})


@pytest.fixture
def node(ros: None, given: dict[str, Any]) -> Iterator[IdentifierNode]:
    node = IdentifierNode(given)
    yield node
    node.destroy_node()


def parameters(values: dict[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def shown(node: IdentifierNode) -> dict[str, Any]:
    """Return what the node says of its live parameters."""
    values = {name: node.get_parameter(name).value for name in LIVE}
    return {k: list(v) if k == 'identifier.adaptation_gains' else v for k, v in values.items()}


def test_the_table_says_what_is_live(node: IdentifierNode) -> None:
    assert {key.name for key in KEYS if key.live} == LIVE
    for key in KEYS:
        described = node.describe_parameter(key.name)
        assert described.description
        assert ('unconfigured' in described.additional_constraints) == (
            key.name not in LIVE), key.name


@pytest.mark.parametrize('values', [
    {'max_gap': 2.5}, {'max_gap': 2}, {'enable': False}, {'velocity.cutoff': 1.0}, RAW,
    {'identifier.adaptation_time': 7.0, 'thrusters.timeout': 0, 'velocity.max': 3},
    {**RAW, 'identifier.adaptation_gains': [1, 2, 3, 4] * 3},
    {'max_wait': 0.0, 'checkpoint.period': 5.0}])
def test_taken_and_shown(
        values: dict[str, Any], given: dict[str, Any], node: IdentifierNode) -> None:
    """As if the file had said so; a whole number will do for a double."""
    expected = settings_from({**given, **values})
    assert node.set_parameters_atomically(parameters(values)).successful
    assert node.settings == expected
    assert repr(node.settings) == repr(expected)  # 2 is 2.0
    for name, value in values.items():
        assert shown(node)[name] == value
    assert type(node.get_parameter('max_gap').value) is float


WRONG = [
    {'max_gap': math.nan}, {'max_gap': math.inf}, {'max_gap': -1.0}, {'max_gap': True},
    {'max_gap': 'long'}, {'max_gap': [1.0]}, {'velocity.cutoff': 0.0}, {'enable': 1},
    {'enable': 'no'}, {'identifier.feedback_gain': -2.0}, {'identifier.feedback_gain': 2.0},
    {'identifier.adaptation_gains': [1.0] * 4}, {**RAW, 'identifier.adaptation_gains': [1.0] * 5},
    {**RAW, 'identifier.adaptation_gains': [1.0, 1.0, 1.0, math.nan]},
    {**RAW, 'identifier.adaptation_gains': ['1', '2', '3', '4']},
    {'max_wait': 1.0, 'max_gap': -1.0}, {'velocity.max': 1.0, **RAW, 'max_wait': 61}]


@pytest.mark.parametrize('values', WRONG, ids=str)
def test_refused_as_the_file_would_be(
        values: dict[str, Any], given: dict[str, Any], node: IdentifierNode) -> None:
    with pytest.raises(SettingsError) as expected:
        settings_from({**given, **values})
    before, settings = shown(node), node.settings
    result = node.set_parameters_atomically(parameters(values))
    assert not result.successful
    assert result.reason == str(expected.value)
    assert '\n' not in result.reason
    assert node.settings is settings
    assert shown(node) == before


def test_all_or_nothing_with_what_is_not_live(node: IdentifierNode) -> None:
    before, settings = shown(node), node.settings
    result = node.set_parameters_atomically(parameters({'max_gap': 2.0, 'frames': 'ned'}))
    assert result.reason == 'frames: takes a change only while the node is unconfigured'
    result = node.set_parameters_atomically(parameters({'max_gap': 2.0, 'max_gaap': 2.0}))
    assert result.reason == 'max_gaap: there is no such key; the nearest is max_gap'
    result = node.set_parameters_atomically(
        [Parameter('max_gap', value=2.0), Parameter('max_wait', Parameter.Type.NOT_SET)])
    assert 'max_wait: got nothing' in result.reason
    assert node.settings is settings
    assert shown(node) == before
    good, bad = node.set_parameters(parameters({'max_gap': 2.0, 'velocity.cutoff': -1.0}))
    assert good.successful and not bad.successful
    assert node.settings.max_gap == 2.0


@pytest.mark.parametrize('no_gains', [
    Parameter('identifier.adaptation_gains', value=[]),
    Parameter('identifier.adaptation_gains', Parameter.Type.NOT_SET)], ids=['empty', 'deleted'])
def test_back_from_raw_gains_without_a_restart(
        no_gains: Parameter[Any], node: IdentifierNode) -> None:
    settings = node.settings
    assert node.set_parameters_atomically(parameters(RAW)).successful
    result = node.set_parameters_atomically(
        [Parameter('identifier.feedback_gain', value=0.0), no_gains])
    assert result.successful, result.reason
    assert node.settings == settings
    assert shown(node)['identifier.adaptation_gains'] == []


def test_all_that_the_node_has_loads_again(
        node: IdentifierNode, given: dict[str, Any], tmp_path: Path) -> None:
    """As ``ros2 param dump`` writes it, and ``ros2 param load`` and ``--params-file`` take it."""
    file = tmp_path / 'dump.yaml'
    values = own_values(node.get_parameters([key.name for key in KEYS]))
    assert values['thrusters.polynomial'] == []
    file.write_text(yaml.safe_dump({NAME: {'ros__parameters': values}}))
    assert settings_from(load(file)) == settings_from(given)
    assert all(result.successful for result in node.set_parameters(parameters(values)))
    assert node.settings == settings_from(given)


def test_what_ros2_param_takes_for_text_is_a_number(ros: None) -> None:
    """It reads YAML 1.1, for which ``1e-5`` has no point and so is text."""
    assert get_parameter_value('1e-05').type == ParameterType.PARAMETER_STRING
    node = IdentifierNode(changed({**RAW, 'autostart': False}))
    for name, text, value in (
            ('current.change', '1e-05', 1e-5), ('max_gap', '2e0', 2.0),
            ('identifier.adaptation_gains', '[1e-05, 2, 3.0, 4e1]', [1e-5, 2.0, 3.0, 40.0])):
        result = node.set_parameters_atomically([Parameter(name, value=text)])
        assert result.successful, result.reason
        shown = node.get_parameter(name).value
        assert (list(shown) if isinstance(value, list) else shown) == value
    for name, text in (('max_gap', 'long'), ('max_gap', '1, 2'), ('max_gap', '[1e-5]'),
                       ('max_gap', 'true'), ('identifier.adaptation_gains', '1e-5')):
        assert not node.set_parameters_atomically([Parameter(name, value=text)]).successful
    assert node.set_parameters_atomically([Parameter('base_frame', value='1e5')]).successful
    assert node.get_parameter('base_frame').value == '1e5'
    node.destroy_node()


def test_simulated_time_can_still_be_set(node: IdentifierNode) -> None:
    assert node.set_parameters([Parameter('use_sim_time', value=True)])[0].successful
    assert node.get_clock().ros_time_is_active


def put(peer: Peer, values: dict[str, Any]) -> str:
    """Set parameters by the service, all at once; return why not, or ''."""
    request = SetParametersAtomically.Request(
        parameters=[p.to_parameter_msg() for p in parameters(values)])
    result = peer.call(SetParametersAtomically, f'{NAME}/set_parameters_atomically', request)
    return '' if result.result.successful else result.result.reason


def test_what_is_set_is_told_and_what_stays_as_it_is_is_not(
        node: IdentifierNode, capfd: pytest.CaptureFixture[str]) -> None:
    gate = node.get_parameter('velocity.gate').value
    for values, taken in (
            ({'velocity.gate': gate, 'max_gap': 3.0}, True), ({'max_gap': 3.0}, True),
            ({'max_gap': -1.0}, False), ({'max_gap': 4.0}, True)):
        assert node.set_parameters_atomically(parameters(values)).successful is taken
    told = [line.partition(']: ')[2].strip() for line in capfd.readouterr().err.splitlines()
            if ']: set ' in line]
    assert told == ['set max_gap: 3.0', 'set max_gap: 4.0']


def test_the_service_and_the_parameter_are_one(peer: Peer, start: Start, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    changes = {'checkpoint.path': str(path), 'checkpoint.period': 86400.0}
    node = start(changes)

    def enabled() -> bool:
        request = GetParameters.Request(names=['enable'])
        return peer.call(GetParameters, f'{NAME}/get_parameters', request).values[0].bool_value

    assert enabled()
    assert peer.call(SetBool, f'{NAME}/enable', SetBool.Request(data=False)).success
    assert not enabled()
    (result,) = peer.call(SetParameters, f'{NAME}/set_parameters', SetParameters.Request(
        parameters=[Parameter('enable', value=True).to_parameter_msg()])).results
    assert result.successful
    assert enabled()
    assert put(peer, {'enable': False}) == ''
    assert put(peer, {'max_gap': 3.0}) == ''  # another change leaves it alone
    assert peer.call(Trigger, f'{NAME}/save').success
    assert json.loads(path.read_text())['state']['adapt'] is False
    for _ in range(2):  # a shorter period counts at once, again and again
        path.unlink()
        assert put(peer, {'checkpoint.period': 0.1}) == ''
        peer.until(path.exists)
    assert node.stop() == 0
    node = start(changes)  # goes on frozen
    assert not enabled()
    assert 'checkpoint.json, frozen' in node.output
    assert put(peer, {'enable': True}) == ''
    assert node.stop() == 0
    node = start({**changes, 'enable': False})  # what the file forbids
    assert not enabled()
    assert node.stop() == 0


def test_the_record_of_changes_replays_to_the_same_bits(
        peer: Peer, start: Start, environment: dict[str, str], tmp_path: Path) -> None:
    record = tmp_path / 'record.mcap'
    estimates = peer.listen_to_steps()
    node = start({**UNSTAMPED, 'record.path': str(record), 'velocity.cutoff': 2})
    peer.advertise(UNSTAMPED_TYPES)
    for values in ({'identifier.adaptation_time': 10}, RAW, {'velocity.cutoff': 0.8},
                   {'max_wait': 0.05, 'velocity.max': 0.5}, {'enable': False},
                   {'enable': True, 'max_gap': 0.5, 'max_wait': 0.4},
                   {'identifier.feedback_gain': 0, 'identifier.adaptation_gains': []},
                   {'thrusters.timeout': 0.015}):
        drive(peer, 0.4)
        assert put(peer, values) == ''
        assert put(peer, {**values, 'max_gap': math.nan}).startswith('max_gap: ')
    drive(peer, 0.4)
    assert node.stop() == 0
    peer.settle(estimates)
    assert len(estimates) > 60
    values = changed({**UNSTAMPED, 'velocity.cutoff': 2})
    assert_same(heard(estimates), replayed_record(record, values))
    assert_same(heard(estimates), replayed_record(record, values, environment))
    with Log([record]) as log:
        told = [json.loads(m.data.data) for m in log.messages(['/rovid/control'])]
    assert [control['control'] for control in told] == ['parameters'] * 8
    assert json.loads(told[0]['value']) == {'identifier.adaptation_time': 10}


def test_what_was_set_before_is_in_the_next_record(
        peer: Peer, start: Start, tmp_path: Path) -> None:
    """A parameter lasts as long as the process, whatever its states; a replay has to know."""
    from test.node.test_lifecycle import ask

    estimates = peer.listen_to_steps()
    node = start({**UNSTAMPED, 'autostart': False, 'record.path': str(tmp_path / 'record.mcap')})
    assert put(peer, {'velocity.cutoff': 3.0, **RAW}) == ''
    assert put(peer, {'velocity.cutoff': -3.0}).startswith('velocity.cutoff: got -3.0')
    for number in ('', '-1'):
        before = len(estimates)
        assert ask(peer, 'configure') and ask(peer, 'activate')
        peer.advertise(UNSTAMPED_TYPES)
        drive(peer, 1.0)
        assert put(peer, {'velocity.cutoff': 1.5}) == ''
        drive(peer, 0.7)
        assert ask(peer, 'deactivate') and ask(peer, 'cleanup')
        peer.settle(estimates, before + 10)
        record = tmp_path / f'record{number}.mcap'
        assert_same(heard(estimates[before:]), replayed_record(record, changed(UNSTAMPED)))
        with Log([record]) as log:
            first = json.loads(next(iter(log.messages(['/rovid/control']))).data.data)
        expected = {'velocity.cutoff': 1.5 if number else 3.0, **RAW}
        assert expected.items() <= json.loads(first['value']).items()
    assert node.stop() == 0


@pytest.mark.parametrize('value', ['', '[]', 'null', '{"frames": "ned"}', '{"max_gap": "x"}',
                                   '{"max_gaap": 1}', '{"use_sim_time": true}', '{"dofs": []}'])
def test_a_record_that_is_not_ours_changes_nothing(value: str) -> None:
    stream = Stream(settings_from(changed({})))
    settings = stream.settings
    with pytest.raises(ValueError):
        repeat_control(stream, 'parameters', value)
    assert stream.settings is settings


@pytest.mark.parametrize('key', [key for key in KEYS if key.live], ids=lambda key: key.name)
def test_every_live_key_finds_its_setting(key: Any) -> None:
    settings = settings_from(changed(RAW))
    value = {'bool': False, 'double': -1.5 if key.high == 0.0 else 1.5,
             'double[]': [0.5] * 4}[key.type]
    expected = settings_from(changed({**RAW, key.name: value}))
    assert changed_settings(settings, {key.name: value}) == expected
    assert settings != expected
    stream = Stream(settings)
    change_parameters(stream, {key.name: value})
    assert stream.settings == expected
