"""
Whatever comes, nothing breaks: messages, logs, parameter files, changes of parameters.

``ROVID_EXAMPLES`` is how many examples each test tries; ``--hypothesis-show-statistics`` tells.
"""

from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
import io
import math
import os
from pathlib import Path
import signal
import struct
from types import FrameType
from typing import Any

from hypothesis import event, given, HealthCheck, settings, strategies as st
import pytest
from rovid_core.pipeline.stream import Stream
from rovid_ros.commands.main import main
from rovid_ros.config.parameters import settings_from
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.types import build, standard_types
from rovid_ros.results.outputs import Outputs
import yaml

from test.support import recorded_logs
from test.support.outputs import message_of
from test.support.sensors import at_rates, sensed

EXAMPLES = int(os.environ.get('ROVID_EXAMPLES', '40'))
PATIENCE = 60
"""[s] after which an example hangs."""

many = settings(max_examples=EXAMPLES, deadline=None,
                suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large,
                                       HealthCheck.function_scoped_fixture])

START = 1_700_000_000  # [s]
VALUES: dict[str, Any] = {
    'dofs': ['surge', 'heave', 'yaw'], 'max_wait': 0.5, 'velocity.max': 1000.0,
    'position.topic': '/position', 'position.type': 'geometry_msgs/msg/PointStamped',
    'position.field': 'point',
    'depth.topic': '/depth', 'depth.type': 'sensor_msgs/msg/FluidPressure',
    'depth.field': 'fluid_pressure',
    'attitude.topic': '/imu', 'attitude.type': 'sensor_msgs/msg/Imu',
    'attitude.field': 'orientation',
    'angular_velocity.topic': '/imu', 'angular_velocity.type': 'sensor_msgs/msg/Imu',
    'angular_velocity.field': 'angular_velocity',
    'thrusters.topic': '/current', 'thrusters.type': 'sensor_msgs/msg/JointState',
    'thrusters.field': 'effort', 'thrusters.names': ['a', 'b'], 'thrusters.gain': [40.0, 40.0],
    'thrusters.allocation': [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.3, -0.3],
    'surge.initial.mass': 200.0, 'heave.initial.mass': 300.0, 'yaw.initial.mass': 50.0,
    'simulation.surge.mass': 200.0, 'simulation.surge.quadratic_drag': 100.0,
    'simulation.surge.forces': [100.0], 'simulation.surge.frequencies': [0.3],
    'simulation.heave.mass': 250.0, 'simulation.yaw.mass': 60.0}

# a log of points and arrays, with everything that reads it turned on
LOGGED: dict[str, Any] = {
    'dofs': ['heave'], 'velocity.max': 1000.0,
    'depth.topic': '/point', 'depth.field': 'point.z', 'depth.stamp': 'receive',
    'thrusters.topic': '/array', 'thrusters.field': 'data', 'thrusters.gain': [1.0, 1.0, 1.0],
    'thrusters.allocation': 6 * [0.0] + [1.0, 1.0, 1.0] + 9 * [0.0], 'heave.initial.mass': 200.0}

nasty = st.sampled_from([0.0, -0.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e-300])
number = st.one_of(*4 * [st.floats(-10.0, 10.0)], st.floats(), nasty)  # mostly sound
vector = st.fixed_dictionaries(dict.fromkeys('xyz', number))
quaternion = st.one_of(st.fixed_dictionaries(dict.fromkeys('xyzw', number)),
                       number.map(lambda x: dict.fromkeys('xyzw', x)))
# [ns]
shift = st.one_of(st.integers(-10**9, 10**9), st.integers(-10**13, 10**13))
time = st.one_of(shift.map(lambda t: START * 10**9 + t), st.just(0),
                 st.integers(-2**31 * 10**9, 2**31 * 10**9 - 1))
numbers = st.one_of(*3 * [st.lists(number, min_size=2, max_size=2)],
                    st.lists(number, max_size=5))
names = st.one_of(*3 * [st.permutations(['a', 'b'])], st.lists(st.text(max_size=3), max_size=5))
fields = st.one_of(
    st.tuples(st.just('/position'), st.fixed_dictionaries({'point': vector})),
    st.tuples(st.just('/depth'), st.fixed_dictionaries({'fluid_pressure': number})),
    st.tuples(st.just('/imu'), st.fixed_dictionaries(
        {'orientation': quaternion, 'angular_velocity': vector})),
    st.tuples(st.just('/current'), st.fixed_dictionaries({'name': names, 'effort': numbers})))
place = st.integers(0, 10_000)
# what happens to a good stream: where, and what
happening = st.one_of(
    *3 * [st.tuples(place, st.just('instead'), fields)],
    st.tuples(place, st.just('besides'), st.tuples(fields, time, time)),
    st.tuples(place, st.just('stamp'), time),
    st.tuples(place, st.just('shift'), st.tuples(st.integers(1, 60), shift)),
    st.tuples(place, st.just('lose'), st.integers(1, 60)),
    st.tuples(place, st.just('late'), place),
    st.tuples(place, st.just('reset'), st.none()),
    st.tuples(place, st.just('enable'), st.booleans()))


