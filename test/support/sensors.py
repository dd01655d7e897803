"""The messages of a simulated vehicle one after the other, without a file, and their stamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
import struct
from typing import Any

from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_ros.commands.simulate import EPOCH
from rovid_ros.messages.simulated_messages import SensorMessage, SensorMessages
from rovid_ros.messages.types import build, standard_types

STAMP = struct.Struct('<iI')
AFTER_ENCAPSULATION = 4
"""Where in the bytes of a message that begins with a header its stamp is."""


def at_rates(settings: Settings, **rates: float) -> Settings:
    """Return settings with other simulated rates [Hz], by input."""
    return replace(settings, simulation=replace(
        settings.simulation, **{f'{name}_rate': rate for name, rate in rates.items()}))


def times_faster(settings: Settings, factor: float) -> Settings:
    """Return settings with all simulated rates higher."""
    simulation = settings.simulation
    return at_rates(settings, **{name: factor * getattr(simulation, f'{name}_rate') for name in (
        'position', 'depth', 'attitude', 'angular_velocity', 'velocity', 'thruster')})


def sensed(settings: Settings, duration: float, seed: int = 1) -> Iterator[SensorMessage]:
    """Yield what the sensors of the simulated vehicle send in a time [s], in order."""
    sensors = SensorMessages(settings)
    for time, group in groupby(simulate(settings, duration, seed), key=lambda sample: sample[0]):
        yield from sensors.messages(EPOCH + time, {name: value for _, name, value in group})


def built(message: SensorMessage) -> Any:
    """Return a message as a log would give it."""
    return build(standard_types(), message.type, message.fields)


def encoded(message: SensorMessage) -> bytearray:
    """Return a message as it is on the wire."""
    return bytearray(standard_types().serialize_cdr(built(message), message.type))


def stamp(cdr: bytearray, time: int) -> None:
    """Give a message that begins with a header another stamp [ns]."""
    STAMP.pack_into(cdr, AFTER_ENCAPSULATION, *divmod(time, 1_000_000_000))


def stamp_of(cdr: bytes) -> int:
    """Return the stamp [ns] of a message that begins with a header."""
    seconds, nanoseconds = STAMP.unpack_from(cdr, AFTER_ENCAPSULATION)
    return int(seconds * 1_000_000_000 + nanoseconds)
