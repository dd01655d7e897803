"""Who is told what goes through the stream."""

from __future__ import annotations

from typing import Protocol

from rovid_core.model.samples import Event, Step


class Recorder(Protocol):
    """Writes down what the pipe consumed, so that it can be replayed to the same bits."""

    def released(self, event: Event) -> None:
        """Take an event, in the order of release."""

    def controlled(self, name: str, value: str) -> None:
        """Take a control at its place between the events."""


class Scorer(Protocol):
    """Keeps what a score needs."""

    def restarted(self, dof: str, time: int, velocity: float) -> None:
        """Take the velocity that a DOF takes up from."""

    def stepped(self, dof: str, span: tuple[int, int, int], step: Step) -> None:
        """Take a step and its times [ns]: start, start of the measurement, end."""

    def reference(self, time: int, value: tuple[float, ...]) -> None:
        """Take a reference velocity (six values)."""

    def changed(self, cutoff: float) -> None:
        """Take the cutoff [Hz] of the steps from now on."""