@dataclass(frozen=True)
class Sent:
    """A message: its topic, its fields without the header, stamp and receive time [ns]."""

    topic: str
    fields: dict[str, Any]
    stamp: int
    receive: int


@cache
def good_stream() -> tuple[Sent, ...]:
    """Return what a simulated vehicle sends in 25 s, after which the filter has begun."""
    sent = []
    slow = at_rates(settings_from(VALUES), position=3.0, depth=2.0, attitude=3.0,
                    angular_velocity=3.0, thruster=4.0)
    for message in sensed(slow, 25.0):
        fields = {name: value for name, value in message.fields.items() if name != 'header'}
        sent.append(Sent(message.topic, fields, message.time, message.time))
    return tuple(sent)


def upset(stream: list[Any], happenings: list[Any]) -> list[Any]:
    """Return the stream with what happens to it; a control is a name and a value."""
    for number, kind, what in happenings:
        i = number % len(stream)
        one = stream[i]
        if kind == 'besides':
            (topic, fields), *times = what
            stream.insert(i, Sent(topic, fields, *times))
        elif kind in ('reset', 'enable'):
            stream.insert(i, (kind, what))
        elif kind == 'lose':
            del stream[i:i + min(what, len(stream) - 1)]
        elif kind == 'late':
            stream.insert(what % len(stream), stream.pop(i))
        elif kind == 'shift':
            count, by = what
            stream[i:i + count] = [replace(m, stamp=m.stamp + by) if isinstance(m, Sent) else m
                                   for m in stream[i:i + count]]
        elif isinstance(one, Sent):
            stream[i] = replace(one, stamp=what) if kind == 'stamp' else replace(
                one, topic=what[0], fields=what[1])
    return stream


@pytest.fixture(autouse=True)
def patience() -> Iterator[None]:
    """Break off what hangs."""
    def give_up(number: int, frame: FrameType | None) -> None:
        raise TimeoutError('hangs')

    before = signal.signal(signal.SIGALRM, give_up)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.long
@many
@given(method=st.sampled_from(['ekf', 'aid']),
       happenings=st.lists(happening, min_size=5, max_size=40))
def test_any_messages_through_the_pipe(method: str, happenings: list[Any]) -> None:
    signal.alarm(PATIENCE)
    run = settings_from({**VALUES, 'identifier.method': method})
    pipe = Stream(run)
    converter = Converter(run, pipe.reject)
    outputs = Outputs(run)
    store = standard_types()
    estimates = []
    for sent in upset(list(good_stream()), happenings):
        if not isinstance(sent, Sent):
            pipe.reset() if sent[0] == 'reset' else pipe.enable(sent[1])
            continue
        header = {'stamp': dict(zip(('sec', 'nanosec'), divmod(sent.stamp, 10**9)))}
        message = build(store, converter.topics[sent.topic], {'header': header, **sent.fields})
        for one in converter.events(sent.topic, message, sent.receive):
            estimates += pipe.receive(one)
    estimates += pipe.finish()
    event(f'{10 ** len(str(len(estimates))) // 10} estimates or more')
    for number, estimate in enumerate(estimates):
        for output in outputs.messages(estimate):
            if number % 20 and number != len(estimates) - 1:
                continue  # this takes longer than all else
            message_of(output)
        assert all(math.isfinite(x) for dof in estimate.dofs for x in dof.parameters)


def run(*arguments: object) -> tuple[int, str]:
    """Run the command; return its exit code and what it says on stderr."""
    signal.alarm(PATIENCE)
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        code = main([str(argument) for argument in arguments])
    signal.alarm(0)
    return code, said.getvalue()


def assert_orderly(code: int, said: str) -> None:
    """Accept success, or one line that says what is wrong."""
    assert code in (0, 1, 2)
    assert 'Traceback' not in said
    if code:
        last = said.splitlines()[-1]
        assert last.startswith('rovid replay: ')
        assert len(last) > len('rovid replay: ')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('fuzz')


@pytest.fixture(scope='module')
def parameters(folder: Path) -> Path:
    return write_yaml(folder / 'logged.yaml', LOGGED)


