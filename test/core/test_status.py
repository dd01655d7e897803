"""Status and reasons of a degree of freedom, from event time alone."""

from dataclasses import replace
from math import pi, sin

import pytest
from rovid_core.identify.last_minute import KEYS
from rovid_core.identify.status import DofStatus, Judgement, STATUSES
from rovid_core.model.dofs import Four
from rovid_core.model.plant import advance
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Scales, SimulatedDof
from rovid_core.simulation.sensors import simulate

from test.support.surge import run, surge_log, surge_settings, SURGE_TRUTH as TRUTH, TRAINING


class Known:
    """An identifier that has said its last word."""

    note = doubt = ''
    converged_share = 0.05
    judges_errors = True
    couplings = ()
    thrusters = AS_CONFIGURED
    fit = 1.0

    def __init__(self, model: float = 0.0, drag: float = 0.0, scale: float = 1.0) -> None:
        """Take the relative standard deviation of all at once (0: unknown) and of drag."""
        self.parameters: Four = tuple(scale * p for p in TRUTH)
        self.excitation = 1.0
        cov = [model * p * model * q for p in TRUTH for q in TRUTH]
        cov[5] += (drag * TRUTH[1]) ** 2
        self.covariance = tuple(cov) if model else ()


def steps(duration, dt=0.1):
    v = 0.0
    for k in range(round(duration / dt)):
        force = sum(f * sin(2 * pi * hz * (k + 0.5) * dt) for f, hz in TRAINING)
        new = advance(TRUTH, v, force, dt)
        yield Step(dt, (v, 0.5 * (v + new), new), (force,) * 3, new, parts=(dt, 0.0),
                   forces=(force, 0.0))
        v = new


def judge(status, identifier, duration=30.0, adapt=True):
    for step in steps(duration):
        found = status.update(identifier, step, '', adapt)
    return found.status, found.reasons


@pytest.fixture
def status():
    return DofStatus(Scales(150.0, 0.5, TRUTH, (True,) * 4), 3.0)


def test_a_covariance_decides_and_says_what_is_open(status):
    name, reasons = judge(status, Known(0.2))
    assert name == 'converging'
    assert reasons[0] == (
        'the mass is known to 20 %, not yet to 5 %: drive this axis longer, or with more thrust')
    name, reasons = judge(status, Known(0.02))
    assert name == 'converged'
    assert not [r for r in reasons if 'known' in r]


def test_what_the_covariance_knows_is_not_said_to_be_hidden():
    """The data look weak, as for a vehicle of a tenth of its typical force and velocity."""
    slow = DofStatus(Scales(1500.0, 5.0, TRUTH, (True,) * 4), 3.0)
    doubted, unknown = Known(0.01), Known(0.2)
    doubted.doubt = 'a doubt of something else'
    assert judge(slow, doubted) == ('converging', (doubted.doubt,))
    assert slow.verdict() == ''
    _, reasons = judge(slow, unknown)
    assert slow.verdict() == '; '.join(reasons[1:]) != ''


def test_between_the_two_limits_it_stays_what_it_was(status):
    assert judge(status, Known(0.07))[0] == 'converging'
    assert judge(status, Known(0.01))[0] == 'converged'
    assert judge(status, Known(0.07))[0] == 'converged'
    assert judge(status, Known(0.2))[0] == 'converging'


@pytest.fixture
def shown():
    """Return an identifier that shows weaker thrust backwards."""
    known = Known(0.02)
    known.note = f'reverse thrust: {KEYS["reverse_thrust"]}'
    return known


@pytest.fixture
def vehicle():
    """Return what makes a DOF of a vehicle, and those of its DOFs that show it."""
    scales, weaker = Scales(150.0, 0.5, TRUTH, (True,) * 4), {}
    return lambda name, **how: DofStatus(scales, 3.0, name, weaker, **how), weaker


def test_what_a_dof_cannot_see_of_the_thrusters_it_is_told(vehicle, shown):
    dof, weaker = vehicle
    heave, surge = dof('heave'), dof('surge', hides_weaker=True)
    assert judge(surge, Known(0.02))[0] == 'converged'
    # that it shows it is not yet that its mass is known with it
    name, reasons = judge(heave, shown)
    assert (name, reasons[1]) == (
        'converging', 'until that is taken into account the mass is off by as much')
    judge(heave, shown, adapt=False)
    assert not heave.settled
    name, reasons = judge(surge, Known(0.02))
    assert name == 'converging'
    assert reasons[0].startswith('heave shows that the thrusters push otherwise backwards')
    # how much of the thrust it is that may not be there is not known before heave has found it
    assert surge.scale_in_doubt == 0.0
    shown.thrusters = AS_CONFIGURED._replace(reverse=0.8)
    judge(heave, shown)
    judge(surge, Known(0.02))
    assert surge.scale_in_doubt == pytest.approx(0.1)
    assert heave.scale_in_doubt == 0.0
    # more data would not help
    assert judge(surge, Known(0.2))[1][0] == reasons[0]
    # one that might show it itself, but does not yet
    assert judge(dof('roll'), Known(0.02))[1][0] == reasons[0]
    heave.reset()
    assert judge(surge, Known(0.02))[0] == 'converged'
    assert surge.scale_in_doubt == 0.0
    # what it sees itself is no more than a chance
    judge(surge, shown)
    assert not weaker


