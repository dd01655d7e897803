"""Vehicles to try rovid on, which differ from their configurations as real ones do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import re

from rovid_core.settings.run import Settings
from rovid_core.simulation.profiles import Multisine, Profile, Steps
from rovid_ros.config.parameter_file import load, shipped_file
from rovid_ros.config.parameters import settings_from


@dataclass(frozen=True)
class Example:
    """
    A vehicle and how it is driven.

    Attributes
    ----------
    summary : str
        What it is, in a line.
    base : str
        The shipped configuration that its user begins with; ``config/examples/NAME.yaml`` over
        it is the truth.
    duration : float
        Of the log [s].
    profile : Profile
        Thrust that its pilot asks for.

    """

    summary: str
    base: str
    duration: float
    profile: Profile


def one_at_a_time(hold: float, levels: Mapping[str, tuple[float, ...]]) -> Profile:
    """Return steps of ``hold`` [s] on each DOF [N or N m] while the others rest, over and over."""
    total = sum(map(len, levels.values()))
    profile, before = {}, 0
    for dof, own in levels.items():
        rest = total - before - len(own)
        profile[dof] = (Steps((0.0,) * before + own + (0.0,) * rest, hold),)
        before += len(own)
    return profile


EXAMPLES = {
    'bluerov2': Example(
        'BlueROV2 Heavy under ArduSub with MAVROS: PWM, pose and IMU; driven axis by axis',
        'bluerov2_ardusub.yaml', 300.0, one_at_a_time(3.0, {
            # it dives first, for it rises while it is not pushed
            'heave': (-55.0, 35.0, -40.0, 15.0, -55.0, 35.0, -30.0, 5.0),
            'surge': (45.0, -45.0, 25.0, 0.0, -25.0, 45.0, -45.0, 0.0),
            'sway': (45.0, -45.0, 25.0, 0.0, -25.0, 45.0, -45.0, 0.0),
            'yaw': (2.5, -2.5, 1.5, 0.0, -1.5, 2.5, -2.5, 0.0)})),
    'lbl_rov': Example(
        'work ROV with a fix a second, depth, compass and a wrench; in a current',
        'lbl_slow.yaml', 600.0, {
            'surge': (Multisine(140.0, 0.01, 0.06, 6),),
            'sway': (Multisine(110.0, 0.012, 0.05, 5),),
            # its buoyancy is held down on average
            'heave': (Steps((-170.0, 120.0, -110.0, 60.0, -20.0, 12.0), 12.0),),
            'yaw': (Steps((0.0, 15.0, -15.0, 0.0, -15.0, 15.0, 7.0, -7.0), 12.0),)}),
    'auv': Example(
        'AUV with an odometry and a wrench that its controller asks for; in a current',
        'odometry_wrench.yaml', 300.0, {
            'surge': (Steps((40.0, 55.0, 20.0, -20.0, 60.0, 30.0), 12.0),),
            'sway': (Multisine(35.0, 0.02, 0.15, 6),),
            'heave': (Multisine(50.0, 0.015, 0.12, 6),),
            'yaw': (Steps((4.0, -4.0, 0.0, -6.0, 6.0, 2.0, 0.0, -2.0), 5.0),)}),
}


def example_configuration(example: Example) -> str:
    """Return the configuration that its user begins with: without a truth for the simulator."""
    text = shipped_file(example.base).read_text(encoding='utf-8')
    # the truth is the last section of each shipped file, below its comment
    return re.sub(r'\n(?:[ ]{4}#[^\n]*\n+)*[ ]{4}simulation:.*', '', text, flags=re.DOTALL)


def example_truth(name: str) -> Settings:
    """Return the settings that an example is simulated with."""
    files = EXAMPLES[name].base, f'examples/{name}.yaml'
    return settings_from({key: value for file in files
                          for key, value in load(shipped_file(file)).items()})
