"""The thrusters with which the filter predicts a log best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.model.thrusters import AS_CONFIGURED
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import ThrusterSettings
from rovid_core.settings.run import IdentifierSettings, Settings
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.tuning.likelihood import (
    BEGIN,
    likeliest,
    next_value,
    PART,
    Prediction,
    PredictionErrors,
)
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import reading_settings
from rovid_core.trials.tuning.tune import tune
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

PRESENT = ThrusterSettings(gain=(1.0,), allocation=((1.0,),) * 6)
PARTS = 24


def worse_by(thrusters: ThrusterSettings, lag: float = 0.13, reverse: float = 0.82,
             dead_zone: float = 0.0) -> float:
    """Return by which share the errors of a filter are larger than with the true thrusters."""
    kind = 0.0 if thrusters.lag_of_turns else 0.03
    return (kind + 10.0 * (thrusters.time_constant - lag)**2
            + 2.0 * (thrusters.reverse - reverse)**2
            + 50.0 * (thrusters.dead_zone - dead_zone)**2)


class Predicted:
    """A filter whose errors are what is said, in parts that are not all as hard to predict."""

    def __init__(self, *shares: Callable[[ThrusterSettings], float], delay: float = 0.04,
                 chance: float = 2e-3) -> None:
        self.count, self._delay, self._chance = 0, delay, chance
        self._shares = shares
        self._hard = np.exp(np.random.default_rng(1).normal(0.0, 0.5, (len(shares), PARTS)))

    def __call__(self, given: Sequence[ThrusterSettings]) -> list[Prediction]:
        self.count += len(given)
        found = []
        for one in given:
            # chance is the same for the same thrusters
            chance = np.random.default_rng([
                round(1e6 * one.time_constant), round(1e6 * one.reverse), one.lag_of_turns,
                round(1e6 * one.dead_zone)]).normal(
                    0.0, self._chance, self._hard.shape)
            errors = {f'dof {k}': hard * np.exp(share(one) + luck) for k, (share, hard, luck) in
                      enumerate(zip(self._shares, self._hard, chance))}
            found.append(Prediction(errors, self._delay))
        return found


def test_finds_lag_and_reverse_thrust_and_leaves_what_there_is_not() -> None:
    predict = Predicted(worse_by, lambda one: 0.5 * worse_by(one))
    found = likeliest(PRESENT, PRESENT, 1.0, predict)
    assert found is not None
    assert found.thrusters.lag_of_turns
    assert found.thrusters.time_constant == pytest.approx(0.13, abs=0.02)
    assert found.thrusters.reverse == pytest.approx(0.82, abs=0.03)
    assert found.thrusters.dead_zone == 0.0
    assert found.delay == 0.04
    assert found.gain > found.spread > 0.0
    assert found.thrusters in found.as_good
    assert predict.count <= 22  # each takes about as long as a replay


def test_finds_a_dead_zone_and_reverse_thrust_beyond_what_is_tried_first() -> None:
    found = likeliest(PRESENT, PRESENT, 2.0, Predicted(
        lambda one: worse_by(one, 0.0, 0.55, 0.12)))
    assert found is not None
    assert found.thrusters.dead_zone == pytest.approx(0.12, abs=0.03)
    assert found.thrusters.reverse == pytest.approx(0.55, abs=0.05)


def test_nothing_that_is_chance_or_makes_a_dof_worse() -> None:
    for chance in (2e-3, 0.1):
        assert likeliest(PRESENT, PRESENT, 1.0, Predicted(
            lambda one: 0.0, chance=chance)) is None
    assert likeliest(PRESENT, PRESENT, 1.0, Predicted(
        worse_by, lambda one: -0.9 * worse_by(one))) is None


def test_what_the_filter_cannot_go_through_is_not_taken() -> None:
    works = Predicted(worse_by)

    def predict(given: Sequence[ThrusterSettings]) -> list[Prediction]:
        return [Prediction() if one.lag_of_turns else found
                for one, found in zip(given, works(given))]

    found = likeliest(PRESENT, PRESENT, 1.0, predict)
    assert found is not None and not found.thrusters.lag_of_turns
    assert likeliest(PRESENT, PRESENT, 1.0, lambda given: [Prediction() for _ in given]) is None


@pytest.mark.parametrize(('line', 'value'), [
    ({1.0: 0.0}, 1.0), ({0.0: 1.0, 2.0: 3.0}, 1.0), ({0.0: 3.0, 2.0: 1.0}, 4.0),
    ({0.75: 1.0, 1.0: 2.0}, 0.5), ({0.2: 1.0, 1.0: 2.0}, 0.1),
    ({x: (x - 0.3)**2 for x in (0.0, 0.25, 1.0)}, pytest.approx(0.3))])
def test_the_next_value_is_that_where_the_least_is_to_be_expected(
        line: dict[float, float], value: float) -> None:
    assert next_value(line) == value


@pytest.fixture(scope='module')
def rov() -> Settings:
    """Return a BlueROV2 that moves along all axes; its commands are known at once."""
    found = settings_from(load(Path(__file__).parents[2] / 'config' / 'bluerov2_ardusub.yaml'))
    return replace(found, identifier=IdentifierSettings('ekf'), thrusters=replace(
        found.thrusters, delay=0.0), simulation=replace(
            found.simulation, thruster_rate=20.0, attitude_rate=20.0))


def predicted(settings: Settings, samples: Sequence[tuple[int, str, tuple[float, ...]]],
              **thrusters: float) -> tuple[Stream, Prediction]:
    """Return how the filter predicts samples with other thrusters."""
    stream = Stream(replace(settings, thrusters=replace(settings.thrusters, **thrusters)))
    errors = PredictionErrors(stream)
    for time, name, value in samples:
        for estimate in stream.receive(Event(time, (Sample(name, value),))):
            errors.note(estimate.time)
    return stream, errors.prediction()


@pytest.mark.long
def test_the_filter_predicts_best_with_the_thrusters_that_there_are(rov: Settings) -> None:
    true = replace(rov, thrusters=replace(
        rov.thrusters, time_constant=0.2, lag_of_turns=True, reverse=0.75))
    samples = list(simulate(true, 90.0, seed=1))
    stream, right = predicted(
        rov, samples, time_constant=0.2, lag_of_turns=True, reverse=0.75)
    assert {*right.errors} == {'surge', 'heave', 'yaw'}  # that of sway is in surge
    assert all(len(errors) == math.ceil(90.0 / PART) for errors in right.errors.values())
    assert right.delay == pytest.approx(0.0, abs=0.02)
    wrong = {}
    for name, other in (('no lag', {'time_constant': 0.0}), ('of the force', {
            'lag_of_turns': False}), ('as strong', {'reverse': 1.0})):
        stream, wrong[name] = predicted(rov, samples, **{
            'time_constant': 0.2, 'lag_of_turns': True, 'reverse': 0.75, **other})
        # it is not put right on the way
        assert stream.identifier('yaw').thrusters == AS_CONFIGURED
    for name, prediction in wrong.items():
        gains = [float(np.log(prediction.errors[dof][BEGIN:] / right.errors[dof][BEGIN:]).mean())
                 for dof in right.errors]
        assert sum(gains) > 0.02, name


def test_a_method_that_predicts_nothing_has_no_errors(rov: Settings) -> None:
    settings = replace(rov, identifier=IdentifierSettings('aid'))
    assert predicted(settings, list(simulate(settings, 3.0, seed=1)))[1].errors == {}


def reader(settings: Settings, duration: float, **thrusters: float) -> Callable[
        [Settings], TuningLog]:
    """Return what reads the log of a vehicle with other thrusters."""
    true = replace(settings, thrusters=replace(settings.thrusters, **thrusters))
    samples = list(simulate(true, duration, seed=1))

    def read(tried: Settings) -> TuningLog:
        log = TuningLog(reading_settings(tried))
        stream = Stream(reading_settings(tried), recorder=log, scorer=log)
        for time, name, value in samples:
            stream.receive(Event(time, (Sample(name, value),)))
        stream.finish()
        return log

    return read


@pytest.fixture(scope='module')
def surge() -> Settings:
    """Return the surge of the paper's vehicle."""
    values = load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml')
    return settings_from({**values, 'dofs': ['surge'], 'depth.topic': '',
                          'simulation.thruster_rate': 10.0, 'simulation.attitude_rate': 10.0})


