"""How the motion moves with the coefficients of regressors, and how well these are known."""

from __future__ import annotations

from collections.abc import Sequence


class Regressor:
    """
    How the motion moves with the coefficient of a regressor.

    Attributes
    ----------
    path, velocity, force : float
        Derivatives of path, velocity and unknown acceleration.
    push : float
        The regressor over a step: the derivative of the acceleration.

    """

    __slots__ = ('path', 'velocity', 'force', 'push')

    def __init__(self) -> None:
        self.path = self.velocity = self.force = self.push = 0.0


class Parameter(Regressor):
    """
    The coefficient of a regressor of the model.

    Attributes
    ----------
    value : float
        What it is.
    gain : float
        Its covariance with the measurement that is looked at.
    alpha, beta, gamma, delta, delay : float
        Its covariances with these.
    couplings : list of m floats
        Those with the parameters of the couplings.

    """

    __slots__ = ('value', 'gain', 'alpha', 'beta', 'gamma', 'delta', 'delay', 'couplings')

    def __init__(self, value: float) -> None:
        super().__init__()
        self.value, self.gain = value, 0.0
        self.alpha = self.beta = self.gamma = self.delta = self.delay = 0.0
        self.couplings: list[float] = []

    @property
    def row(self) -> list[float]:
        """Return its row of the covariance, the delay at the end."""
        return [self.alpha, self.beta, self.gamma, self.delta, *self.couplings, self.delay]

    @row.setter
    def row(self, covariances: Sequence[float]) -> None:
        self.alpha, self.beta, self.gamma, self.delta = covariances[:4]
        self.couplings, self.delay = list(covariances[4:-1]), covariances[-1]
