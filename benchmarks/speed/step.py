"""
Time per step of every method, beside other programs.

``python -m benchmarks.speed.step``

One degree of freedom, 300 s of fixes at 10 Hz. Everything runs in turn in the same process, a
trial each, so that what else the machine does hits all alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import median
from time import process_time

import numpy as np
from rovid_core.pipeline.identification import Identification
from rovid_core.settings.run import IdentifierSettings, Scales, Settings

from benchmarks.accuracy.peers import (
    filterpy_ekf7,
    filterpy_update,
    installed,
    padasip_adapt,
    padasip_rls,
)
from benchmarks.speed.commands import show
from test.support.online_trials import CLEAN, Trial, trial
from test.support.surge import HEAVY, surge_settings

METHODS: dict[str, IdentifierSettings] = {
    'aid': IdentifierSettings(),
    'aid, raw gains, euler': IdentifierSettings(
        integrator='euler', feedback_gain=-2.0, adaptation_gains=(2e-7, 1e-1, 1e-1, 1e-2)),
    'ekf': IdentifierSettings('ekf'),
}
ALONE, PIPED = 'alone', 'in the pipeline'
EKF, UPDATE = 'filterpy EKF, 7 states', 'filterpy EKF, update alone'
RLS, ADAPT = 'padasip RLS, with its regressors', 'padasip RLS, adapt alone'
PEERS = {
    EKF: filterpy_ekf7,
    UPDATE: filterpy_update,
    RLS: lambda one: padasip_rls(one, Scales.of(HEAVY)).seconds,
    ADAPT: padasip_adapt,
}
ASKED = (('aid', EKF, 0.1), ('aid', UPDATE, 0.1), ('aid', RLS, 0.2), ('aid', ADAPT, 0.2),
         ('ekf', EKF, 1.0))
"""Method, peer, and the ratio of their times that is asked for."""

Work = Callable[[Trial], float]
"""Seconds per step on a trial."""


def alone(settings: Settings) -> Work:
    """Return what times the method's own step."""
    def work(one: Trial) -> float:
        identifier = _dof(settings).identifier
        first, *steps = one.pieces()
        assert isinstance(first, float)
        identifier.restart(first)
        began = process_time()
        for step in steps:
            identifier.step(step)  # type: ignore[arg-type]
        return (process_time() - began) / len(steps)
    return work


def piped(settings: Settings) -> Work:
    """Return what times the step as the pipeline calls it: with status and estimate."""
    def work(one: Trial) -> float:
        dof = _dof(settings)
        first, *steps = one.pieces()
        assert isinstance(first, float)
        dof.identifier.restart(first)
        time = 0
        began = process_time()
        for step in steps:
            time += 100_000_000
            dof.add_step(time, step, True, 0.0)  # type: ignore[arg-type]
        return (process_time() - began) / len(steps)
    return work


def _dof(settings: Settings) -> Identification:
    return Identification(settings, settings.dofs[0], _ignore)


def works() -> dict[tuple[str, str], Work]:
    """Return everything that is timed, by method and way."""
    found: dict[tuple[str, str], Work] = {}
    for name, identifier in METHODS.items():
        settings = replace(surge_settings(HEAVY), identifier=identifier)
        found[name, ALONE] = alone(settings)
        found[name, PIPED] = piped(settings)
    if installed():
        found.update({(name, ''): work for name, work in PEERS.items()})
    return found


def measure(works: Mapping[tuple[str, str], Work], runs: int) -> dict[
        tuple[str, str], list[float]]:
    """Let everything have its turn ``runs`` times; return the times per step [s]."""
    found: dict[tuple[str, str], list[float]] = {name: [] for name in works}
    for seed in range(-1, runs):  # the first time everything warms up
        one = trial(CLEAN, max(seed, 0))
        for name, work in works.items():
            seconds = work(one)
            if seed >= 0:
                found[name].append(seconds)
    return found


def table(found: Mapping[tuple[str, str], Sequence[float]]) -> str:
    """Return the times as Markdown."""
    base = median(found['aid', PIPED])
    lines = ['| method | | per step [us] | lowest to highest | ratio to aid in the pipe |',
             '|---|---|---|---|---|']
    for (name, way), seconds in found.items():
        micro = [1e6 * x for x in seconds]
        lines.append(f'| {name} | {way} | {median(micro):.2f} | {min(micro):.2f} to '
                     f'{max(micro):.2f} | {median(seconds) / base:.2f} |')
    return '\n'.join(lines)


def ratios(found: Mapping[tuple[str, str], Sequence[float]]) -> str:
    """Return what is asked for and what it is, as Markdown."""
    lines = ['| method | peer | asked | alone | in the pipe | lowest to highest |',
             '|---|---|---|---|---|---|']
    for method, peer, asked in ASKED:
        if (peer, '') not in found:
            continue
        cells = [_ratio(found[method, way], found[peer, '']) for way in (ALONE, PIPED)]
        each = np.array(found[method, PIPED]) / np.array(found[peer, ''])
        lines.append(f'| {method} | {peer} | {asked:g} | {cells[0]:.3f} | {cells[1]:.3f} | '
                     f'{each.min():.3f} to {each.max():.3f} |')
    return '\n'.join(lines)


def _ratio(one: Sequence[float], other: Sequence[float]) -> float:
    return median(one) / median(other)


def _ignore(*_: str) -> None:
    """Take a refusal or a warning."""


def lines(runs: int) -> list[str]:
    """Return the tables, and what they are of."""
    found = measure(works(), runs)
    return [f'One step of one DOF, processor time, {runs} runs in turn. *Alone* is the method; '
            '*in the pipe* is with status, excitation, watchers and the estimate that '
            'is handed on.', '', table(found), '', ratios(found)]


if __name__ == '__main__':
    show(__doc__, lines, 7)
