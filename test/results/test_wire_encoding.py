"""The encoders against rosbags' own serialisation, with any texts and numbers."""

import math
from typing import Any

from hypothesis import given, strategies as st
import numpy as np
from rovid_ros.messages.types import build, standard_types
from rovid_ros.results.outputs import ARRAY_TYPE, DIAGNOSTIC_TYPE
from rovid_ros.results.wire_encoding import (
    ArrayEncoder,
    begin_stamped,
    DiagnosticEncoder,
    JointStateEncoder,
    known_status,
    number_pairs,
    pair,
    StampedEncoder,
    status_body,
    string,
    words,
)

TIME = st.integers(0, (1 << 31) * 10**9 - 1)
NUMBER = st.floats()
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
LONG = st.one_of(TEXT, st.text('aé', min_size=60, max_size=300))
NAMES = st.lists(TEXT, min_size=1, max_size=4)
VALUES = st.dictionaries(TEXT, st.one_of(
    NUMBER, st.integers(), st.booleans(), LONG, NUMBER.map(np.float64)), max_size=4)
STATUS = st.tuples(st.integers(0, 3), TEXT, LONG, TEXT, VALUES)


def serialised(name: str, fields: dict[str, Any]) -> bytes:
    store = standard_types()
    return bytes(store.serialize_cdr(build(store, name, fields), name))


def header(time: int, frame: str) -> dict[str, Any]:
    sec, nanosec = divmod(time, 10**9)
    return {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': frame}


@given(NAMES, NAMES, st.data())
def test_arrays(names: list[str], labels: list[str], data: st.DataObject) -> None:
    rows, columns = len(names), len(labels)
    table = data.draw(st.lists(
        st.lists(NUMBER, min_size=columns, max_size=columns), min_size=rows, max_size=rows))
    encoder = ArrayEncoder(names, labels)
    assert encoder.encode([encoder.row(row) for row in table]) == serialised(ARRAY_TYPE, {
        'layout': {'dim': [
            {'label': ','.join(names), 'size': rows, 'stride': rows * columns},
            {'label': ','.join(labels), 'size': columns, 'stride': columns}], 'data_offset': 0},
        'data': [value for row in table for value in row]})


@given(TIME, TEXT, st.lists(NUMBER, min_size=6, max_size=6))
def test_twists_and_vectors(time: int, frame: str, values: list[float]) -> None:
    linear, angular = dict(zip('xyz', values[:3])), dict(zip('xyz', values[3:]))
    assert StampedEncoder(frame, 6).encode(begin_stamped(time), values) == serialised(
        'geometry_msgs/msg/TwistStamped',
        {'header': header(time, frame), 'twist': {'linear': linear, 'angular': angular}})
    assert StampedEncoder(frame, 3).encode(begin_stamped(time), values[:3]) == serialised(
        'geometry_msgs/msg/Vector3Stamped', {'header': header(time, frame), 'vector': linear})


@given(TIME, TEXT, NAMES)
def test_joint_states(time: int, frame: str, names: list[str]) -> None:
    velocity = [0.1 * number for number in range(len(names))]
    effort = [math.nan, *velocity][:len(names)]
    mine = JointStateEncoder(frame, names).encode(begin_stamped(time), velocity, effort)
    assert mine == serialised(
        'sensor_msgs/msg/JointState', {
            'header': header(time, frame), 'name': names, 'position': [],
            'velocity': velocity, 'effort': effort})


@given(TIME, TEXT, st.lists(STATUS, max_size=3))
def test_diagnostics(time: int, frame: str, statuses: list[Any]) -> None:
    assert DiagnosticEncoder(frame).encode(begin_stamped(time), [
        (level, status_body(*parts)) for level, *parts in statuses
    ]) == diagnostics(time, frame, statuses)


@given(TEXT, LONG, st.dictionaries(TEXT.filter(lambda key: key != 'text'), st.one_of(
    NUMBER, st.integers(0, 1 << 63), NUMBER.map(np.float64)), min_size=1), TEXT)
def test_a_status_of_parts_that_are_known_is_the_same(
        name: str, message: str, values: dict[str, float], text: str) -> None:
    last, *others = values
    mine = known_status(
        string(name) + string(message) + string(''), len(values) + 1,
        number_pairs([string(key) for key in others], [values[key] for key in others])
        + pair('text', text) + number_pairs([string(last)], [values[last]]))
    assert mine == status_body(name, message, '', {
        **{key: values[key] for key in others}, 'text': text, last: values[last]})


def diagnostics(time: int, frame: str, statuses: list[Any]) -> bytes:
    return serialised(DIAGNOSTIC_TYPE, {'header': header(time, frame), 'status': [
        {'level': level, 'name': name, 'message': message, 'hardware_id': hardware,
         'values': [{'key': key, 'value': words(value)} for key, value in values.items()]}
        for level, name, message, hardware, values in statuses]})


def test_the_text_of_a_number_gives_its_bits_back() -> None:
    assert words(np.float64(0.1)) == '0.1'
    assert words(1.0 / 3.0) == '0.3333333333333333'
    assert (words(True), words(3), words('x')) == ('true', '3', 'x')
