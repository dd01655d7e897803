"""
Tell what the extended Kalman filter makes of real recordings, each alone.

Each recording of a vehicle trains a model, which is scored on that recording and on the others,
beside output error trained on the same data. The folders are those beside that of the tank
recordings, each with the configuration that a user would write.

Usage: python -m benchmarks.accuracy.recordings FOLDER [--only NAME]
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rovid_core.model.thrusters import Thrusters
from rovid_core.settings.run import IdentifierSettings, Scales, Settings
from rovid_core.trials.offline import METHODS
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.markdown import table
from test.support.tank import replayed

RECORDINGS = {
    'bluerov_pool': ('yaw.yaml', ('yaw_1.bag', 'yaw_2.bag', 'yaw_4.bag')),
    'bluerov2_trajectories': (
        'bluerov2.yaml', ('run1.mcap', 'run5.mcap', 'run8.mcap', 'run13.mcap')),
    'subjugator': (
        'subjugator.yaml', ('backward4.bag', 'forward4.bag', 'left2.bag', 'right3.bag')),
    'blueboat': ('blueboat.yaml', ('bb220.mcap', 'bb235.mcap')),
    'tauv': ('tauv.yaml', ('mission.mcap',)),
}
"""Folder, configuration and recordings."""


class Models(NamedTuple):
    """Parameters of both methods, and what the filter says."""

    ekf: tuple[float, ...]
    offline: tuple[float, ...]
    delay: float
    thrusters: Thrusters
    status: str
    reasons: tuple[str, ...]


def models(name: str, folder: Path, settings: Settings) -> dict[str, Models]:
    """Return what a recording makes of each DOF."""
    scores, estimate = replayed(folder, name, settings)
    found = {}
    for dof in estimate.dofs:
        fit = METHODS['output_error'](
            scores.records(dof.dof), Scales.of(settings.dof[dof.dof]), settings)
        found[dof.dof] = Models(
            (*dof.parameters, *dof.couplings), (*fit.parameters, *fit.couplings), dof.delay,
            dof.thrusters, dof.judgement.status, dof.judgement.reasons)
    return found


def main() -> None:
    """Print a table per vehicle."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--only', default='')
    given = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(2) as pool:
        for vehicle, (configuration, names) in RECORDINGS.items():
            folder = given.folder.parent / vehicle
            if given.only not in vehicle or not folder.is_dir():
                continue
            settings = replace(settings_from(load(folder / configuration)),
                               identifier=IdentifierSettings('ekf'))
            trained = list(pool.map(partial(models, folder=folder, settings=settings), names))
            judges = [replayed(folder, name, settings)[0] for name in names]
            for k, name in enumerate(names):
                for dof, (ekf, offline, *found, status, reasons) in trained[k].items():
                    fits = np.array([[100.0 * judge.score(dof, *model).fit
                                      for model in ((ekf, *found), (offline,))]
                                     for judge in judges])
                    others = np.delete(fits, k, axis=0)
                    rows.append((
                        f'{vehicle}, {Path(name).stem}', dof,
                        *(f'{x:.0f}' for x in fits[k]),
                        *(' '.join(f'{x:.0f}' for x in column) for column in others.T),
                        status, reasons[0] if reasons else ''))
    print(table(('trained on', 'DOF', 'own fit [%]', 'output error', 'on the others',
                 'output error', 'status', 'first reason'), rows))


if __name__ == '__main__':
    main()
