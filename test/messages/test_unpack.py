"""Serialised messages read without decoding them as a whole, to the same bits."""

from collections.abc import Mapping
from random import Random
from typing import Any

from hypothesis import given, settings as profile, strategies as st
import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
from rovid_core.model.samples import Event
from rovid_core.settings.run import DofSettings, InputSettings, Settings, ThrusterSettings
from rovid_ros.messages.converter import Converter, MAX_ATTEMPTS, Unpacker
from rovid_ros.messages.field_paths import FieldError, getter
from rovid_ros.messages.serialised_layout import find_layout, NoLayoutError, Numbers
from rovid_ros.messages.types import decoder, standard_types, WireType
from zstandard import ZstdError

ODD = 'test_msgs/msg/Odd'
DEFINITION = f"""\
int8 small
Part[<=3] parts
float64 wide
string<=9 label
uint8[3] three
Part[2] pair
int64 long
string[] words
float32[<=5] few
bool yes
float64[] values
string[2] two
uint16 last
{'=' * 80}
MSG: test_msgs/Part
uint8 mark
float64 value
string note
int16[] counts
"""

TYPES = [
    'geometry_msgs/msg/PointStamped', 'geometry_msgs/msg/PoseWithCovarianceStamped',
    'geometry_msgs/msg/QuaternionStamped', 'geometry_msgs/msg/TwistWithCovarianceStamped',
    'geometry_msgs/msg/WrenchStamped', 'geometry_msgs/msg/Wrench', 'nav_msgs/msg/Odometry',
    'nav_msgs/msg/Path', 'sensor_msgs/msg/BatteryState', 'sensor_msgs/msg/FluidPressure',
    'sensor_msgs/msg/Imu', 'sensor_msgs/msg/JointState', 'sensor_msgs/msg/Joy',
    'sensor_msgs/msg/PointCloud2', 'std_msgs/msg/Float32',
    'std_msgs/msg/Float64MultiArray', 'std_msgs/msg/Int16MultiArray', 'std_msgs/msg/String',
    'tf2_msgs/msg/TFMessage', ODD]


def store() -> Typestore:
    types = get_typestore(Stores.EMPTY)
    types.register(standard_types().fielddefs)
    types.register(get_types_from_msg(DEFINITION, ODD))
    return types


STORE = store()


def some(kind: str, random: Random) -> Any:
    """Return a random value of a field's type."""
    if kind == 'string':
        return ''.join(random.choices('aZ_µ', k=random.randrange(10)))
    if kind == 'bool':
        return random.random() < 0.5
    dtype = np.dtype({'byte': 'int8', 'char': 'uint8'}.get(kind, kind))
    value = np.frombuffer(random.randbytes(dtype.itemsize), dtype)[0]
    # what a NaN carries is lost on the way through a float of another size
    return value.item() if value == value else 0.5


def message(name: str, random: Random) -> Any:
    """Return a message with random contents."""
    return STORE.types[name](*[
        content(kind, random) for _, kind in STORE.fielddefs[name][1]])


def content(kind: Any, random: Random) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return message(detail, random)
    if node == Nodetype.BASE:
        return some(detail[0], random)
    entry, size = detail
    count = size if node == Nodetype.ARRAY else random.randrange(4)
    values = [content(entry, random) for _ in range(count)]
    if entry[0] == Nodetype.BASE and entry[1][0] != 'string':
        return np.array(values, dtype={'byte': 'int8', 'char': 'uint8', 'bool': 'bool'}.get(
            entry[1][0], entry[1][0]))
    return values


def written(name: str, content: Any, form: str) -> tuple[WireType, bytes]:
    if form == 'ros1':
        return WireType(STORE, name, 'ros1'), bytes(STORE.serialize_ros1(content, name))
    data = STORE.serialize_cdr(content, name, little_endian=form == 'little')
    return WireType(STORE, name, 'cdr'), bytes(data)