def test_a_dof_that_finds_what_it_pushes_backwards_needs_no_other(shown):
    scales, weaker = Scales(150.0, 0.5, TRUTH, (True,) * 4), {}
    own = replace(scales, couplings=('reverse_thrust',))
    judge(DofStatus(scales, 3.0, 'heave', weaker), shown)
    for hides_weaker, status in ((False, 'converged'), (True, 'converging')):
        surge = DofStatus(own, 3.0, 'surge', weaker, hides_weaker)
        assert judge(surge, Known(0.02))[0] == status


def test_of_a_wrench_any_dof_may_hide_it(vehicle, shown):
    heave, surge = (vehicle[0](name, of_wrench=True) for name in ('heave', 'surge'))
    judge(heave, shown)
    name, reasons = judge(surge, Known(0.02))
    assert name == 'converging'
    assert reasons[0].endswith('log what each thruster is commanded')
    # one that found it itself has it in its own model
    found = Known(0.02)
    found.thrusters = AS_CONFIGURED._replace(reverse=0.8)
    judge(surge, found)
    assert judge(surge, found)[0] == 'converged'
    assert judge(heave, Known(0.02))[0] == 'converging'


def test_an_acceleration_that_is_not_known_is_not_converged(status):
    name, reasons = judge(status, Known(0.001, 1.0))
    assert (name, reasons[0].partition(':')[0]) == (
        'converging', 'the acceleration is not known yet')


def test_without_a_covariance_the_parameters_have_to_settle(status):
    still = Known()
    assert judge(status, still, 9.0)[0] == 'converging'  # three adaptation times
    assert judge(status, still, 15.0)[0] == 'converged'
    other = Known(scale=1.3)
    name, reasons = judge(status, other, 12.0)
    assert name == 'converging'
    assert 'move by' in reasons[0]
    assert judge(status, other, 30.0)[0] == 'converged'


@pytest.mark.parametrize('known', [0.0, 0.01])
def test_a_method_that_does_not_judge_its_errors_has_to_predict_a_minute(status, known):
    method = Known(known)
    method.judges_errors = False
    assert judge(status, method, 59.0) == (
        'converging', ('the model has not predicted a minute yet',))
    assert judge(status, method, 20.0)[0] == 'converged'
    alpha, beta, gamma, delta = TRUTH
    method.parameters = (0.45 * alpha, 0.4 * beta, gamma, delta)
    name, reasons = judge(status, method, 70.0)
    assert (name, reasons[0][:31]) == ('converging', 'without corrections it predicts')


def test_refused_frozen_and_unexcited_come_first(status):
    known = Known(0.01)
    assert judge(status, known)[0] == 'converged'
    step = next(steps(1.0))
    assert status.update(known, step, 'unstable_step', True) == Judgement(
        'invalid', ('unstable_step',))
    assert judge(status, known, adapt=False) == ('frozen', ())
    assert status.update(known, step, '', True).status == 'converging'  # judged anew
    known.excitation = 0.0
    assert status.update(known, step, '', True) == Judgement('unexcited', ('no thrust',))


def test_the_surge_trial_converges_once_and_stays(status):
    seen = [e.dofs[0].status for e in run(Stream(surge_settings()), surge_log(1))]
    changes = [new for old, new in zip(['waiting', *seen], seen) if new != old]
    assert changes == ['unexcited', 'converging', 'converged']
    assert set(changes) < set(STATUSES)


def test_a_reset_begins_anew_and_keeps_no_verdict():
    stream = Stream(surge_settings())
    run(stream, surge_log(1, 200.0))
    assert stream.verdict('surge') == ''
    stream.reset()
    assert stream.verdict('surge') == 'no step yet'


def rest(start, hours=1.0):
    """Return a trial of nothing: 5 mm of noise on the fixes of a vehicle that lies still."""
    settings = surge_settings()
    settings = replace(settings, simulation=replace(
        settings.simulation, dofs={'surge': SimulatedDof(290.0, 290.0, 43.5)}))
    return [(start + t, n, v) for t, n, v in simulate(settings, 3600.0 * hours, 7)]


@pytest.mark.long
def test_at_rest_nothing_drifts():
    stream = Stream(surge_settings())
    first = stream.identifier('surge').parameters
    estimates = run(stream, rest(0, 0.1))
    assert estimates[-1].dofs[0].status == 'unexcited'
    alpha, beta, gamma, delta = estimates[-1].dofs[0].parameters
    # one that takes noise for drag would have moved gamma by 0.02 1/s
    assert (alpha, beta, gamma) == pytest.approx(first[:3], abs=1e-4)
    assert abs(delta) < 0.003  # the bias is seen at rest, as well as the noise lets it
