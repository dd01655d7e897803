"""A vehicle of another simulator that moves in all axes: what its user gets without any tuning."""

import json
from pathlib import Path

import pytest
from rovid_core.model.dofs import DOFS
from rovid_ros.commands.main import main
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from test.support.six_axes import Dive, dive
from test.support.trials import CONFIG

pytestmark = pytest.mark.long

SHIPPED = CONFIG / 'bluerov2_ardusub.yaml'


@pytest.fixture(scope='module')
def dived(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, float]]:
    """Return a log and the true masses."""
    log = tmp_path_factory.mktemp('six_axes') / 'dive.mcap'
    return log, dive(log, Dive(), seed=3, duration=240.0)


def test_the_shipped_file_finds_the_masses(
        dived: tuple[Path, dict[str, float]], tmp_path: Path) -> None:
    """Without a coupling of its inertia yaw comes out half as large again."""
    assert_found(*dived, SHIPPED, tmp_path / 'result.json')


def test_in_a_tank_the_noise_of_fixes_does_not_make_yaw_heavier(
        dived: tuple[Path, dict[str, float]], tmp_path: Path) -> None:
    """It is coupled with the sway of a filter: with differences of fixes it is 2 % too large."""
    log, masses = dived
    still, result = tmp_path / 'still.yaml', tmp_path / 'result.json'
    still.write_text(SHIPPED.read_text().replace(
        '    dofs:', '    current: {prior: 0.0}\n    dofs:', 1))
    assert_found(log, masses, still, result)
    yaw = json.loads(result.read_text())['dofs']['yaw']
    assert yaw['mass'] == pytest.approx(masses['yaw'], rel=0.015)


def test_init_is_not_misled_by_what_the_axes_do_to_each_other(
        dived: tuple[Path, dict[str, float]], tmp_path: Path) -> None:
    """Two axes at a time push it less than its turning does."""
    log, masses = dived
    made = tmp_path / 'made.yaml'
    assert main(['init', str(log), '--output', str(made)]) == 0
    found, known = settings_from(load(made)), settings_from(load(SHIPPED))
    assert found.dofs == known.dofs
    assert found.position.latency == 0.0
    for row in map(DOFS.index, known.dofs):
        assert found.thrusters.allocation[row] == known.thrusters.allocation[row]
    assert_found(log, masses, made, tmp_path / 'result.json')


def test_what_no_motion_of_a_dof_shows_another_tells_it(tmp_path: Path) -> None:
    """
    Half of the thrusters of surge, sway and yaw always run backwards: all are weaker both ways.

    Where two axes are driven at once, what each thruster does tells it. Heave, whose thrusters all
    run the same way, has another thrust down than up, which is found.
    """
    log, result = tmp_path / 'dive.mcap', tmp_path / 'result.json'
    masses = dive(log, Dive(reverse=0.8), seed=1, duration=240.0)
    assert main(['replay', str(log), '--params-file', str(SHIPPED), '--json', str(result)]) == 0
    dofs = json.loads(result.read_text())['dofs']
    assert dofs['surge']['mass'] > 1.1 * masses['surge']
    assert {dof for dof in masses if dofs[dof]['status'] != 'converging'} == {'heave'}
    # the thrusters of heave push the vehicle down when they run forwards
    assert dofs['heave']['mass'] == pytest.approx(masses['heave'], rel=0.05)
    # which comes out 6 % too low: the model does not explain all of the motion, as it says
    assert dofs['heave']['thrusters']['reverse'] == pytest.approx(1.0 / 0.8, rel=0.08)
    for dof in ('surge', 'sway'):
        assert 'heave shows that the thrusters' in ' '.join(dofs[dof]['reasons'])
    for dof in ('surge', 'yaw'):
        assert 'the reverse thrust of each thruster: about 0.' in dofs[dof]['reasons'][0]
        low, high = dofs[dof]['intervals']['mass']
        assert low < masses[dof] < high


def assert_found(log: Path, masses: dict[str, float], file: Path, result: Path) -> None:
    """Replay a log, and compare the masses with the true ones."""
    assert main(['replay', str(log), '--params-file', str(file), '--json', str(result)]) == 0
    dofs = json.loads(result.read_text())['dofs']
    assert {dof: dofs[dof]['mass'] for dof in masses} == pytest.approx(masses, rel=0.08)
    assert {dofs[dof]['status'] for dof in masses} == {'converged'}
