"""The thrust chain against brute-force integration."""

from dataclasses import replace
import math

from hypothesis import given, strategies as st
import numpy as np
import pytest
from rovid_core.model.lag import all_driven, all_spun, driven, spun
from rovid_core.settings.run import (
    DofSettings,
    InputSettings,
    Settings,
    SettingsError,
    ThrusterSettings,
)
from rovid_core.thrust.force_history import CommandIntake, ForceHistory, NO_PIECES
from rovid_core.thrust.thruster_curve import are_commands, thruster_model, wrench, wrench_model

from test.support.memory import lengths

NONE = (0.0, 0.0)
TWO = ThrusterSettings(
    topics=('/thrusters',), gain=(40.0, -20.0),
    allocation=((1.0, 1.0), NONE, NONE, NONE, NONE, (0.25, -0.25)))
COMMANDS = [(0, (1.0, 0.5)), (100, (2.0, -1.0)), (150, (0.0, 3.0)), (400, (-1.0, 1.0)),
            (420, (1.5, 0.0))]  # ms
MS = 1_000_000


def chain(**changes):
    thrust = ForceHistory(replace(TWO, **changes), ('surge', 'yaw'))
    for time, values in COMMANDS:
        assert thrust.add_commands(time * MS, values)
    return thrust


def brute_force(hold, delay, lag, start, end, turns=False, at=0.0):
    """Integrate surge and yaw with 10 us steps."""
    dt = 1e-5
    times = np.array([t / 1000 + delay for t, _ in COMMANDS])
    left, right = np.array([(40 * a, -20 * b) for _, (a, b) in COMMANDS]).T
    grid = np.arange(times[0], end, dt) + dt / 2
    out = []
    for f in (left, right):
        if turns and not at:
            f = np.copysign(np.sqrt(abs(f)), f)
        if hold == 'linear':
            u = np.interp(grid, times, f)
        else:
            u = f[np.searchsorted(times, grid, side='right') - 1]
        if at:  # inertia n' = F - n |n|
            y, n = np.empty_like(u), math.copysign(math.sqrt(abs(f[0])), f[0])
            for i, x in enumerate(u):
                rise = dt * (x - n * abs(n)) / (2.0 * lag * math.sqrt(at))
                y[i], n = n + rise / 2, n + rise
            u = y
        elif lag:
            y, state, k = np.empty_like(u), f[0], 1 - math.exp(-dt / lag)
            for i, x in enumerate(u):
                y[i] = state + (x - state) * k / 2  # at the middle of the step
                state += (x - state) * k
            u = y
        if turns:
            u = u * abs(u)
        out.append(u[(grid > start) & (grid < end)].sum() * dt)
    return [out[0] + out[1], 0.25 * (out[0] - out[1])]


@pytest.mark.parametrize('hold', ['previous', 'linear'])
@pytest.mark.parametrize('delay', [0.0, 0.03])
@pytest.mark.parametrize(('lag', 'turns', 'at'), [
    (0.0, False, 0.0), (0.08, False, 0.0), (0.08, True, 0.0), (0.08, True, 80.0),
    (0.0, True, 80.0)])
def test_impulse_is_the_exact_integral(hold, delay, lag, turns, at):
    if turns and hold == 'linear':
        with pytest.raises(SettingsError, match='takes previous with thrusters.lag_of_turns'):
            chain(hold=hold, lag_of_turns=True)
        return
    thrust = chain(hold=hold, delay=delay, time_constant=lag, lag_of_turns=turns, lag_at=at)
    for start, end in ((0.05, 0.12), (0.11, 0.3), (0.05, 0.5)):
        a, b = thrust.integrals((round(start * 1e9),))[0], thrust.integrals((round(end * 1e9),))[0]
        expected = brute_force(hold, delay, lag, start, end, turns, at if lag else 0.0)
        assert [y - x for x, y in zip(a, b)] == pytest.approx(expected, abs=5e-3)


