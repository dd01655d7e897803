"""``rovid tune``: from a log to a parameter file that the node takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import json
from pathlib import Path
import re

import numpy as np
import pytest
from rovid_core.settings.run import CurrentSettings, Settings
from rovid_core.trials.tuning.cross_validation import Change, Stage
from rovid_core.trials.tuning.likelihood import Prediction
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import TuningError
from rovid_core.trials.tuning.tune import Tuned
from rovid_ros.commands import tune as command
from rovid_ros.commands.main import main
from rovid_ros.commands.running import CommandError
from rovid_ros.commands.tune import tuned_text
from rovid_ros.config.parameter_file import edited, load
from rovid_ros.config.parameters import settings_from

pytestmark = pytest.mark.long

CONFIG = Path(__file__).parents[2] / 'config'
SURGE = """\
# mine
/**:
  ros__parameters:
    dofs: [surge]  # one
    position: {topic: /fix, type: geometry_msgs/msg/PointStamped, field: point}
    attitude: {topic: /imu, type: sensor_msgs/msg/Imu, field: orientation}
    thrusters:
      topic: /thrust
      type: sensor_msgs/msg/Joy
      field: axes
      gain: [100.0]
      allocation: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    identifier: {method: aid}
    surge.initial.mass: 200
    simulation:
      surge: {mass: 300.0, quadratic_drag: 300.0, linear_drag: 40.0, forces: [150.0, 80.0],
              frequencies: [0.05, 0.13]}
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a log whose delay the parameter file does not have."""
    path = tmp_path_factory.mktemp('tune')
    (path / 'mine.yaml').write_text(SURGE)
    (path / 'true.yaml').write_text(SURGE.replace(
        '      gain:', '      delay: 0.2\n      gain:'))
    assert main(['simulate', '--params-file', f'{path}/true.yaml', '--duration', '120',
                 '--output', f'{path}/log.mcap']) == 0
    return path


def test_a_current_is_no_weaker_thrust_in_reverse(tmp_path: Path) -> None:
    """It is taken out of the velocities, and of what another DOF is coupled with."""
    profile = ('surge=multisine:30@0.02-0.2x5,sway=multisine:28@0.02-0.2x5,'
               'yaw=multisine:4@0.02-0.15x5')
    given = ['--params-file', f'{CONFIG}/bluerov2_ardusub.yaml', '-p', 'dofs:=[surge,sway,yaw]']
    assert main(['simulate', *given, '-p', 'simulation.coriolis:=true', '-p',
                 'simulation.current:=[0.05,0.15]', '--profile', profile, '--duration', '90',
                 '--output', f'{tmp_path}/log.mcap']) == 0
    assert main(['tune', f'{tmp_path}/log.mcap', *given, '--json', f'{tmp_path}/tune.json',
                 '--output', f'{tmp_path}/tuned.yaml']) == 0
    before, after = (settings_from(load(path)) for path in (
        CONFIG / 'bluerov2_ardusub.yaml', tmp_path / 'tuned.yaml'))
    assert after.thrusters.reverse == before.thrusters.reverse
    assert after.thrusters.deadband == before.thrusters.deadband
    for dof in ('surge', 'sway', 'yaw'):
        assert after.couplings(dof) == before.couplings(dof)


def test_the_tuned_file_replays_better(
        folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine, tuned = folder / 'mine.yaml', folder / 'tuned.yaml'
    first = folder / 'first.yaml'
    first.write_text('/**: {ros__parameters: {max_wait: 0.2, surge.initial.mass: 1.0}}')
    assert main(['tune', f'{folder}/log.mcap', '--params-file', str(first), '--params-file',
                 str(mine), '-p', 'max_wait:=0.1', '-p', 'thrusters.delay:=0.0',
                 '-p', 'surge.typical.velocity:=20.0',
                 '--output', str(tuned), '--json', f'{folder}/tune.json']) == 0
    said = capsys.readouterr()
    assert re.search(r'^thrusters.delay \[s\] .* 0.\d+', said.out, re.M)
    assert re.search(r'^thrusters.delay.*: \d+.\d ± \d+.\d % better$', said.out, re.M)
    assert 'nothing else is clearly better, so these stay: ' in said.out
    assert (f'next      rovid replay {folder}/log.mcap --params-file {first} '
            f'--params-file {tuned} -p max_wait:=0.1 -p surge.typical.velocity:=20.0\n'
            ) in said.out
    assert f'-p thrusters.delay:=0.0 wins over what {tuned} says: leave it out' in said.err
    assert 'max_wait' not in said.err
    assert 'typical' not in said.err  # it finds typical sizes itself
    assert mine.read_text() == SURGE
    text = tuned.read_text()
    assert '# mine' in text and '# one' in text
    settings = settings_from(load(tuned))
    thrusters = settings.thrusters
    assert thrusters.delay + thrusters.time_constant == pytest.approx(0.2, abs=0.03)
    found = json.loads((folder / 'tune.json').read_text())
    assert found['keys']['thrusters.delay']['after'] == thrusters.delay
    error = found['dofs']['surge']['output_error']
    assert error['after'] < error['before']
    errors = []
    for file in (mine, tuned):
        assert main(['replay', f'{folder}/log.mcap', '--params-file', str(file),
                     '--json', f'{folder}/out.json']) == 0
        errors.append(json.loads((folder / 'out.json').read_text())['dofs']['surge']['mae'])
    assert errors[1] < 0.9 * errors[0]


def test_warns_of_the_settings_in_use_alone(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def tried(read: Callable[[Settings], TuningLog], settings: Settings, *_: object) -> Tuned:
        read(settings)
        read(replace(settings, yaw_offset=0.1))
        return Tuned((), (), {}, {})

    def warns(*_: object, warn: Callable[[str], None], **__: object) -> None:
        warn('the clock of an input')

    monkeypatch.setattr(command, 'tune', tried)
    monkeypatch.setattr(command, 'replay', warns)
    told: list[str] = []
    settings = replace(settings_from(load(folder / 'mine.yaml')), current=CurrentSettings(0.0))
    command.tune_logs([folder / 'log.mcap'], settings, warn=told.append)
    assert told == ['the clock of an input']


def test_the_filter_predicts_the_log_with_the_thrusters_that_are_tried(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def tried(read: object, settings: Settings, show: object, each: object,
              predict: Callable[[Settings], Prediction]) -> Tuned:
        right, wrong = (predict(replace(settings, thrusters=replace(
            settings.thrusters, delay=0.2, deadband=band))) for band in (0.0, 0.8))
        assert right.delay == pytest.approx(0.0, abs=0.05)  # beside that
        asked.append(float(np.log(wrong.errors['surge'] / right.errors['surge'])[6:].mean()))
        lost = predict(replace(settings, thrusters=replace(settings.thrusters, deadband=1e9)))
        assert not lost.errors.keys() - {'surge'}
        return Tuned((), (), {}, {})

    monkeypatch.setattr(command, 'tune', tried)
    settings = settings_from(load(folder / 'mine.yaml'))
    command.tune_logs([folder / 'log.mcap'], settings, duration=60.0)
    assert asked[0] > 0.01


def test_a_log_that_gives_nothing_with_what_is_tried_is_no_end(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def tried(read: Callable[[Settings], TuningLog], settings: Settings, *_: object) -> Tuned:
        with pytest.raises(TuningError, match='no step'):
            read(replace(settings, yaw_offset=0.1))
        read(settings)
        raise AssertionError

    def nothing(*_: object, **__: object) -> None:
        raise CommandError('no step')

    monkeypatch.setattr(command, 'tune', tried)
    monkeypatch.setattr(command, 'replay', nothing)
    settings = replace(settings_from(load(folder / 'mine.yaml')), current=CurrentSettings(0.0))
    with pytest.raises(CommandError, match='no step'):
        command.tune_logs([folder / 'log.mcap'], settings)


def test_what_a_recorded_node_did_with_its_identifier_is_left_out(folder: Path) -> None:
    player = command.TuningPlayer(settings_from(load(folder / 'mine.yaml')))
    player.restore({'version': 'of a node'})
    for name, value in (('enable', 'false'), ('parameters', '{"surge.initial.mass": 2.0}'),
                        ('reset', '')):
        assert player.repeat_control(name, value) == []
    assert player.stream.adapting
    player.repeat_control('time_jump', '')
    assert player.log.jumped


def test_where_nothing_gains_it_says_so() -> None:
    stays = Stage({'thrusters.delay': Change(0.1, 0.1)}, gain=0.01, spread=0.02)
    said = tuned_text(Tuned((stays,), (), {}, {}))
    assert '\nnothing is clearly better, so these stay: thrusters.delay\n' in said


@pytest.mark.parametrize(('more', 'code', 'says'), [
    (['--duration', '20'], 1, 'takes 60 s'),
    (['--output', '{}/mine.yaml'], 1, 'is read by this command'),
    (['--start', 'now'], 2, '--start'),
])
def test_a_mistake_is_one_line_and_writes_nothing(
        folder: Path, capsys: pytest.CaptureFixture[str], more: list[str], code: int,
        says: str) -> None:
    output = folder / 'nothing.yaml'
    assert main(['tune', f'{folder}/log.mcap', '--params-file', f'{folder}/mine.yaml',
                 '--output', str(output), *(part.format(folder) for part in more)]) == code
    error = capsys.readouterr().err
    assert says in error and error.count('\n') == 1
    assert not output.exists()
    assert (folder / 'mine.yaml').read_text() == SURGE


def test_values_change_and_nothing_else(tmp_path: Path) -> None:
    changes = {'thrusters.delay': 0.125, 'velocity.cutoff': 1.5, 'surge.typical.force': 90.0,
               'yaw.typical.velocity': 0.25, 'attitude.yaw_offset': -1e-05}
    path = CONFIG / 'jhurov.yaml'
    (tmp_path / 'tuned.yaml').write_text(edited(path, changes))
    assert load(tmp_path / 'tuned.yaml') == {**load(path), **changes}
    before, after = path.read_text().splitlines(), edited(path, changes).splitlines()
    assert len(before) == len(after)
    assert sum(a != b for a, b in zip(before, after)) == len(changes)


def test_a_missing_key_is_put_in(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(SURGE)
    changes = {'thrusters.delay': 0.125, 'velocity.cutoff': 1.5, 'surge.typical.force': 90.0,
               'surge.typical.velocity': 0.25, 'attitude.yaw_offset': 0.1,
               'surge.initial.mass': 300.0}
    (tmp_path / 'tuned.yaml').write_text(edited(path, {**changes, 'surge.terms': ('alpha',)}))
    assert load(tmp_path / 'tuned.yaml') == {
        **load(path), **changes, 'surge.terms': ['alpha']}
    settings_from(load(tmp_path / 'tuned.yaml'))


def test_a_file_of_few_keys_takes_them_too(tmp_path: Path) -> None:
    path = tmp_path / 'few.yaml'
    path.write_text('/**:\n  ros__parameters: {max_gap: 1.0}\n')
    path.write_text(edited(path, {'thrusters.delay': 0.125}))
    assert load(path) == {'max_gap': 1.0, 'thrusters.delay': 0.125}


@pytest.mark.parametrize('terms', [
    'terms: [alpha, beta]', 'terms: [alpha,\n                    beta]  # both',
    'terms:\n      - alpha\n      - beta', 'terms:\n    - alpha\n    - beta',  # as PyYAML dumps
    'terms:  # both\n    - alpha\n    - beta  # the last\n    # what follows'])
def test_a_list_is_replaced(terms: str, tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    key = '    surge.initial.mass'
    path.write_text(SURGE.replace(key, f'    surge.{terms}\n{key}'))
    (tmp_path / 'tuned.yaml').write_text(edited(path, {'surge.terms': ('alpha', 'gamma')}))
    assert load(tmp_path / 'tuned.yaml') == {**load(path), 'surge.terms': ['alpha', 'gamma']}
    before, after = [one.read_text() for one in (path, tmp_path / 'tuned.yaml')]
    assert before.count('#') == after.count('#')


def test_of_two_sections_the_one_that_counts(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(SURGE + 'other:\n  ros__parameters: {velocity: {cutoff: 9.0}}\n'
                    'identifier_node:\n  ros__parameters: {velocity: {cutoff: 0.5}}\n')
    (tmp_path / 'tuned.yaml').write_text(edited(path, {'velocity.cutoff': 1.5}))
    assert load(tmp_path / 'tuned.yaml') == {**load(path), 'velocity.cutoff': 1.5}
    assert 'cutoff: 9.0' in (tmp_path / 'tuned.yaml').read_text()


@pytest.mark.parametrize('log', ['surge_sway_heave.mcap'])
def test_the_tank(log: str, data: Path, tmp_path: Path,
                  capsys: pytest.CaptureFixture[str]) -> None:
    tuned = tmp_path / 'tuned.yaml'
    assert main(['tune', str(data / 'bluerov2_tank' / log), '--output', str(tuned),
                 '--params-file', str(CONFIG / 'bluerov2_tank.yaml'),
                 '--duration', '70']) == 0
    assert 'yaw: left out' in capsys.readouterr().out
    settings_from(load(tuned))