def saying(lag: float, reverse: Any) -> Callable[[Settings], Prediction]:
    """Return a filter that predicts best with such thrusters."""
    filter = Predicted(lambda one: worse_by(one, lag, reverse), delay=0.01)
    return lambda tried: filter([tried.thrusters])[0]


@pytest.mark.long
def test_what_is_too_fast_for_blocks_the_filter_may_say(surge: Settings) -> None:
    read = reader(surge, 120.0, time_constant=0.1, lag_of_turns=True)
    assert 'thrusters.lag_of_turns' not in tune(read, surge).changes()
    shares: list[float] = []
    tuned = tune(read, surge, shares.append, predict=saying(0.1, 1.0))
    changes = tuned.changes()
    assert changes['thrusters.lag_of_turns'] is True
    assert changes['thrusters.time_constant'] == pytest.approx(0.1, abs=0.02)
    assert changes['thrusters.delay'] == 0.01  # as the filter says
    assert 'thrusters.reverse' not in changes
    [stage] = [one for one in tuned.stages if 'thrusters.time_constant' in one.keys]
    assert stage.note == (
        'thrusters.delay and thrusters.time_constant and thrusters.lag_of_turns: judged by how '
        'well ekf predicts each measurement from those before it')
    change = stage.keys['thrusters.time_constant']
    assert change.low <= change.after <= change.high
    assert shares == sorted(shares) and shares[-1] < 1.0


@pytest.mark.long
def test_what_blocks_clearly_tell_stays(surge: Settings) -> None:
    read = reader(surge, 90.0, reverse=0.8)
    told = tune(read, surge).changes()
    assert told == {'thrusters.reverse': pytest.approx(0.8, abs=0.05)}
    for filter in (saying(0.0, told['thrusters.reverse']), saying(1.5, 1.0)):
        assert tune(read, surge, predict=filter).changes() == told