def test_a_held_force_comes_in_pieces_that_add_up_to_its_integral():
    thrust = chain()
    for start, end in ((50, 120), (110, 300), (50, 500), (60, 61)):
        a, b = thrust.integrals((start * MS, end * MS))
        for (pieces, each), p, q in zip(thrust.pieces(start * MS, end * MS, (0, 1)), a, b):
            assert not each
            assert sum(length for length, _ in pieces) == pytest.approx((end - start) * 1e-3)
            assert sum(length * force for length, force in pieces) == pytest.approx(q - p)
            assert all(x != y for (_, x), (_, y) in zip(pieces, pieces[1:]))
    for k in range(1000):
        thrust.add_commands((500 + k) * MS, (0.1, math.sin(0.1 * k)))
    # one per command is as good as smooth, and what stays the same is one piece
    assert thrust.pieces(600 * MS, 700 * MS, (1,)) == [NO_PIECES]
    assert chain(time_constant=0.1).pieces(50 * MS, 120 * MS, (0,)) == [NO_PIECES]


@pytest.mark.parametrize('timing', [
    {}, {'time_constant': 0.1}, {'time_constant': 0.1, 'lag_of_turns': True},
    {'time_constant': 0.1, 'lag_of_turns': True, 'lag_at': 40.0}, {'hold': 'linear'}])
def test_a_smooth_force_over_a_long_span_comes_in_means_over_parts(timing):
    """Two means over a span of seconds would put the force where it was not."""
    thrust = ForceHistory(replace(TWO, **timing), ('surge', 'yaw'), {'surge': 80.0})
    for k in range(1000):
        thrust.add_commands(10 * k * MS, (0.1, math.sin(0.05 * k)))
    (held, each), (_, none) = thrust.pieces(1003 * MS, 3003 * MS, (0, 1))
    assert none == ()
    at = 1003
    for (length, mean), means in zip(held, each, strict=True):
        ends = at * MS, round((at + 1000 * length) * MS)
        [first, last] = thrust.integrals(ends)
        assert length == pytest.approx(0.05, rel=1e-6)
        assert mean == pytest.approx((last[0] - first[0]) / length)
        assert means == pytest.approx(thrust.each(ends[0], ends[1], ends[1] + MS, 0)[0])
        at += 50
    assert at == 3003
    thrust = ForceHistory(replace(TWO, **timing), ('surge',))
    for k in range(1000):
        thrust.add_commands(10 * k * MS, (math.sin(0.05 * k), 0.0))
    assert thrust.pieces(1003 * MS, 1203 * MS, (0,)) == [NO_PIECES]
    assert len(thrust.pieces(0, 9000 * MS, (0,))[0].held) == 100


def test_no_force_before_the_first_command_nor_after_the_timeout():
    thrust = chain(delay=0.02, timeout=0.2)
    assert thrust.missing(10 * MS, 50 * MS) == 'no_thrust'
    assert thrust.missing(20 * MS, 300 * MS) == ''
    assert thrust.missing(200 * MS, 380 * MS) == 'stale_thrust'  # 150 + 20 + 200 < 380
    assert thrust.missing(430 * MS, 640 * MS) == ''
    assert thrust.missing(430 * MS, 641 * MS) == 'stale_thrust'
    assert chain(timeout=0.0).missing(0, 10**12) == ''


def test_linear_hold_waits_for_the_next_command():
    assert chain(hold='linear').known(420 * MS)
    assert not chain(hold='linear').known(421 * MS)
    assert chain().known(10**12)


