"""Settings of the inputs: where they come from, and the thrusters' chain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

LONGEST_LAG = 10.0  # [s] of the thrusters


class SettingsError(ValueError):
    """
    A setting that cannot work.

    Parameters
    ----------
    key : str
        The key as in the parameter file, such as ``thrusters.gain``.
    message : str
        What it got and what it takes.

    """

    def __init__(self, key: str, message: str) -> None:
        super().__init__(key, message)  # both, so that it can come from another process
        self.key = key

    def __str__(self) -> str:
        return ': '.join(self.args)


@dataclass(frozen=True)
class InputSettings:
    """Where one input comes from; an empty ``topic`` means that it is not used."""

    topic: str = ''
    type: str = ''
    field: str = ''
    stamp: str = ''  # 'header', 'receive', or '': header where the type has one
    latency: float = 0.0  # [s], subtracted from the stamp
    qos: str = 'sensor_data'  # 'sensor_data', 'reliable' or 'transient_local', of the subscription
    timeout: float = 0.0  # [s] after which it is silent; 0: max_gap
    frames: str = ''  # 'enu' or 'ned', of its messages; '': as those of all
    # [rad] roll, pitch and yaw that turn the axes of the body into those of the sensor
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] where it is in the body
    sensor_frame: str = ''  # frame of tf2 to take lever arm or mounting from; '': as given


@dataclass(frozen=True)
class ThrusterSettings:
    """The chain from a thruster message to the force on the body."""

    topics: tuple[str, ...] = ()  # one for all thrusters, or one per thruster
    type: str = ''
    field: str = ''
    stamp: str = ''
    latency: float = 0.0
    qos: str = 'sensor_data'
    names: tuple[str, ...] = ()
    offset: float = 0.0
    scale: float = 1.0
    deadband: float = 0.0  # of the command after offset and scale, as is the limit
    dead_zone: float = 0.0  # which a command loses of its size
    limit: float = 0.0  # 0: none
    model: str = 'linear'  # linear | quadratic | polynomial | table
    gain: tuple[float, ...] = ()
    newtons: bool = True  # whether the forces are; else masses are relative to a command of 1
    reverse: float = 1.0  # force of a negative command relative to the positive one
    polynomial: tuple[float, ...] = ()  # ascending powers, from the constant term
    table_command: tuple[float, ...] = ()
    table_force: tuple[float, ...] = ()
    delay: float = 0.0
    time_constant: float = 0.0
    lag_of_turns: bool = False  # whether that is the propellers' turns', else the force's
    lag_at: float = 0.0  # force of one at which a torque makes its turns lag so; 0: no torque
    hold: str = 'previous'  # previous | linear
    timeout: float = 1.0
    allocation: tuple[tuple[float, ...], ...] = ()  # 6 rows (surge..yaw) x thrusters

    @property
    def count(self) -> int:
        """Return the number of thrusters."""
        return len(self.gain)

    @property
    def is_wrench(self) -> bool:
        """Tell whether commands are forces and moments of thrusters that are not known."""
        return 'Wrench' in self.type

    def pushes_both_ways(self, dof: int) -> bool:
        """
        Tell whether commands of one sign alone drive a DOF, by its number, both ways.

        Weaker thrust backwards is then a weaker force both ways: no motion of the DOF shows it.
        """
        row = [share * gain for share, gain in zip(self.allocation[dof], self.gain)]
        return min(row) < 0.0 < max(row)

    def shares(self, dof: int, others: Iterable[int]) -> bool:
        """Tell whether a thruster that drives a DOF drives any of others, all by number, too."""
        return any(k * row * self.allocation[other][j] for other in others if other != dof
                   for j, (k, row) in enumerate(zip(self.gain, self.allocation[dof])))

    def __post_init__(self) -> None:
        """Check the shapes against each other."""
        n = self.count
        if n == 0:
            raise SettingsError('thrusters.gain', 'takes one number per thruster, got none')
        if self.names and len(self.names) != n:
            raise SettingsError(
                'thrusters.names', f'has {len(self.names)} entries for {n} thrusters '
                                   '(the length of thrusters.gain)')
        if len(self.topics) > 1 and len(self.topics) != n:
            raise SettingsError(
                'thrusters.topics', f'has {len(self.topics)} entries for {n} thrusters '
                                    '(the length of thrusters.gain)')
        got = sum(len(row) for row in self.allocation)
        if len(self.allocation) != 6 or any(len(row) != n for row in self.allocation):
            raise SettingsError(
                'thrusters.allocation', f'takes 6 rows x {n} thrusters = {6 * n} numbers, '
                                        f'got {got}')
        if self.scale == 0.0:
            raise SettingsError('thrusters.scale', 'got 0, takes any other number')
        if self.hold == 'linear' and len(self.topics) > 1:
            raise SettingsError(
                'thrusters.hold', 'linear takes one topic for all thrusters; takes previous here')
        self._check_lag()
        if self.model == 'polynomial' and not self.polynomial:
            raise SettingsError(
                'thrusters.polynomial', 'takes at least one coefficient for model polynomial')
        if self.model == 'table':
            self._check_table()

    def _check_lag(self) -> None:
        if self.hold == 'linear' and self.lag_of_turns:
            raise SettingsError(
                'thrusters.hold', 'linear takes a lag of the force; takes previous with '
                                  'thrusters.lag_of_turns')
        if self.lag_at and not self.lag_of_turns:
            raise SettingsError(
                'thrusters.lag_at', f'got {self.lag_at:g}, takes 0 without thrusters.lag_of_turns')

    def _check_table(self) -> None:
        commands, forces = self.table_command, self.table_force
        if len(commands) < 2 or len(commands) != len(forces):
            raise SettingsError(
                'thrusters.table_command', f'takes two or more commands, as many as '
                f'thrusters.table_force; got {len(commands)} and {len(forces)}')
        if any(b <= a for a, b in zip(commands, commands[1:])):
            raise SettingsError('thrusters.table_command', 'takes strictly increasing commands')
