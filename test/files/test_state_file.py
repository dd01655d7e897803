"""The saved state: whole or not there, and only for the settings that it was made with."""

from dataclasses import replace
import json
import os
from pathlib import Path

import pytest
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    ThrusterSettings,
)
from rovid_ros.files.state_file import DamagedStateError, load, save, StateError

from test.support.processes import patience

STATE = {'a': [0.1 + 0.2, 5e-324], 'b': {'c': 'text'}}


def settings(**changes: object) -> Settings:
    return replace(Settings(
        dofs=('surge',), dof={'surge': DofSettings(200.0)},
        thrusters=ThrusterSettings(topics=('/t',), gain=(1.0,), allocation=((1.0,),) * 6),
        position=InputSettings('/p'), attitude=InputSettings('/a')), **changes)


def test_what_was_saved_comes_back_exactly(tmp_path: Path) -> None:
    path = tmp_path / 'folder' / 'checkpoint.json'
    save(path, settings(), {'a': 'before'})
    save(path, settings(), STATE)
    assert load(path, settings()) == STATE
    assert load(path.with_name('checkpoint.json.1'), settings()) == {'a': 'before'}
    assert {entry.name for entry in path.parent.iterdir()} == {
        'checkpoint.json', 'checkpoint.json.1'}
    json.loads(path.read_text(), parse_constant=lambda text: pytest.fail(text))


def test_a_failed_save_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    save(path, settings(), STATE)
    with pytest.raises(ValueError):
        save(path, settings(), {'a': float('nan')})
    (tmp_path / f'.checkpoint.json.{os.getpid()}').mkdir()  # nothing can be written there
    with pytest.raises(OSError, match=f"'{path}'"):
        save(path, settings(), {'a': 1.0})
    assert load(path, settings()) == STATE


THRUSTERS = settings().thrusters


@pytest.mark.parametrize('other, text', [
    (settings(identifier=IdentifierSettings(method='ekf')), 'identifier.method aid, '),
    (settings(dofs=('yaw',), dof={'yaw': DofSettings(20.0)}), "dofs ['surge'], "),
    (settings(dof={'surge': DofSettings(200.0, terms=('alpha', 'beta'))}), 'surge.terms '),
    (settings(dof={'surge': DofSettings(210.0)}), 'surge.initial.mass 200.0, '),
    (settings(dof={'surge': DofSettings(200.0, typical_force=9.0)}), 'surge.typical.force 0.0, '),
    (settings(thrusters=replace(THRUSTERS, gain=(2.0,))), 'thrusters.gain [1.0], '),
    (settings(thrusters=replace(THRUSTERS, delay=0.2)), 'thrusters.delay 0.0, '),
    (settings(thrusters=replace(THRUSTERS, allocation=((1.0,),) * 5 + ((0.0,),))),
     'thrusters.allocation [[1.0], '),
    (settings(identifier=IdentifierSettings(feedback_gain=-1.0, adaptation_gains=(1.0,) * 4)),
     'identifier.adaptation_gains False, '),
    (settings(frames='ned'), 'frames enu, '),
    (settings(depth_scale=2.0), 'depth.scale 1.0, '),
    (settings(heading_unit='deg'), 'attitude.unit rad, '),
    (settings(heading_frames='ned'), 'attitude.heading , '),
])
def test_another_configuration_is_refused(other: Settings, text: str, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    save(path, settings(), STATE)
    with pytest.raises(StateError) as refused:
        load(path, other)
    assert f'was made with {text}' in str(refused.value)
    assert ', configured is ' in str(refused.value)


def test_what_else_is_looked_for_has_to_be_the_same(tmp_path: Path) -> None:
    path, made = tmp_path / 'checkpoint.json', settings(identifier=IdentifierSettings('ekf'))
    save(path, made, STATE)
    with pytest.raises(StateError, match='current.prior above 0, configured is 0'):
        load(path, replace(made, current=CurrentSettings(prior=0.0)))
    assert load(path, replace(made, current=CurrentSettings(prior=0.5))) == STATE
    sensor = replace(made, position=InputSettings(), velocity=InputSettings('/v'),
                     current=CurrentSettings(prior=0.0))
    save(path, sensor, STATE)
    with pytest.raises(StateError, match='surge.possible couplings'):
        load(path, replace(sensor, attitude=InputSettings()))


def test_topics_limits_and_gains_can_change(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    save(path, settings(), STATE)
    assert load(path, settings(
        position=InputSettings('/q', latency=0.1), max_speed=3.0, checkpoint_period=1.0,
        identifier=IdentifierSettings(adaptation_time=9.0))) == STATE


def test_what_killed_processes_left_is_removed(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    kept = [f'.checkpoint.json.{os.getppid()}', '.other.json.999999999', '.checkpoint.json.x']
    for name in [*kept, '.checkpoint.json.999999999']:
        (tmp_path / name).touch()
    save(path, settings(), STATE)
    assert {entry.name for entry in tmp_path.iterdir()} == {*kept, 'checkpoint.json'}


@pytest.mark.parametrize('content', [
    '', '[]', '{}', '{"rovid_checkpoint": 99}', '{"rovid_checkpoint": 1, "method": "aid"}',
    '{"rovid_checkpoint": 4}', '{"rovid_checkpoint": 4, "met', '[' * 100_000])
def test_another_file_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    path.write_text(content)
    with pytest.raises(StateError, match=r'checkpoint\.json'):
        load(path, settings())


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StateError):
        load(tmp_path / 'none.json', settings())


def test_a_state_with_another_digit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    state = {'numbers': [1.0000000000000002, -0.1, 1e-300, 12345678, 0.30000000000000004] * 4}
    save(path, settings(), state)
    text = path.read_text()
    places = [i for i, character in enumerate(text) if character.isdigit()]
    assert len(places) > 200
    for number, i in enumerate(places):
        path.write_text(f'{text[:i]}{(int(text[i]) + 1 + number % 9) % 10}{text[i + 1:]}')
        with pytest.raises(StateError):
            load(path, settings())
    path.write_text(text)
    assert load(path, settings()) == state


def test_a_digest_that_is_renamed_is_no_way_around_it(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    save(path, settings(), STATE)
    path.write_text(path.read_text().replace('"sha256"', '"sha255"'))
    with pytest.raises(DamagedStateError, match='it has sha255'):
        load(path, settings())


def test_a_pipe_or_a_device_is_no_state(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    os.mkfifo(path)
    for name in (path, Path('/dev/zero'), tmp_path):
        with patience(), pytest.raises(
                StateError, match=f'^{name}: is not a regular file$'):
            load(name, settings())
