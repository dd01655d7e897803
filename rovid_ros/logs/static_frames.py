"""Where sensors are in the body, from the static transforms of tf2, as in a log, not from YAML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import json
from pathlib import Path
from typing import Any

from rovid_core.model.dofs import Quaternion, Vector
from rovid_core.settings.run import Settings, SettingsError
from rovid_core.velocity.attitude_history import (
    angles_of,
    normalised,
    product,
    rotate,
    rotate_back,
)
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log, RECORD

TOPIC = '/tf_static'
TYPE = 'tf2_msgs/msg/TFMessage'
FOUND = 'found'  # in the metadata of a record: what the node found in TOPIC, as JSON by key
# the keys that the ``sensor_frame`` of their input stands for
KEYS = ('position.lever_arm', 'attitude.mounting', 'angular_velocity.mounting',
        'velocity.mounting', 'velocity.lever_arm')

_IDENTITY: tuple[Vector, Quaternion] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def wanted_frames(settings: Settings) -> dict[str, str]:
    """
    Return the keys whose values are to be looked up, each with the frame of its sensor.

    A value that was given wins, so that what was looked up once can be written down.
    """
    found = {}
    for key in KEYS:
        name, _, value = key.partition('.')
        one = settings.input(name)
        # that of a DVL is of no use without a gyro
        if key == 'velocity.lever_arm' and not settings.angular_velocity.topic:
            continue
        if one.topic and one.sensor_frame and not any(
                one.lever_arm if value == 'lever_arm' else one.mounting):
            found[key] = one.sensor_frame
    return found


class StaticFrames:
    """A tree of frames, from messages of ``/tf_static``."""

    def __init__(self) -> None:
        # by frame, the one that it hangs on, and where it is there
        self._parents: dict[str, tuple[str, tuple[Vector, Quaternion]]] = {}

    def add(self, message: Any) -> None:
        """Add a TFMessage, of rclpy or decoded from a log; what is no transform is left out."""
        for one in message.transforms:
            t, q = one.transform.translation, one.transform.rotation
            try:
                turn = normalised((q.x, q.y, q.z, q.w))
            except ValueError:
                continue
            self._parents[_name(one.child_frame_id)] = (
                _name(one.header.frame_id), ((t.x, t.y, t.z), turn))

    def knows(self, wanted: Iterable[str], base: str) -> bool:
        """Tell whether the frames of some sensors all hang together with that of the body."""
        return all(self._between(base, frame) for frame in wanted)

    def values(self, wanted: Mapping[str, str], base: str, where: str) -> dict[str, list[float]]:
        """
        Return the values of the keys of ``wanted_frames``: lever arms [m], or angles [rad].

        Raises SettingsError for a frame that does not hang together with ``base``; ``where`` says
        where that was looked for.
        """
        values = {}
        for key, frame in wanted.items():
            found = self._between(base, frame)
            if found is None:
                names = sorted({*self._parents, *(parent for parent, _ in self._parents.values())})
                raise SettingsError(
                    f'{key.partition(".")[0]}.sensor_frame', f'{where}: no static transform from '
                    f'{base} (base_frame) to {frame}; {TOPIC} has '
                    f'{", ".join(names) or "nothing"}; publish it, or give {key}')
            offset, turn = found
            values[key] = list(offset if key.endswith('.lever_arm') else angles_of(turn))
        return values

    def _between(self, base: str, frame: str) -> tuple[Vector, Quaternion] | None:
        """Return where a frame is in that of the body; None if they do not hang together."""
        one, other = self._in_root(_name(base)), self._in_root(_name(frame))
        if one is None or other is None or one[0] != other[0]:
            return None
        (b, p), (f, q) = one[1], other[1]
        x, y, z, w = p
        return (rotate_back(p, (f[0] - b[0], f[1] - b[1], f[2] - b[2])),
                product((-x, -y, -z, w), q))

    def _in_root(self, frame: str) -> tuple[str, tuple[Vector, Quaternion]] | None:
        """Return the frame that one hangs on in the end, and where it is there; None of none."""
        (x, y, z), turn = _IDENTITY
        for _ in range(len(self._parents) + 1):
            if frame not in self._parents:
                return frame, ((x, y, z), turn)
            frame, (offset, rotation) = self._parents[frame]
            a, b, c = rotate(rotation, (x, y, z))
            x, y, z = a + offset[0], b + offset[1], c + offset[2]
            turn = product(rotation, turn)
        return None  # they hang on each other in a circle


def _name(frame: str) -> str:
    return frame.lstrip('/')  # ROS 1 had one in front


def values_in_logs(settings: Settings, logs: Sequence[Path]) -> dict[str, Any]:
    """
    Return the values of ``wanted_frames`` by key, from the first of the logs that have them.

    Nothing is read where nothing is wanted. Raises SettingsError if they are not there, and
    LogError if a log cannot be read.
    """
    wanted = wanted_frames(settings)
    frames = StaticFrames()
    broken: LogError | None = None
    for path in logs if wanted else ():
        try:
            found = _read(path, frames)
        except LogError as error:  # one of many dives is told later, when it is its turn
            broken = broken or error
            continue
        if wanted.keys() <= found.keys():
            return {key: found[key] for key in wanted}
        if frames.knows(wanted.values(), settings.base_frame):
            break
    else:
        if broken:
            raise broken
    names = f'{logs[0]} and {len(logs) - 1} more' if len(logs) > 1 else ''.join(map(str, logs))
    return frames.values(wanted, settings.base_frame, names)


def _read(path: Path, frames: StaticFrames) -> dict[str, Any]:
    """Add the transforms in a log; return the values that the node noted in its own record."""
    with Log([path]) as log:
        if TOPIC in log.topics and log.topics[TOPIC].type == TYPE:
            for message in log.messages([TOPIC]):
                frames.add(message.data)
        try:
            found = json.loads(log.metadata.get(RECORD, {}).get(FOUND, '{}'))
        except (ValueError, RecursionError) as error:
            raise LogError(f'{path}: what the node found in {TOPIC}: {error}') from None
    return found if isinstance(found, dict) else {}
