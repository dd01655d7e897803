"""Messages to samples: field paths, stamps, frames, thrusters, and what is refused."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

from hypothesis import given, strategies
import numpy as np
import pytest
from rovid_core.model.samples import Event
from rovid_core.settings.run import (
    DofSettings,
    InputSettings,
    Settings,
    SettingsError,
    ThrusterSettings,
)
from rovid_core.velocity.attitude_history import rotate
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.field_paths import FieldError
from rovid_ros.messages.types import build, standard_types

NOW = 5_000_000_000
IDENTITY = tuple(tuple(float(i == j) for j in range(6)) for i in range(6))
STAMP = {'stamp': {'sec': 7, 'nanosec': 8}}


def settings(thrusters: Mapping[str, Any] | None = None, **given: Any) -> Settings:
    chain = {'topics': ('/thrust',), 'gain': (1.0,) * 6, 'allocation': IDENTITY, 'field': 'data',
             **(thrusters or {})}
    count = len(chain['gain'])
    chain['allocation'] = tuple((1.0,) * count for _ in range(6))
    given.setdefault('depth', InputSettings('/depth', field='data'))
    return Settings(('heave',), {'heave': DofSettings(100.0)}, ThrusterSettings(**chain), **given)


def message(name: str, fields: Mapping[str, Any]) -> Any:
    return build(standard_types(), name, fields)


def ros_message(name: str, fields: Mapping[str, Any]) -> Any:
    pytest.importorskip('rclpy')
    from rovid_ros.node.transport.message_types import import_type

    from test.support.ros_messages import fill
    return fill(import_type(name), fields)


@pytest.fixture(params=[message, ros_message], ids=['log', 'rclpy'])
def make(request: pytest.FixtureRequest) -> Callable[[str, Mapping[str, Any]], Any]:
    """Return what makes a message from a type and fields, for either kind of objects."""
    return request.param


class Case:
    """A converter with its counts."""

    def __init__(self, given: Settings) -> None:
        self.counts: dict[tuple[str, str], int] = {}
        self.converter = Converter(given, self._count)

    def _count(self, name: str, reason: str) -> None:
        self.counts[name, reason] = self.counts.get((name, reason), 0) + 1

    @property
    def refused(self) -> dict[tuple[str, str], int]:
        """Return the counts of what gave no sample."""
        return {key: count for key, count in self.counts.items() if key[1] != 'zero_stamp'}

    def events(self, topic: str, data: Any) -> list[Event]:
        return self.converter.events(topic, data, NOW, 'origin')

    def values(self, topic: str, data: Any) -> dict[str, tuple[float, ...]]:
        events = self.events(topic, data)
        values = {sample.input: sample.value for event in events for sample in event.samples}
        assert all(type(x) is float for value in values.values() for x in value)
        return values


def point(x: float, y: float, z: float) -> dict[str, float]:
    return {'x': x, 'y': y, 'z': z}


POSE = {'position': point(1.0, 2.0, 3.0), 'orientation': {**point(0.5, 0.1, -0.5), 'w': 0.7}}
TWIST = {'linear': point(4.0, 5.0, 6.0), 'angular': point(0.1, 0.2, 0.3)}


# --- types and paths ----------------------------------------------------------------------


@pytest.mark.parametrize('name, fields, paths', [
    ('geometry_msgs/msg/Point', point(1.0, 2.0, 3.0), ['']),
    ('geometry_msgs/msg/PointStamped', {'point': point(1.0, 2.0, 3.0)}, ['point', '']),
    ('geometry_msgs/msg/PoseStamped', {'pose': POSE}, ['pose.position', 'pose', '']),
    ('nav_msgs/msg/Odometry', {'pose': {'pose': POSE}},
     ['pose.pose.position', 'pose.pose', 'pose', '']),
    ('nav_msgs/msg/Path', {'poses': [{'pose': POSE}]},
     ['poses[0].pose.position', 'poses[0]', 'poses[0].pose']),
    ('geometry_msgs/msg/TransformStamped', {'transform': {
        'translation': point(1.0, 2.0, 3.0)}}, ['transform.translation', 'transform', '']),
    ('std_msgs/msg/Float32MultiArray', {'data': [1.0, 2.0, 3.0]}, ['data']),
    ('std_msgs/msg/Int32MultiArray', {'data': [0, 1, 2, 3]}, ['data[1:4]']),
    ('std_msgs/msg/Int32MultiArray', {'data': [3, 0, 1, 2]}, ['data[2], data[3], data[0]']),
    ('geometry_msgs/msg/Point', point(2.0, 1.0, 3.0), ['y, x, z', 'y,x,z']),
])
def test_position_of_many_types(name: str, fields: dict, paths: list[str], make: Any) -> None:
    for path in paths:
        case = Case(settings(position=InputSettings('/p', field=path)))
        assert case.values('/p', make(name, fields)) == {'position': (1.0, 2.0, 3.0)}, path
        assert case.refused == {}


@pytest.mark.parametrize('frames, value', [('enu', (1.0, 2.0, 0.0)), ('ned', (2.0, 1.0, 0.0))])
def test_x_and_y_are_enough_at_the_surface(frames: str, value: tuple[float, ...],
                                           make: Any) -> None:
    pose = make('geometry_msgs/msg/Pose2D', {'x': 1.0, 'y': 2.0, 'theta': 0.3})
    known = settings(frames=frames, position=InputSettings('/p', field='x, y'))
    assert Case(known).values('/p', pose)['position'] == value
    with pytest.raises(FieldError, match="position.field: 'x, y' has no z, which heave needs"):
        Case(replace(known, depth=InputSettings(),
                     attitude=InputSettings('/a'))).converter.check_type('/p', pose)


def test_all_that_an_odometry_holds_is_one_event(make: Any) -> None:
    odometry = make('nav_msgs/msg/Odometry', {
        'header': STAMP, 'pose': {'pose': POSE}, 'twist': {'twist': TWIST}})
    given = InputSettings('/odom')
    case = Case(settings(position=given, attitude=given, angular_velocity=given, velocity=given,
                         reference=given, depth=replace(given, field='pose.pose.position.z')))
    event, = case.events('/odom', odometry)
    assert (event.time, event.origin) == (7_000_000_008, 'origin')
    assert [(sample.input, sample.value) for sample in event.samples] == [
        ('position', (1.0, 2.0, 3.0)),
        ('depth', (3.0,)),
        ('attitude', (0.5, 0.1, -0.5, 0.7)),
        ('angular_velocity', (0.1, 0.2, 0.3)),
        ('velocity', (4.0, 5.0, 6.0)),
        ('reference', (4.0, 5.0, 6.0, 0.1, 0.2, 0.3)),
    ]
    assert case.converter.topics['/odom'] == ''


def test_a_reference_can_be_linear_only(make: Any) -> None:
    case = Case(settings(reference=InputSettings('/r', field='vector')))
    values = case.values('/r', make('geometry_msgs/msg/Vector3Stamped', {
        'vector': point(1.0, 2.0, 3.0)}))['reference']
    assert values[:3] == (1.0, 2.0, 3.0)
    assert all(math.isnan(x) for x in values[3:])


def test_an_imu_and_a_gyro(make: Any) -> None:
    imu = make('sensor_msgs/msg/Imu', {
        'orientation': {'z': 1.0, 'w': 0.0}, 'angular_velocity': point(0.1, 0.2, 0.3)})
    case = Case(settings(attitude=InputSettings('/imu', field='orientation'),
                         angular_velocity=InputSettings('/imu', field='angular_velocity')))
    assert case.values('/imu', imu) == {
        'attitude': (0.0, 0.0, 1.0, 0.0), 'angular_velocity': (0.1, 0.2, 0.3)}


def test_what_an_imu_has_no_estimate_of(make: Any) -> None:
    case = Case(settings(attitude=InputSettings('/imu', field='orientation'),
                         angular_velocity=InputSettings('/imu', field='angular_velocity')))
    for names in ((), ('orientation',), ('angular_velocity', 'orientation')):
        imu = make('sensor_msgs/msg/Imu', {
            f'{name}_covariance': [-1.0] + [0.0] * 8 for name in names})
        assert case.values('/imu', imu).keys() == {
            {'orientation': 'attitude'}.get(name, name)
            for name in {'orientation', 'angular_velocity'} - set(names)}
    assert case.refused == {('attitude', 'not_estimated'): 2,
                            ('angular_velocity', 'not_estimated'): 1}


def test_latitude_and_longitude_are_metres_of_a_world_with_z_up(make: Any) -> None:
    """0.001 deg of latitude at 60 deg and, across the date line, 0.0002 deg of longitude."""
    fixes = [(60.0, 179.9999, 5.0, 0), (60.001, -179.9999, 7.0, 2), (60.002, 179.9999, 5.0, -1),
             (math.nan, 179.9999, 5.0, 0)]
    for frames in ('enu', 'ned'):
        case = Case(settings(position=InputSettings('/gps'), frames=frames))
        one, other, *more = [case.values('/gps', make('sensor_msgs/msg/NavSatFix', {
            'latitude': latitude, 'longitude': longitude, 'altitude': altitude,
            'status': {'status': status}})) for latitude, longitude, altitude, status in fixes]
        moved = np.subtract(other['position'], one['position'])
        assert moved == pytest.approx((11.160, 111.412, 2.0), abs=0.002)
        assert case.refused == {('position', 'not_estimated'): 1}
        assert 'position' not in more[0] and math.isnan(more[1]['position'][1])


def test_who_begins_later_measures_from_the_same_place(make: Any) -> None:
    def position(latitudes: Sequence[float]) -> Any:
        case = Case(settings(position=InputSettings('/gps')))
        return [case.values('/gps', make('sensor_msgs/msg/NavSatFix', {
            'latitude': latitude, 'longitude': -76.6})) for latitude in latitudes][-1]

    assert position([39.3001, 39.3021]) == position([39.3021])


def test_one_sign_for_all_thrusters(make: Any) -> None:
    case = Case(settings({'gain': (1.0, 1.0, 1.0)}, sign=InputSettings('/way', field='data')))
    assert case.values('/way', make('std_msgs/msg/Int8', {'data': -1})) == {'sign': (-1.0,)}


def test_depth_is_scaled(make: Any) -> None:
    pressure = make('sensor_msgs/msg/FluidPressure', {'fluid_pressure': 111325.0})
    case = Case(settings(depth=InputSettings('/depth', field='fluid_pressure'),
                         depth_scale=-1e-4, depth_offset=10.1325))
    assert case.values('/depth', pressure)['depth'][0] == pytest.approx(-1.0)
    whole = make('std_msgs/msg/Int16', {'data': 3})
    for frames in ('enu', 'ned'):
        assert Case(settings(frames=frames)).values('/depth', whole) == {'depth': (3.0,)}


@pytest.mark.parametrize('name, input, path, says', [
    ('geometry_msgs/msg/PointStamped', 'position', 'pint.x',
     "position.field: 'pint.x': geometry_msgs/msg/PointStamped has no field 'pint', "
     "it has header, point; did you mean 'point'?"),
    ('nav_msgs/msg/Odometry', 'position', 'pose.pose.psition',
     "position.field: 'pose.pose.psition': geometry_msgs/msg/Pose has no field 'psition', "
     "it has position, orientation; did you mean 'position'?"),
    ('geometry_msgs/msg/PointStamped', 'position', 'point.x.y',
     "position.field: 'point.x.y': a number has no field 'y'"),
    ('geometry_msgs/msg/PointStamped', 'position', 'point[0]',
     "position.field: 'point[0]': geometry_msgs/msg/Point has no entries to index"),
    ('geometry_msgs/msg/PointStamped', 'position', 'header',
     "position.field: 'header' of geometry_msgs/msg/PointStamped is std_msgs/msg/Header, which "
     'has stamp, frame_id; position takes x, y and z or an array of numbers or latitude, '
     'longitude and altitude'),
    ('sensor_msgs/msg/Imu', 'position', 'orientation',
     "position.field: 'orientation' of sensor_msgs/msg/Imu is geometry_msgs/msg/Quaternion, "
     'which has x, y, z, w; position takes x, y and z or an array of numbers or latitude, '
     'longitude and altitude'),
    ('geometry_msgs/msg/PointStamped', 'depth', 'point',
     "depth.field: 'point' of geometry_msgs/msg/PointStamped is geometry_msgs/msg/Point, which "
     'has x, y, z; depth takes a number'),
    ('std_msgs/msg/String', 'depth', 'data',
     "depth.field: 'data' of std_msgs/msg/String is a text; depth takes a number"),
    ('std_msgs/msg/Bool', 'depth', 'data',
     "depth.field: 'data' of std_msgs/msg/Bool is true or false; depth takes a number"),
    ('sensor_msgs/msg/JointState', 'sign', 'name',
     "thrusters.sign.field: 'name' of sensor_msgs/msg/JointState is an array; sign takes an "
     'array of numbers or a number'),
    *[('geometry_msgs/msg/Point', 'position', path,
       f'position.field: {path!r} is not a field path; one looks like a.b, a[0] or a[0:4]')
      for path in ('.x', 'a..b', 'a b', 'a[]', 'a[-1]', 'a[1', 'a.[1]', 'a[0]b', '/a')],
])
def test_a_path_that_leads_nowhere_is_refused_before_any_message(
        name: str, input: str, path: str, says: str, make: Any) -> None:
    converter = Converter(settings(**{input: InputSettings('/t', field=path)}), lambda *_: None)
    for action in (lambda data: converter.check_type('/t', data),
                   lambda data: converter.events('/t', data, NOW)):
        with pytest.raises(FieldError) as refused:
            action(make(name, {}))
        assert str(refused.value) == says


def test_an_array_of_messages_is_checked_when_there_is_one(make: Any) -> None:
    case = Case(settings(position=InputSettings('/p', field='poses[1].pose')))
    assert case.values('/p', make('nav_msgs/msg/Path', {})) == {}
    assert case.values('/p', make('nav_msgs/msg/Path', {'poses': [{}, {'pose': POSE}]})) == {
        'position': (1.0, 2.0, 3.0)}
    assert case.values('/p', make('nav_msgs/msg/Path', {'poses': [{}]})) == {}
    assert case.refused == {('position', 'missing_index'): 2}
    assert case.converter.details == {
        ('position', 'missing_index'):
            "position.field: 'poses[1].pose' is beyond the end of 0 entries"}


def test_types_that_contradict_each_other_are_refused() -> None:
    both = {'position': InputSettings('/odom', 'nav_msgs/msg/Odometry'),
            'attitude': InputSettings('/odom', 'sensor_msgs/msg/Imu')}
    with pytest.raises(SettingsError, match='attitude.type: is sensor_msgs/msg/Imu, but position'
                                            '.type reads /odom as nav_msgs/msg/Odometry$'):
        Converter(settings(**both), lambda *_: None)
    for name in both:
        wrong = {**both, name: InputSettings('/odom', 'nav_msgs/msg/Odometri')}
        with pytest.raises(SettingsError, match=f'^{name}.type: is nav_msgs/msg/Odometri, .*; '
                                                "did you mean 'nav_msgs/msg/Odometry'"):
            Converter(settings(**wrong), lambda *_: None)
    both['attitude'] = replace(both['attitude'], type='')
    topics = Converter(settings(**both), lambda *_: None).topics
    assert topics == {'/odom': 'nav_msgs/msg/Odometry', '/depth': '', '/thrust': ''}


def test_another_topic_gives_nothing() -> None:
    assert Case(settings()).events('/other', message('std_msgs/msg/Float64', {})) == []


# --- time ---------------------------------------------------------------------------------


@pytest.mark.parametrize('stamp, sec, time, zero', [
    ('', 7, 7_000_000_008, False), ('header', 7, 7_000_000_008, False),
    ('receive', 7, NOW, False), ('', 0, NOW, True), ('header', 0, NOW, True),
    ('receive', 0, NOW, False), ('', -1, -999_999_992, False)])
def test_the_event_time(stamp: str, sec: int, time: int, zero: bool, make: Any) -> None:
    case = Case(settings(position=InputSettings('/p', stamp=stamp, latency=0.25)))
    event, = case.events('/p', make('geometry_msgs/msg/PointStamped', {
        'header': {'stamp': {'sec': sec, 'nanosec': 8 if sec else 0}}}))
    assert event.time == time - 250_000_000
    assert case.counts == ({('position', 'zero_stamp'): 1} if zero else {})


def test_a_type_without_a_header_has_the_receive_time(make: Any) -> None:
    event, = Case(settings()).events('/depth', make('std_msgs/msg/Float64', {'data': 1.0}))
    assert event.time == NOW
    case = Case(settings(depth=InputSettings('/depth', stamp='header')))
    with pytest.raises(FieldError) as refused:
        case.events('/depth', make('std_msgs/msg/Float64', {}))
    assert str(refused.value) == (
        "depth.stamp: is 'header', but std_msgs/msg/Float64 has none, it has data; "
        "use 'receive'")


def test_unequal_latencies_give_two_events(make: Any) -> None:
    case = Case(settings(position=InputSettings('/odom', latency=0.1),
                         attitude=InputSettings('/odom')))
    first, second = case.events('/odom', make('nav_msgs/msg/Odometry', {'header': STAMP}))
    assert (first.time, first.samples[0].input) == (6_900_000_008, 'position')
    assert (second.time, second.samples[0].input) == (7_000_000_008, 'attitude')


# --- frames -------------------------------------------------------------------------------

WORLD = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # ENU axes in terms of NED
BODY = np.diag([1, -1, -1])  # FLU axes in terms of FRD


def matrix(q: tuple[float, ...]) -> np.ndarray:
    """Return the rotation matrix, by Rodrigues' formula."""
    axis, w = np.array(q[:3]), q[3]
    sine = np.linalg.norm(axis)
    angle = 2.0 * math.atan2(float(sine), w)
    k = axis / sine if sine else axis
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def turn(yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


number = strategies.floats(-1.0, 1.0).map(lambda x: x + 1e-3)


@given(x=number, y=number, z=number, w=number, offset=strategies.floats(-4.0, 4.0))
def test_ned_vectors_and_quaternions(
        x: float, y: float, z: float, w: float, offset: float) -> None:
    length = math.sqrt(x * x + y * y + z * z + w * w)
    q = (x / length, y / length, z / length, w / length)
    odometry = message('nav_msgs/msg/Odometry', {
        'pose': {'pose': {'position': point(x, y, z), 'orientation': dict(zip('xyzw', q))}},
        'twist': {'twist': {'linear': point(x, y, z), 'angular': point(y, z, w)}}})
    inputs = dict.fromkeys(
        ('position', 'attitude', 'velocity', 'angular_velocity', 'reference'),
        InputSettings('/odom'))
    case = Case(settings(**inputs, frames='ned', yaw_offset=offset))
    values = case.values('/odom', odometry)
    np.testing.assert_allclose(values['position'], WORLD @ (x, y, z), atol=1e-12)
    np.testing.assert_allclose(values['velocity'], BODY @ (x, y, z), atol=1e-12)
    np.testing.assert_allclose(values['angular_velocity'], BODY @ (y, z, w), atol=1e-12)
    np.testing.assert_allclose(values['reference'][:3], BODY @ (x, y, z), atol=1e-12)
    np.testing.assert_allclose(values['reference'][3:], BODY @ (y, z, w), atol=1e-12)
    np.testing.assert_allclose(
        matrix(values['attitude']), turn(offset) @ WORLD @ matrix(q) @ BODY, atol=1e-9)
    # a velocity turned into the world is the same velocity in both conventions
    if offset == 0.0:
        np.testing.assert_allclose(
            matrix(values['attitude']) @ values['velocity'], WORLD @ matrix(q) @ (x, y, z),
            atol=1e-9)


@pytest.mark.parametrize('frames, sense', [('enu', 'ned'), ('ned', 'ned'), ('ned', '')])
def test_a_compass(frames: str, sense: str, make: Any) -> None:
    case = Case(settings(attitude=InputSettings('/h', field='data'), frames=frames,
                         heading_unit='deg', heading_frames=sense))
    q = case.values('/h', make('std_msgs/msg/Float64', {'data': 90.0}))['attitude']
    np.testing.assert_allclose(matrix(q) @ (1, 0, 0), (1, 0, 0), atol=1e-12)
    q = case.values('/h', make('std_msgs/msg/Float64', {'data': 180.0}))['attitude']
    np.testing.assert_allclose(matrix(q) @ (1, 0, 0), (0, -1, 0), atol=1e-12)


@pytest.mark.parametrize('frames, unit, heading, direction', [
    ('enu', 'rad', 0.0, (1, 0)), ('enu', 'rad', math.pi / 2, (0, 1)), ('enu', 'deg', 180, (-1, 0)),
    ('ned', 'deg', 0, (0, 1)), ('ned', 'deg', 90, (1, 0)), ('ned', 'rad', -math.pi / 2, (-1, 0)),
    ('ned', 'deg', 405, (math.sqrt(0.5), math.sqrt(0.5)))])
def test_a_heading(frames: str, unit: str, heading: float, direction: tuple[float, float],
                   make: Any) -> None:
    given = {'attitude': InputSettings('/h', field='data'), 'frames': frames,
             'heading_unit': unit}
    data = make('std_msgs/msg/Float64', {'data': float(heading)})
    q = Case(settings(**given)).values('/h', data)['attitude']
    np.testing.assert_allclose(matrix(q) @ (1, 0, 0), (*direction, 0), atol=1e-12)
    np.testing.assert_allclose(matrix(q) @ (0, 0, 1), (0, 0, 1), atol=1e-12)
    q = Case(settings(**given, yaw_offset=0.3)).values('/h', data)['attitude']
    np.testing.assert_allclose(
        matrix(q) @ (1, 0, 0), turn(0.3) @ (*direction, 0), atol=1e-12)


@pytest.mark.parametrize('unit', ['rad', 'deg'])
@pytest.mark.parametrize(('frames', 'sense'), [('enu', ''), ('ned', ''), ('enu', 'ned')])
def test_roll_pitch_and_yaw(unit: str, frames: str, sense: str, make: Any) -> None:
    angles = (0.1, 0.2, 0.5) if (sense or frames) == 'enu' else (0.1, -0.2, 0.5 * math.pi - 0.5)
    scale = 1.0 if unit == 'rad' else 180.0 / math.pi
    case = Case(settings(attitude=InputSettings('/a', field='data'), heading_unit=unit,
                         heading_frames=sense, frames=frames))
    data = make('std_msgs/msg/Float64MultiArray', {'data': [scale * angle for angle in angles]})
    q = case.values('/a', data)['attitude']
    # where bow and port side point in the world, from the angles themselves
    bow, port = rotate(q, (1.0, 0.0, 0.0)), rotate(q, (0.0, 1.0, 0.0))
    assert bow == pytest.approx((math.cos(0.2) * math.cos(0.5), math.cos(0.2) * math.sin(0.5),
                                 -math.sin(0.2)), abs=1e-12)
    assert port[2] == pytest.approx(math.sin(0.1) * math.cos(0.2), abs=1e-12)


def test_a_quaternion_at_four_paths(make: Any) -> None:
    case = Case(settings(attitude=InputSettings('/a', field='data[1], data[2], data[3], data[0]')))
    data = make('std_msgs/msg/Float64MultiArray', {'data': [0.7, 0.5, 0.1, -0.5]})
    assert case.values('/a', data) == {'attitude': (0.5, 0.1, -0.5, 0.7)}


@pytest.mark.parametrize(('name', 'field', 'says'), [
    ('depth', 'x, y', "depth.field: 'x, y' is a list; depth takes a number"),
    ('position', 'x, y, q', "position.field: 'x, y, q': geometry_msgs/msg/Point has no field 'q'"),
    ('position', 'x,, z', "position.field: 'x,, z': a list of paths takes a number at each"),
])
def test_a_list_of_paths_that_leads_nowhere(name: str, field: str, says: str) -> None:
    case = Case(settings(**{name: InputSettings('/in', field=field)}))
    with pytest.raises(FieldError) as refused:
        case.converter.check_type('/in', message('geometry_msgs/msg/Point', {}))
    assert says in str(refused.value)


angle = strategies.floats(-3.0, 3.0)


@given(x=number, y=number, z=number, roll=angle, pitch=angle, yaw=angle)
def test_a_sensor_that_is_turned_in_the_body(
        x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> None:
    """By rpy as in a URDF: first about x, then y, then z, all of them axes of the body."""
    (a, b), (c, d), (e, f) = ((math.cos(one), math.sin(one)) for one in (roll, pitch, yaw))
    sensor = turn(yaw) @ np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]]) @ np.array(
        [[1, 0, 0], [0, a, -b], [0, b, a]])
    mounting = (roll, pitch, yaw)
    velocity = message('geometry_msgs/msg/TwistStamped', {'twist': {
        'linear': point(x, y, z), 'angular': point(z, x, y)}})
    of_world = (0.5, -0.5, 0.5, 0.5)  # of the sensor
    imu = message('geometry_msgs/msg/Quaternion', dict(zip('xyzw', of_world)))
    for own, there in (('', 'ned'), ('ned', 'enu')):  # a DVL with z down beside positions in ENU
        given = InputSettings('/dvl', frames=own, mounting=mounting)
        case = Case(settings(
            velocity=given, angular_velocity=replace(given, field='twist.angular'),
            position=InputSettings('/position'), frames=there,
            attitude=InputSettings('/imu', frames='enu', mounting=mounting)))
        values = case.values('/dvl', velocity)
        np.testing.assert_allclose(values['velocity'], sensor @ BODY @ (x, y, z), atol=1e-12)
        np.testing.assert_allclose(
            values['angular_velocity'], sensor @ BODY @ (z, x, y), atol=1e-12)
        values = case.values('/position', message('geometry_msgs/msg/Point', point(x, y, z)))
        expected = WORLD @ (x, y, z) if there == 'ned' else (x, y, z)
        np.testing.assert_allclose(values['position'], expected, atol=1e-12)
        np.testing.assert_allclose(
            matrix(case.values('/imu', imu)['attitude']) @ sensor, matrix(of_world), atol=1e-9)


