"""One degree of freedom under identification: its method, its status, its estimate."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast

from rovid_core.identify import make_identifier, retuned_identifier
from rovid_core.identify.estimate import DofEstimate
from rovid_core.identify.status import DofStatus, Judgement
from rovid_core.inputs.units_and_signs import Sign, TypicalSizes
from rovid_core.model.dofs import Four
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.settings.scales import Scales


class Identification:
    """
    What becomes of the steps of one DOF.

    Parameters
    ----------
    settings : Settings
        The run.
    i : int
        Number of the DOF in ``settings.dofs``.
    reject : callable
        Told the DOF and the reason of every step that is refused.
    warn : callable
        Told one line about what looks wrong in the data.

    Attributes
    ----------
    identifier : Identifier
        The method.
    estimate : DofEstimate
        The last one.

    """

    def __init__(self, settings: Settings, i: int, reject: Callable[[str, str], None],
                 warn: Callable[[str], None]) -> None:
        self._name = name = settings.dofs[i]
        dof, method = settings.dof[name], settings.identifier
        self._i = i
        self.identifier = make_identifier(method, dof, _raw_gains(method, i))
        # raw gains have their own adaptation time
        self._status = DofStatus(Scales.of(dof), getattr(
            self.identifier, 'adaptation_time', method.adaptation_time))
        self._sizes = TypicalSizes(name, dof, warn)
        self._sign = Sign(name, Scales.of(dof).force, settings.source(name), warn)
        self._reject = reject
        true = settings.simulation.dofs.get(name) if settings.simulation.publish_w else None
        self._truth = None if true is None else lumped(
            true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        self.refresh()

    def change(self, settings: Settings) -> None:
        """Take other gains from the next step on; what was found stays."""
        method = settings.identifier
        self.identifier = retuned_identifier(
            self.identifier, method, settings.dof[self._name], _raw_gains(method, self._i))
        self._status.retune(getattr(self.identifier, 'adaptation_time', method.adaptation_time))

    def refresh(self) -> None:
        """Let the estimate say what the identifier holds by now; no step has been made."""
        self._status.reset()
        self._steps = 0
        identifier = self.identifier
        self.estimate = DofEstimate(
            self._name, identifier.parameters, identifier.uncertainty,
            Judgement('waiting', ('no step yet',)), delay=identifier.delay)

    def verdict(self) -> str:
        """Return what all data leave open, '' if nothing."""
        return self._status.verdict()

    def step(self, time: int, step: Step, adapt: bool) -> None:
        """Take a step that ends at ``time`` [ns]; without ``adapt`` the parameters stay."""
        identifier = self.identifier
        refused = identifier.step(step, adapt)
        if refused:
            self._reject(self._name, refused)
        else:
            self._steps += 1
        self._sizes.step(step)
        self._sign.step(step)
        velocity, v_hat = step.velocity[2], identifier.v_hat
        if v_hat != v_hat:  # lost its way: it takes up from what is measured
            v_hat = velocity
        w = math.nan if self._truth is None else identifier.lyapunov(velocity, self._truth)
        # by position: it is made at every step, and names would cost as much as the step
        self.estimate = DofEstimate._make((
            self._name, identifier.parameters, identifier.uncertainty,
            self._status.update(identifier, step, refused, adapt), time, self._steps, velocity,
            v_hat, step.force[1], identifier.excitation, w, identifier.delay))


def _raw_gains(method: IdentifierSettings, i: int) -> Four | None:
    """Return the diagonal of Gamma of DOF number ``i``, None where there are no raw gains."""
    gains = method.adaptation_gains
    raw = gains[4 * i:4 * i + 4] if len(gains) > 4 else gains
    return cast(Four, raw) if raw else None
