"""The managed node: through the real services of a running process, and in one process."""

from collections.abc import Iterator
import json
from pathlib import Path
import signal
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rovid_core.pipeline.stream import Stream
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.state_file import save
from rovid_ros.logs.log import Log
from rovid_ros.logs.player import CONTROL
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import latched
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from test.support.live_drive import (
    assert_same,
    drive,
    replayed_record,
    running,
    Start,
    UNSTAMPED,
    UNSTAMPED_TYPES,
)
from test.support.live_node import changed, heard, Peer, Raw, TYPES, VALUES

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
WAITING = {'autostart': False}
NAME = '/identifier_node'


def ask(peer: Peer, transition: str) -> bool:
    """Ask for a transition by its label, as ``ros2 lifecycle set`` does."""
    request = ChangeState.Request(transition=Transition(label=transition))
    return peer.call(ChangeState, f'{NAME}/change_state', request).success


def state(peer: Peer) -> str:
    return peer.call(GetState, f'{NAME}/get_state').current_state.label


def is_heard(peer: Peer, topic: str) -> bool:
    return bool(peer.node.count_subscribers(topic))


def are_matched(peer: Peer) -> bool:
    """Tell whether what the peer publishes reaches the node, which knows the publishers."""
    return all(publisher.get_subscription_count() for publisher in peer.publishers.values())


def test_through_all_states(messages: list[Raw], peer: Peer, start: Start,
                            tmp_path: Path) -> None:
    record, checkpoint = tmp_path / 'record.mcap', tmp_path / 'checkpoint.json'
    estimates = peer.listen_to_steps()
    node = start({**WAITING, 'record.path': str(record), 'checkpoint.path': str(checkpoint)})
    assert state(peer) == 'unconfigured'
    assert not record.exists()
    assert not peer.node.count_publishers('/rov/estimate')

    assert ask(peer, 'configure')
    assert state(peer) == 'inactive'
    peer.until(lambda: peer.node.count_publishers('/rov/estimate'))
    assert record.exists()
    assert not any(is_heard(peer, topic) for topic in TYPES)

    assert ask(peer, 'activate')
    peer.advertise(TYPES)
    peer.publish(messages[:300])
    peer.settle(estimates, 50)
    assert ask(peer, 'deactivate')
    assert state(peer) == 'inactive'
    peer.settle(estimates)
    peer.until(lambda: not any(is_heard(peer, topic) for topic in TYPES))
    saved = json.loads(checkpoint.read_text())
    count, params = len(estimates), parameters(estimates[-1])

    peer.publish(messages[300:500])  # into the void
    peer.spin(0.5)
    assert len(estimates) == count
    assert ask(peer, 'activate')
    peer.until(lambda: are_matched(peer))
    peer.publish(messages[500:])
    peer.settle(estimates, count + 50)
    assert parameters(estimates[count]) == pytest.approx(params, rel=0.1)  # it went on
    got = heard(estimates)

    assert ask(peer, 'deactivate')
    assert ask(peer, 'cleanup')
    assert state(peer) == 'unconfigured'
    peer.until(lambda: not peer.node.count_publishers('/rov/estimate'))
    assert json.loads(checkpoint.read_text())['state'] != saved['state']
    peer.settle(estimates)
    assert_same(heard(estimates), replayed_record(record, VALUES))
    assert heard(estimates)[:len(got)] == got

    (result,) = peer.call(SetParameters, f'{NAME}/set_parameters', SetParameters.Request(
        parameters=[Parameter('velocity.max', value=4.0).to_parameter_msg()])).results
    assert result.successful
    assert ask(peer, 'configure')
    assert 'going on from' in node.output
    assert (tmp_path / 'record-1.mcap').exists()
    assert ask(peer, 'activate')
    peer.until(lambda: are_matched(peer))
    before = len(estimates)
    peer.publish(messages[500:])
    peer.settle(estimates, before + 10)
    assert ask(peer, 'shutdown')
    assert state(peer) == 'finalized'
    with Log([tmp_path / 'record-1.mcap']) as log:
        assert not log.warnings  # closed properly
        # what was set when it was configured stands at the first message
        assert next(log.messages([*log.topics])).topic == CONTROL
        assert log.end - log.start < 60 * 10**9
    assert node.stop() == 0, node.output
    assert 'ERROR' not in node.output
    assert 'Traceback' not in node.output