@pytest.mark.parametrize('timing', [{}, {'time_constant': 1e-6}, {'hold': 'linear'}])
def test_the_mean_force_on_some_dofs_is_of_what_is_known(timing):
    thrust = ForceHistory(replace(TWO, **timing), ('surge', 'yaw'))
    assert thrust.means(0, 100 * MS, (0, 1)) == [0.0, 0.0]
    for time in (100, 200):
        thrust.add_commands(time * MS, (1.0, 0.0))
    assert thrust.means(0, 100 * MS, (0, 1)) == [0.0, 0.0]
    assert thrust.means(50 * MS, 200 * MS, (1, 0)) == pytest.approx([10.0, 40.0], rel=1e-4)
    assert thrust.means(150 * MS, 200 * MS, (1,)) == pytest.approx([10.0])
    assert thrust.means(0, 200 * MS, ()) == []


def test_one_topic_per_thruster_needs_all_of_them():
    thrust = ForceHistory(replace(TWO, topics=('/a', '/b')), ('surge', 'yaw'))
    thrust.add_commands(0, (1.0,), 0)
    assert thrust.missing(0, 1) == 'no_thrust'
    thrust.add_commands(5 * MS, (2.0,), 1)
    assert thrust.integrals((15 * MS,))[0] == pytest.approx((0.0, 10e-3 * 20.0))
    thrust.add_commands(15 * MS, (2.0,), 0)  # both at one instant: the later message completes it
    thrust.add_commands(15 * MS, (0.0,), 1)
    assert thrust.integrals((25 * MS,))[0][0] == pytest.approx(10e-3 * 80.0)


def test_one_topic_that_falls_silent_makes_the_force_stale():
    thrust = ForceHistory(replace(TWO, topics=('/a', '/b'), timeout=0.5), ('surge', 'yaw'))
    thrust.add_commands(0, (1.0,), 1)
    for k in range(10):
        thrust.add_commands(k * 100 * MS, (2.0,), 0)
    assert thrust.missing(0, 500 * MS) == ''
    assert thrust.missing(0, 501 * MS) == 'stale_thrust'


def test_two_topics_of_one_instant_are_one_command():
    """What the first of them alone would push is no piece of the force."""
    thrust = ForceHistory(replace(TWO, topics=('/a', '/b')), ('surge', 'yaw'))
    for second in range(2):
        for part in range(2):
            thrust.add_commands(1000 * second * MS, (float(second),), part)
    assert thrust.pieces(500 * MS, 1500 * MS, (0,)) == [(((0.5, 0.0), (0.5, 20.0)), ())]


@pytest.mark.parametrize('timing', [{}, {'time_constant': 1e-6}, {'hold': 'linear'}])
def test_what_each_thruster_does_is_no_function_of_the_force(timing):
    """At a turn on the spot surge has no force, but less of one if a thruster gives less."""
    thrust = ForceHistory(replace(TWO, **timing), ('surge', 'yaw'), {'surge': 80.0})
    # each pushes by half of the typical force, which is beyond the dead band that is looked for
    steps = [(0.0, 0.0), (1.0, -2.0), (1.0, -2.0), (-1.0, 2.0), (0.5, 1.0), (0.0, 0.0)]
    for second, values in enumerate(steps):
        for part in (0, 999):  # so that straight lines between commands hardly count
            thrust.add_commands((1000 * second + part) * MS, values)
    ends = (1001 * MS, 2500 * MS, 3999 * MS)
    pieces = thrust.pieces(ends[0], ends[2], (0, 1))
    means = thrust.each(*ends, 0)
    assert thrust.each(*ends, 1) == ()
    assert means[0] == pytest.approx((0.0, 0.2, 1.0), abs=2e-3)
    assert means[1] == pytest.approx(
        [(500 * a + 999 * b) / 1499 for a, b in zip((0.0, 0.2, 1.0), (-1.0, -0.2, 1.0))],
        abs=5e-3)
    if timing:
        return
    (held, each), (_, none) = pieces
    assert held == ((pytest.approx(1.999), 80.0), (pytest.approx(0.999), -80.0))
    assert each == ((0.0, pytest.approx(0.2), 1.0), (-1.0, pytest.approx(-0.2), 1.0))
    assert none == ()
    # the same force on surge, from one thruster that pushes backwards and one that does not
    held, each = thrust.pieces(3500 * MS, 4500 * MS, (0,))[0]
    assert [force for _, force in held] == [-80.0, 0.0]
    assert each[1] == (-0.25, 0.0, pytest.approx(math.sqrt(0.5)))
    held, each = thrust.pieces(4500 * MS, 5500 * MS, (0,))[0]
    assert held == ((0.5, 0.0), (0.5, 0.0))
    assert each[1] == (0.0, 0.0, 0.0)


