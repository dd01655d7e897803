"""The online methods on the tank recordings, through the real pipe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rovid_core.settings.run import IdentifierSettings
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.accuracy.offline_methods import replayed, TANK_LENGTH
from test.support.trials import CONFIG

LEAST = {'surge': 64, 'sway': 61, 'heave': 62, 'yaw': 32}
"""Fit [%] that is asked of the extended Kalman filter."""


def tank_fits(logs: Path, method: str) -> dict[str, float]:
    """
    Return the fit per DOF of what a method has in the end, on data it was not trained on.

    One set of settings, the default one, for all DOFs; ``surge_sway_heave`` is judged on
    ``all_axes``, yaw on the last 40 % of ``all_axes`` from its first 60 %.
    """
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    settings = replace(settings, identifier=IdentifierSettings(method))
    _, trained = replayed(logs, 'surge_sway_heave.mcap', settings)
    judge, _ = replayed(logs, 'all_axes.mcap', settings)
    _, first = replayed(logs, 'all_axes.mcap', settings, 0.0, 0.6 * TANK_LENGTH)
    rest, _ = replayed(logs, 'all_axes.mcap', settings, 0.6 * TANK_LENGTH)
    models = {d.dof: d.parameters for d in trained.dofs}
    models |= {d.dof: d.parameters for d in first.dofs if d.dof == 'yaw'}
    return {dof: (rest if dof == 'yaw' else judge).score(dof, models[dof]).fit for dof in LEAST}
