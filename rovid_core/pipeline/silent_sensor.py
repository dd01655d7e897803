"""The rule for a sensor that dies: what is still known of a DOF while no step comes."""

from __future__ import annotations

import math

from rovid_core.identify.estimate import DofEstimate
from rovid_core.model.samples import NS
from rovid_core.settings.run import Settings


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