def parameters(estimate: Any) -> list[float]:
    """Return alpha to delta of surge."""
    values = {entry.key: entry.value for entry in estimate.status[0].values}
    return [float(values[name]) for name in ('alpha', 'beta', 'gamma', 'delta')]


def test_shut_down_while_active(messages: list[Raw], peer: Peer, start: Start,
                                tmp_path: Path) -> None:
    record = tmp_path / 'record.mcap'
    node, estimates = running(peer, start, messages[:300], {'record.path': str(record)})
    assert ask(peer, 'shutdown')
    assert state(peer) == 'finalized'
    peer.settle(estimates)
    assert_same(heard(estimates), replayed_record(record, VALUES))
    assert node.stop() == 0
    assert 'Traceback' not in node.output


def test_the_record_of_pauses_replays_to_the_same_bits(
        peer: Peer, start: Start, environment: dict[str, str], tmp_path: Path) -> None:
    """Unstamped commands, and a vehicle that moves on while nobody listens."""
    record = tmp_path / 'record.mcap'
    estimates = peer.listen_to_steps()
    node = start({**UNSTAMPED, 'record.path': str(record)})
    peer.advertise(UNSTAMPED_TYPES)
    for _ in range(3):
        drive(peer, 0.6)
        assert ask(peer, 'deactivate')
        drive(peer, 0.3)
        assert ask(peer, 'activate')
        peer.until(lambda: are_matched(peer))
    drive(peer, 0.6)
    assert node.stop() == 0
    peer.settle(estimates)
    assert len(estimates) > 30
    assert_same(heard(estimates), replayed_record(record, changed(UNSTAMPED)))
    assert_same(heard(estimates), replayed_record(record, changed(UNSTAMPED), environment))


def topics(peer: Peer) -> set[str]:
    """Return what the node publishes, as far as it has been discovered."""
    if 'identifier_node' not in peer.node.get_node_names():
        return set()
    return {name for name, _ in peer.node.get_publisher_names_and_types_by_node(
        'identifier_node', '/')}


def test_never_configured(peer: Peer, start: Start) -> None:
    node = start(WAITING)
    assert state(peer) == 'unconfigured'
    least = {'/parameter_events', '/rosout', f'{NAME}/transition_event'}
    peer.until(lambda: topics(peer) >= least)
    peer.spin(0.5)
    assert topics(peer) == least
    assert node.stop(signal.SIGINT, signal.SIGINT) == 0
    assert not node.output


@pytest.mark.parametrize('changes, expected', [
    ({'thrusters.gian': [1.0]}, 'thrusters.gian: there is no such key'),
    ({'max_gap': -1.0}, 'max_gap: got -1.0, takes'),
    ({'surge.initial.mass': None}, 'surge.initial.mass: is required'),
    ({'position.type': 'vehicle_msgs/msg/Fix'}, 'vehicle_msgs'),
    ({'position.field': 'pont'}, 'pont'),
    ({'record.path': '/proc/none/record.mcap'}, 'record.path: /proc/none'),
])
def test_what_is_wrong_fails_the_transition_in_one_line(
        changes: dict[str, Any], expected: str, ros: None, capfd: pytest.CaptureFixture[str]
        ) -> None:
    node = IdentifierNode(changed({**WAITING, **changes}))
    for _ in range(2):
        assert node.trigger_configure() == FAILURE
        (line,) = capfd.readouterr().err.splitlines()
        assert '[ERROR]' in line
        assert 'configure: ' in line
        assert expected in line
    node.destroy_node()


def put(node: IdentifierNode, **values: Any) -> str:
    """Set parameters at once, their dots as ``__``; return why not, or ''."""
    return node.set_parameters_atomically([
        Parameter(name.replace('__', '.'), value=value)
        for name, value in values.items()]).reason


def test_what_was_wrong_at_the_start_is_put_right_without_a_restart(ros: None) -> None:
    node = IdentifierNode(changed({
        **WAITING, 'surge.initial.mass': -1.0, 'identifier.feedback_gain': -2.0}))
    assert node.trigger_configure() == FAILURE
    assert put(node, surge__initial__mass=-2.0).startswith('surge.initial.mass: got -2.0, takes')
    assert put(node, surge__initial__mass=250) == ''
    assert node.trigger_configure() == FAILURE  # feedback_gain alone
    assert put(node, identifier__adaptation_gains=[1e-6, 0.1, 0.1, 1e-3]) == ''
    assert node.trigger_configure() == SUCCESS
    assert node.settings.dof['surge'].mass == 250.0
    assert node.settings.identifier.feedback_gain == -2.0
    node.destroy_node()


