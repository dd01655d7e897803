"""Messages that are written without rclpy's message objects, to the bytes of the wire."""

from typing import Any

from hypothesis import given, strategies as st
import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.serialization import deserialize_message
from rovid_ros.messages.types import build, standard_types
from rovid_ros.node.transport.wire_encoding import encoded, import_type
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE

from test.support.live_node import Peer
from test.support.ros_messages import fill

NUMBER = st.floats(allow_nan=False)
NUMBERS = st.lists(NUMBER, max_size=5)
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
WHOLE = st.integers(0, 1 << 31)
HEADER = st.fixed_dictionaries({
    'stamp': st.fixed_dictionaries({'sec': st.integers(-9, 1 << 30), 'nanosec': WHOLE}),
    'frame_id': TEXT})
VALUES = st.lists(st.fixed_dictionaries({'key': TEXT, 'value': TEXT}), max_size=4)
VECTOR = st.fixed_dictionaries(dict.fromkeys('xyz', NUMBER))
FIELDS = {
    DIAGNOSTIC_TYPE: st.fixed_dictionaries({'header': HEADER, 'status': st.lists(
        st.fixed_dictionaries({
            'level': st.integers(0, 3), 'name': TEXT, 'message': TEXT, 'hardware_id': TEXT,
            'values': VALUES}), max_size=3)}),
    'std_msgs/msg/Float64MultiArray': st.fixed_dictionaries({
        'layout': st.fixed_dictionaries({
            'dim': st.lists(st.fixed_dictionaries(
                {'label': TEXT, 'size': WHOLE, 'stride': WHOLE}), max_size=3),
            'data_offset': WHOLE}),
        'data': NUMBERS}),
    'sensor_msgs/msg/JointState': st.fixed_dictionaries({
        'header': HEADER, 'name': st.lists(TEXT, max_size=4), 'position': NUMBERS,
        'velocity': NUMBERS, 'effort': NUMBERS}),
    'geometry_msgs/msg/TwistStamped': st.fixed_dictionaries({
        'header': HEADER, 'twist': st.fixed_dictionaries({'linear': VECTOR, 'angular': VECTOR})}),
    'geometry_msgs/msg/PoseWithCovariance': st.fixed_dictionaries({  # an array of fixed length
        'pose': st.fixed_dictionaries({'position': VECTOR, 'orientation': st.fixed_dictionaries(
            dict.fromkeys('xyzw', NUMBER))}),
        'covariance': st.lists(NUMBER, min_size=36, max_size=36)}),
    'sensor_msgs/msg/NavSatStatus': st.fixed_dictionaries({
        'status': st.integers(-128, 127), 'service': st.integers(0, 65535)}),
}


@pytest.mark.parametrize('name', FIELDS)
@given(data=st.data())
def test_the_bytes_are_those_of_the_type(name: str, data: st.DataObject) -> None:
    fields: dict[str, Any] = data.draw(FIELDS[name])
    cdr, message = encoded(name, fields), fill(import_type(name), fields)
    store = standard_types()
    # padding is 0 in both; rclpy leaves in it what was there before
    assert cdr == bytes(store.serialize_cdr(build(store, name, fields), name))
    assert deserialize_message(cdr, import_type(name)) == message


def test_every_field_has_to_be_there() -> None:
    with pytest.raises(KeyError):
        encoded('geometry_msgs/msg/Vector3', {'x': 1.0, 'y': 2.0})


def test_they_are_on_the_wire_what_rclpy_publishes() -> None:
    rclpy.init(args=[])
    peer = Peer()
    names = {f'/encoded_{number}': name for number, name in enumerate(SOME)}
    heard = {topic: peer.listen(topic, name, raw=True) for topic, name in names.items()}
    peer.advertise(names)
    for topic, name in names.items():
        peer.send(topic, fill(import_type(name), SOME[name]))
        peer.send(topic, encoded(name, SOME[name]))
    peer.until(lambda: all(len(messages) == 2 for messages in heard.values()))
    for topic, name in names.items():
        theirs, ours = heard[topic]
        assert len(ours) == len(theirs), name
        assert deserialize_message(ours, import_type(name)) == deserialize_message(
            theirs, import_type(name))
    peer.close()
    rclpy.shutdown()


def header(frame: str) -> dict[str, Any]:
    return {'stamp': {'sec': 5, 'nanosec': 7}, 'frame_id': frame}


SOME: dict[str, dict[str, Any]] = {
    DIAGNOSTIC_TYPE: {'header': header('base_link'), 'status': [
        {'level': level, 'name': 'surge', 'message': 'waiting: \u00b5', 'hardware_id': '',
         'values': [{'key': 'alpha', 'value': '0.0055'}, {'key': 'reasons', 'value': ''}][:level]}
        for level in range(3)]},
    'std_msgs/msg/Float64MultiArray': {
        'layout': {'dim': [{'label': 'surge', 'size': 1, 'stride': 4}], 'data_offset': 0},
        'data': [1.0, 2.0]},
    'sensor_msgs/msg/JointState': {
        'header': header(''), 'name': ['surge', 'yaw'], 'position': [], 'velocity': [0.5, -0.0],
        'effort': []},
    'geometry_msgs/msg/TwistStamped': {'header': header('ab'), 'twist': {
        'linear': {'x': 1.0, 'y': 2.0, 'z': 3.0}, 'angular': {'x': 4.0, 'y': 5.0, 'z': 6.0}}},
}