def test_backwards_is_a_thruster_and_not_what_it_does_to_a_dof():
    """A port thruster that runs forwards turns the vehicle to starboard."""
    forces = wrench_model(TWO, ('yaw',), {'yaw': 10.0})
    assert forces((1.0, -2.0))[:2] == (0.0, 0.0)
    assert forces((1.0, 2.0))[:2] == (20.0, 1.0)
    assert forces((-1.0, -2.0))[:2] == (-20.0, -1.0)
    assert forces((-1.0, 2.0))[:2] == (0.0, 0.0)


@pytest.mark.parametrize(('allocation', 'gain', 'expected'), [
    (TWO.allocation, TWO.gain, True),
    (TWO.allocation, (40.0, 0.0), True),
    (((1.0, 0.0), NONE, NONE, NONE, NONE, (0.0, 1.0)), TWO.gain, False),
    (((1.0, 1.0), NONE, NONE, NONE, NONE, (0.0, 1.0)), (40.0, 0.0), False)])
def test_thrusters_that_drive_two_dofs_are_shared(allocation, gain, expected):
    """One without gain drives none, and a DOF that nobody asks for does not count."""
    settings = replace(TWO, allocation=allocation, gain=gain)
    assert settings.shares(0, (0, 5)) is settings.shares(5, (0, 5)) is expected
    assert not settings.shares(0, (0, 1, 2))


def intake(topics, timeout=1.0, **changes):
    """Return what takes commands whose direction has a topic of its own, and their force."""
    settings = Settings(
        dofs=('surge', 'yaw'), dof={'surge': DofSettings(50.0), 'yaw': DofSettings(9.0)},
        thrusters=replace(TWO, topics=topics, **changes), attitude=InputSettings('/a'),
        velocity=InputSettings('/v'), sign=InputSettings('/s', timeout=timeout))
    history = ForceHistory(settings.thrusters, settings.dofs)
    return CommandIntake(settings, history, pytest.fail), history


def test_directions_are_those_of_each_thruster():
    both, history = intake(('/t',))
    assert both.add_commands(0, (1.0, 2.0), 0) == 'no_sign'
    for signs, force in (((1.0, -1.0), 80.0), ((-1.0, 1.0), -80.0), ((-1.0,), 0.0)):
        both.add_signs(0, signs)
        assert both.add_commands(0, (-1.0, 2.0), 0) == ''  # of a magnitude the sign says nothing
        assert history.newest[0] == force
    one_each, history = intake(('/t', '/u'))
    one_each.add_signs(0, (0.5, -0.5))
    for part, magnitude in enumerate((1.0, 2.0)):
        assert one_each.add_commands(0, (magnitude,), part) == ''
    assert history.newest == (80.0, 0.0)


def test_a_magnitude_loses_its_offset_before_it_has_a_direction():
    both, history = intake(('/t',), offset=0.25)
    for sign, force in ((1.0, 80.0), (-1.0, -80.0)):
        both.add_signs(0, (sign, -sign))
        assert both.add_commands(0, (1.25, 2.25), 0) == ''
        assert history.newest[0] == force


@pytest.mark.parametrize('changes', [
    {'reverse': 0.5}, {'offset': 0.25, 'reverse': 0.5},
    {'model': 'table', 'table_command': (-2.0, 0.0, 3.0), 'table_force': (-1.0, 0.0, 4.0)}])
