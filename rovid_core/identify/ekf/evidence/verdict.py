"""What blocks say of a model: what it lacks, its parameters, and how well these are known."""

from __future__ import annotations

from dataclasses import dataclass, field

from rovid_core.model.plant import Array

NAMED_T = 4.0
"""Significance from which a regressor is named."""

OTHERWISE = 'otherwise'
"""
Name of the doubt whether thrust comes and goes by a delay and a lag at all: where the lags that
are watched say together that it does not, the mass is open by what they would move it.
"""

LAG_SHAPE = 'lag_shape'
"""
Name of the doubt whether a lag that was found is one of the force. Propellers lag in their turns,
and a filter in what it measures: that moves the mass by as much as the lag itself does.
"""


@dataclass(frozen=True)
class Missing:
    """
    A regressor that the model lacks.

    Attributes
    ----------
    name : str
        One of the watched ones, or ``current``.
    coefficient : float
        What it would have, in typical velocities per second; of a current its size.
    share : float
        Of the squared innovations that it explains.
    alpha : float
        That its DOF has with it; 0 for a regressor of no DOF with thrust.

    """

    name: str
    coefficient: float
    share: float
    alpha: float = 0.0


@dataclass(frozen=True)
class Regression:
    """
    What further regressors would explain.

    Attributes
    ----------
    kappa : ndarray, shape (k,)
        Their coefficients.
    power : float
        By how much -2 log of the likelihood would fall; chi-squared if there is nothing.
    t_squared : float
        The same by the scatter of the blocks, whatever the model says (Hotelling).
    moved : ndarray, shape (active parameters,)
        By how much the parameters fall short of what they would be, with the other sign.

    """

    kappa: Array
    power: float
    t_squared: float
    moved: Array

    @property
    def is_significant(self) -> bool:
        """Tell whether it is more than chance, by the model and by the scatter of the blocks."""
        return min(self.power, self.t_squared) > NAMED_T * NAMED_T


@dataclass(frozen=True)
class Verdict:
    """
    What the blocks say.

    Attributes
    ----------
    covariance : p lists of p floats
        Of the parameters.
    scatter : float
        Of the scores, relative to what the model says; 1 where it is right.
    missing : Missing or None
        The regressor that explains most of what the model does not.
    count : int
        Of the blocks.
    theta : list of p floats
        The parameters that fit all of them best, also beyond their bounds.
    untold : tuple of str
        The term of each DOF that it may have and that makes most of its alpha's variance, and
        before it ``OTHERWISE`` where that does.
    rest : tuple of Missing
        By how much terms whose size was found are off, the most significant first; none where
        something else is missing.
    unexplained : float
        The scatter that is left when what is missing is added.
    drift : float
        By which share the thrust rose from the beginning of the data to their end: below 0, or 0
        where that cannot be told from no change.
    begin : list of p floats
        The parameters with the thrust of the beginning, where it falls.

    """

    covariance: list[list[float]]
    scatter: float
    missing: Missing | None
    count: int
    theta: list[float]
    untold: tuple[str, ...]
    rest: tuple[Missing, ...] = ()
    unexplained: float = 1.0
    drift: float = 0.0
    begin: list[float] = field(default_factory=list)

    @property
    def to_find(self) -> tuple[Missing, ...]:
        """Return what may be found of the thrusters: what is missing, or the sizes of the rest."""
        return (self.missing,) if self.missing else self.rest
