"""The offline methods on simulated trials of one sinusoid whose truth is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

import numpy as np
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.settings.run import Scales
from rovid_core.trials.offline import adaptive_identifier, with_acceleration
from rovid_core.trials.output_error import information, noise, output_error
from rovid_core.trials.record import Record

from test.support.trials import (
    Array,
    CUTOFF,
    error,
    measured_error,
    NOISE,
    NOISES,
    trial,
    TRIALS,
    vehicle,
    Waves,
)

SEEDS = 20


Identify = Callable[[Record, Scales], Four]


def aid(record: Record, scales: Scales) -> Four:
    """Return the adaptive identifier's repeated passes."""
    return adaptive_identifier([record], scales, 3.0).parameters


def squares(record: Record, scales: Scales) -> Four:
    """Return the paper's least squares."""
    return with_acceleration([record], scales, CUTOFF).parameters


def errors_on(dof: str, waves: Waves, identify: Identify, judges: Sequence[Waves],
              seeds: int = SEEDS) -> list[float]:
    """Return the median over the seeds of a model's error on each profile."""
    truth, guess = vehicle(dof)
    models = [identify(trial(truth, waves, seed, NOISES[dof]), Scales.of(guess))
              for seed in range(seeds)]
    return [median(error(truth, model, judge) for model in models) for judge in judges]


COMPARED = (squares, aid)


def scores(dof: str, waves: Waves, seed: int,
           methods: Sequence[Identify] = COMPARED) -> list[list[float]]:
    """
    Return what each method reaches with a trial.

    Returns
    -------
    list
        Per method the paper's score on the trial itself, then the error on each trial of
        the DOF.

    """
    truth, guess = vehicle(dof)
    record = trial(truth, waves, seed, NOISES[dof])
    models = [method(record, Scales.of(guess)) for method in methods]
    return [[measured_error(record, model), *(error(truth, model, j) for j in TRIALS[dof])]
            for model in models]


def bias(dof: str, seed: int) -> list[float]:
    """
    Return what the identifier finds of a bias that only heave has, as the paper's vehicle.

    Returns
    -------
    list
        True and identified delta, then the error with and without the bias term, and the
        paper's score with and without it.

    """
    truth, guess = vehicle(dof)
    truth = (*truth[:3], truth[3] if dof == 'heave' else 0.0)
    waves = TRIALS[dof][1]
    record = trial(truth, waves, seed, NOISES[dof])
    models = [aid(record, Scales.of(replace(guess, terms=terms)))
              for terms in (PARAMETERS, PARAMETERS[:3])]
    return [truth[3], models[0][3], *(error(truth, model, waves) for model in models),
            *(measured_error(record, model) for model in models)]


def bound_ratio(seeds: int) -> tuple[Array, Array]:
    """Return relative rms errors of output error over the bound, and the bound itself."""
    truth, guess = vehicle('surge')
    waves = ((150.0, 1 / 18), (80.0, 1 / 7.3))
    scales = Scales.of(guess)
    found = np.array([
        output_error([trial(truth, waves, seed)], scales, scales.initial).parameters
        for seed in range(seeds)])
    rms = np.sqrt(np.mean((found - np.array(truth)) ** 2, axis=0))
    clean = trial(truth, waves, 0)
    bound = information([clean], scales, truth).covariance
    # for the noise that was put in, not for the one that is estimated from this seed
    sigma = np.sqrt(np.diag(bound)) * NOISE / noise_of(clean)
    return rms / sigma, sigma / np.abs(np.array(truth))


def noise_of(record: Record) -> float:
    """Return the noise that the methods see."""
    return noise([record])
