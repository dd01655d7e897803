"""What a model's errors over a minute follow, on vehicles that are not the model."""

import pytest
from rovid_core.identify.last_minute import LastMinute
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

from test.support.real_vehicles import (
    BIAS,
    GUESS,
    LINEAR,
    MASS,
    pieces,
    QUADRATIC,
    TRUTH,
    VEHICLES,
)


def doubt(kind, model=TRUTH, duration=70.0):
    minute = LastMinute(Scales.of(GUESS))
    for piece in pieces(VEHICLES[kind], 1, duration):
        if isinstance(piece, Step):
            minute.add_step(piece, model)
    return minute.doubt(False)


def test_the_truth_is_not_doubted_after_a_minute():
    assert doubt('exact', duration=50.0) == 'the model has not predicted a minute yet'
    assert doubt('exact') == ''


@pytest.mark.parametrize(('kind', 'name'), [
    ('dead-band 3 N', 'dead band'), ('reverse thrust x 0.8', 'reverse thrust'),
    ('reverse drag x 1.3', 'reverse drag'), ('lag 0.15 s', 'lag')])
def test_what_the_vehicle_has_and_the_model_has_not_is_named(kind, name):
    assert doubt(kind).endswith(f'of the error follows {name}, which the model does not have')


@pytest.mark.parametrize(('factor', 'asked'), [(1.2, 'smaller'), (0.8, 'larger')])
def test_another_mass_is_told(factor, asked):
    model = lumped(factor * MASS, QUADRATIC, LINEAR, BIAS)
    assert doubt('exact', model) == f'the last minute by itself asks for a {asked} mass'


def test_a_poor_prediction_is_told():
    alpha, *rest = TRUTH
    assert doubt('exact', (2.0 * alpha, *rest)).startswith('without corrections it predicts')
