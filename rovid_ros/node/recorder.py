"""The node's own log: every message that was consumed, in the order of its release."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
import json
import math
from pathlib import Path
from threading import Thread
import time
from typing import Any

from rovid_core.model.samples import Event
from rovid_ros import __version__
from rovid_ros.files.whole_files import create_unused, prepare_file, sync_folder
from rovid_ros.logs.container import LogError
from rovid_ros.logs.player import CONTROL
from rovid_ros.logs.static_frames import FOUND
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

    An existing file is kept, and the next free ``name-1.mcap`` taken; so it is when a file has
    become as large or as long as it may. Each of these parts can be replayed alone, from the
    state in it, and all of them as one. Raises SettingsError if the file could not be written.

    Parameters
    ----------
    path : Path
        The file.
    definition : callable
        Returns the definition of a message type.
    failed : callable
        Gets a line about what could not be written.
    state : callable
        Returns the state of the stream, for the beginning of a part.
    opened : callable
        Gets a line about each part that is begun.
    max_size, max_duration : float
        Of a part [bytes and s]; 0: any. A part has at least as much of messages as of the state
        that it begins with.
    found : mapping
        What was looked up in /tf_static, by key, which a replay needs as well.

    """

    def __init__(self, path: Path, definition: Callable[[str], str],
                 failed: Callable[[str], object],
                 state: Callable[[], Mapping[str, Any]] = dict, *,
                 opened: Callable[[str], object] = lambda line: None,
                 max_size: float = 0.0, max_duration: float = 0.0,
                 found: Mapping[str, Any] | None = None) -> None:
        prepare_file('record.path', path)
        self.path = self._first_path = path
        self._definition = definition
        self._failed = failed
        self._state = state
        self._opened = opened
        self._found = found
        self._max_size = max_size or math.inf
        self._max_duration = max_duration * 1e9 or math.inf
        self._writer: LogWriter | None = None
        self._syncing: Thread | None = None
        self._times: tuple[int, int] | None = None  # log and publish time of the newest message
        self._early: list[tuple[str, str]] = []  # controls before the first one
        self._run = str(time.time_ns())  # tells the parts of this record from others
        self._part = 0
        self._begins_at = 0  # [bytes] where the messages of a part begin
        self._since: int | None = None  # [ns] receive time of the first message of a part

    def open(self, restored: Mapping[str, Any] | None) -> None:
        """Make the file, with the state that the stream goes on from, which a replay needs."""
        made: Path | None = None
        try:
            made = self.path = create_unused(self._first_path)
            self._begin_part(restored)
        except (OSError, LogError) as error:
            self._writer = None
            self._failed(f'recording to {self._first_path} ended: {error}')
            with suppress(OSError):
                if made and not made.stat().st_size:  # as on a disk that is full
                    made.unlink()
        else:
            self._opened(f'recording to {self.path}')

    def _begin_part(self, restored: Mapping[str, Any] | None) -> None:
        self._writer = writer = LogWriter(self.path)
        sync_folder(self.path.parent)  # the new name, too, has to outlast a loss of power
        values = {'version': __version__, 'run': self._run, 'part': str(self._part)}
        if self._found:
            values[FOUND] = json.dumps(self._found)
        if restored is not None:
            values['state'] = json.dumps(restored)
        writer.metadata('rovid_record', values)
        writer.flush()  # what is wrong with the disk shows now
        self._begins_at = writer.size

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
        self._split_when_due(received.time)
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
            self._begin(self._writer.sync)

    def close(self) -> None:
        """End the log properly."""
        self.flush()
        if self._syncing:
            self._syncing.join()
        self._write(lambda writer: writer.close())
        self._writer = None

    def _split_when_due(self, now: int) -> None:
        """Go on in another file before a message, if the one so far is large or long enough."""
        if self._since is None:
            self._since = now
        writer = self._writer
        largest = max(self._max_size, 2 * self._begins_at)
        if writer is None or (
                writer.size < largest and now - self._since < self._max_duration):
            return
        before = self._syncing

        def end() -> None:
            if before:
                before.join()
            self._attempt(writer, lambda writer: writer.close(synced=True))

        self._part += 1
        self._since = now
        self._begin(end)
        self.open(self._state())

    def _begin(self, work: Callable[[], None]) -> None:
        self._syncing = Thread(target=work, daemon=True)
        self._syncing.start()

    def _write(self, action: Callable[[LogWriter], object]) -> None:
        if self._writer is not None and not self._attempt(self._writer, action):
            self._writer = None

    def _attempt(self, writer: LogWriter, action: Callable[[LogWriter], object]) -> bool:
        """Return whether it went well."""
        try:
            action(writer)
        except OSError as error:
            self._failed(f'recording to {writer.path} ended: {error}')
            return False
        return True
