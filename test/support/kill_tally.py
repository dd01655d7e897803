"""What a series of kills has shown, and what the runs that are killed are given."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rovid_ros.logs.container import LogError, MALFORMED
from rovid_ros.logs.log import Log

from test.support.processes import child_environment, REPOSITORY
from test.support.trials import CONFIG


@dataclass
class Tally:
    """What a series of kills has shown."""

    kills: int = 0
    states: int = 0  # that were there after a kill, and loaded
    logs: int = 0  # that were there after a kill, and opened
    messages: int = 0  # in them
    finished: int = 0  # runs between the kills that came to their end
    lost: float = 0.0  # longest time [s] that a log lacked at its end
    leftovers: int = 0  # temporary files, at most at one time
    faults: list[str] = field(default_factory=list)

    def check(self, sound: object, fault: str) -> None:
        """Note a fault of the last kill if something is not as it has to be."""
        if not sound:
            self.faults.append(f'kill {self.kills}: {fault}')

    def opened(self, path: Path, least: int) -> list[int]:
        """Return the log times of what our reader finds in a log; mcap's must find it too."""
        times: list[int] = []
        try:
            with Log([path]) as log:
                times = [message.time for message in log.raw(log.topics)]
        except LogError as error:  # before anything was flushed there is nothing to read
            self.check(not least and 'cut off before' in str(error) or 'is empty' in str(error),
                       str(error))
        self.check(len(times) >= least, f'{path.name}: {len(times)} messages, {least} flushed')
        streamed = 0
        with path.open('rb') as file:
            try:
                for record in StreamReader(file).records:
                    streamed += isinstance(record, Message)
            except (McapError, *MALFORMED):
                pass  # the cut
        # ours takes what there is of the chunk at the cut as well
        self.check(least <= streamed <= len(times), f'{path.name}: mcap reads {streamed} messages')
        self.logs += 1
        self.messages += len(times)
        return times


def environment() -> dict[str, str]:
    """Return the environment of the runs."""
    return {**child_environment(), 'PYTHONPATH': str(REPOSITORY), 'OPENBLAS_NUM_THREADS': '1'}


def configured(path: Path, **changes: str) -> Path:
    """Write a copy of the simulated vehicle's parameter file with some text replaced."""
    text = (CONFIG / 'jhurov.yaml').read_text()
    for old, new in {'period: 60.0': 'period: 0.1', **changes}.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)
    return path
