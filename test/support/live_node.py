"""What the live tests share: a vehicle, its messages, the node's process and its peer."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from rovid_core.identify.estimate import Estimate
from rovid_core.model.samples import Event
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameters import settings_from
from rovid_ros.messages.converter import Converter
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.results.outputs import Outputs

from test.support.live import heard, level, Peer, Raw, Status, write_parameters
from test.support.outputs import fields_of
from test.support.processes import NodeProcess, PATIENCE

__all__ = ['changed', 'heard', 'level', 'NodeProcess', 'PATIENCE', 'Peer', 'Raw', 'replayed',
           'simulated', 'Status', 'told', 'TYPES', 'VALUES',
           'WatchedStream', 'write_parameters']

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


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """Return ``VALUES`` with changes; None leaves a key out."""
    return {key: value for key, value in {**VALUES, **changes}.items() if value is not None}


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
             for status in fields_of(outputs.messages(estimate)[-1])['status']]
            for estimate in estimates]


class WatchedStream:
    """A stream for which something else receives; in compiled code no method can be replaced."""

    def __init__(self, stream: Stream, receive: Callable[[Event], list[Estimate]]) -> None:
        self._stream = stream
        self.receive = receive

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