@pytest.mark.parametrize('kind', ['Float64', 'Float64MultiArray'])
def test_a_compass_that_is_turned_in_the_body(kind: str) -> None:
    """Mounted to port, it shows north when the body looks east."""
    case = Case(settings(attitude=InputSettings(
        '/h', field='data', frames='ned', mounting=(0.0, 0.0, 0.5 * math.pi))))
    data: Any = 0.0 if kind == 'Float64' else [0.0, 0.0, 0.0]
    values = case.values('/h', message(f'std_msgs/msg/{kind}', {'data': data}))
    np.testing.assert_allclose(matrix(values['attitude']), np.eye(3), atol=1e-12)


def test_what_is_not_finite_passes_through() -> None:
    for frames in ('enu', 'ned'):
        case = Case(settings(
            position=InputSettings('/p'), attitude=InputSettings('/h'), frames=frames))
        values = case.values(
            '/p', message('geometry_msgs/msg/Point', point(math.nan, 1.0, -math.inf)))
        assert sorted(map(str, values['position'])) == sorted(
            ['nan', '1.0', '-inf' if frames == 'enu' else 'inf'])
        for heading in (math.nan, math.inf, -math.inf):
            values = case.values('/h', message('std_msgs/msg/Float64', {'data': heading}))
            assert all(map(math.isnan, values['attitude']))


