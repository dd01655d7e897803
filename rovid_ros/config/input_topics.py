"""Which topics feed an input, which inputs a topic feeds, and what a DOF needs."""

from __future__ import annotations

from rovid_core.settings.run import Settings


def topics_of(settings: Settings, name: str) -> tuple[str, ...]:
    """Return the topics of an input: one, or one per thruster."""
    return settings.thrusters.topics if name == 'thrusters' else (settings.input(name).topic,)


def inputs_of(settings: Settings, topic: str) -> list[str]:
    """Return the inputs that a topic feeds."""
    return [name for name in settings.used_inputs() if topic in topics_of(settings, name)]


def section(name: str) -> str:
    """Return the section of an input in the parameter file."""
    return 'thrusters.sign' if name == 'sign' else name


def needs(settings: Settings, dof: str) -> tuple[str, ...]:
    """Return the inputs without which a DOF makes no step, its source first."""
    source = settings.source(dof)
    turned = source in ('position', 'depth') and settings.attitude.topic
    needed = (source, 'attitude' if turned else '', 'sign', 'thrusters')
    return tuple(name for name in needed if name in settings.used_inputs())
