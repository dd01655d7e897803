"""The node's own log: every message that was consumed, in the order of its release."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from threading import Thread
from typing import Any

from rovid_core.model.samples import Event
from rovid_ros import __version__
from rovid_ros.files.whole_files import create_unused, prepare_file, sync_folder
from rovid_ros.logs.player import CONTROL
from rovid_ros.logs.writer import LogWriter


@dataclass
class Received:
    """A message as it came in."""

    topic: str  # as configured, before any remapping: what a replay looks for
    type: str
    cdr: bytes  # the message as it was on the wire
    time: int  # receive time [ns]
    recorded: bool = False  # True once it is in the log: a message can give several events


class Recorder:
    """
    Writes the messages that the stream consumes.

    A file that cannot be written any more (a full disk) ends the recording, not the node. What
    was flushed outlasts the process at once and a loss of power a moment later: a thread of its
    own brings it to the disk, for on a slow card that takes longer than a message may wait.

    An existing file is kept, and the next free ``name-1.mcap`` taken. Raises SettingsError if the
    file could not be written.
    """

    def __init__(self, path: Path, definition: Callable[[str], str],
                 failed: Callable[[str], object]) -> None:
        prepare_file('record.path', path)
        self.path = path
        self._definition = definition
        self._failed = failed
        self._writer: LogWriter | None = None
        self._syncing: Thread | None = None
        self._times: tuple[int, int] | None = None  # log and publish time of the newest message
        self._early: list[tuple[str, str]] = []  # controls before the first one

    def open(self, restored: Mapping[str, Any] | None) -> None:
        """Make the file, with the state that the stream goes on from, which a replay needs."""
        self.path = create_unused(self.path)
        self._writer = LogWriter(self.path)
        sync_folder(self.path.parent)  # the new name, too, has to outlast a loss of power
        values = {'version': __version__}
        if restored is not None:
            values['state'] = json.dumps(restored)
        self._writer.metadata('rovid_record', values)

    @property
    def is_open(self) -> bool:
        """Tell whether it still records."""
        return self._writer is not None

    def released(self, event: Event) -> None:
        """Write the message that the event came from."""
        received = event.origin
        assert isinstance(received, Received)
        self._times = received.time, event.time
        for control in self._early:
            self.controlled(*control)
        self._early.clear()
        if received.recorded:
            return
        received.recorded = True
        self._write(lambda writer: writer.write_raw(
            f'/{received.topic.lstrip("/")}', received.type, received.cdr, received.time,
            self._definition(received.type), event.time))

    def controlled(self, name: str, value: str) -> None:
        """
        Write what a service call or a jump of time did to the stream.

        It gets the times of the message before it, or of the first one: the log begins there.
        """
        times = self._times
        if times is None:
            self._early.append((name, value))
            return
        text = json.dumps({'control': name, 'value': value})
        self._write(lambda writer: writer.write(
            CONTROL, 'std_msgs/msg/String', {'data': text}, *times))

    def flush(self) -> None:
        """Make what was written readable, and begin to bring it to the disk."""
        self._write(lambda writer: writer.flush())
        if self._writer and not (self._syncing and self._syncing.is_alive()):
            self._syncing = Thread(target=self._writer.sync, daemon=True)
            self._syncing.start()

    def close(self) -> None:
        """End the log properly."""
        self.flush()
        if self._syncing:
            self._syncing.join()
        self._write(lambda writer: writer.close())
        self._writer = None

    def _write(self, action: Callable[[LogWriter], None]) -> None:
        if self._writer is None:
            return
        try:
            action(self._writer)
        except OSError as error:
            self._writer = None
            self._failed(f'recording to {self.path} ended: {error}')
