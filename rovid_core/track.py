"""Where the DOFs of one source stand between two steps."""

from __future__ import annotations

from collections.abc import Callable

from rovid_core.lowpass import LowPass
from rovid_core.motion import Motion
from rovid_core.motion_source import MotionSource
from rovid_core.settings import Settings
from rovid_core.world import World

NS = 1e-9


class Track:
    """
    The DOFs of one source: their filters and how far they have come.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        The source.
    world : World
        What the sources know of each other.
    warn : callable
        Told one line if the samples come too slowly.

    """

    def __init__(self, settings: Settings, input: str, world: World,
                 warn: Callable[[str], None]) -> None:
        self.source = MotionSource(settings, input, world)
        self.indices = tuple(settings.dofs.index(d) for d in self.source.dofs)
        self.velocity = LowPass(settings.cutoff)
        self.force = LowPass(settings.cutoff)
        self.held: Motion | None = None  # waits for the force of its span
        self.last: Motion | None = None  # where the next step begins
        self._warn: Callable[[str], None] | None = warn
        self._gaps = 0
        self.change(settings)

    def change(self, settings: Settings) -> None:
        """Take other limits and another cutoff; the filters go on from where they are."""
        self.timeout = round(settings.timeout_of(self.source.input) / NS)  # between two steps
        self.source.change(settings)
        self.velocity.retune(settings.cutoff)
        self.force.retune(settings.cutoff)

    def interrupt(self) -> None:
        """Take up from the next measurement."""
        self.velocity.restart()
        self.force.restart()
        self.held = self.last = None

    def note_gap(self) -> None:
        """Say once that there are nothing but gaps."""
        self._gaps += 1
        if self._warn and self._gaps == 20 and not self.velocity.steps:
            self._warn(f'the messages of {self.source.input} are further apart than max_gap: '
                       'nothing can be identified from them')

    def warn_if_clamped(self) -> None:
        """Say once that the samples come too slowly for the cutoff."""
        taken, clamped = self.velocity.steps, self.velocity.clamped
        if self._warn and taken >= 50 and clamped > taken // 2:
            self._warn(f'velocity.cutoff is above 0.4 of the rate of {self.source.input}, and '
                       'clamped to that')
            self._warn = None
