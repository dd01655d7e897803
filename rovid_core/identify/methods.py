"""The identification methods by name."""

from __future__ import annotations

from collections.abc import Callable

from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains
from rovid_core.identify.aid.running_mean import AveragedIdentifier
from rovid_core.identify.ekf.extended_kalman import ExtendedKalman
from rovid_core.identify.method import Identifier
from rovid_core.identify.rls.recursive_least_squares import RecursiveLeastSquares
from rovid_core.model.dofs import Four
from rovid_core.settings.run import DofSettings, IdentifierSettings, SettingsError
from rovid_core.settings.scales import Scales


def _aid(scales: Scales, settings: IdentifierSettings, raw_gains: Four | None) -> Identifier:
    if raw_gains is None:
        return AveragedIdentifier(scales, settings.adaptation_time, settings.integrator)
    return AdaptiveIdentifier(
        scales, Gains(settings.feedback_gain, raw_gains), settings.integrator)


def _rls(scales: Scales, settings: IdentifierSettings, _: Four | None) -> Identifier:
    return RecursiveLeastSquares(scales, settings.adaptation_time)


def _ekf(scales: Scales, settings: IdentifierSettings, _: Four | None) -> Identifier:
    return ExtendedKalman(scales)


METHODS: dict[str, Callable[[Scales, IdentifierSettings, Four | None], Identifier]] = {
    'aid': _aid,
    'rls': _rls,
    'ekf': _ekf,
}
"""What makes the identifier of a DOF; in the order in which they are offered."""


def retuned(identifier: Identifier, settings: IdentifierSettings, dof: DofSettings,
            raw_gains: Four | None = None) -> Identifier:
    """
    Return an identifier with other gains that goes on from what this one has found.

    Parameters
    ----------
    identifier : Identifier
        Made with the same method, DOF and integrator; not to be used any more.
    settings, dof, raw_gains
        As in :func:`make`.

    """
    averaged = isinstance(identifier, AveragedIdentifier) and raw_gains is None
    if averaged or not isinstance(identifier, AdaptiveIdentifier):
        identifier.retune(settings.adaptation_time)
        return identifier
    made, found = make(settings, dof, raw_gains), identifier.state()
    # from a mean to theta_hat and back, what is published must not leap
    made.restore({**made.state(), **found, 'theta_hat': found['parameters']})
    return made


def make(settings: IdentifierSettings, dof: DofSettings,
         raw_gains: Four | None = None) -> Identifier:
    """
    Return the configured identifier for one DOF.

    Parameters
    ----------
    settings : IdentifierSettings
        Method, integrator and gains.
    dof : DofSettings
        Initial values, scales and terms.
    raw_gains : tuple of 4 floats, optional
        The diagonal of Gamma for this DOF where the settings give raw gains (``aid``).

    Raises
    ------
    SettingsError
        For a method that there is not.

    """
    if settings.method not in METHODS:
        raise SettingsError(
            'identifier.method', f'got {settings.method!r}, takes {", ".join(METHODS)}')
    return METHODS[settings.method](Scales.of(dof), settings, raw_gains)
