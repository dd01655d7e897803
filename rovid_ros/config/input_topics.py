"""What is read from which topic, and which inputs a topic feeds."""

from __future__ import annotations

from dataclasses import dataclass

from rovid_core.settings.run import INPUTS, InputSettings, Settings, ThrusterSettings


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
    def section(self) -> str:
        """Return the section of the input in the parameter file."""
        return section(self.input)


def sources(settings: Settings) -> list[Source]:
    """Return what to read, in the order of INPUTS."""
    found = []
    for name in INPUTS:
        if name in settings.used_inputs():
            given = given_of(settings, name)
            found += [
                Source(name, topic, given.type, given.field, given.stamp,
                       round(given.latency * 1e9), part)
                for part, topic in enumerate(topics_of(settings, name))]
    return found


def given_of(settings: Settings, name: str) -> InputSettings | ThrusterSettings:
    """Return what is given of an input; both kinds say type, field, stamp, latency and QoS."""
    return settings.thrusters if name == 'thrusters' else settings.input(name)


def topics_of(settings: Settings, name: str) -> tuple[str, ...]:
    """Return the topics of an input: one, or one per thruster."""
    return settings.thrusters.topics if name == 'thrusters' else (settings.input(name).topic,)


def inputs_of(settings: Settings, topic: str) -> list[str]:
    """Return the inputs that a topic feeds."""
    return [name for name in settings.used_inputs() if topic in topics_of(settings, name)]


def section(name: str) -> str:
    """Return the section of an input in the parameter file."""
    return 'thrusters.sign' if name == 'sign' else name
