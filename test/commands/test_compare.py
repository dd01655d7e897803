"""``rovid compare`` on simulated trials: models, choice of terms, scores, files."""

from collections.abc import Callable, Sequence
from dataclasses import replace
import json
import os
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.identify import METHODS as ONLINE
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import lumped
from rovid_core.trials.offline import METHODS
from rovid_core.trials.record import Fit
from rovid_core.trials.score import Score
from rovid_ros.commands.compare import read_trials
from rovid_ros.commands.main import main
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.comparison.report_data import sentence
from rovid_ros.comparison.trials import compare, Model, unseen
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.writer import LogWriter
from rovid_ros.results.documents import read_estimates
import yaml

pytestmark = pytest.mark.long

CONFIG = Path(__file__).parents[2] / 'config' / 'jhurov.yaml'
STILL = ',heave=0,yaw=0'


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two trials of surge alone, and their comparison."""
    folder = tmp_path_factory.mktemp('compare')
    text = CONFIG.read_text().replace('dofs: [surge, heave, yaw]', 'dofs: [surge]')
    (folder / 'rov.yaml').write_text(text)
    assert main(['simulate', '--params-file', str(folder / 'rov.yaml'), '--duration', '120',
                 '--output', str(folder / 't{}.mcap'),
                 '--profile', f'surge=150@0.055+80@0.14{STILL}',
                 '--profile', f'surge=120@0.08+60@0.04{STILL}']) == 0
    assert main(['compare', str(folder / 't1.mcap'), '--validate', str(folder / 't2.mcap'),
                 '--params-file', str(folder / 'rov.yaml'), '--json', str(folder / 'out.json'),
                 '--report', str(folder / 'out.html')]) == 0
    return folder


def test_every_method_scores_every_log(folder: Path) -> None:
    models = json.loads((folder / 'out.json').read_text())['models']
    assert {m['method'] for m in models} == {*ONLINE, *METHODS}
    true = settings_from(load(CONFIG)).simulation.dofs['surge']
    truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
    for model in models:
        assert model['trained_on'] == 't1.mcap'
        surge = model['dofs']['surge']
        assert surge['alpha'] == pytest.approx(truth[0], rel=0.1)
        assert surge['mass'] == pytest.approx(1 / surge['alpha'])
        assert set(surge['scores']) == {'t1.mcap', 't2.mcap'}
        assert surge['scores']['t2.mcap']['fit'] > 0.9
        assert (surge['std'] is not None) == (
            model['method'] in ('output_error', 'ekf'))
    assert sum(m['selected_terms'] for m in models) == len(METHODS)


def test_output_error_is_nearest_and_knows_how_near(folder: Path) -> None:
    models = json.loads((folder / 'out.json').read_text())['models']
    surge = next(m['dofs']['surge'] for m in models if m['method'] == 'output_error')
    true = settings_from(load(CONFIG)).simulation.dofs['surge']
    truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
    for name, value in zip(PARAMETERS, truth):
        assert abs(surge[name] - value) < 5 * surge['std'][name]


@pytest.mark.parametrize('method', ['ekf', 'aid'])
def test_a_method_is_what_a_replay_makes_of_it(folder: Path, method: str) -> None:
    found = folder / f'{method}.json'
    assert main(['replay', str(folder / 't1.mcap'), '--params-file', str(folder / 'rov.yaml'),
                 '--method', method, '--json', str(found)]) == 0
    alone = json.loads(found.read_text())['dofs']['surge']
    models = json.loads((folder / 'out.json').read_text())['models']
    compared = next(m['dofs']['surge'] for m in models if m['method'] == method)
    assert [compared[name] for name in PARAMETERS] == [alone[name] for name in PARAMETERS]


def test_a_replay_speaks_of_the_whole_log(folder: Path) -> None:
    """Not of its end, where nothing pushes any more; where nothing ever did, it says that."""
    for name, levels in (('end', '150/-150/150/-150/0/0/0/0'), ('idle', '0/0')):
        log, found = folder / f'{name}.mcap', folder / f'{name}.json'
        config = str(folder / 'rov.yaml')
        assert main(['simulate', '--params-file', config, '--duration', '80', '--output',
                     str(log), '--profile', f'surge=steps:{levels}@10{STILL}']) == 0
        assert main(['replay', str(log), '--params-file', config, '--json', str(found)]) == 0
        surge = json.loads(found.read_text())['dofs']['surge']
        assert (surge['status'] == 'unexcited') == (name == 'idle'), surge
        assert ('no thrust' in surge['reasons']) == (name == 'idle')


def test_yaw_is_pushed_by_the_velocity_through_the_water(tmp_path: Path) -> None:
    """Which is known once the log has been read; over ground yaw's fit was 0.5."""
    known = settings_from(load(CONFIG.with_name('odometry_wrench.yaml')))
    moving = replace(known.simulation, coriolis=True, current=(0.2, -0.1))
    settings = replace(known, dofs=('surge', 'sway', 'yaw'), simulation=moving)
    simulate_log(settings, tmp_path / 'dive.mcap', 45.0, 1)
    trials = read_trials([tmp_path / 'dive.mcap'], [], settings, pytest.fail)

    def each(label: str, work: Callable[[Any], Any], given: Sequence[Any]) -> list[Any]:
        return [work(one) for one in given]

    models = {model.method: model for model in compare(trials, settings, each)
              if model.dof == 'yaw' and not model.selected}
    for method in ('ekf', 'output_error'):
        assert models[method].scores['dive.mcap'].fit > 0.9
        assert 1.0 / models[method].fit.parameters[0] == pytest.approx(
            moving.dofs['yaw'].mass, rel=0.05)


