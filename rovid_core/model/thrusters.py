"""How the thrusters of one DOF are found to work besides what the configuration says of them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from rovid_core.model.plant import Array


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

    """

    lag: float = 0.0
    dead_band: float = 0.0
    reverse: float = 1.0

    @property
    def is_curved(self) -> bool:
        """Tell whether a force that is held is not what is asked for."""
        return self.dead_band != 0.0 or self.reverse != 1.0

    @property
    def found(self) -> list[str]:
        """Return the names of what is not as configured."""
        return [name for name, is_there in (
            ('lag', self.lag != 0.0), ('dead_band', self.dead_band != 0.0),
            ('reverse_thrust', self.reverse != 1.0)) if is_there]

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
            (f'backwards {self.reverse!r} of forwards', self.reverse != 1.0)) if is_there)

    def in_units(self, unit: float) -> Thrusters:
        """Return the same for forces in other units, of which ``unit`` is what was 1."""
        return Thrusters(self.lag, self.dead_band * unit, self.reverse)


AS_CONFIGURED: Final = Thrusters()


def read_thrusters(values: object) -> Thrusters:
    """Return thrusters of three numbers; raises ValueError if there are none such."""
    if not isinstance(values, (list, tuple)) or len(values) != 3:
        raise ValueError('thrusters that do not fit')
    lag, dead_band, reverse = [float(value) for value in values]
    if not (0.0 <= lag < math.inf and 0.0 <= dead_band < math.inf and 0.0 < reverse < math.inf):
        raise ValueError('thrusters out of range')
    return Thrusters(lag, dead_band, reverse)