# --- thrusters ----------------------------------------------------------------------------


@pytest.mark.parametrize('name, fields, path', [
    ('std_msgs/msg/Float64MultiArray', {'data': [1.5, -2.0, 3.0]}, 'data'),
    ('std_msgs/msg/Float64MultiArray', {'data': [1.5, -2.0, 3.0]}, ''),
    ('sensor_msgs/msg/Joy', {'axes': [0.0, 1.5, -2.0, 3.0]}, 'axes[1:4]'),
    ('sensor_msgs/msg/JointState', {'effort': [1.5, -2.0, 3.0]}, 'effort'),
])
def test_thruster_arrays(name: str, fields: dict, path: str, make: Any) -> None:
    case = Case(settings({'gain': (1.0,) * 3, 'field': path}))
    assert case.values('/thrust', make(name, fields)) == {'thrusters': (1.5, -2.0, 3.0)}


@pytest.mark.parametrize('name', ['Int8', 'UInt8', 'Int16', 'UInt16', 'Int32', 'UInt64'])
def test_integer_arrays(name: str, make: Any) -> None:
    data = make(f'std_msgs/msg/{name}MultiArray', {'data': [1, 100, 3]})
    case = Case(settings({'gain': (1.0,) * 3}))
    assert case.values('/thrust', data) == {'thrusters': (1.0, 100.0, 3.0)}


