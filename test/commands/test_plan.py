"""``rovid plan``: what it prints and writes, and that ``rovid simulate`` takes it."""

from collections.abc import Callable
import csv
import json
from pathlib import Path
import shlex

import pytest
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import lumped
from rovid_ros.commands.main import main
from rovid_ros.commands.profile_text import parse_profile

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def config(repository: Path) -> str:
    return str(repository / 'config' / 'jhurov.yaml')


@pytest.fixture
def run(config: str, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str) -> tuple[int, str, str]:
        code = main(['plan', '--params-file', config, *arguments])
        return (code, *capsys.readouterr())
    return call


@pytest.fixture
def estimates(tmp_path: Path) -> str:
    """Return what a replay would have found: the simulated surge, nearly."""
    values = dict(zip(PARAMETERS, lumped(280.0, 300.0, 45.0, 2.8)))
    path = tmp_path / 'estimates.json'
    path.write_text(json.dumps({'method': 'ekf', 'dofs': {'surge': values}}))
    return str(path)


def test_the_plan_is_printed_written_and_simulated(
        run: Run, estimates: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(estimates, '--dofs', 'surge', '--max-force', '100', '--max-speed',
                         'surge=0.5', '--room', '3', '--duration', '60', '--output', 'plan.csv',
                         '--json', 'plan.json')
    assert (code, err) == (0, '')
    for text in ('model   ekf', '(limit 100.0)', '(limit 0.5000', '(limit 3.000', 'planned',
                 '@0.25', 'quadratic drag', 'gamma', 'written   plan.csv'):
        assert text in out
    document = json.loads(Path('plan.json').read_text())
    surge = document['dofs']['surge']
    assert surge['planned']['force'] <= 100.0
    assert surge['planned']['speed']['worst'] <= 0.5
    assert surge['planned']['room']['worst'] <= 3.0
    assert (surge['planned']['worst_relative']['linear_drag']
            < 0.5 * surge['naive']['worst_relative']['linear_drag'])
    profile = parse_profile(document['profile'])
    assert profile['heave'] == () == profile['yaw']

    with open('plan.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ['time_s', 'surge_N'] and len(rows) == 1201
    for row in rows[::50]:
        assert float(row['surge_N']) == pytest.approx(
            sum(w.at(float(row['time_s'])) for w in profile['surge']), rel=1e-4, abs=1e-4)

    call = shlex.split(out.partition('simulate it with: ')[2].splitlines()[0])
    assert call[:2] == ['rovid', 'simulate']
    assert main(call[1:]) == 0
    assert Path('planned.mcap').stat().st_size > 0


def test_several_dofs_and_yaml(run: Run, tmp_path: Path) -> None:
    path = tmp_path / 'plan.yaml'
    code, out, err = run('--dofs', 'yaw,surge', '--duration', '20', '--room', '1,yaw=2',
                         '--output', str(path))
    assert code == 0
    assert out.index('surge=') < out.index('yaw=')
    assert 'initial values' in out
    text = path.read_text().partition("'")[2].partition("'")[0]
    assert set(parse_profile(text)) == {'surge', 'heave', 'yaw'}
    assert 'duration: 20.0' in path.read_text()


def test_what_is_poorly_determined_is_said(run: Run) -> None:
    code, out, _ = run('--dofs', 'surge', '--duration', '10', '--room', '0.2')
    assert code == 0
    assert 'at worst' in out and 'linear drag to' in out


@pytest.mark.parametrize(('arguments', 'code', 'says'), [
    (['--room', '0'], 2, '--room: got'),
    (['--max-force', 'surge=-3'], 2, '--max-force: got'),
    (['--max-speed', 'fast'], 2, '--max-speed: got'),
    (['--dofs', 'sruge'], 2, "did you mean 'surge'?"),
    (['--dofs', 'surge', '--max-force', 'yaw=3'], 2, 'yaw is not planned'),
    (['--dofs', 'yaw', '--room', '3'], 2, 'yaw=NUMBER'),
    (['--room', '3,4'], 2, 'twice'),
    (['--duration', '5'], 2, '--duration: got 5'),
    (['--factor', '0.5'], 2, '--factor: got'),
    (['--output', 'plan.txt'], 2, '--output: got'),
    (['--dofs', 'sway'], 1, 'sway is not configured'),
    (['--dofs', 'surge', '--room', '0.001', '--duration', '20'], 1, 'too little to identify'),
    (['nothing.json'], 1, 'nothing.json'),
])
def test_bad_input_is_one_line(run: Run, arguments: list[str], code: int, says: str) -> None:
    got, out, err = run(*arguments)
    assert got == code and out == ''
    assert says in err and err.count('\n') == 1


def test_thrusters_limit_what_is_planned(
        run: Run, config: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Surge and yaw share two thrusters whose curve ends at 1."""
    text = Path(config).read_text()
    assert 'model: linear' in text
    table = 'model: table\n      table_command: [-1.0, 1.0]\n      table_force: [-1.0, 1.0]'
    path = tmp_path / 'table.yaml'
    assert '      # couplings: [vr]' in text
    path.write_text(text.replace('model: linear', table).replace(
        '      # couplings: [vr]', '      couplings: [vr]'))
    assert main(['plan', '--params-file', str(path), '--dofs', 'surge,yaw', '--duration', '15',
                 '--json', str(tmp_path / 'plan.json')]) == 0, capsys.readouterr().err
    dofs = json.loads((tmp_path / 'plan.json').read_text())['dofs']
    assert dofs['surge']['couplings'] == {'vr': None}  # sway is not planned
    assert 'not told: vr' in capsys.readouterr().out
    gain = 40.0  # of each thruster
    share = dofs['surge']['limits']['force'] / 2.0 + dofs['yaw']['limits']['force'] / 0.5
    assert share <= gain * (1.0 + 1e-9)
