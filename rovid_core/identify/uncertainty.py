"""How well the parameters of a degree of freedom are known."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from rovid_core.model.dofs import Four, NAN4


class Uncertainty(Protocol):
    """
    What a method knows of its errors, as it was at a step; computed when it is read.

    ``covariance`` is that of the parameters: 16 floats, row-major, 0 for left-out terms; ()
    for a method without. ``std`` are their standard deviations, NaN where there are none,
    and ``delay_std`` is that of the delay [s].
    """

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the parameters."""

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters."""

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""


class Stated(NamedTuple):
    """An uncertainty that is there already; without values, that of a method without any."""

    covariance: tuple[float, ...] = ()
    std: Four = NAN4
    delay_std: float = math.nan


NOTHING = Stated()
