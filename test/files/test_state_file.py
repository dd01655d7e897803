"""The saved state: whole or not there, and only for the settings that it was made with."""

from dataclasses import replace
import json
import os
from pathlib import Path

import pytest
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    ThrusterSettings,
)
from rovid_ros.files.state_file import Checkpoint, load, save, StateError

STATE = {'a': [0.1 + 0.2, 5e-324], 'b': {'c': 'text'}}


def settings(**changes: object) -> Settings:
    return replace(Settings(
        dofs=('surge',), dof={'surge': DofSettings(200.0)},
        thrusters=ThrusterSettings(topics=('/t',), gain=(1.0,), allocation=((1.0,),) * 6),
        position=InputSettings('/p'), attitude=InputSettings('/a')), **changes)


def test_what_was_saved_comes_back_exactly(tmp_path: Path) -> None:
    path = tmp_path / 'folder' / 'checkpoint.json'
    save(path, settings(), STATE)
    save(path, settings(), STATE)  # over the old one
    assert load(path, settings()) == STATE
    assert [entry.name for entry in path.parent.iterdir()] == ['checkpoint.json']
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
    (settings(identifier=IdentifierSettings(method='rls')), 'identifier.method aid, '),
    (settings(dofs=('yaw',), dof={'yaw': DofSettings(20.0)}), "dofs ['surge'], "),
    (settings(dof={'surge': DofSettings(200.0, terms=('alpha', 'beta'))}), 'surge.terms '),
    (settings(dof={'surge': DofSettings(210.0)}), 'surge.initial.mass 200.0, '),
    (settings(dof={'surge': DofSettings(200.0, typical_force=9.0)}), 'surge.typical.force 0.0, '),
    (settings(thrusters=replace(THRUSTERS, gain=(2.0,))), 'thrusters.gain [1.0], '),
    (settings(thrusters=replace(THRUSTERS, delay=0.2)), 'thrusters.delay 0.0, '),
    (settings(thrusters=replace(THRUSTERS, allocation=((1.0,),) * 5 + ((0.0,),))),
     'thrusters.allocation [[1.0], '),
    (settings(frames='ned'), 'frames enu, '),
])
def test_another_configuration_is_refused(other: Settings, text: str, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    save(path, settings(), STATE)
    with pytest.raises(StateError) as refused:
        load(path, other)
    assert f'was made with {text}' in str(refused.value)
    assert ', configured is ' in str(refused.value)


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
    '{"rovid_checkpoint": 2}', '{"rovid_checkpoint": 2, "met', '[' * 100_000])
def test_another_file_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    path.write_text(content)
    with pytest.raises(StateError, match=r'checkpoint\.json'):
        load(path, settings())


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StateError):
        load(tmp_path / 'none.json', settings())


class Lines:
    """A log that keeps its lines."""

    def __init__(self) -> None:
        self.text = ''

    def error(self, message: str) -> None:
        self.text += f'{message}\n'

    info = warning = error


def checkpoint(path: Path, **changes: object) -> tuple[Checkpoint, Lines]:
    """Return what keeps the state of a new stream in a file, and its log."""
    run, lines = settings(checkpoint_path=str(path), **changes), Lines()
    return Checkpoint(run, Stream(run), lines), lines


def test_a_damaged_checkpoint_is_kept(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    path.write_text('{"rovid')
    (tmp_path / 'checkpoint-1.json').write_text('of before')
    kept, lines = checkpoint(path)
    assert kept.restore() is None
    assert 'not restored' in lines.text
    assert path.read_text() == '{"rovid'  # until there is another one
    for _ in range(2):
        assert kept.save() == ''
    assert json.loads(path.read_text())['settings']['dofs'] == ['surge']
    assert (tmp_path / 'checkpoint-1.json').read_text() == 'of before'
    assert (tmp_path / 'checkpoint-2.json').read_text() == '{"rovid'
    assert not (tmp_path / 'checkpoint-3.json').exists()
    assert 'checkpoint-2.json' in lines.text


def test_a_checkpoint_of_other_settings_is_kept(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    first, _ = checkpoint(path)
    assert first.save() == ''
    saved = path.read_text()
    again, lines = checkpoint(path)
    assert again.restore() is not None
    assert 'going on from' in lines.text
    other, lines = checkpoint(path, dofs=('yaw',), dof={'yaw': DofSettings(20.0)})
    assert other.restore() is None
    assert 'not restored' in lines.text
    assert 'dofs' in lines.text
    assert path.read_text() == saved
    assert other.save() == ''
    assert json.loads(path.read_text())['settings']['dofs'] == ['yaw']
    assert (tmp_path / 'checkpoint-1.json').read_text() == saved
    assert 'checkpoint-1.json' in lines.text
