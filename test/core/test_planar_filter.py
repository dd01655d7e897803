"""The filter of surge and sway: its linearisation, and what it takes up from."""

import json

import numpy as np
import pytest
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.planar.filter_with_current import PlanarFilter
from rovid_core.identify.ekf.planar.layout import Row
from rovid_core.identify.ekf.planar.member import PlanarClock
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import CANDIDATES
from rovid_core.identify.ekf.single.watched_lag import LAGS, SECOND_LAG
from rovid_core.model.dofs import EACH
from rovid_core.model.samples import PlanarPiece, PlanarStep
from rovid_core.model.thrusters import AS_CONFIGURED, DEAD_BAND, Thrusters

ROWS = (Row(0, 6, 0.5, 4, ()), Row(6, 13, 0.4, 10, ((11, 0),)))
THETA = [0.6, -0.5, -0.2, 0.05, 0.3, 0.04, 0.5, -0.4, -0.1, -0.03, -0.35, 0.2, 0.03, 0.15, -0.1]
STEP = 0.1


def _moved(theta, velocity=(0.3, -0.1), count=12, thrusters=(AS_CONFIGURED, AS_CONFIGURED)):
    """Return a filter that went along a turn under a force that changes evenly."""
    filter = PlanarFilter(ROWS, theta, [0.0] * 15, thrusters=thrusters)
    filter.set_motion(velocity, (1.0, 0.0, 0.0, 1.0), 0.01, 0.0)
    filter.set_position((2.0, 3.0), 0.0)
    recent = DelayedForce(), DelayedForce()
    for k in range(count + 10):
        recent[0].add([(STEP, 0.2 + 0.08 * k)])
        recent[1].add([(STEP, 0.9 - 0.06 * k)])
    for k in range(count):
        heading, rate = 0.05 * k, 0.5
        c, s = np.cos(heading + 0.025), np.sin(heading + 0.025)
        filter.move(recent, 0.5 + STEP * k, 0.5 + STEP * (k + 1),
                    [PlanarPiece(c, s, -s, c, 0.02, -0.01, rate)], ((), (0.3,)), 0.0)
    return filter


@pytest.mark.parametrize('thrusters', [
    (AS_CONFIGURED, AS_CONFIGURED), (Thrusters(loss=0.3), Thrusters(loss=0.2))])
@pytest.mark.parametrize('i', range(len(THETA)))
def test_sensitivities_are_the_derivatives_of_the_motion(i, thrusters):
    """Current and parameters, through drag, turning couplings and the path in the world."""
    size = 1e-5
    ahead, behind = ([x + sign * size * (k == i) for k, x in enumerate(THETA)]
                     for sign in (1.0, -1.0))
    slope = (_moved(ahead, thrusters=thrusters).motion
             - _moved(behind, thrusters=thrusters).motion) / (2.0 * size)
    found = _moved(THETA, thrusters=thrusters).sensitivities[:, i]
    assert found == pytest.approx(slope, rel=0.02, abs=2e-3 * max(abs(slope).max(), 1e-6))


def test_covariance_of_the_motion_is_that_of_motions_which_began_otherwise():
    """That of the velocity in the beginning, carried along by differences."""
    filter = _moved(THETA)
    slopes = [(_moved(THETA, ahead).motion - _moved(THETA, behind).motion) / 2e-4
              for ahead, behind in (((0.3001, -0.1), (0.2999, -0.1)),
                                    ((0.3, -0.0999), (0.3, -0.1001)))]
    expected = 0.01 * sum(np.outer(slope, slope) for slope in slopes)
    assert filter.covariance[:4, :4] == pytest.approx(expected[:4, :4], rel=0.02, abs=1e-5)


