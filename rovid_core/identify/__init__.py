"""The identification methods by name, and how the identifier of one DOF is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains
from rovid_core.identify.aid.self_tuning import SelfTuningIdentifier
from rovid_core.identify.ekf.extended_kalman import ExtendedKalman
from rovid_core.identify.method import Identifier
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales, SettingsError


def _aid(scales: Scales, settings: IdentifierSettings,
         raw_gains: tuple[float, ...] | None) -> Identifier:
    if raw_gains is None:
        return SelfTuningIdentifier(scales, settings.adaptation_time)
    return AdaptiveIdentifier(
        scales, Gains(settings.feedback_gain, raw_gains), settings.integrator)


# The function that makes the identifier of a DOF, in the order in which they are offered.
METHODS: dict[
    str, Callable[[Scales, IdentifierSettings, tuple[float, ...] | None], Identifier]] = {
    'aid': _aid,
    'ekf': lambda scales, settings, _: ExtendedKalman(scales),
}


def make_identifier(settings: IdentifierSettings, dof: DofSettings,
                    raw_gains: tuple[float, ...] | None = None,
                    watched: tuple[str, ...] = (), shares: bool = False) -> Identifier:
    """
    Return the configured identifier for one DOF; raises SettingsError if there is no such method.

    ``raw_gains`` is the diagonal of Gamma where the settings give raw gains (``aid``);
    ``watched`` names the regressors that steps carry besides those of the model; ``shares`` tells
    whether the DOF's thrusters drive others, too.
    """
    if settings.method not in METHODS:
        raise SettingsError(
            'identifier.method', f'got {settings.method!r}, takes {", ".join(METHODS)}')
    scales = replace(Scales.of(dof), watched=watched, shares=shares)
    return METHODS[settings.method](scales, settings, raw_gains)


def retuned_identifier(identifier: Identifier, settings: IdentifierSettings, dof: DofSettings,
                       raw_gains: tuple[float, ...] | None) -> Identifier:
    """
    Return an identifier with other gains that continues with the state of a given one.

    That was made with the same method, DOF and integrator, and must not be used afterwards.
    """
    keeps_gains = isinstance(identifier, SelfTuningIdentifier) and raw_gains is None
    if keeps_gains or not isinstance(identifier, AdaptiveIdentifier):
        identifier.retune(settings.adaptation_time)
        return identifier
    made, found = make_identifier(settings, dof, raw_gains), identifier.state()
    # one kind publishes a mean and the other theta_hat: the published values must not jump
    made.restore({**made.state(), **found, 'theta_hat': found['parameters']})
    return made
