"""The offline methods by name, and the choice of terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
import math

from rovid_core.model.dofs import PARAMETERS
from rovid_core.settings.run import DofSettings, Scales, Settings
from rovid_core.trials.least_squares import with_acceleration, without_acceleration
from rovid_core.trials.output_error import output_error
from rovid_core.trials.record import Fit, Record
from rovid_core.trials.repeated_passes import repeated_passes

Method = Callable[[Sequence[Record], Scales, Settings], Fit]


def _output_error(records: Sequence[Record], scales: Scales, settings: Settings) -> Fit:
    start = with_acceleration(records, scales, settings.cutoff).parameters
    if not all(map(math.isfinite, start)):
        start = scales.initial
    return output_error(records, scales, start)


METHODS: dict[str, Method] = {
    'least_squares': lambda records, scales, settings: with_acceleration(
        records, scales, settings.cutoff),
    'filtered_least_squares': lambda records, scales, settings: without_acceleration(
        records, scales, settings.cutoff),
    'aid_offline': lambda records, scales, settings: repeated_passes(
        records, scales, settings.identifier.adaptation_time),
    'output_error': _output_error,
}
"""Least squares as in the paper, without acceleration, the paper's identifier in repeated
passes with Runge-Kutta, and output error, the reference."""


def subsets(settings: DofSettings) -> Iterator[DofSettings]:
    """Yield the DOF with one or two of its configured terms left out; alpha stays."""
    others = [term for term in settings.terms if term != 'alpha']
    for count in (1, 2):
        for kept in combinations(others, max(len(others) - count, 0)):
            yield replace(settings, terms=tuple(
                term for term in PARAMETERS if term == 'alpha' or term in kept))
