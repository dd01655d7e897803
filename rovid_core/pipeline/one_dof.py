"""One degree of freedom under identification: its method, its status, its estimate."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast

from rovid_core.identify import make_identifier, retuned_identifier
from rovid_core.identify.estimate import DofEstimate
from rovid_core.identify.status import DofStatus, Judgement
from rovid_core.inputs.units_and_signs import (
    SignCheck,
    TypicalSizeCheck,
    UnsignedCommandCheck,
)
from rovid_core.model.dofs import Four
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import IdentifierSettings, Scales, Settings


class Identification:
    """
    Identify one DOF from its steps.

    Parameters
    ----------
    settings : Settings
        The run.
    i : int
        Number of the DOF in ``settings.dofs``.
    unsigned : UnsignedCommandCheck
        Gets the velocity of every step.
    reject : callable
        Called with the DOF and the reason for every step that is refused.
    warn : callable
        Called with one line about what looks wrong in the data.

    Attributes
    ----------
    identifier : Identifier
        The method.
    estimate : DofEstimate
        The last one.

    """

    def __init__(self, settings: Settings, i: int, unsigned: UnsignedCommandCheck,
                 reject: Callable[[str, str], None], warn: Callable[[str], None]) -> None:
        self._name = name = settings.dofs[i]
        dof, method = settings.dof[name], settings.identifier
        self._i = i
        self.identifier = make_identifier(method, dof, _raw_gains(method, i))
        # raw gains have their own adaptation time
        self._status = DofStatus(Scales.of(dof), getattr(
            self.identifier, 'adaptation_time', method.adaptation_time))
        self._sizes = TypicalSizeCheck(name, dof, warn)
        self._sign = SignCheck(name, Scales.of(dof).force, settings.source(name), warn)
        self._unsigned = unsigned
        self._reject = reject
        true = settings.simulation.dofs.get(name) if settings.simulation.publish_w else None
        self._truth = None if true is None else lumped(
            true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        self.refresh()

    def change(self, settings: Settings) -> None:
        """Use other gains from the next step on; the parameters stay."""
        method = settings.identifier
        self.identifier = retuned_identifier(
            self.identifier, method, settings.dof[self._name], _raw_gains(method, self._i))
        self._status.retune(getattr(self.identifier, 'adaptation_time', method.adaptation_time))

    def refresh(self) -> None:
        """Let the estimate say what the identifier holds by now, without a step."""
        self._status.reset()
        self._steps = 0
        identifier = self.identifier
        self.estimate = DofEstimate(
            dof=self._name, parameters=identifier.parameters, uncertainty=identifier.uncertainty,
            judgement=Judgement('waiting', ('no step yet',)), delay=identifier.delay)

    def verdict(self) -> str:
        """Return what all data leave open, '' if nothing."""
        return self._status.verdict()

    def add_step(self, time: int, step: Step, adapt: bool) -> None:
        """Add a step that ends at ``time`` [ns]; without ``adapt`` the parameters stay."""
        identifier = self.identifier
        refused = identifier.step(step, adapt)
        if refused:
            self._reject(self._name, refused)
        else:
            self._steps += 1
        judgement = self._status.update(identifier, step, refused, adapt)
        velocity, v_hat = step.velocity[2], identifier.v_hat
        self._sizes.add_step(step)
        self._sign.add_step(step)
        self._unsigned.add_velocity(self._i, velocity)
        self.estimate = DofEstimate(
            dof=self._name,
            parameters=identifier.parameters,
            uncertainty=identifier.uncertainty,
            judgement=judgement,
            time=time,
            steps=self._steps,
            velocity=velocity,
            # NaN after a divergence: it goes on from what is measured
            v_hat=velocity if v_hat != v_hat else v_hat,
            force=step.force[1],
            excitation=identifier.excitation,
            W=math.nan if self._truth is None else identifier.lyapunov(velocity, self._truth),
            delay=identifier.delay)


def _raw_gains(method: IdentifierSettings, i: int) -> Four | None:
    """Return the diagonal of Gamma of DOF number ``i``, None where there are no raw gains."""
    gains = method.adaptation_gains
    raw = gains[4 * i:4 * i + 4] if len(gains) > 4 else gains
    return cast(Four, raw) if raw else None