def write_yaml(path: Path, values: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    return path


class Logs(dict[str, bytes]):
    """Good logs by name; what hypothesis prints of them is short."""

    def __repr__(self) -> str:
        """Return the names."""
        return str(sorted(self))


@pytest.fixture(scope='module')
def logs(folder: Path) -> Logs:
    """Return the bytes of good logs, by the ends of their names."""
    recorded = list(recorded_logs.messages(80, size=3))
    recorded_logs.write_mcap(folder / 'plain.mcap', recorded, compression='', chunk=1000)
    recorded_logs.write_mcap(folder / 'zstd.mcap', recorded, chunk=1000)
    recorded_logs.write_mcap(folder / 'open.mcap', recorded, chunked=False, summary=False)
    recorded_logs.write_old_sqlite(folder / 'old.db3', recorded).close()
    recorded_logs.write_bag(folder / 'plain.bag', recorded)
    return Logs({name: (folder / name).read_bytes() for name in (
        'plain.mcap', 'zstd.mcap', 'open.mcap', 'old.db3', 'plain.bag')})


def mutated(draws: st.DataObject, good: bytes) -> bytes:
    """Return bytes with some damage: cut, flipped, repeated, other numbers in them."""
    damaged = bytearray(good)
    for _ in range(draws.draw(st.integers(1, 6))):
        place = draws.draw(st.integers(0, max(len(damaged) - 1, 0)))
        kind = draws.draw(st.sampled_from(['byte', 'length', 'cut', 'out', 'twice', 'noise']))
        if kind == 'byte':
            damaged[place:place + 1] = draws.draw(st.binary(min_size=1, max_size=1))
        elif kind == 'length':
            large = draws.draw(st.sampled_from([0, 1, 2**31 - 1, 2**32 - 1, 2**63, 2**64 - 1]))
            damaged[place:place + 8] = struct.pack('<Q', large)
        elif kind == 'cut':
            del damaged[place:]
        elif kind == 'out':
            del damaged[place:place + draws.draw(st.integers(1, 200))]
        elif kind == 'twice':
            damaged[place:place] = damaged[place:place + draws.draw(st.integers(1, 200))]
        else:
            damaged[place:place] = draws.draw(st.binary(max_size=30))
    return bytes(damaged)


def test_the_good_logs_are_good(logs: Logs, parameters: Path, folder: Path) -> None:
    for name in logs:
        code, said = run('replay', folder / name, '--params-file', parameters)
        assert code == 0, said


@many
@given(end=st.sampled_from(['mcap', 'db3', 'bag']), content=st.binary(max_size=300))
def test_any_bytes_as_a_log(end: str, content: bytes, parameters: Path, folder: Path) -> None:
    start = {'mcap': b'\x89MCAP0\r\n', 'db3': b'SQLite format 3\0', 'bag': b'#ROSBAG V2.0\n'}[end]
    path = folder / f'any.{end}'
    for data in (content, start + content):
        path.write_bytes(data)
        code, said = run('replay', path, '--params-file', parameters)
        assert code == 1
        assert_orderly(code, said)


@many
@given(draws=st.data())
def test_any_damage_to_a_log(draws: st.DataObject, logs: Logs, parameters: Path,
                             folder: Path) -> None:
    name = draws.draw(st.sampled_from(sorted(logs)))
    path = folder / f'damaged{Path(name).suffix}'
    path.write_bytes(mutated(draws, logs[name]))
    assert_orderly(*run('replay', path, '--params-file', parameters))


@many
@given(content=st.one_of(st.binary(max_size=300), st.text(max_size=300).map(str.encode)))
def test_any_bytes_as_a_parameter_file(content: bytes, logs: Logs,
                                       folder: Path) -> None:
    path = folder / 'any.yaml'
    path.write_bytes(content)
    code, said = run('replay', folder / 'zstd.mcap', '--params-file', path)
    assert code == 1
    assert_orderly(code, said)


WORDS = st.sampled_from([
    'nan', '.nan', '.inf', '-.inf', '1e999', '-1', '0', '1', '1e308', '5e-324', '9' * 20, 'true',
    'no', 'null', '~', "''", '""', '[]', '{}', '[1.0]', '[1, a]', '[[1]]', '{a: b}', '&a 1',
    '*a', '!!python/object:os.system x', '<<: *a', '# x', '---', '...', '\t', ': :', '- -', '%x',
    'surge', 'roll', 'ekf', 'aid', 'linear', '/x', 'point.x', 'a[0]', 'a[', '/**',
    '\x00', 'é', '\\'])


@many
@given(draws=st.data())
def test_any_damage_to_a_parameter_file(draws: st.DataObject, repository: Path,
                                        logs: Logs, parameters: Path,
                                        folder: Path) -> None:
    good = draws.draw(st.sampled_from([
        parameters, repository / 'config' / 'jhurov.yaml',
        repository / 'config' / 'bluerov2_tank.yaml']))
    path = folder / 'damaged.yaml'
    if draws.draw(st.booleans()):
        path.write_bytes(mutated(draws, good.read_bytes()))
    else:
        lines = good.read_text().splitlines()
        for _ in range(draws.draw(st.integers(1, 4))):
            place = draws.draw(st.integers(0, len(lines) - 1))
            key, colon, _ = lines[place].partition(':')
            lines[place] = f'{key}{colon} {draws.draw(WORDS)}'
        path.write_text('\n'.join(lines))
    assert_orderly(*run('replay', folder / 'zstd.mcap', '--params-file', path))
