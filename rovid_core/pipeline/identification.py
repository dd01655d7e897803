"""One DOF: its steps into what is known of its parameters, also while no step comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math

from rovid_core.identify import make_identifier, retuned_identifier
from rovid_core.identify.estimate import DofEstimate
from rovid_core.identify.intervals import Uncertainty, WithScaleInDoubt
from rovid_core.identify.method import Identifier
from rovid_core.identify.status import DofStatus, Judgement
from rovid_core.inputs.units_and_signs import TypicalSizeCheck
from rovid_core.model.dofs import DOFS
from rovid_core.model.plant import lumped
from rovid_core.model.samples import NS, Step
from rovid_core.settings.run import Scales, Settings


class SilentSensor:
    """
    Tell from the age of a DOF's last step whether it still has a present.

    An input that is silent for its timeout (``Settings.timeout_of``) makes no step, and steps do
    not go on across it. Once the last step is older than the longest timeout of what a DOF
    needs, its velocity, force and error are unknown; its parameters stay as they are.

    Parameters
    ----------
    settings : Settings
        The run.
    dof : str
        The DOF.

    """

    def __init__(self, settings: Settings, dof: str) -> None:
        self._dof = dof
        self._interrupted = False
        self.change(settings)

    def change(self, settings: Settings) -> None:
        """Use other timeouts."""
        self._largest_age = round(settings.largest_age(self._dof) / NS)

    def interrupt(self) -> None:
        """Know nothing of the present until the next step."""
        self._interrupted = True

    def end(self) -> None:
        """Go on: a step came."""
        self._interrupted = False

    def seen(self, estimate: DofEstimate, now: int, silent: bool) -> DofEstimate:
        """
        Return an estimate as it is at an event time [ns], stale if its step is too long ago.

        It is stale at once if it is ``silent``: an input without which there is no step has been
        so for its timeout, or the histories were started anew.
        """
        age = now - estimate.time
        if -self._largest_age <= age <= self._largest_age and not (silent or self._interrupted):
            return estimate
        if estimate.judgement.status == 'waiting':  # for its first step
            return estimate
        nan = math.nan
        return estimate.replaced(stale_for=max(age, 1) * NS if age >= 0 else math.inf,
                                 velocity=nan, v_hat=nan, force=nan, W=nan)


class Identification:
    """
    Identify one DOF from its steps.

    Parameters
    ----------
    settings : Settings
        The run.
    name : str
        Of the DOF.
    reject : callable
        Called with the DOF and the reason for every step that is refused.
    identifier : Identifier, optional
        The method, where it is not the configured one for this DOF alone.
    weaker : dict of str to float, optional
        Shared by the DOFs of a vehicle, as of a ``DofStatus``.
    family : list of Identification, optional
        Those DOFs, each added by itself; they are told what this one finds of the thrusters, and
        that the vehicle changed.

    Attributes
    ----------
    identifier : Identifier
        The method.
    sizes : TypicalSizeCheck
        What its force and velocity are in fact; it is given the steps by its owner.
    estimate : DofEstimate
        The last one.

    """

    def __init__(self, settings: Settings, name: str, reject: Callable[[str, str], None],
                 identifier: Identifier | None = None, weaker: dict[str, float] | None = None,
                 family: list[Identification] | None = None) -> None:
        self._name = name
        self._family = [] if family is None else family
        self._family.append(self)
        dof, method = settings.dof[name], settings.identifier
        self.identifier = identifier or make_identifier(
            method, dof, settings.raw_gains(name), settings.watched(name),
            name in settings.sharing)
        # a method may leave couplings out, and raw gains have their own adaptation time
        scales = replace(Scales.of(dof), couplings=settings.couplings(name))
        self._status = DofStatus(scales, getattr(
            self.identifier, 'adaptation_time', method.adaptation_time), name, weaker,
            settings.thrusters.pushes_both_ways(DOFS.index(name)), settings.thrusters.is_wrench)
        self.sizes = TypicalSizeCheck(name, dof, settings.max_speed)
        self._reject = reject
        self._told = self.identifier.thrusters
        true = settings.simulation.dofs.get(name) if settings.simulation.publish_w else None
        self._truth = None if true is None else lumped(
            true.mass, true.quadratic_drag, true.linear_drag, true.bias)
        self._silence = SilentSensor(settings, name)
        self.refresh()

    def change(self, settings: Settings, gains_change: bool) -> None:
        """Use other timeouts, and from the next step on other gains; the parameters stay."""
        self._silence.change(settings)
        if not gains_change:
            return
        method = settings.identifier
        self.identifier = retuned_identifier(
            self.identifier, method, settings.dof[self._name], settings.raw_gains(self._name))
        self._status.retune(getattr(self.identifier, 'adaptation_time', method.adaptation_time))

    def at(self, now: int, silent: bool = False) -> DofEstimate:
        """Return the estimate at an event time [ns]; see ``SilentSensor.seen``."""
        return self._silence.seen(self.estimate, now, silent)

    def interrupt(self) -> None:
        """Have no present velocity until the next step; the parameters stay."""
        self._silence.interrupt()

    def refresh(self) -> None:
        """Let the estimate say what the identifier holds by now, without a step."""
        self._status.reset()
        self._steps, self._changed_at = 0, self.identifier.changed_at
        self._silence.end()
        self.estimate = DofEstimate(
            dof=self._name, parameters=self.identifier.parameters,
            judgement=Judgement('waiting', ('no step yet',)))
        self.take_up()

    def begin_anew(self) -> None:
        """Forget the data, beginning with what was learned; the steps go on being counted."""
        steps = self._steps
        self.identifier.begin_anew()
        self.refresh()
        self._steps = steps
        self.estimate = self.estimate.replaced(steps=steps)

    def take_up(self) -> None:
        """Let the last estimate have the parameters that the identifier has by now."""
        identifier = self.identifier
        self.estimate = self.estimate.replaced(
            parameters=identifier.parameters, uncertainty=self._uncertainty(),
            delay=identifier.delay, couplings=identifier.couplings,
            thrusters=identifier.thrusters)

    def _uncertainty(self) -> Uncertainty:
        """Return that of the method, with what is known of the thrust from other DOFs."""
        identifier, share = self.identifier, self._status.scale_in_doubt
        return identifier.uncertainty if not share else WithScaleInDoubt(
            identifier.uncertainty, share * identifier.parameters[0])

    def _tell(self) -> None:
        """Tell the other DOFs how the thrusters are found to work, or that the vehicle changed."""
        told, changed_at = self._told, self._changed_at
        self._told, self._changed_at = self.identifier.thrusters, self.identifier.changed_at
        for other in self._family:
            if other.identifier is not self.identifier:
                if self._told is not told:
                    other.identifier.hear(self._told)
                if self._changed_at > changed_at:
                    other.identifier.hear_of_change()

    def judgement(self) -> Judgement:
        """Return the judgement over all of the data, not that of the last step."""
        now = self.estimate.judgement
        return now if now.status in ('waiting', 'frozen') else self._status.of_all

    def verdict(self) -> str:
        """Return what all data leave open, '' if nothing."""
        return self._status.verdict()

    def add_step(self, time: int, step: Step, adapt: bool, delay: float) -> None:
        """
        Add a step that ends at ``time`` [ns]; without ``adapt`` the parameters stay.

        ``delay`` [s] is that of the low-pass behind which the velocity is.
        """
        identifier = self.identifier
        refused = identifier.step(step, adapt)
        if refused:
            self._reject(self._name, refused)
        else:
            self._steps += 1
        self._silence.end()
        judgement = self._status.update(identifier, step, refused, adapt)
        if identifier.thrusters is not self._told or identifier.changed_at != self._changed_at:
            self._tell()
        velocity, v_hat = step.velocity[2], identifier.v_hat
        status = self._status
        # in the order of the fields: by their names it would take three times as long
        self.estimate = DofEstimate(
            self._name, identifier.parameters, self._uncertainty(), judgement, time,
            self._steps, velocity,
            # NaN after a divergence: it goes on from what is measured
            velocity if v_hat != v_hat else v_hat,
            step.force[1], identifier.excitation,
            math.nan if self._truth is None else identifier.lyapunov(velocity, self._truth),
            identifier.delay, identifier.couplings, status.settled, status.fit,
            delay, delay if identifier.filtered else 0.0, identifier.thrusters)