def test_fixes_that_come_fast_are_one_measurement_of_their_mean():
    """At 100 Hz, while heading, velocities and what they are coupled with change evenly."""
    clocks, found = [PlanarClock((2.0, 3.0), (1, 0)) for _ in range(2)], []
    for k in range(17):
        time = 0.01 * k + 0.005
        step = PlanarStep(0.01, (0.0, 0.0), 0.01, (0.005, 0.005), ((k, k), (0.0, 0.0)),
                          (time, -time), (PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, time),),
                          (1.0, 0.0, 0.0, 1.0), 0.1, ((time,), ()), ((), ()))
        found += [one for one in [clocks[0].add_step(step)] if one is not None]
        clocks[1].restore(json.loads(json.dumps(clocks[0].state())))
        clocks.reverse()  # a saved clock goes on as if it had not been
    first, *spans = found
    assert first.begins
    assert len(spans) == 4
    assert [span.end for span in spans] == pytest.approx([0.03, 0.07, 0.11, 0.15])
    assert [span.start for span in spans] == [first.end, *[span.end for span in spans[:-1]]]
    for span in spans:
        assert span.value == pytest.approx((span.end, -span.end))
        assert span.dt == pytest.approx(0.04)
        assert span.heading_noise == pytest.approx(0.1)
        (piece,) = span.pieces
        # a step has the mean since the fix before
        mean = 0.5 * (span.start + span.end) + 0.005
        assert piece.rate == pytest.approx(mean, abs=2e-3)
        assert span.couplings == ((pytest.approx(mean, abs=2e-3),), ())


def test_a_body_at_rest_in_the_water_drifts_with_it():
    """Without force or heave, at any heading."""
    theta = [0.0] * 15
    theta[0] = theta[6] = 0.5
    theta[13:] = 0.2, -0.1
    filter = PlanarFilter(ROWS, theta, [0.0] * 15)
    filter.set_motion((0.0, 0.0), (0.0, 1.0, -1.0, 0.0), 0.0, 0.0)
    filter.motion[2:4] = 0.0
    filter.set_position((1.0, 1.0), 0.0)
    filter.move((DelayedForce(), DelayedForce()), 0.0, 2.0,
                [PlanarPiece(0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.1)], ((), (0.0,)), 0.0)
    assert filter.motion[:2] == pytest.approx([1.4, 0.8])


def test_one_that_takes_up_over_ground_has_the_velocity_through_the_water():
    """And what it does not know of the current is in the velocity, too."""
    filter = PlanarFilter(ROWS, THETA, [*[0.0] * 13, 0.09, 0.09])
    filter.set_motion((0.3, 0.2), (0.0, 1.0, -1.0, 0.0), 0.01, 0.0)
    assert filter.motion[2:4] == pytest.approx([0.3 - THETA[14], 0.2 + THETA[13]])
    along = filter.sensitivities[2:4, :15]
    spread = along @ filter.theta_covariance @ along.T + filter.covariance[2:4, 2:4]
    assert spread == pytest.approx(0.1 * np.eye(2))


def test_a_current_that_nobody_saw_may_have_changed():
    """Its variance grows by the gap."""
    filter = PlanarFilter(ROWS, THETA, [0.0] * 15, current_change=1e-5)
    filter.set_motion((0.0, 0.0), (1.0, 0.0, 0.0, 1.0), 0.01, 100.0)
    assert filter.current(filter.theta_covariance)[1] == pytest.approx(1e-3 * np.eye(2))


COMMANDS = np.array([0.9, -0.7, 0.1, -0.1, 0.6, -1.0, 0.15, 0.8, -0.3, -0.9, 0.5, 0.05])
BEND = DEAD_BAND * (abs(COMMANDS)**3).sum() / (COMMANDS**2).sum()


@pytest.mark.parametrize('k', [0, 1])
@pytest.mark.parametrize(('column', 'bent'), [
    (0, lambda force: np.minimum(force, 0.0)),
    (2, lambda force: DEAD_BAND * np.clip(force / BEND, -1.0, 1.0))])
def test_what_bends_with_the_thrust_is_taken_of_each_command(k, column, bent):
    """Weaker reverse thrust and a dead band, where commands jump within a measurement."""
    def moved(size):
        filter = PlanarFilter(ROWS, THETA, [0.0] * 15)
        filter.set_motion((0.3, -0.1), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)
        filter.set_position((2.0, 3.0), 0.0)
        recent = DelayedForce(), DelayedForce()
        for i, one in enumerate(recent):
            alpha = THETA[ROWS[i].first]
            forces = COMMANDS + (size / alpha * bent(COMMANDS) if i == k else 0.0)
            one.add([(0.07, force) for force in forces], held=True)
        for i in range(3):
            filter.move(recent, 0.1 + 0.2 * i, 0.3 + 0.2 * i,
                        [PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)], ((), (0.3,)), 0.0)
        return filter

    slope = (moved(1e-4).motion - moved(-1e-4).motion) / 2e-4
    found = moved(0.0).sensitivities[:, len(THETA) + len(CANDIDATES) * k + column]
    assert found[:4] == pytest.approx(slope[:4], rel=0.02, abs=2e-3 * abs(slope).max())


