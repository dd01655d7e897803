"""Thruster commands on their way to the thrust: their direction, and what looks wrong."""

from __future__ import annotations

from collections.abc import Callable
import math

from rovid_core.inputs.units_and_signs import Interleaved, OneSided, Pulses
from rovid_core.settings.run import Settings
from rovid_core.thrust.force_history import Thrust
from rovid_core.thrust.thruster_curve import are_commands

NS = 1e-9


class Commands:
    """
    What becomes of the inputs ``thrusters`` and ``sign``.

    Parameters
    ----------
    settings : Settings
        The run.
    thrust : Thrust
        Takes the signed commands.
    warn : callable
        Told one line about what looks wrong in the data.

    Attributes
    ----------
    one_sided : OneSided
        Has to be told the velocities as well.

    """

    def __init__(self, settings: Settings, thrust: Thrust, warn: Callable[[str], None]) -> None:
        self._thrust = thrust
        self._is_signed = not settings.sign.topic
        self.one_sided = OneSided(settings, warn)
        self._interleaved = Interleaved(warn)
        self._pulses = Pulses(settings, warn)
        self.change(settings)
        self.restart()

    def change(self, settings: Settings) -> None:
        """Take other timeouts."""
        self._settings = settings.thrusters
        self._timeout = round(settings.timeout_of('sign') / NS)
        # a span begins at most a timeout before a measurement that waited as long for the rest
        self._memory = 3 * round(settings.longest_timeout / NS)

    def restart(self) -> None:
        """Forget the direction."""
        self._sign: tuple[int, tuple[float, ...]] | None = None

    def sign(self, time: int, value: tuple[float, ...]) -> None:
        """Take the direction of the commands from ``time`` [ns] on."""
        self._sign = time, value

    def take(self, time: int, value: tuple[float, ...], part: int) -> str:
        """Take commands at ``time`` [ns]; return why they were refused, or ''."""
        if not self._is_signed:
            if self._sign is None:
                return 'no_sign'
            since, signs = self._sign
            if time - since > self._timeout:
                return 'stale_sign'
            signs = signs if len(signs) > 1 else signs * len(value)
            if len(signs) > len(value):
                signs = signs[part:part + 1]
            value = tuple([math.copysign(abs(u), s) for u, s in zip(value, signs)])
        self._pulses.take(value)  # what is beyond the limit, too
        if not are_commands(self._settings, value, part):
            return 'not_a_command'
        self.one_sided.command(value)
        self._interleaved.command(value, part)
        self._thrust.forget(time - self._memory)
        return '' if self._thrust.command(time, value, part) else 'force_out_of_range'
