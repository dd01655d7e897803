"""What a model's errors over a minute follow, on vehicles that are not the model."""

from dataclasses import replace
from random import Random

import pytest
from rovid_core.identify.last_minute import LastMinute, UNTOLD_DEAD_BAND
from rovid_core.model.plant import advance, lumped
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


def doubt(kind, model=TRUTH, duration=70.0, guess=GUESS):
    minute = LastMinute(Scales.of(guess))
    for piece in pieces(VEHICLES[kind], 1, duration):
        if isinstance(piece, Step):
            minute.add_step(piece, model)
    return minute.doubt(False)


def test_the_truth_is_not_doubted_after_a_minute():
    assert doubt('exact', duration=50.0) == 'the model has not predicted a minute yet'
    assert doubt('exact') == ''


@pytest.mark.parametrize(('kind', 'name', 'advice'), [
    ('dead-band 3 N', 'a dead band of the thrusters', ': see thrusters.dead_zone'),
    ('reverse thrust x 0.8', 'reverse thrust', ': see thrusters.reverse'),
    ('reverse drag x 1.3', 'reverse drag', ': add couplings: [reverse_drag]'),
    ('lag 0.15 s', 'a lag of the thrusters', ': see thrusters.time_constant'),
    ('thrust that fades at 3 m/s', 'thrust that falls with speed', '')])
def test_what_the_vehicle_has_and_the_model_has_not_is_named(kind, name, advice):
    assert doubt(kind).endswith(
        f'of the error follows {name}, which the model does not have{advice}')


def test_a_dead_band_is_named_also_where_the_guess_is_far_too_strong():
    guess = replace(GUESS, typical_force=4.0 * Scales.of(GUESS).force)
    assert 'a dead band of the thrusters' in doubt('dead-band 3 N', guess=guess)


def test_a_dead_band_hides_behind_the_mass_where_thrust_has_one_size():
    part = 20.0 / 17.0
    seen = lumped(part * MASS, part * QUADRATIC, part * LINEAR, part * BIAS)
    assert doubt('dead-band, 20 N or -20 N', seen) == UNTOLD_DEAD_BAND


@pytest.mark.parametrize(('factor', 'asked'), [(1.2, 'smaller'), (0.8, 'larger')])
def test_another_mass_is_told(factor, asked):
    model = lumped(factor * MASS, QUADRATIC, LINEAR, BIAS)
    assert doubt('exact', model) == f'the last minute by itself asks for a {asked} mass'


def coasting(speed):
    """Return the steps of a vehicle that comes to rest, with 5 mm of noise on its fixes."""
    random, dt = Random(1), 0.1
    fixes, middles, x, v = [], [speed], 0.0, speed
    for _ in range(700):
        fixes.append(x + random.gauss(0.0, 0.005))
        middle = advance(TRUTH, v, 0.0, 0.5 * dt)
        x += dt * middle
        v = advance(TRUTH, middle, 0.0, 0.5 * dt)
        middles.append(middle)
    means = [(after - before) / dt for before, after in zip(fixes, fixes[1:])]
    return [Step(dt, (a, 0.5 * (a + b), b), (0.0,) * 3, mean, dt, (0.05, 0.05))
            for a, b, mean in zip(middles[1:], middles[2:], means[1:])]


def test_without_thrust_the_mass_does_not_show():
    minute = LastMinute(Scales.of(GUESS))
    for step in coasting(2.0):
        minute.add_step(step, TRUTH)
    assert minute.doubt(False) == 'the mass does not show'


@pytest.mark.parametrize('force', [0.0, 1e-130, 1e-170])
def test_thrust_that_has_faded_away_does_not_show_the_mass(force):
    minute = LastMinute(Scales.of(GUESS))
    for k in range(700):
        last = force * 0.9**k if k % 10 else 0.0
        minute.add_step(Step(0.1, (0.0,) * 3, (last,) * 3, 0.0, 0.1, (0.05, 0.05), (last, 0.0)),
                        TRUTH)
    assert minute.doubt(False) in ('the mass does not show',
                                   'without corrections it predicts 0 % of the motion')


def test_a_poor_prediction_is_told():
    alpha, *rest = TRUTH
    assert doubt('exact', (2.0 * alpha, *rest)).startswith('without corrections it predicts')
