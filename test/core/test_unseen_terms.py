"""What a vehicle may have that the data do not tell: it belongs to the intervals."""

from dataclasses import replace
import json
import math

import numpy as np
import pytest
from rovid_core.identify.ekf.evidence.missing_terms import described
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.evidence.unseen_terms import (
    averaged,
    by_question,
    expected,
    judged,
    summed,
)
from rovid_core.identify.ekf.extended_kalman import ExtendedKalman
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.intervals import intervals
from rovid_core.identify.status import DofStatus
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

from test.support.real_vehicles import GUESS, MASS, pieces, VEHICLES

SCALES = replace(Scales.of(GUESS), watched=('vr',))
UNIT = np.eye(2)


def said(name, seed, duration, scales=SCALES):
    """Return, per step, whether it has converged, whether its interval holds, and the reasons."""
    one, status, found = ExtendedKalman(scales), DofStatus(scales, 3.0), []
    for piece in pieces(VEHICLES[name], seed, duration):
        if not isinstance(piece, Step):
            one.restart(piece)
            continue
        judged = status.update(one, piece, one.step(piece), True)
        low, high = intervals(one.parameters, one.covariance).get('mass', (-math.inf, math.inf))
        found.append((judged.status == 'converged', low <= MASS <= high, judged.reasons))
    return found


@pytest.mark.parametrize('name', ['dead-band, 20 N or -20 N', 'dead-band, 5 N or -5 N'])
def test_thrust_of_one_size_cannot_tell_the_mass_from_a_dead_band(name):
    """The model is right with a mass that is 18 or 150 % too large."""
    for seed in range(2):
        found = said(name, seed, 150.0)
        assert not any(converged and not holds for converged, holds, _ in found)
        assert 'push at several sizes' in ' '.join(found[-1][2])


@pytest.mark.long
@pytest.mark.parametrize('seed', range(4))
def test_two_kinds_of_lag_make_a_dead_band_no_less_likely(seed):
    *_, (_, holds, _) = said('dead-band, 5 N or -5 N', seed, 300.0)
    assert holds


def test_what_matters_little_is_not_asked_for():
    *_, (converged, _, reasons) = said('exact', 0, 150.0)
    assert converged
    assert not any('cannot be told' in reason for reason in reasons)


def test_a_guess_that_is_far_too_strong_hides_no_dead_band():
    strong = replace(SCALES, force=10.0 * SCALES.force)
    *_, (_, _, reasons) = said('exact', 0, 150.0, strong)
    assert not any('push at several sizes' in reason for reason in reasons)


@pytest.mark.parametrize(('size', 'coefficient', 'name'), [
    (0.5, -0.4, 'reverse_drag'), (1e-4, -2000.0, None)])
def test_a_coefficient_that_nothing_can_have_is_chance(size, coefficient, name):
    """Both explain as much; the second regressor hardly acts."""
    theta, random = [0.5, -1.0, -0.2, 0.0, 0.0], np.random.default_rng(0)
    blocks = ScoreBlocks(theta, [1.0] * 5, ['reverse_drag'])
    for _ in range(16000):
        psi = random.normal(size=6)
        psi[-1] *= size
        blocks.add(random.normal() + psi[:5] @ theta + coefficient * psi[5], 1.0, psi.tolist(),
                   0.025)
    missing = blocks.verdict().missing
    assert (missing and missing.name) == name


def of_two(name, coefficient, alike, seed=0, own=0.2):
    """Return what is said of a thrust and of what is missing, which may be much like it."""
    blocks, random = ScoreBlocks([1.0, *[0.0] * 4], [1.0, *[0.0] * 4], ['reverse_thrust', name]), (
        np.random.default_rng(seed))
    for _ in range(16000):
        thrust, other, reverse = random.normal(size=3)
        other = alike * thrust + own * other
        blocks.add(thrust + coefficient * other + random.normal(), 1.0,
                   [thrust, *[0.0] * 4, reverse, other], 0.025)
    return blocks.verdict()


