"""The static transforms of tf2 in logs: where the sensors of a dive were."""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log, RECORD
from rovid_ros.messages.static_frames import StaticFrames, TOPIC, TYPE, wanted_frames

FOUND = 'found'  # in the metadata of a record: what the node found in /tf_static, as JSON by key


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
