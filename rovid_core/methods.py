"""The identification methods by name."""

from __future__ import annotations

from rovid_core.aid import AdaptiveIdentifier, Gains
from rovid_core.dofs import Four
from rovid_core.identifier import Identifier, Scales
from rovid_core.settings import DofSettings, IdentifierSettings, SettingsError


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
        The diagonal of Gamma for this DOF where the settings give raw gains.

    Raises
    ------
    SettingsError
        For a method that there is not.

    """
    if settings.method != 'aid':
        raise SettingsError('identifier.method', f'got {settings.method!r}, takes aid')
    scales = Scales.of(dof)
    if raw_gains is not None:
        gains = Gains(settings.feedback_gain, raw_gains)
    else:
        gains = Gains.from_time(settings.adaptation_time, scales)
    return AdaptiveIdentifier(scales, gains, settings.integrator)