FORMS = ('little', 'big', 'ros1')


@pytest.mark.parametrize('name', TYPES)
@profile(max_examples=40, deadline=None)
@given(random=st.builds(Random, st.integers(0, 2**32)), form=st.sampled_from(FORMS))
def test_every_value_is_where_the_decoder_finds_it(name: str, random: Random, form: str) -> None:
    wire, data = written(name, message(name, random), form)
    layout = find_layout(wire, data)
    decoded = decoder(*wire)(data)
    for path, place in layout.places.items():
        value = getter(path)(decoded)
        got, = layout.fetch([path])(data)
        if isinstance(place, str) or isinstance(place, Numbers) and place.length is None:
            assert got == value
            continue
        assert got == tuple(value)
        if isinstance(place, Numbers):
            assert layout.fetch([(*path, slice(1, 99))])(data) == (got[1:],)
            assert not got or layout.fetch([(*path, len(got) - 1)])(data) == got[-1:]
    numbers = [path for path, place in layout.places.items() if isinstance(place, Numbers)
               and place.length is None]
    random.shuffle(numbers)
    assert layout.fetch(numbers)(data) == tuple(getter(path)(decoded) for path in numbers)


@pytest.mark.parametrize('name', TYPES)
@profile(max_examples=40, deadline=None)
@given(random=st.builds(Random, st.integers(0, 2**32)), form=st.sampled_from(FORMS))
def test_what_lacks_its_end_has_no_layout(name: str, random: Random, form: str) -> None:
    wire, data = written(name, message(name, random), form)
    cut = data[:random.randrange(len(data))] if data else b''
    try:
        decoder(*wire)(cut)
    except (SerdeError, AssertionError, ValueError):
        with pytest.raises(NoLayoutError):
            find_layout(wire, cut)


def test_other_encapsulations_have_no_layout() -> None:
    wire, data = written(TYPES[0], message(TYPES[0], Random(0)), 'little')
    for kind in (b'\0\2', b'\0\3', b'\0\7', b'\1\0'):
        with pytest.raises(NoLayoutError):
            find_layout(wire, kind + data[2:])
    # the other two bytes are options, which nobody reads
    assert find_layout(wire, data[:2] + b'\5\6' + data[4:]) == find_layout(wire, data)


def settings(position: str, attitude: str = '', **thrusters: Any) -> Settings:
    return Settings(
        dofs=('surge',), position=InputSettings('/in', field=position),
        attitude=InputSettings('/in' if attitude else '/other', field=attitude),
        thrusters=ThrusterSettings(
            topics=('/thrust',), gain=(1.0, 1.0), allocation=((1.0, 1.0),) * 6, **thrusters),
        dof={'surge': DofSettings(mass=1.0)})


CASES: Mapping[str, dict[str, Any]] = {
    'geometry_msgs/msg/PointStamped': {'position': 'point'},
    'geometry_msgs/msg/PoseWithCovarianceStamped': {'position': 'pose', 'attitude': 'pose'},
    'nav_msgs/msg/Odometry': {'position': 'pose.pose', 'attitude': 'pose.pose'},
    'nav_msgs/msg/Path': {'position': 'poses[1].pose.position'},
    'sensor_msgs/msg/Joy': {'position': 'axes'},
    'sensor_msgs/msg/JointState': {'position': 'velocity[0:3]'},
    ODD: {'position': 'values', 'attitude': 'wide'},
}


