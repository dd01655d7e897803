"""The node's saved state: locked, kept when it does not fit, and not lost to a clock."""

import json
from pathlib import Path
import subprocess
import sys
from threading import Event, Lock
import time

import pytest
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import DofSettings, SettingsError
from rovid_ros.files.state_file import Checkpoint, load
from rovid_ros.files.whole_files import FileLock

from test.files.test_state_file import settings
from test.support.processes import child_environment, REPOSITORY


class Lines:
    """A log that keeps its lines."""

    def __init__(self) -> None:
        self.text = ''

    def error(self, message: str) -> None:
        self.text += f'{message}\n'

    info = warning = error


def checkpoint(path: Path, stream: Stream | None = None,
               **changes: object) -> tuple[Checkpoint, Lines]:
    """Return what keeps the state of a stream, a new one by default, in a file, and its log."""
    lines = Lines()
    return Checkpoint(stream or new_stream(path, **changes), lines), lines


def new_stream(path: Path, **changes: object) -> Stream:
    return Stream(settings(checkpoint_path=str(path), **changes))


def names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


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


def test_the_node_goes_on_while_a_slow_card_is_written(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, done, written = tmp_path / 'checkpoint.json', Event(), []
    kept, _ = checkpoint(path)
    card = Lock()

    def slow(path: Path, text: str, keep: bool) -> None:
        assert card.acquire(blocking=False)
        assert done.wait(20.0)
        time.sleep(0.1)
        written.append(json.loads(text)['settings']['dofs'])
        card.release()

    monkeypatch.setattr('rovid_ros.files.state_file.write_text', slow)
    kept.begin_saving()
    kept.begin_saving()  # the one before is not done yet
    assert not written
    done.set()
    assert kept.save() == ''  # after it
    assert written == [['surge'], ['surge']]
    kept.begin_saving()
    kept.close()
    assert len(written) == 3


def test_a_checkpoint_of_other_settings_is_kept(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    first, _ = checkpoint(path)
    assert first.save() == ''
    first.close()
    saved = path.read_text()
    again, lines = checkpoint(path)
    assert again.restore() is not None
    again.close()
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


def test_of_a_damaged_checkpoint_the_one_before_is_taken(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    stream = new_stream(path)
    first, _ = checkpoint(path, stream)
    for adapt in (False, True):
        stream.enable(adapt)
        assert first.save() == ''
    first.close()
    damaged = path.read_text().replace('true', 'false')
    path.write_text(damaged)

    second, lines = checkpoint(path)
    state = second.restore()
    assert state is not None and state['adapt'] is False
    assert f'not restored: {path}: is damaged' in lines.text
    assert f'going on from {path}.1, frozen' in lines.text
    assert second.save() == ''
    assert (tmp_path / 'checkpoint-1.json').read_text() == damaged
    assert load(path, settings())['adapt'] is False


def test_a_checkpoint_that_somebody_removed_is_not_taken_from_the_one_before(
        tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    kept, _ = checkpoint(path)
    assert kept.save() == kept.save() == ''
    kept.close()
    path.unlink()
    assert checkpoint(path)[0].restore() is None


def test_a_second_one_is_refused_until_the_first_one_ends(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    (tmp_path / 'link.json').symlink_to(path)
    first, _ = checkpoint(path)
    for name in ('checkpoint.json', 'link.json'):
        with pytest.raises(SettingsError, match=f'{name} is in use by another process'):
            checkpoint(tmp_path / name)
    other, _ = checkpoint(tmp_path / 'other.json')
    other.close()
    assert first.save() == ''
    with pytest.raises(SettingsError, match='in use'):  # the save has replaced the file
        checkpoint(path)
    first.close()
    first.close()
    second, _ = checkpoint(path)
    with pytest.raises(SettingsError, match='in use'):
        checkpoint(path)
    second.close()
    assert names(tmp_path) == {'checkpoint.json', 'link.json'}


def test_a_lock_ends_with_its_process_however_it_ends(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    code = ('import sys, time; from pathlib import Path\n'
            'from rovid_ros.files.whole_files import FileLock\n'
            'lock = FileLock(Path(sys.argv[1])); print(flush=True); time.sleep(99)')
    holder = subprocess.Popen([sys.executable, '-c', code, str(path)], cwd=REPOSITORY,
                              env=child_environment(), stdout=subprocess.PIPE)
    assert holder.stdout is not None
    with holder.stdout:
        holder.stdout.readline()
    with pytest.raises(BlockingIOError):
        FileLock(path)
    holder.kill()
    holder.wait()
    assert names(tmp_path) == {'.checkpoint.json.lock'}
    FileLock(path).release()
    assert names(tmp_path) == set()


def test_a_clock_that_goes_back_does_not_overwrite_what_was_learned(tmp_path: Path) -> None:
    path, beside = tmp_path / 'checkpoint.json', tmp_path / 'checkpoint-reset.json'
    stream = new_stream(path)
    kept, lines = checkpoint(path, stream)
    assert kept.save() == ''
    learned = path.read_text()
    stream.control('time_jump', '')
    for adapt in (False, True):
        stream.enable(adapt)
        assert kept.save() == ''
    assert (kept.is_kept, kept.path) == (True, beside)  # what /diagnostics looks at
    assert path.read_text() == learned
    assert load(beside, settings())['adapt'] is True
    assert lines.text.count(f'{path} stays as it was, {beside} is written') == 1


def test_what_there_is_only_after_a_jump_of_the_clock_is_saved(tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    stream = new_stream(path)
    kept, _ = checkpoint(path, stream)
    stream.control('time_jump', '')
    assert kept.save() == kept.save() == ''
    assert names(tmp_path) == {'checkpoint.json', 'checkpoint.json.1', '.checkpoint.json.lock'}


@pytest.mark.parametrize('reset', [False, True])
def test_a_state_that_a_jump_or_a_service_leaves_alone_is_overwritten(
        reset: bool, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    stream = new_stream(path, reset_on_time_jump=False)
    kept, _ = checkpoint(path, stream)
    assert kept.save() == ''
    stream.control('time_jump', '')
    if reset:
        stream.reset()  # somebody asked for it
    stream.enable(False)
    assert kept.save() == ''
    assert load(path, settings())['adapt'] is False
