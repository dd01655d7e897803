"""One degree of freedom under identification: its method, its status, its estimate."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast

from rovid_core.dofs import Four
from rovid_core.identifier import Scales, Step
from rovid_core.methods import make
from rovid_core.plant import lumped
from rovid_core.settings import Settings
from rovid_core.slips import Sign
from rovid_core.status import DofStatus
from rovid_core.values import DofEstimate
from rovid_core.watch import TypicalSizes


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
        gains = method.adaptation_gains
        raw = gains[4 * i:4 * i + 4] if len(gains) > 4 else gains
        self.identifier = make(method, dof, cast(Four, raw) if raw else None)
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

    def refresh(self) -> None:
        """Let the estimate say what the identifier holds by now; no step has been made."""
        self._status.reset()
        identifier = self.identifier
        self.estimate = DofEstimate(
            self._name, identifier.parameters, identifier.std, reasons=('no step yet',),
            covariance=identifier.covariance, delay=identifier.delay,
            delay_std=identifier.delay_std)

    def verdict(self) -> str:
        """Return what all data leave open, '' if nothing."""
        return self._status.verdict()

    def step(self, time: int, step: Step, adapt: bool) -> None:
        """Take a step that ends at ``time`` [ns]; without ``adapt`` the parameters stay."""
        identifier, before = self.identifier, self.estimate
        refused = identifier.step(step, adapt)
        if refused:
            self._reject(self._name, refused)
        self._sizes.step(step)
        self._sign.step(step)
        status, reasons = self._status.after(identifier, step, refused, adapt)
        truth = self._truth
        self.estimate = DofEstimate(
            dof=self._name, parameters=identifier.parameters, std=identifier.std,
            status=status, reasons=reasons, time=time,
            steps=before.steps + (not refused), velocity=step.velocity[2],
            v_hat=identifier.v_hat, force=step.force[1], excitation=identifier.excitation,
            W=math.nan if truth is None else identifier.lyapunov(step.velocity[2], truth),
            covariance=identifier.covariance, delay=identifier.delay,
            delay_std=identifier.delay_std)