@dataclass
class Commands:
    values: Any


@pytest.mark.parametrize('values', [
    [1, 2.5], (1, 2.5), array('d', [1.0, 2.5]), np.array([1.0, 2.5]),
    np.array([1.0, 2.5], np.float32), [np.float64(1.0), np.float32(2.5)]])
def test_any_container_of_numbers(values: Any) -> None:
    case = Case(settings({'gain': (1.0, 1.0), 'field': 'values'}))
    assert case.values('/thrust', Commands(values)) == {'thrusters': (1.0, 2.5)}


def test_joints_are_picked_by_name(make: Any) -> None:
    case = Case(settings({
        'gain': (1.0, 1.0), 'field': 'effort', 'names': ('port', 'starboard')}))
    kind = 'sensor_msgs/msg/JointState'
    for names, efforts, expected in [
            (['starboard', 'gripper', 'port'], [1.0, 2.0, 3.0], (3.0, 1.0)),
            (['port', 'starboard'], [3.0, 1.0], (3.0, 1.0)),
            (['starboard', 'gripper'], [1.0, 2.0], None),
            (['starboard', 'gripper', 'port'], [1.0, 2.0], None),
            (['starboard', 'gripper', 'port'], [], None)]:
        values = case.values('/thrust', make(kind, {'name': names, 'effort': efforts}))
        assert values.get('thrusters') == expected
    assert case.refused == {('thrusters', 'missing_name'): 1, ('thrusters', 'wrong_length'): 2}
    with pytest.raises(FieldError, match="thrusters.names: needs an array name beside 'data', but "
                                         'std_msgs/msg/Float64MultiArray has layout, data'):
        Case(settings({'gain': (1.0,), 'names': ('port',)})).events(
            '/thrust', make('std_msgs/msg/Float64MultiArray', {}))


