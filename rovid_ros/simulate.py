"""``rovid simulate``: the log of a vehicle whose parameters are known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import difflib
import heapq
from itertools import chain, groupby
import math
from pathlib import Path
import re
import struct

from rovid_core.dofs import DOFS, PARAMETERS, PHYSICAL
from rovid_core.plant import lumped
from rovid_core.settings import Settings, SimulatedDof
from rovid_core.simulator import simulate
from rovid_ros.interrupt import Interrupt, Interrupted
from rovid_ros.log_writer import LogWriter
from rovid_ros.progress import Progress
from rovid_ros.sensor_messages import SensorMessage, SensorMessages, SimulationError

EPOCH = 1_700_000_000 * 1_000_000_000
"""When every simulation begins [ns]: fixed, so that the same seed gives the same file."""

Profile = Mapping[str, tuple[tuple[float, float], ...]]


class ProfileError(ValueError):
    """A thrust profile that cannot be read; the text says what and where."""


def parse_profile(text: str) -> Profile:
    """
    Read a thrust profile.

    Parameters
    ----------
    text : str
        Sinusoids per DOF, amplitude [N or N m] @ frequency [Hz], such as
        ``surge=120@0.083+60@0.04,yaw=20@0.05``.

    Returns
    -------
    profile : mapping of str to tuple of (amplitude, frequency)

    Raises
    ------
    ProfileError
        Says which part it does not understand.

    """
    profile: dict[str, tuple[tuple[float, float], ...]] = {}
    for part in text.split(','):
        dof, equals, waves = (piece.strip() for piece in part.partition('='))
        if dof not in DOFS:
            near = difflib.get_close_matches(dof, DOFS, 1)
            hint = f'; did you mean {near[0]}?' if near else ''
            raise ProfileError(f'got DOF {dof!r}, takes {", ".join(DOFS)}{hint}')
        if dof in profile:
            raise ProfileError(f'names {dof} twice; add waves with +')
        profile[dof] = tuple([_wave(dof, wave) for wave in waves.split('+')])
    return profile


def simulate_log(settings: Settings, path: Path, duration: float, seed: int,
                 profile: Profile | None = None) -> int:
    """
    Write the log of a simulated vehicle, with the configured topics and types.

    Parameters
    ----------
    settings : Settings
        With the truth, the sensor rates and the noise under ``simulation``.
    path : Path
        MCAP file; its metadata record ``rovid_truth`` holds the true parameters.
    duration : float
        Length [s].
    seed : int
        Of the noise; the same seed gives the same file, byte for byte.
    profile : mapping, optional
        Thrust per DOF, see :func:`parse_profile`; instead of that in the settings.

    Returns
    -------
    count : int
        Number of messages written.

    Raises
    ------
    SimulationError, SettingsError
        If there is no truth to simulate, or a message type cannot be filled.

    """
    sensors = SensorMessages(settings)
    messages = _in_order(settings, sensors, duration, seed, profile)
    first = next(messages)  # what cannot be simulated shows before there is a file
    count, elapsed = 0, 0
    with (LogWriter(path) as writer, Interrupt() as interrupt,
          Progress('simulate', lambda: elapsed / (duration * 1e9)) as progress):
        writer.metadata('rovid_truth', truth(settings.simulation.dofs))
        for message in chain([first], messages):
            if interrupt.asked:
                break
            _write(writer, message)
            count, elapsed = count + 1, message.time - EPOCH
            progress.tick()
    if interrupt.asked:
        raise Interrupted(f'interrupted; {path} holds the first {elapsed * 1e-9:.1f} s')
    return count


def truth(simulated: Mapping[str, SimulatedDof]) -> dict[str, str]:
    """Return the true parameters, physical and lumped, as text by ``<dof>.<parameter>``."""
    values: dict[str, str] = {}
    for dof, true in simulated.items():
        physical = (true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        for name, value in zip(PHYSICAL + PARAMETERS, physical + lumped(*physical)):
            values[f'{dof}.{name}'] = repr(float(value))
    return values


def _write(writer: LogWriter, message: SensorMessage) -> None:
    try:
        writer.write(message.topic, message.type, message.fields, message.time)
    except (OverflowError, struct.error) as error:
        raise SimulationError(
            f'{message.topic}: a value does not fit the integer in {message.type}: {error}'
        ) from None


def _in_order(settings: Settings, sensors: SensorMessages, duration: float, seed: int,
              profile: Profile | None) -> Iterator[SensorMessage]:
    """Yield the messages in the order of arrival: each is as late as its input's latency."""
    waiting: list[tuple[int, int, SensorMessage]] = []
    count = 0
    samples = simulate(settings, duration, seed, profile)
    for time, group in groupby(samples, key=lambda sample: sample[0]):
        now = EPOCH + time
        while waiting and waiting[0][0] <= now + sensors.soonest:
            yield heapq.heappop(waiting)[2]
        for message in sensors.messages(now, {name: value for _, name, value in group}):
            heapq.heappush(waiting, (message.time, count, message))
            count += 1
    while waiting:
        yield heapq.heappop(waiting)[2]


def _wave(dof: str, text: str) -> tuple[float, float]:
    found = re.fullmatch(r'\s*([^@]+)@([^@]+)', text)
    try:
        if found:
            amplitude, frequency = float(found[1]), float(found[2])
            if math.isfinite(amplitude) and math.isfinite(frequency) and frequency >= 0.0:
                return (amplitude, frequency)
    except ValueError:
        pass
    raise ProfileError(f'got {text.strip()!r} for {dof}, takes AMPLITUDE@FREQUENCY such as '
                       '120@0.083 ([N or N m] @ [Hz])')