def test_cleaned_up_it_takes_everything_and_is_judged_when_configured(
        waiting: IdentifierNode, capfd: pytest.CaptureFixture[str]) -> None:
    assert waiting.trigger_configure() == SUCCESS
    reason = 'position.topic: takes a change only while the node is unconfigured'
    assert put(waiting, position__topic='/usbl') == reason
    assert waiting.trigger_activate() == SUCCESS
    assert put(waiting, position__topic='/usbl') == reason
    assert put(waiting, position__topic='/position') == ''  # as it is
    assert waiting.trigger_deactivate() == SUCCESS
    assert waiting.trigger_cleanup() == SUCCESS

    assert put(waiting, position__topic='/usbl', max_gap=3.0, thrusters__gain=[1.0, 2.0]) == ''
    assert waiting.trigger_configure() == FAILURE
    assert 'thrusters.names: has 3 entries for 2 thrusters' in capfd.readouterr().err
    assert put(waiting, thrusters__gain=[40.0, 40.0, 50.0]) == ''
    assert waiting.trigger_configure() == SUCCESS
    settings = waiting.settings
    assert (settings.position.topic, settings.max_gap, settings.thrusters.gain) == (
        '/usbl', 3.0, (40.0, 40.0, 50.0))
    assert waiting.trigger_activate() == SUCCESS
    assert '/usbl' in [one.topic_name for one in waiting.input_subscriptions]


def test_requests_that_fail_or_do_not_fit_the_state(
        peer: Peer, start: Start, tmp_path: Path) -> None:
    folder = tmp_path / 'records'
    folder.write_text('in the way')
    node = start({**WAITING, 'record.path': str(folder / 'record.mcap')})
    for transition in ('activate', 'cleanup', 'deactivate', 'none such', 'configure'):
        assert not ask(peer, transition)
        assert state(peer) == 'unconfigured'
    (line,) = [line for line in node.output.splitlines() if '[identifier_node]' in line]
    assert 'configure: record.path: ' in line
    folder.unlink()
    assert ask(peer, 'configure')
    assert node.stop() == 0
    assert 'Traceback' not in node.output


def entities(node: IdentifierNode) -> tuple[int, ...]:
    return tuple(len(list(kind)) for kind in (
        node.publishers, node.subscriptions, node.services, node.timers, node.waitables))


@pytest.fixture
def waiting(ros: None, tmp_path: Path) -> Iterator[IdentifierNode]:
    node = IdentifierNode(changed({**WAITING, 'checkpoint.path': str(tmp_path / 'c.json')}))
    yield node
    node.destroy_node()


def test_what_a_checkpoint_froze_is_not_frozen_without_it(
        waiting: IdentifierNode, tmp_path: Path) -> None:
    path = tmp_path / 'c.json'
    frozen = Stream(settings_from(changed({'enable': False})))
    save(path, frozen.settings, frozen.state())
    assert waiting.trigger_configure() == SUCCESS
    assert not waiting.stream.adapting
    assert waiting.get_parameter('enable').value is False
    assert waiting.trigger_cleanup() == SUCCESS
    path.unlink()
    assert waiting.trigger_configure() == SUCCESS
    assert waiting.stream.adapting
    assert waiting.get_parameter('enable').value is True


def test_nothing_is_left_behind(waiting: IdentifierNode) -> None:
    before = entities(waiting)
    for _ in range(3):
        assert waiting.trigger_configure() == SUCCESS
        inactive = entities(waiting)
        for _ in range(3):
            assert waiting.trigger_activate() == SUCCESS
            assert waiting.active
            assert entities(waiting) > inactive
            assert waiting.trigger_deactivate() == SUCCESS
            assert not waiting.active
            assert entities(waiting) == inactive
        assert waiting.trigger_cleanup() == SUCCESS
        assert entities(waiting) == before


@pytest.mark.parametrize('creator, transitions', [
    ('create_publisher', 1), ('create_timer', 1), ('create_service', 1),
    ('create_subscription', 2)])
