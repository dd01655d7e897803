"""Thrust profiles: sums of sinusoids, multisines and steps as functions of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Protocol

MAX_LINES = 100


class ProfileError(ValueError):
    """A waveform with impossible values; the text says what they have to be."""


class Waveform(Protocol):
    """The thrust on one DOF."""

    def at(self, t: float) -> float:
        """Return the thrust [N or N m] at ``t`` [s] from the trial's start."""

    @property
    def max_frequency(self) -> float:
        """Return the highest frequency [Hz] that commands have to follow."""


Profile = Mapping[str, tuple[Waveform, ...]]
"""DOF -> waveforms whose sum is its thrust; a DOF without waveforms gets no thrust."""


@dataclass(frozen=True)
class Sinusoid:
    """``amplitude`` [N or N m] at one ``frequency`` [Hz], from 0 upwards."""

    amplitude: float
    frequency: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not math.isfinite(self.amplitude):
            raise ProfileError('the amplitude has to be finite')
        if not 0.0 < self.frequency < math.inf:
            raise ProfileError('the frequency has to be above 0 Hz')

    def at(self, t: float) -> float:
        """Return the thrust at ``t`` [s]."""
        return self.amplitude * math.sin(2.0 * math.pi * self.frequency * t)

    @property
    def max_frequency(self) -> float:
        """Return the frequency [Hz]."""
        return self.frequency


@dataclass(frozen=True)
class Multisine:
    """
    Equal sinusoids from ``low`` to ``high``, with Schroeder's phases.

    The phases keep the peak low: the crest factor (peak over rms) is 1.7 to 2, while sinusoids
    in phase have sqrt(2 lines). Schroeder, IEEE Trans. Inf. Theory 16(1), 1970, for
    a flat spectrum.

    Attributes
    ----------
    amplitude : float
        Of the sum [N or N m], which comes close to it and never exceeds it.
    low, high : float
        First and last frequency [Hz], both included.
    lines : int
        Number of frequencies, evenly spaced.

    """

    amplitude: float
    low: float
    high: float
    lines: int

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not math.isfinite(self.amplitude):
            raise ProfileError('the amplitude has to be finite')
        if not 0.0 < self.low < self.high < math.inf:
            raise ProfileError('the band has to begin above 0 Hz and end higher')
        if not 2 <= self.lines <= MAX_LINES:
            raise ProfileError(f'there have to be 2 to {MAX_LINES} lines')

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Return the frequencies [Hz]."""
        spacing = (self.high - self.low) / (self.lines - 1)
        return (*(self.low + k * spacing for k in range(self.lines - 1)), self.high)

    @property
    def phases(self) -> tuple[float, ...]:
        """Return the phases [rad] of the cosines."""
        return tuple([-math.pi * k * (k + 1) / self.lines for k in range(self.lines)])

    @cached_property
    def line_amplitude(self) -> float:
        """Return the amplitude of each sinusoid [N or N m]."""
        # Lines that are no multiples of their spacing drift through all common phases, so the
        # sum reaches the peak of its envelope, which repeats after 1 / spacing.
        peak, points = 0.0, 16 * self.lines
        for i in range(points):
            angles = [2.0 * math.pi * k * i / points + p for k, p in enumerate(self.phases)]
            peak = max(peak, math.hypot(
                math.fsum(map(math.cos, angles)), math.fsum(map(math.sin, angles))))
        return self.amplitude / peak

    @cached_property
    def _lines(self) -> tuple[tuple[float, float], ...]:
        return tuple([(2.0 * math.pi * f, p) for f, p in zip(self.frequencies, self.phases)])

    def at(self, t: float) -> float:
        """Return the thrust at ``t`` [s]."""
        return self.line_amplitude * math.fsum([math.cos(w * t + p) for w, p in self._lines])

    @property
    def max_frequency(self) -> float:
        """Return the last frequency [Hz]."""
        return self.high


@dataclass(frozen=True)
class Steps:
    """``levels`` [N or N m], each held for ``hold`` [s], over and over."""

    levels: tuple[float, ...]
    hold: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        if len(self.levels) < 2 or not all(map(math.isfinite, self.levels)):
            raise ProfileError('there have to be two or more levels, all finite')
        if not 0.0 < self.hold < math.inf:
            raise ProfileError('the time has to be above 0 s')

    def at(self, t: float) -> float:
        """Return the thrust at ``t`` [s]."""
        # times are rounded: a command 1e-9 before a level begins belongs to it
        return self.levels[math.floor(t / self.hold + 1e-9) % len(self.levels)]

    @property
    def max_frequency(self) -> float:
        """Return the frequency [Hz] of steps up and down."""
        return 0.5 / self.hold
