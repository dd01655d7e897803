"""A vehicle that moves in all axes at once, through the commands, its couplings configured."""

from collections.abc import Iterator
import csv
import json
from pathlib import Path
import re
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.identify import METHODS as ONLINE
from rovid_core.model.dofs import PARAMETERS
from rovid_core.trials.offline import METHODS as OFFLINE
from rovid_ros.commands.main import main
from rovid_ros.config.parameter_file import load
from rovid_ros.messages.types import standard_types
from rovid_ros.results.documents import read_estimates

pytestmark = pytest.mark.long

MASSES = {'surge': 20.0, 'sway': 30.0, 'yaw': 1.5}
KAPPAS = {'surge': ('vr', 1.5), 'sway': ('ur', -2.0 / 3.0), 'yaw': ('uv', -10.0 / 1.5)}
"""Kirchhoff's: m_v / m_u, -m_u / m_v, (m_u - m_v) / I."""

VEHICLE = """
/**:
  ros__parameters:
    dofs: [surge, sway, yaw]
    position: {topic: /fix, type: geometry_msgs/msg/PointStamped, field: point}
    attitude: {topic: /imu, type: sensor_msgs/msg/Imu, field: orientation}
    thrusters:
      topic: /thrust
      type: sensor_msgs/msg/JointState
      field: effort
      gain: [1.0, 1.0, 1.0]
      allocation: [1.0, 0.0, 0.0,  0.0, 1.0, 0.0,  0.0, 0.0, 0.0,
                   0.0, 0.0, 0.0,  0.0, 0.0, 0.0,  0.0, 0.0, 1.0]
    identifier: {method: ekf}
    surge: {initial: {mass: 16.0, quadratic_drag: 30.0, linear_drag: 5.0}, couplings: [vr]}
    sway: {initial: {mass: 25.0, quadratic_drag: 60.0, linear_drag: 8.0}, couplings: [ur]}
    yaw: {initial: {mass: 1.0, quadratic_drag: 1.0, linear_drag: 0.2}, couplings: [uv]}
    simulation:
      coriolis: true
      attitude_rate: 10.0
      thruster_rate: 10.0
      surge: {mass: 20.0, quadratic_drag: 40.0, linear_drag: 8.0,
              forces: [25.0, 10.0], frequencies: [0.05, 0.23]}
      sway: {mass: 30.0, quadratic_drag: 90.0, linear_drag: 12.0,
             forces: [25.0, 12.0], frequencies: [0.07, 0.31]}
      yaw: {mass: 1.5, quadratic_drag: 2.0, linear_drag: 0.4,
            forces: [0.8, 0.5], frequencies: [0.03, 0.17]}
"""
OTHER = 'surge=20@0.11,sway=15@0.04+15@0.2,yaw=0.9@0.09'


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two logs, and what a replay and a comparison make of them."""
    folder = tmp_path_factory.mktemp('coupled')
    config = folder / 'rov.yaml'
    config.write_text(VEHICLE)
    simulate = ['simulate', '--params-file', str(config)]
    assert main([*simulate, '--duration', '180', '--output', str(folder / 'a.mcap')]) == 0
    assert main([*simulate, '--duration', '20', '--output', str(folder / 'b.mcap'),
                 '--profile', OTHER]) == 0
    assert main(['replay', str(folder / 'a.mcap'), '--params-file', str(config), '--output',
                 str(folder / 'out.mcap'), '--json', str(folder / 'out.json')]) == 0
    assert main(['compare', str(folder / 'a.mcap'), '--validate', str(folder / 'b.mcap'),
                 '--params-file', str(config), '--json', str(folder / 'compared.json'),
                 '--report', str(folder / 'compared.html')]) == 0
    return folder


def dofs(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / 'out.json').read_text())['dofs']
    return found


def models(folder: Path) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for model in json.loads((folder / 'compared.json').read_text())['models']:
        for dof, values in model['dofs'].items():
            yield model['method'], dof, values


def test_the_json_has_the_couplings_and_both_fits(folder: Path) -> None:
    for dof, found in dofs(folder).items():
        name, kappa = KAPPAS[dof]
        assert found['mass'] == pytest.approx(MASSES[dof], rel=0.02)
        assert list(found['couplings']) == [name, f'{name}_std']
        assert found['couplings'][name] == pytest.approx(kappa, rel=0.03)
        assert 0.0 < found['couplings'][f'{name}_std'] < 0.02 * abs(kappa)
        assert found['fit'] > 0.93
        assert found['fit_joint'] == pytest.approx(found['fit'], abs=0.01)


def test_the_topics_say_the_same(folder: Path) -> None:
    store, last, counts = standard_types(), {}, {}
    with (folder / 'out.mcap').open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            last[channel.topic] = store.deserialize_cdr(message.data, schema.name)
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert len(counts) == 10
    assert len(set(counts.values())) == 1
    for topic, end in (('/rov/couplings', ''), ('/rov/couplings_std', '_std')):
        dims = last[topic].layout.dim
        assert [(dim.label, dim.size, dim.stride) for dim in dims] == [
            ('surge,sway,yaw', 3, 9), ('vr,ur,uv', 3, 3)]
        data = last[topic].data.reshape(3, 3)
        for i, (dof, found) in enumerate(dofs(folder).items()):
            assert data[i, i] == found['couplings'][f'{KAPPAS[dof][0]}{end}']
        assert sum(data.ravel() == data.ravel()) == 3  # the others are NaN
    *of_dofs, current = last['/rov/estimate'].status
    assert current.name == 'current'
    for status in of_dofs:
        values = {entry.key: entry.value for entry in status.values}
        name = KAPPAS[status.name][0]
        found = dofs(folder)[status.name]['couplings']
        assert float(values[f'kappa_{name}']) == found[name]
        assert float(values[f'kappa_{name}_std']) == found[f'{name}_std']


def test_the_table_has_them_with_their_intervals(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ['replay', str(folder / 'b.mcap'), '--params-file', str(folder / 'rov.yaml')]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert 'all together' in out
    rows = {tuple(line.split()[:2]): line.split()[2:] for line in out.splitlines()
            if len(line.split()) == 6}
    for dof, (name, _) in KAPPAS.items():
        kappa, low, _, high = rows[dof, name]
        assert float(low) < float(kappa) < float(high)


def test_the_node_gives_the_same_bits(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    found = []
    for options in ([], ['--ros']):
        output, table = tmp_path / f'out{len(found)}.mcap', tmp_path / f'out{len(found)}.json'
        assert main(['replay', str(folder / 'b.mcap'), '--params-file', str(folder / 'rov.yaml'),
                     *options, '--output', str(output), '--json', str(table)]) == 0
        found.append((json.loads(table.read_text()), output.read_bytes()))
    assert found[0] == found[1]


def test_a_comparison_scores_them_where_the_method_has_them(folder: Path) -> None:
    seen = set()
    for method, dof, found in models(folder):
        seen.add(method)
        coupled = method in ('aid', 'ekf', 'aid_offline', 'output_error')
        assert ('couplings' in found) == coupled
        for score in found['scores'].values():
            assert ('fit_joint' in score) == coupled
        if coupled:
            name, kappa = KAPPAS[dof]
            near = 0.1 if method == 'aid' else 0.03
            assert found['mass'] == pytest.approx(MASSES[dof], rel=near)
            assert found['couplings'][name] == pytest.approx(kappa, rel=near)
            for score in found['scores'].values():
                assert score['fit'] > 0.9
                assert score['fit_joint'] == pytest.approx(score['fit'], abs=0.02)
        elif dof == 'yaw':
            assert max(score['fit'] for score in found['scores'].values()) < 0.5
    assert seen == {*ONLINE, *OFFLINE}


def test_a_comparison_gives_the_filter_what_a_replay_gives_it(folder: Path) -> None:
    replayed = dofs(folder)
    compared = {dof: found for method, dof, found in models(folder) if method == 'ekf'}
    for dof in MASSES:
        for name in (*PARAMETERS, 'couplings', 'std'):
            assert compared[dof][name] == replayed[dof][name]


def test_the_report_shows_them(folder: Path) -> None:
    page = (folder / 'compared.html').read_text()
    for _, (name, _) in KAPPAS.items():
        assert f'coupling <i>κ<sub>{name}</sub></i>' in page
    assert 'all together: with all DOFs simulated' in page
    assert re.search(r'<small>fit [^<]*</small><small>all together [^<]*</small>', page)


def test_export_has_them(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    estimates = str(folder / 'out.json')
    for one in (estimates, str(folder / 'compared.json')):
        for found in read_estimates(Path(one), 'ekf' if one != estimates else '', ''):
            name, kappa = KAPPAS[found.dof]
            assert found.couplings == {name: pytest.approx(kappa, rel=0.03)}
    assert main(['export', estimates, '--format', 'yaml', '--output',
                 str(folder / 'initial.yaml')]) == 0
    values = load(folder / 'initial.yaml')
    assert {dof: values[f'{dof}.couplings'] for dof in KAPPAS} == {
        dof: [name] for dof, (name, _) in KAPPAS.items()}
    capsys.readouterr()
    assert main(['export', estimates, '--format', 'csv']) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    for row in rows:
        name = KAPPAS[row['dof']][0]
        assert float(row[f'kappa_{name}']) == dofs(folder)[row['dof']]['couplings'][name]
        assert sum(bool(row[f'kappa_{other}']) for other, _ in KAPPAS.values()) == 1


def test_check_names_them(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['check', str(folder / 'rov.yaml'), str(folder / 'b.mcap')]) == 0
    out = capsys.readouterr().out
    table = [line.split() for line in out.splitlines() if line.startswith(tuple(KAPPAS))]
    assert [line[-1] for line in table if line[1] in ('position', 'attitude')] == [
        name for name, _ in KAPPAS.values()]


def test_a_state_goes_on_with_its_couplings_alone(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state, config = folder / 'state.json', folder / 'rov.yaml'
    arguments = ['replay', str(folder / 'b.mcap'), '--state', str(state), '--params-file']
    assert main([*arguments, str(config)]) == 0
    assert main([*arguments, str(config)]) == 0
    other = folder / 'other.yaml'
    other.write_text(VEHICLE.replace('couplings: [vr]', 'couplings: [wq]'))
    capsys.readouterr()
    assert main([*arguments, str(other)]) == 1
    assert 'surge.couplings' in capsys.readouterr().err
