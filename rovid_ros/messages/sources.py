"""What is read from which topic, and by which field path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rovid_core.settings.run import INPUTS, Settings, SettingsError
from rovid_ros.messages.field_paths import nearest
from rovid_ros.messages.types import standard_types


@dataclass(frozen=True, slots=True)
class Source:
    """Where an input's samples come from; one topic of several is a ``part``."""

    input: str
    topic: str
    type: str
    field: str
    stamp: str
    latency: int  # [ns]
    part: int

    @property
    def key(self) -> str:
        """Return the section of the parameter file."""
        return 'thrusters.sign' if self.input == 'sign' else self.input


def sources(settings: Settings) -> list[Source]:
    """Return what to read, in the order of INPUTS."""
    found = []
    for name in INPUTS:
        if name not in settings.used_inputs():
            continue
        if name == 'thrusters':
            given: Any = settings.thrusters
            topics = settings.thrusters.topics
        else:
            given = settings.input(name)
            topics = (given.topic,)
        for part, topic in enumerate(topics):
            found.append(Source(
                name, topic, given.type, given.field, given.stamp,
                round(given.latency * 1e9), part))
    return found


def conflict(one: Source, other: Source) -> SettingsError:
    """Return the error for two types of one topic; one that ROS does not know is at fault."""
    types = standard_types().fielddefs
    if other.type not in types and one.type in types:
        one, other = other, one
    hint = '' if one.type in types else nearest(one.type, [other.type, *types])
    return SettingsError(
        f'{one.key}.type', f'is {one.type}, but {other.key}.type reads {one.topic} as '
                           f'{other.type}{hint}')
