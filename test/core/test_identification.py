"""What the DOFs of a vehicle tell each other."""

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
