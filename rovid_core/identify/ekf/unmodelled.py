"""What may move a vehicle besides its model: filters that believe in each run side by side."""

from __future__ import annotations

from typing import NamedTuple


class Unmodelled(NamedTuple):
    """
    What a filter takes to move the vehicle besides its model.

    Attributes
    ----------
    force_std : float
        Stationary standard deviation of an unknown acceleration that goes on for seconds, in
        typical accelerations.
    slip : float
        Standard deviation of what the path moves by itself from one fix to the next, over that of
        a fix. The model's velocity is then off by white noise, and the most likely parameters are
        those whose simulated velocity has the least squares of errors: output error.

    """

    force_std: float
    slip: float

    @property
    def is_there(self) -> bool:
        """Tell whether it takes the model to be wrong."""
        return self.force_std > 0.0 or self.slip > 0.0


UNMODELLED = (Unmodelled(0.0, 0.0), Unmodelled(0.05, 0.0), Unmodelled(0.0, 3.0))
"""
Nothing; an unknown force; a model that is not quite right.

A larger force explains everything and leaves the model only what is fast. From a slip of 1 on the
noise of the fixes hardly counts beside it, and a larger one changes little.
"""
