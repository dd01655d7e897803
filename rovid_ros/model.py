"""The model of a vehicle as ``/rov/model`` carries it, for controllers; needs no rclpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
import math
from typing import Any

from rovid_core.identify.status import STATUSES
from rovid_core.model.thrusters import Thrusters


@dataclass(frozen=True)
class DofModel:
    """
    The model of one degree of freedom, with what tells whether it may be used.

    Units are those of the DOF: N, m/s and kg, or N m, rad/s and kg m^2. A value that the message
    does not have is NaN.

    Attributes
    ----------
    stamp : float
        Time [s] of velocity, v_hat and force.
    age : float
        How much later [s] the newest data were when the message was made.
    status : str
        waiting, unexcited, converging, converged, frozen, invalid or stale.
    valid : bool
        Whether the numbers may be used: the data are fresh, the first estimate has settled, and
        the model explains the motion.
    updated : bool
        Whether a step of this DOF has made the message.
    fit : float
        How much of the motion the model predicts without corrections; 1 is all.
    delay : float
        Of the thrust [s], where it is estimated.
    mass, quadratic_drag, linear_drag, bias : float
        Of ``mass v' + quadratic_drag v|v| + linear_drag v + bias = force``; in a current, v is
        the velocity through the water.
    alpha, beta, gamma, delta : float
        Of ``v' = alpha force + beta v|v| + gamma v + delta``.
    velocity, v_hat, force : float
        Measured and filtered; in the identifier's state; filtered like the velocity.
    velocity_delay, v_hat_delay : float
        By how much [s] they lag behind the motion at ``stamp``.
    dead_band, reverse : float
        Force that thrusters are found to lose, either way, and what there is of one backwards;
        the model is of the force that is left.
    loss : float
        What they are found to lose with speed: this times velocity times the root of that force.
    std : dict
        Standard deviation by name, NaN where there is none.
    couplings : dict
        kappa by name, of the DOF's couplings.

    """

    dof: str
    stamp: float
    age: float
    status: str
    valid: bool
    updated: bool
    fit: float
    delay: float
    mass: float
    quadratic_drag: float
    linear_drag: float
    bias: float
    alpha: float
    beta: float
    gamma: float
    delta: float
    velocity: float
    v_hat: float
    force: float
    velocity_delay: float
    v_hat_delay: float
    dead_band: float
    reverse: float
    loss: float
    std: Mapping[str, float]
    couplings: Mapping[str, float]

    def force_for(self, acceleration: float, velocity: float,
                  regressors: Mapping[str, float] | None = None) -> float:
        """Return the force that gives an acceleration at a velocity; see ``Model.force``."""
        x = dict(regressors or {})
        unknown = [name for name in x if name not in self.couplings]
        if unknown:
            raise ValueError(f'{self.dof} has no coupling {unknown[0]!r}, '
                             f'has {", ".join(self.couplings) or "none"}')
        if 'reverse_drag' in self.couplings:
            x['reverse_drag'] = min(velocity, 0.0) * abs(velocity)
        # drag never pushes, also where a fit found more of it ahead than there is astern
        kappas = {**self.couplings, 'reverse_drag': min(
            self.couplings.get('reverse_drag', 0.0), -self.beta)}
        push = acceleration - math.fsum(
            [self.beta * velocity * abs(velocity), self.gamma * velocity, self.delta,
             *(kappas[name] * value for name, value in x.items())])
        reverse = self.couplings.get('reverse_thrust', 0.0) if push < 0.0 else 0.0
        alpha = self.alpha + reverse
        thrusters = Thrusters(
            dead_band=0.0 if math.isnan(self.dead_band) else self.dead_band,
            reverse=1.0 if math.isnan(self.reverse) else self.reverse,
            loss=0.0 if math.isnan(self.loss) else self.loss * self.alpha / alpha)
        return thrusters.asked(thrusters.at_rest(push / alpha, velocity))


class Model:
    """
    All degrees of freedom of a message of ``/rov/model``.

    Attributes
    ----------
    dofs : dict
        Name -> DofModel.

    """

    def __init__(self, dofs: Mapping[str, DofModel]) -> None:
        self.dofs = dict(dofs)

    def __getitem__(self, dof: str) -> DofModel:
        """Return the model of a degree of freedom; raises KeyError where there is none."""
        return self.dofs[dof]

    @staticmethod
    def from_message(message: Any) -> Model:
        """
        Read a ``std_msgs/msg/Float64MultiArray``, of rclpy or of rosbags.

        Columns go by their labels, so others than those of today do no harm. Raises ValueError
        for a message that is no ``/rov/model``.
        """
        try:
            rows, columns = message.layout.dim
            names, labels = rows.label.split(','), columns.label.split(',')
            data = [float(value) for value in message.data][message.layout.data_offset:]
        except (AttributeError, TypeError, ValueError) as error:
            raise ValueError(f'not a message of /rov/model: {error}') from None
        width = len(labels)
        if len(data) != len(names) * width or 'valid' not in labels:
            raise ValueError(f'not a message of /rov/model: {len(data)} numbers for '
                             f'{len(names)} x {width} labels')
        return Model({name: _dof_model(name, dict(zip(labels, data[i * width:(i + 1) * width])))
                      for i, name in enumerate(names)})

    def force(self, dof: str, acceleration: float, velocity: float,
              regressors: Mapping[str, float] | None = None) -> float:
        """
        Return the force [N or N m] that the model needs, for feed-forward.

        Parameters
        ----------
        dof : str
            A degree of freedom of the message; KeyError where it is none.
        acceleration, velocity : float
            The wanted ones [m/s^2 and m/s, or rad/s^2 and rad/s].
        regressors : mapping, optional
            x of the DOF's couplings by name, such as ``{'vr': v * r}``; one left out is 0, but
            ``reverse_thrust`` and ``reverse_drag`` are found from force and velocity. Raises
            ValueError for a name that the DOF does not have.

        """
        return self.dofs[dof].force_for(acceleration, velocity, regressors)


NUMBERS = tuple(one.name for one in fields(DofModel) if one.type == 'float')


def _dof_model(name: str, values: Mapping[str, float]) -> DofModel:
    status = values.get('status', math.nan)
    known = status in range(len(STATUSES))
    return DofModel(
        dof=name, status=STATUSES[int(status)] if known else 'unknown',
        valid=values['valid'] == 1.0, updated=values.get('updated') == 1.0,
        std={label.removesuffix('_std'): value for label, value in values.items()
             if label.endswith('_std')},
        couplings={label.removeprefix('kappa_'): value for label, value in values.items()
                   if label.startswith('kappa_') and not label.endswith('_std')
                   and not math.isnan(value)},
        **{label: values.get(label, math.nan) for label in NUMBERS})
