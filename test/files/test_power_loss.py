"""Saved states and logs on a disk that loses its power, fails or is full."""

import errno
from pathlib import Path

import pytest
from rovid_ros.files.state_file import load, save
from rovid_ros.files.whole_files import write_text
from rovid_ros.logs.writer import OutputLog
from rovid_ros.node.recorder import Recorder

from test.files.test_state_file import settings
from test.support.disk import Disk

OLDER, OLD, NEW = ({'a': [float(k)] * 9} for k in range(3))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of a saved state that has one before it."""
    path = tmp_path / 'state.json'
    save(path, settings(), OLDER)
    save(path, settings(), OLD)
    return path


def test_a_state_outlasts_a_loss_of_power_at_any_moment(
        path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.with_name('state.json.1')
    older, old = before.read_bytes(), path.read_bytes()
    disk = Disk(monkeypatch, path.parent)
    disk.watch(path), disk.watch(before)
    save(path, settings(), NEW)
    assert disk.watch(path) == {path.read_bytes()}  # whatever happens from now on
    assert disk.watch(before) == {old}
    assert disk.seen(path) == {old, path.read_bytes()}
    assert disk.seen(before) == {older, old}
    assert [call.split()[0] for call in disk.calls] == [
        'write', 'fsync', 'link', 'replace', 'replace', 'fsync']
    assert disk.calls[-2:] == ['replace state.json', f'fsync {path.parent.name}']


@pytest.mark.parametrize('error', [errno.EIO, errno.ENOSPC])
@pytest.mark.parametrize('number', range(6))
def test_a_call_that_fails_leaves_a_state_and_no_rubbish(
        number: int, error: int, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        disk = Disk(patch, path.parent, number, error)
        if number == 2:  # a file system without links: it is copied
            save(path, settings(), NEW)
            assert disk.calls[2:5] == [disk.failed, f'write {disk.failed[5:]}',
                                       f'fsync {disk.failed[5:]}']
        else:
            with pytest.raises(OSError, match=f"'{path}'") as failed:
                save(path, settings(), NEW)
            assert failed.value.errno == error
    assert disk.failed
    assert {entry.name for entry in path.parent.iterdir()} == {'state.json', 'state.json.1'}
    assert load(path, settings()) == (NEW if number in (2, 5) else OLD)
    assert load(path.with_name('state.json.1'), settings()) == (
        OLDER if number in (0, 1, 3) else OLD)
    save(path, settings(), NEW)
    assert load(path, settings()) == NEW


def test_what_others_read_has_its_name_when_it_is_on_the_disk(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'result.json'
    disk = Disk(monkeypatch, tmp_path)
    write_text(path, 'text')
    assert disk.watch(path) == {b'text'}
    assert [call.split()[0] for call in disk.calls] == ['write', 'fsync', 'replace', 'fsync']
    assert [entry.name for entry in tmp_path.iterdir()] == ['result.json']


@pytest.mark.parametrize('closed', [False, True])  # before it is given its name
def test_an_output_log_has_its_name_when_it_is_on_the_disk(
        closed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'out.mcap'
    path.write_bytes(b'old')
    disk = Disk(monkeypatch, tmp_path)
    disk.watch(path)
    with OutputLog(path) as log:
        log.write('/a', 'std_msgs/msg/String', {'data': 'x'}, 1)
        if not closed:
            log.finish()
    if closed:
        log.finish()
    assert disk.watch(path) == {path.read_bytes()}
    assert disk.seen(path) == {b'old', path.read_bytes()}
    assert disk.calls == ['fsync out.part.mcap', 'replace out.mcap', f'fsync {tmp_path.name}']


def test_a_record_outlasts_a_loss_of_power_after_each_flush(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'record.mcap'
    disk = Disk(monkeypatch, tmp_path)
    recorder = Recorder(path, lambda type: '', pytest.fail)
    recorder.open(None)
    assert disk.calls == [f'fsync {tmp_path.name}']  # the name
    assert disk.watch(path) == {b''}
    recorder.close()
    (kept,) = disk.watch(path)
    assert disk.calls[1:] == ['fsync record.mcap']
    assert kept and path.read_bytes().startswith(kept)