def test_a_transition_that_fails_halfway_undoes_what_it_did(
        creator: str, transitions: int, waiting: IdentifierNode,
        monkeypatch: pytest.MonkeyPatch) -> None:
    triggers = [waiting.trigger_configure, waiting.trigger_activate][:transitions]
    for trigger in triggers[:-1]:
        assert trigger() == SUCCESS
    before, calls = entities(waiting), 0
    create = getattr(waiting, creator)

    def create_one(*args: Any, **kwargs: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise RuntimeError('the middleware is out of memory')
        return create(*args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(waiting, creator, create_one)
        assert triggers[-1]() == FAILURE
    assert calls == 2
    assert entities(waiting) == before
    assert not waiting.active
    assert triggers[-1]() == SUCCESS


def test_what_is_inactive_uses_nothing(waiting: IdentifierNode, messages: list[Raw]) -> None:
    assert waiting.trigger_configure() == SUCCESS
    for raw in messages[:100]:
        message = deserialize_message(raw.cdr, import_type(raw.type))
        assert waiting.add_message(raw.topic, message, raw.time) == []
    assert waiting.stream.inputs['position'].count == 0
    assert waiting.finish() == []


def test_a_reset_while_inactive_is_saved(peer: Peer, start: Start, messages: list[Raw],
                                         tmp_path: Path) -> None:
    checkpoint = tmp_path / 'checkpoint.json'
    node = start({'checkpoint.path': str(checkpoint)})
    peer.advertise(TYPES)
    peer.publish(messages[:300])
    assert ask(peer, 'deactivate')
    moved = json.loads(checkpoint.read_text())
    assert peer.call(Trigger, f'{NAME}/reset').success
    assert ask(peer, 'cleanup')
    assert json.loads(checkpoint.read_text()) != moved
    assert node.stop() == 0


class Controller:
    """What uses the model: a node that takes the last parameters."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('controller')
        self.masses: list[float] = []
        self.node.create_subscription(
            Float64MultiArray, 'rov/params', self._take, latched())

    def _take(self, message: Float64MultiArray) -> None:
        self.masses.append(1.0 / message.data[0])


@pytest.mark.parametrize('order', [1, -1])
def test_in_one_process_with_a_controller(order: int, peer: Peer, messages: list[Raw]) -> None:
    """One executor, one thread, and either node can go first."""
    executor = SingleThreadedExecutor()
    identifier, controller = IdentifierNode(VALUES), Controller()
    executor.add_node(identifier)
    executor.add_node(controller.node)
    peer.advertise(TYPES)
    for number, raw in enumerate(messages):
        peer.send(raw.topic, raw.cdr)
        if number % 20 == 0:
            for _ in range(10):
                executor.spin_once(timeout_sec=0.002)
    peer.until(lambda: executor.spin_once(timeout_sec=0.01) or len(controller.masses) > 10)
    identifier.finish()
    assert identifier.stream.estimate is not None
    last = 1.0 / identifier.stream.estimate.dofs[0].parameters[0]
    peer.until(lambda: executor.spin_once(timeout_sec=0.01) or controller.masses[-1] == last)
    for node in (identifier, controller.node)[::order]:
        executor.remove_node(node)
        node.destroy_node()
        executor.spin_once(timeout_sec=0.01)  # the other one goes on
    executor.shutdown()


def test_a_controller_sees_a_managed_node_come_and_go(waiting: IdentifierNode) -> None:
    executor, controller, peer = SingleThreadedExecutor(), Controller(), Peer()
    executor.add_node(waiting)
    executor.add_node(controller.node)
    future = peer.node.create_client(ChangeState, f'{NAME}/change_state')
    for transition in ('configure', 'activate', 'deactivate', 'activate', 'shutdown'):
        peer.until(lambda: executor.spin_once(timeout_sec=0.01) or future.service_is_ready())
        answer = future.call_async(ChangeState.Request(transition=Transition(label=transition)))
        peer.until(lambda answer=answer: executor.spin_once(timeout_sec=0.01) or answer.done())
        assert answer.result().success, transition
    asked = peer.node.create_client(GetState, f'{NAME}/get_state').call_async(GetState.Request())
    peer.until(lambda: executor.spin_once(timeout_sec=0.01) or asked.done())
    assert asked.result().current_state.id == State.PRIMARY_STATE_FINALIZED
    executor.shutdown()
    controller.node.destroy_node()
    peer.close()
