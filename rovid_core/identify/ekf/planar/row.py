"""What the filter of surge and sway says of one of them, as of an identifier of its own."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, TYPE_CHECKING

from rovid_core.identify.method import check_bounds, floats, Identifier
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import Thrusters

if TYPE_CHECKING:
    from rovid_core.identify.ekf.planar_kalman import PlanarKalman


class PlanarRow(Identifier):
    """
    What the filter of surge and sway says of one of them.

    Parameters
    ----------
    filter : PlanarKalman
        It takes the steps before this is asked.
    k : int
        0 for surge, 1 for sway.
    bounds : tuple
        The lowest and the highest lumped parameters.

    Attributes
    ----------
    k, bounds
        As given.

    """

    converged_share = 0.1
    judges_errors = True
    filtered = False

    def __init__(self, filter: PlanarKalman, k: int, bounds: tuple[Four, Four]) -> None:
        self._filter = filter
        self.k, self.bounds = k, bounds
        self.parameters = (0.0, 0.0, 0.0, 0.0)
        self.v_hat = math.nan
        self.excitation = 0.0

    @property
    def is_found(self) -> bool:
        """Tell whether the first data of both were gone through."""
        return self._filter.is_found

    @property
    def fit(self) -> float:
        """Return how much of the motion the model predicts without corrections."""
        return self._filter.fit(self.k)

    @property
    def note(self) -> str:
        """Return what the filter has to say."""
        return self._filter.note(self.k)

    @property
    def doubt(self) -> str:
        """Return why the model may not be used yet, '' if it may."""
        return self._filter.doubt(self.k)

    def step(self, step: Step, adapt: bool = True) -> str:
        """Return what the filter made of the step that it took for both."""
        return self._filter.refused

    def restart(self, velocity: float) -> None:
        """Do nothing: the filter takes up both velocities at once."""

    def reset(self) -> None:
        """Go back to the initial values, with the other one."""
        self._filter.reset()

    @property
    def changed_at(self) -> float:
        """Return after how long [s] both were found to have changed last, 0 for never."""
        return self._filter.changed_at

    def hear_of_change(self) -> None:
        """Let the filter learn that another DOF has shown that the vehicle changed."""
        self._filter.hear_of_change()

    @property
    def surprise(self) -> tuple[float, int]:
        """Return that of both; one of them tells it."""
        return self._filter.surprise if self._is_first else (math.nan, 0)

    def trust_thrusters(self) -> None:
        """Begin with thrusters as configured, for both."""
        self._filter.trust_thrusters()

    def hear(self, thrusters: Thrusters) -> None:
        """Let the filter learn how another DOF shows that the thrusters work."""
        self._filter.hear(thrusters)

    def conclude(self) -> bool:
        """Make the best of data that end here, for both."""
        return self._is_first and self._filter.conclude()

    @property
    def _is_first(self) -> bool:
        return self is next(iter(self._filter.rows.values()))

    def state(self) -> dict[str, Any]:
        """Return what is needed to go on; the first of both has all of it."""
        return {'parameters': list(self.parameters),
                'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
                'planar': self._filter.state() if self._is_first else None}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        check_bounds(PARAMETERS, floats(state['parameters'], 4), *self.bounds)
        v_hat = math.nan if state['v_hat'] is None else float(state['v_hat'])
        shared = state['planar']
        if (shared is None) == self._is_first:
            raise ValueError('the state of another filter')
        if shared is not None:
            self._filter.restore(shared)
        self.v_hat = v_hat