def test_one_topic_per_thruster(make: Any) -> None:
    case = Case(settings({'gain': (1.0,) * 3, 'topics': ('/a', '/b', '/c')}))
    event, = case.events('/b', make('std_msgs/msg/Int16', {'data': -4}))
    sample, = event.samples
    assert (sample.input, sample.part, sample.value) == ('thrusters', 1, (-4.0,))
    assert list(case.converter.topics) == ['/depth', '/a', '/b', '/c']


@pytest.mark.parametrize('frames, sign', [('enu', 1.0), ('ned', -1.0)])
def test_a_wrench(frames: str, sign: float, make: Any) -> None:
    wrench = {'force': point(1.0, 2.0, 3.0), 'torque': point(4.0, 5.0, 6.0)}
    for name, fields, path in [
            ('geometry_msgs/msg/Wrench', wrench, ''),
            ('geometry_msgs/msg/WrenchStamped', {'wrench': wrench}, 'wrench')]:
        case = Case(settings({'field': path}, frames=frames))
        assert case.values('/thrust', make(name, fields)) == {
            'thrusters': (1.0, sign * 2.0, sign * 3.0, 4.0, sign * 5.0, sign * 6.0)}
    with pytest.raises(FieldError, match="thrusters.field: 'wrench' gives 6 values for 2 "
                                         r'thrusters \(the length of thrusters.gain\)'):
        Case(settings({'gain': (1.0, 1.0), 'field': 'wrench'})).events(
            '/thrust', make('geometry_msgs/msg/WrenchStamped', {}))


