"""What a replay gave, and the last estimate as plain JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any, Protocol

from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.identify.intervals import Interval
from rovid_core.model.dofs import Four, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings


@dataclass(frozen=True)
class Result:
    """
    What a replay gave.

    Attributes
    ----------
    logs : tuple of Path
        What was read.
    settings : Settings
        The run.
    steps : int
        Number of estimates, each of which the node would publish.
    messages : int
        Number of messages read.
    duration : float
        Time [s] from the first of them to the last.
    dofs : dict
        Per DOF, as in the JSON: see :func:`summary`.
    rejected : dict
        (input, reason) -> how many.

    """

    logs: tuple[Path, ...]
    settings: Settings
    steps: int
    messages: int
    duration: float
    dofs: Mapping[str, Mapping[str, Any]]
    rejected: Mapping[tuple[str, str], int]

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` writes."""
        reasons: dict[str, int] = {}
        for (_, reason), count in sorted(self.rejected.items()):
            reasons[reason] = reasons.get(reason, 0) + count
        return {
            'method': self.settings.identifier.method, 'steps': self.steps,
            'duration_s': self.duration, 'rejected': reasons, 'dofs': self.dofs}


class Scored(Protocol):
    """What :func:`summary` reads of a DOF's score."""

    @property
    def mae(self) -> float:
        """Return mean |v_sim - v| [m/s or rad/s]."""

    @property
    def fit(self) -> float:
        """Return 1 - rms(v_sim - v) / std(v), NaN where std(v) is 0."""


def summary(settings: Settings, estimate: Estimate | None,
            scores: Mapping[str, Scored] | None = None,
            verdicts: Mapping[str, str] | None = None) -> dict[str, dict[str, Any]]:
    """
    Return the ``dofs`` part of the JSON of ``rovid replay``.

    Parameters
    ----------
    settings : Settings
        What DOFs there are.
    estimate : Estimate or None
        The last one; None where there was no step: the initial values, no steps, waiting.
    scores : mapping of str to Scored, optional
        The score of each DOF.
    verdicts : mapping of str to str, optional
        What the data leave open of each DOF.

    Returns
    -------
    dofs : dict
        Per DOF the parameters in both forms, ``std``, their 95 % ``intervals`` and
        ``delay_s`` (None where there are none), ``mae``, ``fit``, ``steps``, ``status``,
        ``reasons`` and ``verdict``; a number that is not finite is None.

    """
    dofs = estimate.dofs if estimate else tuple([
        DofEstimate(name, Scales.of(settings.dof[name]).initial) for name in settings.dofs])
    result: dict[str, dict[str, Any]] = {}
    for dof in dofs:
        score = (scores or {}).get(dof.dof)
        known = any(math.isfinite(x) for x in dof.std)
        result[dof.dof] = {
            **_named(PARAMETERS, dof.parameters),
            'std': _named(PARAMETERS, dof.std) if known else None,
            **_named(PHYSICAL, physical(dof.parameters)),
            'intervals': _intervals(dof.intervals),
            'delay_s': {'value': dof.delay, 'std': _finite(dof.delay_std)}
            if math.isfinite(dof.delay) else None,
            'mae': _finite(score.mae if score else math.nan),
            'fit': _finite(score.fit if score else math.nan),
            'steps': dof.steps,
            'status': dof.status,
            'reasons': list(dof.reasons),
            'verdict': (verdicts or {}).get(dof.dof, ''),
        }
    return result


def _intervals(found: Mapping[str, Interval]) -> dict[str, list[float | None] | None] | None:
    """Return all eight by name, None for a left-out term; None for all without covariance."""
    return {name: [_finite(x) for x in found[name]] if name in found else None
            for name in (*PARAMETERS, *PHYSICAL)} if found else None


def _named(names: tuple[str, ...], values: Four) -> dict[str, float | None]:
    return {name: _finite(value) for name, value in zip(names, values)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