def test_thrust_that_falls_with_speed_is_linear_drag_under_a_force_that_stays():
    filter, recent = PlanarFilter(ROWS, THETA, [0.0] * 15), (DelayedForce(), DelayedForce())
    filter.set_motion((0.3, -0.1), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)
    for one, force in zip(recent, (-0.49, 0.25)):
        one.add([(1.0, force)], held=True)
    filter.move(recent, 0.2, 0.8, [PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)],
                ((), (0.3,)), 0.0)
    for k, root in enumerate((0.7, 0.5)):
        drag = filter.sensitivities[:4, ROWS[k].first + 2]
        loss = len(THETA) + len(CANDIDATES) * k + CANDIDATES.index('thrust_loss')
        assert abs(drag).max() > 0.0
        assert filter.sensitivities[:4, loss] == pytest.approx(root * drag)


def test_a_filter_that_begins_under_way_sees_no_lag_in_the_thrust_there_is():
    filter, recent = PlanarFilter(ROWS, THETA, [0.0] * 15), (DelayedForce(), DelayedForce())
    filter.set_motion((-1.0, 1.0), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)
    for one, force in zip(recent, (-0.49, 0.25)):
        one.add([(1.0, force), (1.0, -force)], held=True)
    lags = [len(THETA) + len(CANDIDATES) * k + CANDIDATES.index(name)
            for k in range(2) for name in (*LAGS, SECOND_LAG)]
    for begin, least, most in ((0.0, 0.0, 1e-12), (1.0, 1e-3, 1.0)):
        filter.move(recent, begin, begin + 1.0, [
            PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)] * 5, ((), (0.3,)), 0.0)
        sizes = abs(filter.sensitivities[:4, lags]).max(axis=0)
        assert least <= sizes.min() and sizes.max() <= most


def test_what_one_thruster_does_by_itself_is_what_the_force_of_its_dof_does():
    """Of sway, which alone has thrusters that drive another DOF; a step brings one more."""
    rows = ROWS[0]._replace(watched=1), ROWS[1]._replace(watched=1 + len(EACH), shares=True)
    filter, recent = PlanarFilter(rows, THETA, [0.0] * 15), (DelayedForce(), DelayedForce())
    filter.set_motion((0.3, -0.1), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)
    filter.set_position((2.0, 3.0), 0.0)
    for one in recent:
        one.add([(0.07, force) for force in COMMANDS], True, each=[
            (min(force, 0.0), DEAD_BAND * np.clip(force / BEND, -1.0, 1.0), 2.0)
            for force in COMMANDS])
    filter.move(recent, 0.1, 0.3, [PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)],
                ((0.0, 0.5), (0.3, 0.0, 0.6)), 0.0)
    sway = filter.sensitivities[:4, len(THETA) + len(CANDIDATES) + 1:]
    for name, other in zip(('reverse_thrust', 'dead_band'), EACH):
        known, each = (sway[:, (*CANDIDATES, *EACH).index(x)] for x in (name, other))
        assert each == pytest.approx(known)
        assert abs(each).max() > 0.0
    # the root of the force stays the same
    assert sway[:, len(CANDIDATES) + 2] == pytest.approx(
        2.0 * filter.sensitivities[:4, ROWS[1].first + 2])
    delta = filter.sensitivities[:4, ROWS[1].first + 3]
    assert sway[:, len(CANDIDATES) + 3] == pytest.approx(0.6 * delta)


def test_each_dof_has_its_own_doubt():
    """Sway's dead band looks like its mass, surge's thrust has many sizes."""
    theta = [0.5, -1.0, -0.2, 0.0, 0.5, -1.0, -0.2, 0.0]
    watched = ['surge dead_band', 'sway dead_band']
    blocks = ScoreBlocks(theta, [1.0] * 8, watched, rows=(('surge ', 0), ('sway ', 4)))
    random = np.random.default_rng(0)
    for _ in range(16000):
        psi = np.zeros(10)
        k = random.integers(2)
        psi[4 * k:4 * k + 4] = random.normal(size=4)
        psi[8 + k] = random.normal() if k == 0 else 0.2 * psi[4]
        blocks.add(random.normal() + psi[:8] @ theta, 1.0, psi.tolist(), 0.025)
    verdict = blocks.verdict()
    assert verdict is not None
    assert verdict.untold == ('sway dead_band',)
    assert 10.0 * verdict.covariance[0][0] < verdict.covariance[4][4]