class Both:
    """The whole way and the short one, beside each other."""

    def __init__(self, name: str, form: str, settings: Settings, topic: str) -> None:
        self.whole = 0
        self.counts: tuple[list[Any], list[Any]] = ([], [])
        self.topic = topic
        plain, fast = (Converter(settings, lambda *reason, to=to: to.append(reason))
                       for to in self.counts)
        self._plain = plain
        wire = WireType(STORE, name, 'ros1' if form == 'ros1' else 'cdr')
        self._decode = decoder(*wire)
        self._unpacker = Unpacker(fast, topic, wire, self._counted)

    def _counted(self, data: bytes) -> Any:
        self.whole += 1
        return self._decode(data)

    def events(self, data: bytes) -> list[Event] | str:
        """Return what both give, which has to be the same."""
        found = []
        for way in (lambda: self._plain.events(self.topic, self._decode(data), 7),
                    lambda: self._unpacker.events(data, 7)):
            try:
                found.append(repr(way()))
            except (SerdeError, ZstdError, AssertionError, ValueError) as error:
                found.append(repr(error))
        assert found[0] == found[1]
        assert self.counts[0] == self.counts[1]
        return found[0]


@pytest.mark.long
@pytest.mark.parametrize('name', CASES)
@profile(max_examples=40, deadline=None)
@given(random=st.builds(Random, st.integers(0, 2**32)), form=st.sampled_from(FORMS))
def test_both_ways_give_the_same_events(name: str, random: Random, form: str) -> None:
    both = Both(name, form, settings(**CASES[name]), '/in')
    _, data = written(name, message(name, random), form)
    try:
        both.events(data)
    except FieldError:
        return
    for _ in range(20):  # a byte wrong here, the end missing there, another message between
        other = bytearray(data)
        for _ in range(random.randrange(3)):
            if other:
                other[random.randrange(len(other))] = random.randrange(256)
        both.events(bytes(other))
        both.events(data[:random.randrange(len(data) + 1)])
        both.events(written(name, message(name, random), form)[1])


@pytest.mark.parametrize('form', FORMS)
def test_a_message_of_a_known_layout_is_not_decoded_as_a_whole(form: str) -> None:
    name = 'nav_msgs/msg/Odometry'
    both = Both(name, form, settings(**CASES[name]), '/in')
    random = Random(1)
    for number in range(10):
        content = message(name, random)
        content.header.frame_id, content.child_frame_id = 'world', 'b'
        content.header.stamp.nanosec = number
        both.events(written(name, content, form)[1])
    assert both.whole == 1
    content.header.frame_id = 'worlds'
    both.events(written(name, content, form)[1])
    assert both.whole == 2


def test_thrusters_picked_by_name_follow_the_names() -> None:
    name = 'sensor_msgs/msg/JointState'
    run = settings('point', field='effort', names=('port', 'star'))
    both = Both(name, 'little', run, '/thrust')
    content = message(name, Random(2))
    content.velocity = content.position = np.empty(0)
    for names, effort in ((['port', 'star'], [1.0, 2.0]), (['port', 'star'], [3.0, 4.0]),
                          (['star', 'port'], [5.0, 6.0]), (['star', 'bow_'], [5.0, 6.0]),
                          (['star', 'port'], [5.0]), (['port', 'star'], [7.0, 8.0])):
        content.name, content.effort = names, np.array(effort)
        both.events(written(name, content, 'little')[1])
    assert both.counts[1] == [('thrusters', 'missing_name'), ('thrusters', 'wrong_length')]
    assert both.whole == 5  # but the second


def test_a_topic_without_a_layout_that_stays_is_not_looked_at_for_ever() -> None:
    name = 'sensor_msgs/msg/Joy'
    both = Both(name, 'little', settings(position='axes'), '/in')
    content = message(name, Random(3))
    for number in range(MAX_ATTEMPTS + 50):
        content.header.frame_id = f'{number:03}'
        both.events(written(name, content, 'little')[1])
    both.whole = 0
    content.header.frame_id = f'{MAX_ATTEMPTS - 1:03}'
    both.events(written(name, content, 'little')[1])
    assert both.whole == 0  # the last one that was learned
    content.header.frame_id = f'{MAX_ATTEMPTS:03}'
    both.events(written(name, content, 'little')[1])
    both.events(written(name, content, 'little')[1])
    assert both.whole == 2
