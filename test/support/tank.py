"""The tank recordings through the real pipe, and what the methods make of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import IdentifierSettings, Scales, Settings
from rovid_core.trials.offline import METHODS
from rovid_core.trials.score import Score, ScoreLog
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.converter import Converter

from test.support.trials import CONFIG

LEAST = {'surge': 69, 'sway': 64, 'heave': 58, 'yaw': 45}
"""Fit [%] that is asked of the extended Kalman filter."""


TANK_LENGTH = 165.395
"""[s] Of all_axes.mcap."""


def with_couplings(settings: Settings, dof: str, couplings: tuple[str, ...]) -> Settings:
    """Return settings with other couplings of a DOF."""
    return replace(settings, dof={
        **settings.dof, dof: replace(settings.dof[dof], couplings=couplings)})


def replayed(logs: Path, name: str, settings: Settings, start: float = 0.0,
             duration: float | None = None) -> tuple[ScoreLog, Estimate]:
    """Return a part of a recording after the pipe, and the last estimate, judged on all of it."""
    scores = ScoreLog(settings)
    stream = Stream(settings, scorer=scores)
    converter = Converter(settings, stream.reject)
    with Log([logs / name]) as log:
        for message in log.messages(converter.topics, start, duration):
            for event in converter.events(message.topic, message.data, message.time):
                stream.receive(event)
    stream.end()
    assert stream.estimate is not None
    return scores, stream.estimate.replaced(dofs=tuple(
        dof.replaced(judgement=stream.judgement(dof.dof)) for dof in stream.estimate.dofs))


def measured(logs: Path, name: str, settings: Settings, start: float = 0.0,
             duration: float | None = None) -> ScoreLog:
    """Return what models are scored on; aid gives it soonest."""
    return replayed(logs, name, replace(settings, identifier=IdentifierSettings('aid')),
                    start, duration)[0]


def tank_scores(logs: Path) -> tuple[Estimate, dict[str, Score]]:
    """Train on surge_sway_heave.mcap; score on all_axes.mcap against the motion capture."""
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    _, trained = replayed(logs, 'surge_sway_heave.mcap', settings)
    validation = measured(logs, 'all_axes.mcap', settings)
    return trained, {
        d.dof: validation.score(d.dof, (*d.parameters, *d.couplings), d.delay, d.thrusters)
        for d in trained.dofs}


def offline_fits(logs: Path) -> dict[str, tuple[float, float]]:
    """Return mae and fit of output error per DOF, on data that it was not trained on."""
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    train = measured(logs, 'surge_sway_heave.mcap', settings)
    validate = measured(logs, 'all_axes.mcap', settings)
    settings = with_couplings(settings, 'yaw', ())
    first = measured(logs, 'all_axes.mcap', settings, 0.0, 0.6 * TANK_LENGTH)
    rest = measured(logs, 'all_axes.mcap', settings, 0.6 * TANK_LENGTH)
    fits = {}
    for dof, learn, judge in (('surge', train, validate), ('sway', train, validate),
                              ('heave', train, validate), ('yaw', first, rest)):
        fit = METHODS['output_error'](
            learn.records(dof), Scales.of(settings.dof[dof]), settings)
        score = judge.score(dof, (*fit.parameters, *fit.couplings))
        fits[dof] = (score.mae, score.fit)
    return fits


def online_fits(logs: Path, method: str) -> dict[str, float]:
    """
    Return the fit per DOF of what a method has in the end, on data it was not trained on.

    One set of settings, the shipped one, for all DOFs; ``surge_sway_heave`` is judged on
    ``all_axes``, yaw on the last 40 % of ``all_axes`` from its first 60 %.
    """
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    settings = replace(settings, identifier=IdentifierSettings(method))
    _, trained = replayed(logs, 'surge_sway_heave.mcap', settings)
    judge = measured(logs, 'all_axes.mcap', settings)
    _, first = replayed(logs, 'all_axes.mcap', settings, 0.0, 0.6 * TANK_LENGTH)
    rest = measured(logs, 'all_axes.mcap', settings, 0.6 * TANK_LENGTH)
    found = {d.dof: d for d in (*trained.dofs, *[d for d in first.dofs if d.dof == 'yaw'])}
    return {dof: (rest if dof == 'yaw' else judge).score(
        dof, (*d.parameters, *d.couplings), d.delay, d.thrusters).fit for dof, d in found.items()}


def yaw_fit(logs: Path, couplings: tuple[str, ...]) -> float:
    """Return the fit of yaw on short_all_axes.mcap, trained on all_axes.mcap."""
    settings = replace(with_couplings(
        settings_from(load(CONFIG / 'bluerov2_tank.yaml')), 'yaw', couplings), dofs=('yaw',))
    trained = replayed(logs, 'all_axes.mcap', settings)[1]
    yaw, = (d for d in trained.dofs if d.dof == 'yaw')
    judge = measured(logs, 'short_all_axes.mcap', settings)
    return judge.score('yaw', (*yaw.parameters, *yaw.couplings), yaw.delay, yaw.thrusters).fit