def test_a_motor_that_turns_the_other_way_has_the_curve_of_its_propeller(changes):
    """Its commands are mirrored, and it pushes less where the propeller runs backwards."""
    usual, other = replace(TWO, gain=(40.0, 20.0), **changes), replace(TWO, **changes)
    twice = 2.0 * other.offset
    for command in (-1.5, -0.25, 0.5, 2.5):
        assert wrench(other, (command, twice - command)) == wrench(usual, (command, command))
        for dof, unit in (('surge', 80.0), ('yaw', 10.0)):
            assert wrench_model(other, (), {dof: unit})((command, twice - command)) == (
                wrench_model(usual, (), {dof: unit})((command, command)))


def test_a_direction_is_stale_after_its_timeout():
    both, _ = intake(('/t',))
    both.add_signs(0, (1.0, 1.0))
    assert both.add_commands(1000 * MS, (1.0, 1.0), 0) == ''
    assert both.add_commands(1001 * MS, (1.0, 1.0), 0) == 'stale_sign'


def test_propellers_give_the_same_in_many_spans_at_once():
    random = np.random.default_rng(2)
    turns, steady = random.normal(size=(2, 200)) * (random.random((2, 200)) > 0.2)
    lengths = random.uniform(0.0, 1.0, 200)
    pushes = [spun(*one, 0.3)[0] for one in zip(turns.tolist(), steady.tolist(), lengths.tolist())]
    np.testing.assert_allclose(all_spun(turns, steady, lengths, 0.3), pushes, atol=1e-14)
    ends = [driven(*one, 0.3)[2] for one in zip(turns.tolist(), steady.tolist(), lengths.tolist())]
    np.testing.assert_allclose(all_driven(turns, steady, lengths, 0.3), ends, atol=1e-14)


@pytest.mark.parametrize(('turns', 'at'), [(False, 0.0), (True, 0.0), (True, 40.0)])
def test_forgetting_changes_no_span(turns, at):
    def span(thrust):
        a, b = thrust.integrals((9_000_500_000,))[0], thrust.integrals((9_100_000_000,))[0]
        return [y - x for x, y in zip(a, b)]

    thrust = ForceHistory(
        replace(TWO, time_constant=0.1, lag_of_turns=turns, lag_at=at), ('surge', 'yaw'))
    for k in range(1000):
        thrust.add_commands(k * 10 * MS, (math.sin(0.1 * k), math.cos(0.1 * k)))
    before = span(thrust)
    thrust.forget(9_000_000_000)
    assert span(thrust) == pytest.approx(before, rel=1e-9)
    assert max(lengths(thrust)) < 200


@pytest.mark.parametrize(('changes', 'command', 'force'), [
    ({}, 1.5, 1.5),
    ({'offset': 1500.0}, 1600.0, 100.0),
    ({'offset': 1500.0, 'scale': 0.0025}, 1700.0, 0.5),
    ({'offset': 1500.0, 'scale': 0.0025, 'deadband': 0.0625}, 1520.0, 0.0),
    ({'offset': 1500.0, 'scale': 0.0025, 'limit': 1.0}, 1050.0, -1.0),
    ({'limit': 2.0, 'model': 'quadratic'}, -3.0, -4.0),
    ({'deadband': 0.2}, 0.2, 0.0),
    ({'deadband': 0.2}, -0.3, -0.3),
    ({'dead_zone': 0.2}, 0.1, 0.0),
    ({'dead_zone': 0.2}, -0.3, -0.1),
    ({'deadband': 0.2, 'dead_zone': 0.2}, 0.3, 0.1),
    ({'limit': 2.0, 'dead_zone': 0.5, 'model': 'quadratic'}, -9.0, -2.25),
    ({'reverse': 0.75}, -2.0, -1.5),
    ({'reverse': 0.75}, 2.0, 2.0),
    ({'model': 'quadratic'}, -3.0, -9.0),
    ({'model': 'polynomial', 'polynomial': (1.0, 2.0, 0.0, 4.0)}, 2.0, 37.0),
    ({'model': 'table', 'table_command': (-1.0, 0.0, 2.0), 'table_force': (-9.0, 0.0, 8.0)},
     0.5, 2.0),
    ({'model': 'table', 'table_command': (-1.0, 0.0, 2.0), 'table_force': (-9.0, 0.0, 8.0)},
     -7.0, -9.0),
])
def test_thruster_models(changes, command, force):
    assert thruster_model(replace(TWO, **changes))(command) == pytest.approx(force)


