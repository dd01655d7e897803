"""Logs in MCAP, as rosbag2 writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import BufferedWriter, FileIO
import os
from pathlib import Path
from typing import Any

from rovid_ros.files.whole_files import sync_folder
from rovid_ros.logs.container import LogError
from rovid_ros.logs.mcap_writer import McapWriter
from rovid_ros.messages.types import build, standard_types, TypeUnknownError

_CHUNK = 768 * 1024  # [bytes], as rosbag2
_FOREVER = 'sec: 9223372036\n    nsec: 854775807'
_QOS = """\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline:
    {forever}
  lifespan:
    {forever}
  liveliness: 1
  liveliness_lease_duration:
    {forever}
  avoid_ros_namespace_conventions: false"""
# As rosbag2 of every ROS 2 reads it: keep last, reliable, and (2) volatile or (1) transient local
_OFFERED = {
    False: _QOS.format(depth=10, durability=2, forever=_FOREVER),
    True: _QOS.format(depth=1, durability=1, forever=_FOREVER)}


class _File(FileIO):
    """A file whose errors say which file it is."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.name)) from None


class LogWriter:
    """
    Writes messages to an MCAP file.

    What was written before the last ``flush`` can be read also when the process is killed. A file
    that is there is replaced.

    Raises
    ------
    LogError
        If the file cannot be written.
    OSError
        By any method, with the name of the file: if it cannot be written any more.

    """

    def __init__(self, path: Path) -> None:
        try:
            self.path = path
            self._file = BufferedWriter(_File(path, 'wb'))
        except OSError as error:
            raise LogError(f'{path}: cannot be written: {error.strerror}') from None
        self._writer = McapWriter(self._file, _CHUNK)
        self._schemas: dict[tuple[str, str | None], int] = {}
        self._channels: dict[tuple[str, int], int] = {}

    def write(self, topic: str, type: str, fields: Mapping[str, Any], time: int,
              publish_time: int | None = None, latched: bool = False) -> None:
        """
        Write a message of a type that comes with ROS 2.

        Parameters
        ----------
        topic, type : str
            Such as /rov/velocity and geometry_msgs/msg/TwistStamped.
        fields : mapping
            As in ``messages.types.build``.
        time, publish_time : int
            Log time [ns] and publish time, the same unless given; a log has none before 1970.
        latched : bool
            Whether ``ros2 bag play`` keeps the topic's last message for late subscribers.

        Raises
        ------
        TypeUnknownError, FieldError
            If ROS 2 has no such type, or the type no such field.

        """
        store = standard_types()
        if type not in store.fielddefs:
            raise TypeUnknownError(f'type {type}: ROS 2 comes with no such type')
        data = store.serialize_cdr(build(store, type, fields), type)
        self.write_raw(topic, type, bytes(data), time, publish_time=publish_time, latched=latched)

    def write_raw(self, topic: str, type: str, cdr: bytes, time: int,
                  definition: str | None = None, publish_time: int | None = None,
                  latched: bool = False) -> int:
        """
        Write a message that is serialised already; return the number of its channel.

        The type's definition is needed where it does not come with ROS 2; the rest is as in
        ``write``.
        """
        schema = self._schemas.get((type, definition))
        if schema is None:
            schema = self._schemas[type, definition] = self._schema(type, definition)
        channel = self._channels.get((topic, schema))
        if channel is None:
            channel = self._writer.add_channel(
                topic, schema, {'offered_qos_profiles': _OFFERED[latched]})
            self._channels[topic, schema] = channel
        self.write_together([channel], [cdr], time, time if publish_time is None else publish_time)
        return channel

    def write_together(self, channels: Sequence[int], messages: Sequence[bytes], time: int,
                       publish_time: int) -> None:
        """Write a message for each of some channels, all with the same times, as ``write_raw``."""
        self._writer.add_messages(channels, messages, max(time, 0), max(publish_time, 0))

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, values)

    def flush(self) -> None:
        """Hand everything so far to the operating system, in a form that can be read."""
        self._writer.flush()

    def sync(self) -> None:
        """Bring what was flushed to the disk, so that it outlasts a loss of power."""
        if not self._file.closed:
            with suppress(OSError):  # what a device has no use for; a full disk shows in write
                os.fdatasync(self._file.fileno())

    @property
    def size(self) -> int:
        """Return how much has been written [bytes], without what still waits for a flush."""
        return self._file.tell()

    def close(self, synced: bool = False) -> None:
        """Write the index and close the file; ``synced``: it is on the disk then."""
        if not self._file.closed:
            try:
                self._writer.finish()
                if synced:
                    self._file.flush()
                    os.fsync(self._file.fileno())
            finally:
                self._file.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _schema(self, type: str, definition: str | None) -> int:
        if definition is None:
            store = standard_types()
            if type not in store.fielddefs:
                raise TypeUnknownError(f'type {type}: no definition of it is at hand')
            definition = store.generate_msgdef(type, ros_version=2)[0]
        return self._writer.add_schema(type, definition.encode())


class OutputLog(LogWriter):
    """
    A log that is written to ``NAME.part.mcap`` and gets its name when it is finished.

    A run that is killed or interrupted leaves what was there under the name as it was, and what
    it wrote itself beside it. A device or a pipe is written to as it is.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(os.path.realpath(path)) if path.is_symlink() else path
        self._part = unfinished(path)
        super().__init__(self._part)

    def __enter__(self) -> OutputLog:
        return self

    def finish(self) -> None:
        """Give it its name, whole and on the disk."""
        self._close()
        if self._part != self._path:
            os.replace(self._part, self._path)
            sync_folder(self._path.parent)

    def __exit__(self, *error: object) -> None:
        """Close the file; a part without a message is removed."""
        self._close()
        if self._part != self._path and not self._channels:
            self._part.unlink(missing_ok=True)

    def _close(self) -> None:
        self.close(synced=self._part != self._path)


def unfinished(path: Path) -> Path:
    """Return where an output log is written until it is finished."""
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    if place.exists() and not place.is_file():
        return place
    return place.with_name(f'{place.stem}.part{place.suffix}')
