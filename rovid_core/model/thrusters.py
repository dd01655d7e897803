"""How the thrusters of one DOF are found to work besides what the configuration says of them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from rovid_core.model.plant import Array

DEAD_BAND: Final = 0.2
"""Force up to which a dead band is looked for, in the size that thrust has."""


class Thrusters(NamedTuple):
    """
    What becomes of a force that is asked for; as configured by default.

    Attributes
    ----------
    lag : float
        [s] Time constant with which the force follows what it is asked to be; 0 for none.
    dead_band : float
        Force that is lost, either way.
    reverse : float
        What there is of a force backwards, relative to one forwards. Propellers that run backwards
        give less, so the larger one of both is what is asked for.
    loss : float
        What is lost with speed, in the root of a force per speed: by ``slowing`` times the speed.
    turns : bool
        Whether the turns of propellers lag, whose force goes with n |n| of their turns n; without
        it the force itself does.
    lag_at : float
        Force about which the turns lag so where a torque drives the propellers, which asks for
        the force that it ends at: the lag goes with the root of 1 / force. 0 where the turns
        themselves are asked for.

    """

    lag: float = 0.0
    dead_band: float = 0.0
    reverse: float = 1.0
    loss: float = 0.0
    turns: bool = False
    lag_at: float = 0.0

    @property
    def follows(self) -> tuple[float, bool, float]:
        """Return how the force follows what it is asked to be."""
        return self.lag, self.turns, self.lag_at

    @property
    def is_curved(self) -> bool:
        """Tell whether a force that is held is not what is asked for."""
        return self.dead_band != 0.0 or self.reverse != 1.0

    @property
    def found(self) -> list[str]:
        """Return the names of what is not as configured."""
        return [name for name, is_there in (
            ('turns_lag' if self.turns else 'lag', self.lag != 0.0),
            ('dead_band', self.dead_band != 0.0),
            ('reverse_thrust', self.reverse != 1.0),
            ('thrust_loss', self.loss != 0.0)) if is_there]

    @property
    def shares(self) -> tuple[float, float]:
        """Return what there is of a force forwards, and of one backwards."""
        return min(1.0, 1.0 / self.reverse), min(1.0, self.reverse)

    def given(self, force: float) -> float:
        """Return the force, before the lag, that there is for one that is asked for."""
        ahead, astern = self.shares
        size = max(abs(force) - self.dead_band, 0.0)
        return ahead * size if force > 0.0 else -astern * size

    def all_given(self, forces: Array) -> Array:
        """Return the same of many forces."""
        ahead, astern = self.shares
        size = np.maximum(np.abs(forces) - self.dead_band, 0.0)
        return np.where(forces > 0.0, ahead * size, -astern * size)

    def slowing(self, force: float) -> float:
        """
        Return how much of a force that there is at rest is lost per speed.

        That of a propeller at rest goes with n |n| of its turns n; its coefficient falls with the
        advance ratio, v over n times the diameter, about in proportion: by |n| v.
        """
        return self.loss * math.sqrt(abs(force))

    def at_rest(self, force: float, velocity: float) -> float:
        """Return the force that there is at rest, where there is this one at a velocity."""
        lost = self.loss * (velocity if force > 0.0 else -velocity)
        root = 0.5 * (lost + math.sqrt(lost * lost + 4.0 * abs(force)))
        return math.copysign(root * root, force) if force else 0.0

    def asked(self, force: float) -> float:
        """Return a force that is asked for where there is this one."""
        ahead, astern = self.shares
        asked = force / (ahead if force > 0.0 else astern)
        return asked + math.copysign(self.dead_band, asked) if asked else 0.0

    @property
    def curve(self) -> str:
        """Return in words how a force that is held differs from what is asked for, '' if not."""
        return ', '.join(said for said, is_there in (
            (f'dead band {self.dead_band!r}', self.dead_band != 0.0),
            (f'backwards {self.reverse!r} of forwards', self.reverse != 1.0),
            (f'{self.loss!r} v sqrt(force) lost with speed', self.loss != 0.0)) if is_there)

    def in_units(self, force: float, velocity: float) -> Thrusters:
        """Return the same in other units, in which these are what was 1."""
        return Thrusters(self.lag, self.dead_band * force, self.reverse,
                         self.loss * math.sqrt(force) / velocity, self.turns, self.lag_at * force)


AS_CONFIGURED: Final = Thrusters()


def read_thrusters(values: object) -> Thrusters:
    """Return thrusters of six numbers; raises ValueError if there are none such."""
    if not isinstance(values, (list, tuple)) or len(values) != 6:
        raise ValueError('thrusters that do not fit')
    lag, dead_band, reverse, loss, turns, lag_at = [float(value) for value in values]
    if not (0.0 <= lag < math.inf and 0.0 <= dead_band < math.inf and 0.0 < reverse < math.inf
            and 0.0 <= loss < math.inf and 0.0 <= lag_at < math.inf):
        raise ValueError('thrusters out of range')
    return Thrusters(lag, dead_band, reverse, loss, turns != 0.0 and lag > 0.0,
                     lag_at if turns != 0.0 and lag > 0.0 else 0.0)
