"""The node against a hostile network, and the rights that it needs in a secured one."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE, TOPICS
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from test.support.live_node import changed, NodeProcess, Peer, TYPES, write_parameters

CONFIG = Path(__file__).parents[2] / 'config'
POLICY = CONFIG / 'sros2_policy.xml'
NODE = '/identifier_node'
APART = '/apart'  # no node of another test is taken for this one
READ_ONLY = ('record.path', 'checkpoint.path', 'position.topic', 'thrusters.type')

LIFECYCLE = ('transition_event', 'change_state', 'get_available_states', 'get_state',
             'get_available_transitions', 'get_transition_graph')

# what the schema of SROS 2 policies has: elements in each element, and their attributes
ELEMENTS = {
    'policy': ({'enclaves'}, {'version'}), 'enclaves': ({'enclave'}, set()),
    'enclave': ({'profiles'}, {'path'}), 'profiles': ({'profile'}, set()),
    'profile': ({'topics', 'services'}, {'ns', 'node'}),
    'topics': ({'topic'}, {'publish', 'subscribe'}),
    'services': ({'service'}, {'reply', 'request'}), 'topic': (set(), set()),
    'service': (set(), set()),
}


def memory(process: NodeProcess) -> int:
    """Return the resident memory of a process [bytes]."""
    pages = Path(f'/proc/{process.process.pid}/statm').read_text().split()[1]
    return int(pages) * 4096


def refused(diagnostics: list[Any]) -> dict[str, int]:
    """Return what the newest diagnostics count of the thrusters, by reason."""
    return {entry.key.rpartition('.')[2]: int(entry.value)
            for status in (diagnostics[-1].status if diagnostics else ())
            for entry in status.values if entry.key.startswith('thrusters.')}


def test_a_hostile_network_does_not_bring_the_node_down(
        peer: Peer, tmp_path: Path, environment: dict[str, str], repository: Path) -> None:
    values = changed({'record.path': str(tmp_path / 'record.mcap')})
    file = write_parameters(tmp_path / 'p.yaml', values)
    diagnostics = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    process = NodeProcess(['--ros-args', '--params-file', file], environment, tmp_path, repository)
    try:
        peer.advertise(TYPES)
        before = memory(process)
        topic = values['thrusters.topic']
        many = JointState(name=['\x1b[2J'] * 300_000, effort=[1.0] * 300_000)
        for _ in range(20):
            peer.send(topic, many)  # 6 MB each
        for claim in (0x7fffffff, 0xffffffff):  # names, and 40 bytes for them
            peer.send(topic, serialize_message(JointState())[:20]
                      + claim.to_bytes(4, 'little') + bytes(40))
        peer.send(topic, b'\0\1\0\0')
        peer.until(lambda: refused(diagnostics).get('too_large', 0) >= 20
                   and refused(diagnostics).get('undecodable', 0) >= 3)

        request = SetParameters.Request(parameters=[
            Parameter(name, value='y' * 10_000_000).to_parameter_msg() for name in READ_ONLY[:2]
        ] + [Parameter(name, value='/else').to_parameter_msg() for name in READ_ONLY[2:]])
        answer = peer.call(SetParameters, f'{NODE}/set_parameters', request)
        assert [result.successful for result in answer.results] == [False] * 4
        assert all(len(result.reason) < 2000 for result in answer.results)
        kept = peer.call(GetParameters, f'{NODE}/get_parameters',
                         GetParameters.Request(names=list(READ_ONLY)))
        assert kept.values == [
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=values.get(name, ''))
            for name in READ_ONLY]

        client = peer.node.create_client(Trigger, f'{NODE}/reset')
        peer.until(client.service_is_ready)
        for _ in range(2000):
            client.call_async(Trigger.Request())
        peer.node.destroy_client(client)
        assert peer.call(Trigger, f'{NODE}/reset').success
        assert memory(process) - before < 150 << 20
        assert process.process.poll() is None
        assert '\x1b[2J' not in process.output and 'Traceback' not in process.output
    finally:
        process.stop()
    assert sorted(path.name for path in tmp_path.iterdir()) == ['p.yaml', 'record.mcap', 'stderr']


def policy() -> ElementTree.Element:
    return ElementTree.parse(POLICY).getroot()


def resolved(kind: str, right: str) -> set[str]:
    """Return the full names that the policy allows, for a node in the namespace ``APART``."""
    profile = policy().find('./enclaves/enclave/profiles/profile')
    assert profile is not None and (profile.get('ns'), profile.get('node')) == (
        '/', NODE.strip('/'))
    names = [str(entry.text) for group in profile.findall(f'{kind}s') for entry in group
             if group.get(right) == 'ALLOW']
    assert len(set(names)) == len(names)
    return {name.replace('~', f'{APART}{NODE}') if name.startswith('~')
            else name if name.startswith('/') else f'{APART}/{name}' for name in names}


def test_the_policy_has_the_form_that_sros2_takes() -> None:
    root = policy()
    assert root.tag == 'policy' and root.get('version') == '0.2.0'
    for element in root.iter():
        inner, attributes = ELEMENTS[element.tag]
        assert {child.tag for child in element} <= inner
        assert set(element.attrib) <= attributes
        assert len(element) > 0 or element.tag in ('topic', 'service')
        if element.tag in ('topics', 'services'):
            assert list(element.attrib.values()) == ['ALLOW']  # one right for each list
        elif element.tag in ('topic', 'service'):
            assert element.text and element.text.strip() == element.text
        else:
            assert set(element.attrib) == attributes


def test_the_policy_gives_the_node_what_it_needs_and_no_more(
        peer: Peer, tmp_path: Path, environment: dict[str, str], repository: Path) -> None:
    process = NodeProcess(
        ['--ros-args', '-r', f'__ns:={APART}', '--params-file', CONFIG / 'jhurov.yaml'],
        environment, tmp_path, repository)

    def names(of: str) -> set[str]:
        try:
            return {name for name, _ in getattr(peer.node, f'get_{of}_names_and_types_by_node')(
                NODE.strip('/'), APART)}
        except RuntimeError:  # not discovered yet
            return set()

    publishes, replies = resolved('topic', 'publish'), resolved('service', 'reply')
    subscribes = resolved('topic', 'subscribe')
    try:
        peer.until(lambda: {f'{APART}/{topic}' for topic in TOPICS} <= names('publisher')
                   and f'{APART}{NODE}/save' in names('service')
                   and f'{APART}{NODE}/list_parameters' in names('service')
                   and subscribes - {'/clock'} <= names('subscriber'))
        peer.spin(0.3)  # for what the policy does not have
        managed = f'{APART}{NODE}/get_state' in names('service')
        lifecycle = set() if managed else {f'{APART}{NODE}/{name}' for name in LIFECYCLE}
        assert publishes - lifecycle == names('publisher')
        assert replies - lifecycle == names('service')
        assert subscribes - {'/clock'} == names('subscriber')
    finally:
        process.stop()
    assert not resolved('service', 'request')