def test_too_many_or_too_few_values(make: Any) -> None:
    case = Case(settings({'gain': (1.0, 1.0)}))
    assert case.values('/thrust', make('std_msgs/msg/Float64MultiArray', {
        'data': [1.0, 2.0, 3.0]})) == {}
    assert case.counts == {('thrusters', 'wrong_length'): 1}
    assert case.converter.details == {
        ('thrusters', 'wrong_length'): 'thrusters.field: got 3 values, takes 2'}
    with pytest.raises(FieldError, match="'data' gives 1 values for 2 thrusters"):
        case.events('/thrust', make('std_msgs/msg/Float64', {}))
    case = Case(settings({'gain': (1.0, 1.0), 'field': 'orientation_covariance'}))
    with pytest.raises(FieldError, match=r'gives 9 values for 2 .*; pick with \[0:2\]'):
        case.converter.check_type('/thrust', make('sensor_msgs/msg/Imu', {}))
    assert case.values('/thrust', make('sensor_msgs/msg/Imu', {})) == {}
    assert case.refused == {('thrusters', 'wrong_length'): 1}


def test_the_sign_of_the_thrust(make: Any) -> None:
    case = Case(settings({'gain': (1.0, 1.0), 'field': 'effort', 'names': ('a', 'b')},
                         sign=InputSettings('/thrust', field='velocity')))
    state = make('sensor_msgs/msg/JointState', {
        'name': ['b', 'a'], 'effort': [2.0, 1.0], 'velocity': [-1.0, 1.0]})
    event, = case.events('/thrust', state)
    assert [(sample.input, sample.value) for sample in event.samples] == [
        ('sign', (1.0, -1.0)), ('thrusters', (1.0, 2.0))]
