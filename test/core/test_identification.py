"""What the DOFs of a vehicle tell each other."""

import pytest
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import Thrusters
from rovid_core.pipeline.identification import Identification
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import IdentifierSettings, Settings

from test.support.real_vehicles import GUESS, pieces, Vehicle

ALL = ('surge', 'sway', 'heave')


def test_what_one_dof_shows_of_the_thrusters_the_others_hear() -> None:
    settings = Settings(
        dofs=ALL, dof=dict.fromkeys(ALL, GUESS), velocity=InputSettings(topic='/dvl'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), gain=(1.0,), allocation=((1.0,),) * 6),
        identifier=IdentifierSettings('ekf'))
    family: list[Identification] = []
    surge, *others = [Identification(settings, dof, print, family=family) for dof in ALL]
    velocity, step, *_ = pieces(Vehicle(), 0, 1.0)
    surge.identifier.restart(velocity)
    surge.add_step(0, step.replaced(watched=()), True, 0.0)
    heard = [one.identifier.state()['heard'] for one in family]
    assert heard == [[0.0, False]] * 3
    surge.identifier.thrusters = Thrusters(lag=0.2, turns=True)
    surge.add_step(0, step.replaced(watched=()), True, 0.0)
    assert surge.identifier.state()['heard'] == [0.0, False]
    for other in others:
        assert other.identifier.state()['heard'] == [0.2, True]
        other.identifier.thrusters = Thrusters(lag=0.1)
    others[0].add_step(0, step.replaced(watched=()), True, 0.0)
    assert [one.identifier.state()['heard'] for one in family] == [
        [0.1, False], [0.2, True], [0.1, False]]


@pytest.mark.parametrize(('together', 'factor', 'changed'), [
    (True, 1.2, True), (False, 1.2, False), (True, 1.0, False)])
def test_a_change_that_one_dof_shows_the_others_look_for(
        together: bool, factor: float, changed: bool) -> None:
    """Sway is pushed about so much that it takes 20 % more mass alone for chance."""
    settings = Settings(
        dofs=('surge', 'sway'), dof={'surge': GUESS, 'sway': GUESS},
        velocity=InputSettings(topic='/dvl'), thrusters=ThrusterSettings(
            topics=('/thrusters',), gain=(1.0, 1.0),
            allocation=((1.0, 0.0), (0.0, 1.0), *((0.0, 0.0),) * 4)),
        identifier=IdentifierSettings('ekf'))
    family: list[Identification] = []
    surge, sway = [Identification(settings, dof, print, family=family if together else None)
                   for dof in settings.dofs]
    of_surge = pieces(Vehicle(change=(200.0, 1.2)), 0, 300.0)
    of_sway = pieces(Vehicle(disturbance='unknown', change=(200.0, factor)), 50, 300.0)
    for both in zip(of_surge, of_sway):
        for one, piece in zip((surge, sway), both):
            if isinstance(piece, Step):
                one.add_step(0, piece.replaced(watched=()), True, 0.0)
            else:
                one.identifier.restart(piece)
    assert 200.0 < surge.identifier.changed_at < 240.0
    assert (200.0 < sway.identifier.changed_at < 260.0) is changed
    assert (sway.identifier.changed_at > 0.0) is changed
    assert sway.identifier.state()['bank']['expecting'] == 0  # a minute has passed


def test_thrust_that_another_dof_shows_to_be_less_is_in_the_interval() -> None:
    settings = Settings(
        dofs=('surge',), dof={'surge': GUESS}, velocity=InputSettings(topic='/dvl'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), gain=(1.0, 1.0), allocation=((1.0, -1.0),) * 6),
        identifier=IdentifierSettings('ekf'))
    one = Identification(settings, 'surge', print, weaker={'heave': 0.1})
    for piece in pieces(Vehicle(), 0, 10.0):
        if isinstance(piece, Step):
            one.add_step(0, piece.replaced(watched=()), True, 0.0)
        else:
            one.identifier.restart(piece)
    alpha, known = one.identifier.parameters[0], one.identifier.std[0]
    assert one.estimate.std[0]**2 == pytest.approx(known**2 + (0.1 * alpha)**2)
    one.take_up()
    assert one.estimate.std[0] > known
