"""What the live tests share: a vehicle, its messages, the node's process and its peer."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from mcap.reader import make_reader
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rovid_core.settings import Settings
from rovid_core.stream import Stream
from rovid_core.values import Estimate
from rovid_ros.convert import Converter
from rovid_ros.node_messages import import_type
from rovid_ros.node_publishers import reliable
from rovid_ros.outputs import Outputs
from rovid_ros.parameters import settings_from
from rovid_ros.simulate import simulate_log
import yaml

PATIENCE = 20.0
"""[s] Discovery takes up to 3 s, more on a busy machine."""

VALUES: dict[str, Any] = {
    'dofs': ['surge', 'heave', 'yaw'],
    'max_wait': 60.0,  # no order of delivery is too late
    'position.topic': '/position',
    'position.type': 'geometry_msgs/msg/PointStamped',
    'position.field': 'point',
    'position.qos': 'reliable',
    'depth.topic': '/depth',
    'depth.type': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    'depth.field': 'pose.pose.position.z',
    'depth.qos': 'reliable',
    'attitude.topic': '/imu',
    'attitude.type': 'sensor_msgs/msg/Imu',
    'attitude.field': 'orientation',
    'attitude.qos': 'reliable',
    'thrusters.topic': '/current',
    'thrusters.type': 'sensor_msgs/msg/JointState',
    'thrusters.field': 'effort',
    'thrusters.names': ['starboard', 'port', 'vertical'],
    'thrusters.gain': [40.0, 40.0, 55.0],
    'thrusters.qos': 'reliable',
    'thrusters.allocation': [
        1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25, -0.25, 0.0],
    'surge.initial.mass': 290.0,
    'surge.initial.quadratic_drag': 200.0,
    'heave.initial.mass': 400.0,
    'heave.initial.quadratic_drag': 300.0,
    'yaw.initial.mass': 60.0,
    'yaw.initial.quadratic_drag': 40.0,
    'simulation.surge.mass': 305.0,
    'simulation.surge.quadratic_drag': 265.0,
    'simulation.surge.forces': [120.0, 50.0],
    'simulation.surge.frequencies': [0.05, 0.13],
    'simulation.heave.mass': 380.0,
    'simulation.heave.quadratic_drag': 350.0,
    'simulation.heave.forces': [60.0],
    'simulation.heave.frequencies': [0.07],
    'simulation.yaw.mass': 50.0,
    'simulation.yaw.quadratic_drag': 45.0,
    'simulation.yaw.forces': [8.0],
    'simulation.yaw.frequencies': [0.06],
}
TYPES = {VALUES[f'{name}.topic']: VALUES[f'{name}.type']
         for name in ('position', 'depth', 'attitude', 'thrusters')}

Status = tuple[str, int, str, dict[str, str]]


@dataclass(frozen=True)
class Raw:
    """A message as it is on the wire."""

    topic: str
    type: str
    cdr: bytes
    time: int


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """Return ``VALUES`` with changes; None leaves a key out."""
    return {key: value for key, value in {**VALUES, **changes}.items() if value is not None}


def write_parameters(path: Path, values: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    return path


def simulated(path: Path, duration: float = 12.0) -> list[Raw]:
    """Return the messages of a simulated run, in order."""
    simulate_log(settings_from(VALUES), path, duration, seed=1)
    with path.open('rb') as file:
        return [Raw(channel.topic, schema.name, message.data, message.log_time)
                for schema, channel, message in make_reader(file).iter_messages() if schema]


def replayed(settings: Settings, messages: Iterable[Raw]) -> list[Estimate]:
    """Return what the pipe alone makes of the messages."""
    stream = Stream(settings)
    converter = Converter(settings, stream.reject)
    estimates = []
    for raw in messages:
        message = deserialize_message(raw.cdr, import_type(raw.type))
        for event in converter.events(raw.topic, message, raw.time):
            estimates += stream.receive(event)
    return estimates + stream.finish()


def told(settings: Settings, estimates: Iterable[Estimate]) -> list[list[Status]]:
    """Return the statuses that ``rov/estimate`` has to carry for the estimates."""
    outputs = Outputs(settings)
    return [[(status['name'], status['level'], status['message'],
              {entry['key']: entry['value'] for entry in status['values']})
             for status in outputs.messages(estimate)[-1].fields['status']]
            for estimate in estimates]


def heard(messages: Iterable[Any]) -> list[list[Status]]:
    """Return the statuses of messages, of rclpy or out of a log."""
    return [[(status.name, level(status.level), status.message,
              {entry.key: entry.value for entry in status.values})
             for status in message.status] for message in messages]


def level(value: Any) -> int:
    return value[0] if isinstance(value, bytes) else value


class Peer:
    """The rest of the vehicle: publishes sensors, listens to the node, calls services."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('peer')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}

    def listen(self, topic: str, type_name: str, qos: QoSProfile | None = None) -> list[Any]:
        """Subscribe; the list grows with what comes."""
        messages: list[Any] = []
        self.node.create_subscription(
            import_type(type_name), topic, messages.append, qos or reliable(10_000))
        return messages

    def advertise(self, types: Mapping[str, str], qos: QoSProfile | None = None) -> None:
        """Make the publishers and wait until each has found the node."""
        for topic, type_name in types.items():
            self._publishers[topic] = self.node.create_publisher(
                import_type(type_name), topic, qos or reliable(10_000))
        self.until(lambda: all(
            p.get_subscription_count() for p in self._publishers.values()))
        self.spin(0.5)  # the other side matches a little later

    def publish(self, messages: Iterable[Raw]) -> None:
        for raw in messages:
            self.send(raw.topic, raw.cdr)

    def send(self, topic: str, message: Any) -> None:
        """Publish one message, an object or its bytes."""
        self._publishers[topic].publish(message)

    def call(self, service: type[Any], name: str, request: Any = None) -> Any:
        client = self.node.create_client(service, name)
        self.until(client.service_is_ready)
        future = client.call_async(request or service.Request())
        self.until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def until(self, condition: Callable[[], Any], timeout: float = PATIENCE) -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, 'waited in vain'
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, duration: float) -> None:
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def settle(self, messages: list[Any], least: int = 0) -> None:
        """Spin until there are ``least`` messages and nothing more comes."""
        self.until(lambda: len(messages) >= least)
        count = -1
        while count != len(messages):
            count = len(messages)
            self.spin(0.3)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()


class NodeProcess:
    """The node as its own process."""

    def __init__(self, arguments: Sequence[str | Path], environment: dict[str, str],
                 folder: Path, repository: Path) -> None:
        self._stderr = folder / 'stderr'
        with self._stderr.open('w') as stderr:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'rovid_ros.node', *map(str, arguments)],
                env=environment, cwd=repository, stdout=stderr, stderr=stderr)

    @property
    def output(self) -> str:
        return self._stderr.read_text()

    def wait(self) -> int:
        return self.process.wait(PATIENCE)

    def stop(self, *signals: int) -> int:
        """Send the signals, one right after the other, and return the exit code."""
        for number in signals or (signal.SIGINT,):
            self.process.send_signal(number)
            time.sleep(0.02)
        return self.wait()

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
