"""The terms of a model that the data want: those without which it predicts worse."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from rovid_core.model.dofs import PARAMETERS
from rovid_core.trials.tuning.choice import sure_error
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.dof import Dof

WORTH = 0.01
"""A term has to lower the error by this share to be kept: without it the model is simpler."""


@dataclass(frozen=True)
class TermsChange:
    """
    The terms of one DOF.

    Attributes
    ----------
    dof : str
        Its name.
    before, after : tuple of str
        The same where nothing better was found.
    gain, spread : float
        Of those that predict best against the present ones on held-out blocks, as a share.

    """

    dof: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    gain: float
    spread: float

    @property
    def key(self) -> str:
        """Return the key in the parameter file."""
        return f'{self.dof}.terms'


def tune_terms(dof: Dof, commanded: Commanded, pair: tuple[float, float]) -> TermsChange:
    """
    Choose the terms of a DOF; alpha always stays.

    Terms are left out where the model predicts held-out blocks as well without them, and added
    where it clearly predicts better with them.
    """
    before = dof.settings.terms
    candidates = [before, *(
        ('alpha', *others) for count in range(len(PARAMETERS))
        for others in combinations(PARAMETERS[1:], count) if {'alpha', *others} != {*before})]
    scores = np.concatenate([
        dof.fit_terms(commanded, pair, terms).scores for terms in candidates])
    cost = scores.mean(axis=1) * [1.0 + WORTH * len(terms) for terms in candidates]
    best = int(np.where(np.isfinite(cost), cost, np.inf).argmin())
    gains = (scores[0] - scores[best]) / scores[0].mean()
    gain, spread = float(gains.mean()), float(sure_error(gains))
    taken = {*candidates[best]} < {*before} or gain > spread
    return TermsChange(dof.name, before, candidates[best] if taken else before, gain, spread)