PWM = replace(TWO, offset=1500.0, scale=0.0025, limit=1.0)


@pytest.mark.parametrize(('raw', 'part', 'settings', 'verdict'), [
    ((1500.0, 1900.0), 0, PWM, True),
    ((2200.0, 800.0), 0, PWM, True),  # clipped
    ((1500.0, 0.0), 0, PWM, False),
    ((1500.0, 65535.0), 0, PWM, False),
    ((0.0, 65535.0), 0, replace(PWM, limit=0.0), True),
    ((1500.0, 0.0), 0, replace(PWM, gain=(1.0, 0.0)), True),  # nobody asks for it
    ((0.0,), 1, replace(PWM, topics=('/a', '/b'), gain=(1.0, 0.0)), True),
    ((0.0,), 1, replace(PWM, topics=('/a', '/b'), gain=(0.0, 1.0)), False),
])
def test_what_is_far_beyond_the_limit_is_no_command(raw, part, settings, verdict):
    assert are_commands(settings, raw, part) is verdict


def test_wrench_of_a_port_thruster_turns_to_starboard():
    # forward thrust at y = +0.25 (port) gives yaw -0.25, design of the allocation
    port = replace(TWO, gain=(1.0, 1.0), allocation=(
        (1.0, 1.0), NONE, NONE, NONE, NONE, (0.25, -0.25)))
    assert wrench(port, (0.0, 4.0)) == (4.0, 0.0, 0.0, 0.0, 0.0, -1.0)


@given(st.lists(st.floats(), min_size=2, max_size=2))
def test_a_wild_command_never_poisons_the_impulse(values):
    thrust = chain()
    thrust.add_commands(430 * MS, values)
    thrust.add_commands(440 * MS, (1.0, 1.0))
    assert all(math.isfinite(x) for x in thrust.integrals((500 * MS,))[0])


@pytest.mark.parametrize(('changes', 'key'), [
    ({'allocation': ((1.0,),) * 6}, 'thrusters.allocation'),
    ({'gain': ()}, 'thrusters.gain'),
    ({'names': ('one',)}, 'thrusters.names'),
    ({'topics': ('/a', '/b', '/c')}, 'thrusters.topics'),
    ({'model': 'table', 'table_command': (1.0, 0.0), 'table_force': (0.0, 1.0)},
     'thrusters.table_command'),
    ({'model': 'polynomial'}, 'thrusters.polynomial'),
    ({'scale': 0.0}, 'thrusters.scale'),
])
def test_shapes_that_do_not_match_name_their_key(changes, key):
    with pytest.raises(SettingsError) as caught:
        replace(TWO, **changes)
    assert caught.value.key == key


def test_of_a_wrench_the_thrusters_are_not_known() -> None:
    assert replace(TWO, type='geometry_msgs/msg/WrenchStamped').is_wrench
    assert not replace(TWO, type='sensor_msgs/msg/JointState').is_wrench


def test_which_dofs_hide_weaker_thrust_backwards() -> None:
    # the second motor turns the other way: surge takes a negative command whichever way it goes
    assert [TWO.pushes_both_ways(dof) for dof in range(6)] == [True, *[False] * 5]
    alike = replace(TWO, gain=(40.0, 20.0))
    assert [alike.pushes_both_ways(dof) for dof in (0, 5)] == [False, True]