@pytest.mark.parametrize(('alike', 'named'), [(1.0, 'pq'), (0.0, None)])
def test_what_explains_little_is_named_where_the_mass_depends_on_it(alike, named):
    """Where measurements come fast their noise is most of the error, whatever is missing."""
    missing = of_two('pq', 0.3, alike).missing
    assert (missing and missing.name) == named
    if missing:
        assert 'less than 1 % of the error' in described(missing, [1.0, *[0.0] * 4], SCALES)


@pytest.mark.parametrize(('coefficient', 'own', 'wide'), [
    (-0.14, 0.2, True), (0.14, 0.2, False), (0.0, 0.2, False), (0.0, 0.005, False)])
def test_each_thruster_is_weaker_backwards_only_where_the_data_say_so(coefficient, own, wide):
    """Where one of two always runs backwards, nothing but a larger mass may come of it."""
    verdicts = [of_two('reverse_of_each', coefficient, 1.0, seed, own) for seed in range(5)]
    alpha = [math.sqrt(one.covariance[0][0]) for one in verdicts if not one.missing]
    assert (max(alpha) > 0.05) is wide


@pytest.mark.long
@pytest.mark.parametrize('name', [
    'dead-band 3 N', 'reverse thrust x 0.8', 'reverse drag x 1.3', 'coupled'])
def test_the_interval_holds_before_blocks_can_judge_the_model(name):
    # at 40 and 55 s
    found = [said(name, seed, 55.0) for seed in range(4)]
    assert sum(one[400][1] + one[-1][1] for one in found) >= 7


def test_thrust_may_fall_by_what_the_data_do_not_show():
    """By 4 %, known to 3: the interval holds what alpha was in the beginning, and in the end."""
    held = {1.0: 0, 0.96: 0}
    for seed in range(20):
        blocks = ScoreBlocks((1.0, -0.5, 0.0), (1.0, 1.0, 1.0), ())
        random = np.random.default_rng(seed)
        for k in range(6000):  # 5 min
            psi = random.normal(size=3)
            told = psi[0] * (1.0 - 0.04 * k / 6000) - 0.5 * psi[1]
            blocks.add(told + 0.7 * random.normal(), 0.49, psi.tolist(), 0.05)
        verdict, alpha = blocks.verdict(), blocks.solution()[0][0]
        assert not verdict.drift
        for true in held:
            held[true] += abs(alpha - true) < 1.96 * math.sqrt(verdict.covariance[0][0])
    assert min(held.values()) >= 17


def test_a_term_that_data_tell_adds_next_to_nothing():
    """Its size is a hundred standard deviations, and it is not there."""
    sharp, blunt = [judged([3.0, 0.0], 0.0, known, 1.0, 0) for known in (1e4, 0.0)]
    assert averaged([sharp], UNIT)[0, 0] < 0.01
    assert summed([sharp], 2)[0, 0] < 1e-3 * summed([blunt], 2)[0, 0]
    assert averaged([sharp], UNIT)[1, 1] == 0.0


def test_a_term_that_is_there_is_counted_with_its_size():
    found = judged([0.5, 0.0], 1.0, 1e4, 1.0, 0)
    assert found.mean == pytest.approx(1.0, rel=1e-3)
    assert found.evidence > 1000.0
    # the half width of what lies about 0.5, whichever way it is off
    assert math.sqrt(1.0 + averaged([found], UNIT)[0, 0]) * 1.96 == pytest.approx(
        0.5 + 1.645, abs=0.15)


@pytest.mark.parametrize('sign', [0, -1, 1])
@pytest.mark.parametrize(('coefficient', 'information'), [
    (0.0, 0.0), (1.2, 3.0), (-0.7, 40.0), (-1.5, 60.0), (1.0, 100.0)])
def test_what_data_say_of_a_term_is_bayes(coefficient, information, sign):
    std = 0.8
    found = judged([1.0], coefficient, information, std, sign)
    x = np.linspace(-12.0, 12.0, 1_000_001)
    prior = np.exp(-0.5 * (x / std)**2)
    if sign:
        prior[sign * x < 0.0] = 0.0
    prior /= prior.sum()
    # the likelihood over the one without the term
    both = prior * np.exp(information * x * (coefficient - 0.5 * x))
    mean = (x * both).sum() / both.sum()
    assert found.evidence == pytest.approx(math.log(both.sum()), abs=3e-3)
    assert found.mean == pytest.approx(mean, rel=1e-3, abs=1e-4)
    assert found.variance == pytest.approx(((x - mean)**2 * both).sum() / both.sum(), rel=5e-3)


