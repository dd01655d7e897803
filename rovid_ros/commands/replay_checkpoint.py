"""The file that a replay goes on from: all that it has in mind, behind a certain message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import hashlib
import json
from pathlib import Path
import time
from typing import Any

from rovid_core.snapshot import Snapshots
from rovid_ros import __version__
from rovid_ros.commands.feeder import Feeder
from rovid_ros.config.fingerprint import decides_bits, difference, fingerprint
from rovid_ros.files.output_log import OutputFile
from rovid_ros.files.state_file import CheckpointError
from rovid_ros.files.whole_files import write_text
from rovid_ros.logs.identity import ends, identity, names
from rovid_ros.logs.log import Log

VERSION = 1


@dataclass
class Read:
    """
    How far a replay has come.

    Attributes
    ----------
    messages : int
        Of all logs so far.
    here : int
        Of these of the logs of this call.
    first, last : int
        When the first and the last were received [ns].
    steps : int
        Estimates so far.

    """

    messages: int = 0
    here: int = 0
    first: int = 0
    last: int = 0
    steps: int = 0


@dataclass(frozen=True)
class _Run:
    """What has to be the same for a state to fit: settings, part of the log, logs."""

    settings: Mapping[str, Any]
    part: list[float | None]
    logs: list[dict[str, Any]]


@dataclass
class ReplayCheckpoint:
    """
    The state of a replay, in a file that is whole at every moment.

    Parameters
    ----------
    path : Path
        The file. One that is there is gone on from; one that does not fit is refused, and
        stays.
    append : bool
        Whether the file may be of earlier logs that were read to their end.
    period : float
        Time between two saves [s].

    Attributes
    ----------
    earlier : list of str
        The logs that were read before those of this call.
    written : tuple of int
        Messages in the output file and their checksum, as OutputFile counts them.

    """

    path: Path
    append: bool = False
    period: float = 60.0
    earlier: list[str] = field(default_factory=list)
    written: tuple[int, int] = (0, 0)

    def begin(self, log: Log, part: tuple[float, float | None], feeder: Feeder, read: Read,
              roots: Mapping[str, object], output: Path | None) -> None:
        """
        Go on from the file, if it is there.

        Parameters
        ----------
        log : Log
            What is going to be read.
        part : tuple
            Start and duration [s] of what is asked for.
        feeder : Feeder
            What takes the messages, as it was made; its stream is part of the state.
        read : Read
            How far the replay has come; part of its state.
        roots : mapping
            The other objects that are its state, as they were made.
        output : Path or None
            The output file.

        Raises
        ------
        CheckpointError
            If the file cannot be read or does not fit; the text says in what.

        """
        self._feeder = feeder
        self._run = _Run(self._settings(), list(part), identity(log))
        self._read = read
        self._output = output is not None
        self._snapshots = Snapshots({
            'stream': feeder.stream, 'details': feeder.converter.details, 'read': read, **roots})
        self._due = time.monotonic() + self.period
        if self.path.exists():
            try:
                self._go_on(read_state(self.path), log)
            except ValueError as error:
                raise CheckpointError(f'{self.path}: {error}') from None
            except (KeyError, TypeError, RecursionError) as error:
                raise CheckpointError(
                    f'{self.path}: makes no sense: {type(error).__name__} {error}') from None
        elif self.append:
            raise CheckpointError(f'{self.path}: is not there; --append goes on from a state')

    @property
    def is_due(self) -> bool:
        """Tell whether it is time to save."""
        return time.monotonic() >= self._due

    def save(self, output: OutputFile | None, complete: bool = False) -> None:
        """
        Write the file.

        Parameters
        ----------
        output : OutputFile or None
            What has to be on the disk before.
        complete : bool
            Whether the logs have been read to their end.

        Raises
        ------
        OSError
            If that fails.

        """
        changes = self._changes()
        if changes:
            self._snapshots.learn()
        if output is not None:
            output.flush()
            output.sync()
            self.written = output.count, output.checksum
        content = {
            'rovid_replay': VERSION, 'version': __version__, 'settings': self._run.settings,
            'part': self._run.part, 'logs': self._run.logs, 'earlier': self.earlier,
            'last': self._read.last, 'complete': complete, 'changes': changes,
            'output': [*self.written] if self._output else None,
            'state': self._snapshots.take()}
        lines = [f'{json.dumps(key)}: {json.dumps(value, allow_nan=False)}'
                 for key, value in content.items()]
        lines.append(f'"sha256": "{_digest(content)}"')
        write_text(self.path, '{\n' + ',\n'.join(lines) + '\n}\n')
        self._due = time.monotonic() + self.period

    def _go_on(self, content: Mapping[str, Any], log: Log) -> None:
        differs = difference(content['settings'], self._run.settings)
        if differs:
            raise CheckpointError(differs)
        is_same = content['part'] == self._run.part and ends(content['logs']) == ends(
            self._run.logs)
        if not is_same:
            self._check_append(content, log)
        elif self._output and content['output'] is None:
            raise CheckpointError('was made without --output, which would lack its beginning')
        earlier = [*content['earlier']]
        count, checksum = map(int, content['output'] or (0, 0))
        if content['changes']:  # that a control in the log made
            self._feeder.control('parameters', json.dumps(content['changes']))
            self._snapshots.learn()
        self._snapshots.put_back(content['state'])
        if is_same:
            self.earlier, self.written = earlier, (count, checksum)
        else:
            self.earlier = [*earlier, *(one['path'] for one in content['logs'])]
            self._read.here = 0

    def _settings(self) -> dict[str, Any]:
        return fingerprint(self._feeder.stream.settings, decides_bits)

    def _changes(self) -> dict[str, Any]:
        """Return what the settings have become, by key, where it is not as at first."""
        return {key: value for key, value in self._settings().items()
                if value != self._run.settings.get(key)}

    def _check_append(self, content: Mapping[str, Any], log: Log) -> None:
        """Refuse a state of other logs that cannot be gone on from with these."""
        theirs, mine = names(content['logs']), names(self._run.logs)
        if not self.append:
            what = (f'start and duration {content["part"]}, not {self._run.part}'
                    if ends(content['logs']) == ends(self._run.logs)
                    else f'{theirs}, not of {mine} as it is')
            raise CheckpointError(f'is of {what}; --append goes on with a further log')
        if not content['complete']:
            raise CheckpointError(f'{theirs} has not been read to its end')
        if log.start < content['last']:
            raise CheckpointError(f'{mine} begins before the end of {theirs}')


def read_state(path: Path) -> dict[str, Any]:
    """Return what a state file holds; raises ValueError if it is not whole or of another kind."""
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise CheckpointError(error.strerror or str(error)) from None
    if not isinstance(content, dict) or 'rovid_replay' not in content:
        raise CheckpointError('is not the state of a replay')
    versions = content['rovid_replay'], content.get('version')
    if versions != (VERSION, __version__):
        raise CheckpointError(f'was written by version {versions[1]} ({versions[0]}), this is '
                              f'{__version__} ({VERSION})')
    if content.pop('sha256', None) != _digest(content):
        raise CheckpointError('is damaged')
    return content


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()