def test_averages_leave_out_logs_that_do_not_push() -> None:
    def model(**more: Any) -> Model:
        scores = {'own': Score(0.01, 0.9), 'moves': Score(0.02, 0.8), 'idle': Score(9.0, -5.0)}
        return Model('ekf', 'own', 'surge', PARAMETERS, False, Fit.none(''), scores, **more)
    logs = ['own', 'moves', 'idle']
    one = model(idle=frozenset(['idle']))
    assert unseen(one, logs) == ['moves']
    assert one.error(['moves', 'idle']) == 0.02 and one.fit_on(['moves', 'idle']) == 0.8
    assert model().error(['moves', 'idle']) == pytest.approx(4.51)
    # rather an idle log than none
    assert one.error(['idle']) == 9.0
    assert model(idle=frozenset(logs)).error(logs) == pytest.approx(9.03 / 3)


def test_a_log_that_hardly_pushes_judges_no_model(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config, weak = str(folder / 'rov.yaml'), folder / 'weak.mcap'
    assert main(['simulate', '--params-file', config, '--duration', '40', '--output', str(weak),
                 '--profile', f'surge=15@0.06{STILL}']) == 0
    for validate, said in ((weak, 't1.mcap, on which it was trained,'),
                           (folder / 't2.mcap', 't2.mcap to')):
        capsys.readouterr()
        assert main(['compare', str(folder / 't1.mcap'), '--validate', str(validate),
                     '--params-file', config, '--duration', '40']) == 0
        text = capsys.readouterr().out
        assert f'predicts the velocity of {said}' in ' '.join(text.split())
        assert max(map(len, text.partition('\nown: ')[2].splitlines())) < 100


@pytest.mark.parametrize(('fit', 'ends'), [
    (0.1, '(fit 10.0 %).'),
    (-0.1, '(fit -10.0 %): no better than a constant, so it says nothing of the vehicle.')])
def test_a_model_worse_than_a_constant_is_no_finding(folder: Path, fit: float, ends: str) -> None:
    trials = read_trials([folder / 't1.mcap'], [folder / 't2.mcap'],
                         settings_from(load(folder / 'rov.yaml')), print, duration=2.0)
    scores = {'t1.mcap': Score(0.01, 0.9), 't2.mcap': Score(0.02, fit)}
    one = Model('ekf', 't1.mcap', 'surge', PARAMETERS, False, Fit((0.005, -1.0, 0.0, 0.0)), scores)
    assert sentence(one, trials).endswith(ends)


def test_masses_that_are_no_kilograms_are_told(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / 'commands.json'
    assert main(['compare', str(folder / 't1.mcap'), '--params-file', str(folder / 'rov.yaml'),
                 '--duration', '40', '-p', 'thrusters.newtons:=false', '--json', str(out)]) == 0
    text = ' '.join(capsys.readouterr().out.split())
    assert 'cmd is what a command of 1 pushes' in text and ' cmd s²/m, quadratic drag ' in text
    assert all(model['dofs']['surge']['newtons'] is False
               for model in json.loads(out.read_text())['models'])


def test_the_report_and_export_take_it(folder: Path) -> None:
    page = (folder / 'out.html').read_text()
    assert 'Surge' in page
    assert 't2.mcap' in page
    assert read_estimates(folder / 'out.json', '', '')


def test_a_term_that_is_not_there_is_left_out(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (folder / 'rov.yaml').read_text().replace('        bias: 2.9', '        bias: 0.0')
    (folder / 'level.yaml').write_text(text)
    assert main(['simulate', '--params-file', str(folder / 'level.yaml'), '--duration', '60',
                 '--output', str(folder / 'level{}.mcap'), '--profile', f'surge=150@0.05{STILL}',
                 '--profile', f'surge=100@0.08{STILL}']) == 0
    capsys.readouterr()
    assert main(['compare', str(folder / 'level1.mcap'), str(folder / 'level2.mcap'),
                 '--params-file', str(folder / 'level.yaml'),
                 '--json', str(folder / 'level.json')]) == 0
    models = json.loads((folder / 'level.json').read_text())['models']
    chosen = [m['dofs']['surge']['terms'] for m in models if m['selected_terms']]
    assert all('delta' not in terms for terms in chosen)
    assert 'predicts the velocity of' in capsys.readouterr().out


def test_a_log_without_steps_of_a_dof(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither is its model the initial guess, nor are the others worth less for it."""
    two = folder / 'two.yaml'
    two.write_text(CONFIG.read_text().replace('dofs: [surge, heave, yaw]', 'dofs: [surge, heave]')
                   .replace('        bias: 10.0', '        bias: 0.0'))
    assert main(['simulate', '--params-file', str(two), '--duration', '60', '--output',
                 str(folder / 'both.mcap')]) == 0
    with LogWriter(folder / 'none.mcap') as writer, (folder / 'both.mcap').open('rb') as file:
        depths = 0
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            depths += channel.topic == '/depth/pressure'
            if channel.topic != '/depth/pressure' or depths == 1:
                writer.write_raw(channel.topic, schema.name, message.data, message.log_time)
    capsys.readouterr()
    assert main(['compare', str(folder / 'both.mcap'), str(folder / 'none.mcap'),
                 '--params-file', str(two), '--json', str(folder / 'two.json'),
                 '--report', str(folder / 'two.html')]) == 0
    out = capsys.readouterr().out
    assert 'effective mass 2,4' in out
    assert 'to - ' not in out
    chosen = []
    for model in json.loads((folder / 'two.json').read_text())['models']:
        heave = model['dofs'].get('heave')
        if model['trained_on'] == 'none.mcap' and heave:
            assert heave['mass'] is None, model['method']
        elif model['selected_terms'] and heave:
            chosen.append(heave['terms'])
    assert chosen and all('delta' not in terms for terms in chosen)


@pytest.mark.parametrize(('values', 'duration'), [
    ({'simulation.position_rate': 0.5, 'max_gap': 5.0}, 90.0),  # slower than velocity.cutoff
    ({}, 0.9)])  # too short for any method
def test_few_fixes(values: dict[str, float], duration: float, folder: Path) -> None:
    few = {'/**': {'ros__parameters': {**load(folder / 'rov.yaml'), **values}}}
    (folder / 'few.yaml').write_text(yaml.safe_dump(few))
    assert main(['simulate', '--params-file', str(folder / 'few.yaml'), '--duration',
                 str(duration), '--output', str(folder / 'few.mcap')]) == 0
    assert main(['compare', str(folder / 't1.mcap'), '--validate', str(folder / 'few.mcap'),
                 '--duration', '60', '--params-file', str(folder / 'few.yaml'),
                 '--report', str(folder / 'few.html')]) == 0
    if duration > 60.0:
        assert main(['compare', str(folder / 'few.mcap'),
                     '--params-file', str(folder / 'few.yaml')]) == 0


def test_mistakes_are_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (['nothing.mcap'], ['t1.mcap', '--validate', 'nothing.mcap'],
                      ['t1.mcap', '--report', str(folder / 'no' / 'x.html')]):
        logs = [str(folder / a) if a.endswith('.mcap') else a for a in arguments]
        assert main(['compare', *logs, '--params-file', str(folder / 'rov.yaml')]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_part_of_each_log(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ['compare', str(folder / 't1.mcap'), '--params-file', str(folder / 'rov.yaml'),
                 '--json', str(folder / 'part.json')]
    assert main([*arguments, '--start', '20', '--duration', '60']) == 0
    part, whole = (
        next(m['dofs']['surge'] for m in json.loads((folder / name).read_text())['models']
             if m['method'] == 'output_error') for name in ('part.json', 'out.json'))
    assert part['std']['beta'] > 1.2 * whole['std']['beta']
    capsys.readouterr()
    assert main([*arguments, '--start', '500']) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_report_without_plotly_is_refused_before_the_work(
        folder: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr('rovid_ros.commands.compare.find_spec', lambda name: None)
    monkeypatch.setattr('rovid_ros.commands.compare.read_trials', pytest.fail)
    out = folder / 'none.html'
    assert main(['compare', str(folder / 't1.mcap'), '--params-file', str(folder / 'p.yaml'),
                 '--report', str(out)]) == 1
    error, = capsys.readouterr().err.splitlines()
    assert "pip install 'rovid_ros[report]'" in error
    assert not out.exists()


def test_a_report_is_called_html(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / 'report.pdf'
    assert main(['compare', str(folder / 't1.mcap'), '--params-file', str(folder / 'p.yaml'),
                 '--report', str(out)]) == 2
    error, = capsys.readouterr().err.splitlines()
    assert f'got {str(out)!r}, takes a name that ends in .html' in error
    assert not out.exists()


def test_a_report_that_cannot_be_written_is_refused_before_the_work(
        folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr('rovid_ros.commands.compare.read_trials', pytest.fail)
    tmp_path.chmod(0o555)
    if os.access(tmp_path, os.W_OK):
        pytest.skip('this user may write everywhere')
    out = tmp_path / 'report.html'
    assert main(['compare', str(folder / 't1.mcap'), '--params-file', str(folder / 'p.yaml'),
                 '--report', str(out)]) == 1
    error, = capsys.readouterr().err.splitlines()
    assert error == f'rovid compare: {out}: cannot be written: no permission'