def test_the_interval_is_that_of_the_average_over_vehicles_with_and_without():
    terms = [judged([2.0, 0.1], 0.4, 5.0, 1.0, 0),
             replace(judged([-1.0, 3.0], -0.3, 2.0, 0.5, -1), weight=0.25)]
    covariance = np.array([[1.0, 0.3], [0.3, 0.5]])
    whole = covariance + averaged(terms, covariance)
    random = np.random.default_rng(0)
    odds = np.array([1.0, *[share * math.exp(term.evidence)
                            for share, term in zip((0.8, 0.2), terms)]])
    which = random.choice(3, 400_000, p=odds / odds.sum())
    for i in range(2):
        # either way of the estimate, for nobody knows on which side it is
        mean = np.array([0.0, *[term.leaning[i] * term.mean for term in terms]])[which]
        variance = np.array([0.0, *[term.leaning[i]**2 * term.variance for term in terms]])[which]
        off = random.normal(mean, np.sqrt(covariance[i, i] + variance))
        assert np.mean(abs(off) < 1.96 * math.sqrt(whole[i, i])) == pytest.approx(0.95, abs=2e-3)
    assert np.linalg.eigvalsh(whole).min() > 0.0


def test_weaker_thrust_backwards_and_with_speed_come_on_top_of_all_else():
    terms = dict.fromkeys(('sway lag', 'sway reverse_thrust', 'sway dead_band',
                           'sway thrust_loss'), judged([1.0], 0.0, 0.0, 1.0, 0))
    assert [set(group) for group in by_question(terms)] == [
        {'sway lag', 'sway dead_band'}, {'sway thrust_loss'}, {'sway reverse_thrust'}]


def test_the_sizes_are_those_of_thrusters_and_hulls():
    sizes = expected([2.0, -1.0, -0.5, 0.0, 0.0])
    assert sizes == {'reverse_thrust': (0.5, 0), 'reverse_drag': (pytest.approx(0.45), 0),
                     'dead_band': (2.0, -1), 'lag': (2.0, -1), 'turns_lag': (2.0, -1),
                     'thrust_loss': (0.5, -1)}


def test_a_force_that_bends_is_taken_of_each_command():
    recent = DelayedForce()
    recent.add([(0.3, 2.0), (0.2, -1.0), (0.1, 0.05), (0.4, -0.5)], held=True)
    for start, end in ((0.05, 0.95), (0.31, 0.45), (-0.5, 0.4), (0.45, 1.3), (1.2, 1.4)):
        time = np.linspace(start, end, 200_001)
        force = np.select([time < 0.3, time < 0.5, time < 0.6], [2.0, -1.0, 0.05], -0.5)
        for got, bent in zip(recent.bent(start, end), (
                np.minimum(force, 0.0), np.clip(force, -0.2, 0.2))):
            assert got[0] == pytest.approx(np.trapezoid(bent, time), abs=1e-4)
            assert got[1] == pytest.approx(np.trapezoid(bent * (end - time), time), abs=1e-4)
    assert DelayedForce().bent(0.0, 1.0) == ((0.0, 0.0), (0.0, 0.0))


def test_what_nothing_tells_yet_goes_on_after_a_restore():
    steps = pieces(VEHICLES['dead-band 3 N'], 0, 60.0)
    one, new = ExtendedKalman(SCALES), ExtendedKalman(SCALES)
    one.restart(steps[0])
    for step in steps[1:330]:
        one.step(step)
    new.restore(json.loads(json.dumps(one.state())))
    assert (new.covariance, new.uncertainty.delay_std) == (
        one.covariance, one.uncertainty.delay_std)
    for step in steps[330:]:
        one.step(step)
        new.step(step)
    assert new.covariance == one.covariance
