"""Files of others: what is no log is refused by name, what makes up its content is bounded."""

from collections.abc import Callable
import os
from pathlib import Path
import signal
import subprocess
import sys
from threading import Timer

import pytest
from rovid_ros.commands.main import main
from rovid_ros.logs import sqlite
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import MAX_MESSAGE_SIZE
import yaml

from test.support.hostile_databases import HOSTILE_DATABASES, large_messages, repeated_pages, TYPES
from test.support.processes import child_environment, patience, REPOSITORY

CONFIG = REPOSITORY / 'config' / 'jhurov.yaml'
MEMORY = 300  # [MB]
READ = """\
import resource, sys
from pathlib import Path
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log
resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
for path in map(Path, sys.argv[1:]):
    count = 0
    try:
        with Log([path]) as log:
            for message in log.raw(list(log.topics)):
                count += 1
    except LogError as error:
        print(error)
    else:
        print(count, 'messages')
# not ru_maxrss, which a program inherits from the one that starts it
status = dict(line.split(':', 1) for line in Path('/proc/self/status').read_text().splitlines())
print(int(status['VmHWM'].split()[0]) >> 10)
"""


def some_log(path: Path, time: int = 1) -> None:
    with LogWriter(path) as writer:
        writer.write('/a', 'std_msgs/msg/String', {'data': path.stem}, time)


def read(log: Log) -> list[str]:
    return [message.data.data for message in log.messages(['/a'])]


def test_databases_that_make_up_rows_take_no_memory(tmp_path: Path) -> None:
    paths = [tmp_path / f'{name}.db3' for name in HOSTILE_DATABASES]
    for path, make in zip(paths, HOSTILE_DATABASES.values()):
        make(path)
    run = subprocess.run([sys.executable, '-c', READ, *map(str, paths)], cwd=REPOSITORY,
                         env=child_environment(), capture_output=True, text=True, check=True)
    *lines, memory = run.stdout.splitlines()
    assert int(memory) < MEMORY
    said = dict(zip(HOSTILE_DATABASES, lines))
    for name in ('view', 'forged view'):
        assert 'not a log of rosbag2 (no tables messages and topics)' in said[name]
    assert 'not a log of rosbag2 (messages has columns that are computed)' in said['computed']
    assert said['one time'] == '60000 messages'
    assert said['large messages'] == '3 messages'


def test_a_message_that_is_too_large_is_told_and_not_fetched(tmp_path: Path) -> None:
    large_messages(tmp_path / 'log.db3')
    with Log([tmp_path / 'log.db3']) as log:
        assert [message.data for message in log.messages([*TYPES])] == []
        assert len(log.warnings) == 3
        assert all(len(raw.data) < 2 * MAX_MESSAGE_SIZE for raw in log.raw([*TYPES]))
        assert all('has messages of more than 1,048,576 bytes' in line for line in log.warnings)


def test_a_database_without_end_is_left_on_ctrl_c(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    repeated_pages(tmp_path / 'log.db3')
    monkeypatch.setattr(sqlite, '_STEPS_PER_BYTE', 10**9)
    timer = Timer(0.2, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with patience(), pytest.raises(KeyboardInterrupt):
        Log([tmp_path / 'log.db3'])
    timer.join()


@pytest.mark.parametrize('name', ['log.mcap', 'log.db3', 'log.mcap.zst', '/dev/zero'])
def test_a_pipe_or_a_device_is_no_log(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if not path.exists():
        os.mkfifo(path)
    with patience(), pytest.raises(LogError, match=f'^{path}: is not a regular file$'):
        Log([path])


def test_a_bag_with_a_pipe_or_an_impossible_name_reads_the_others(tmp_path: Path) -> None:
    some_log(tmp_path / 'first.mcap')
    some_log(tmp_path / 'last.mcap', 2)
    os.mkfifo(tmp_path / 'pipe.mcap')
    (tmp_path / 'folder.mcap').mkdir()
    (tmp_path / 'loop.mcap').symlink_to('loop.mcap')
    names = ['first.mcap', 'pipe.mcap', 'x' * 300, '', '..', 'no\0name', 'folder.mcap',
             'loop.mcap', 'last.mcap']
    (tmp_path / 'metadata.yaml').write_text(yaml.safe_dump({
        'rosbag2_bagfile_information': {'relative_file_paths': names}}))
    with patience(), Log([tmp_path]) as log:
        assert read(log) == ['first', 'last']
        assert len(log.warnings) == len(names) - 2
        assert f'{tmp_path}/pipe.mcap: is not a regular file' in log.warnings
    (tmp_path / 'metadata.yaml').write_text(yaml.safe_dump({
        'rosbag2_bagfile_information': {'relative_file_paths': [['first.mcap'], {}]}}))
    for name in ('pipe.mcap', 'loop.mcap'):
        (tmp_path / name).unlink()
    with Log([tmp_path]) as log:  # a list that makes no sense is none
        assert read(log) == ['first', 'last']


def test_a_bag_whose_list_is_a_pipe_has_no_list(tmp_path: Path) -> None:
    some_log(tmp_path / 'first.mcap')
    os.mkfifo(tmp_path / 'metadata.yaml')
    with patience(), Log([tmp_path]) as log:
        assert read(log) == ['first']


def test_a_pipe_beside_a_database_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / 'log.db3'
    large_messages(path)
    for suffix in ('-wal', '-shm', '-journal'):
        os.mkfifo(f'{path}{suffix}')
    with patience(), Log([path]) as log:
        assert {*log.topics} == {*TYPES}


def simulate(*options: object) -> int:
    return main(['simulate', '--params-file', str(CONFIG), '--duration', '1', *map(str, options)])


def stopped_simulation(path: Path, stop: Callable[[], None]) -> int:
    """Simulate to where a log is already, do something at the 20th message; the log stays."""
    path.write_bytes(b'mine')
    write, left = LogWriter.write, [20]

    def stopping(*given: object, **named: object) -> None:
        left[0] -= 1
        if not left[0]:
            stop()
        write(*given, **named)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LogWriter, 'write', stopping)
        code = simulate('--output', path)
    assert path.read_bytes() == b'mine'
    return code


def test_a_simulation_that_fails_leaves_the_log_that_was_there(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, part = tmp_path / 'log.mcap', tmp_path / 'log.part.mcap'

    def fail() -> None:
        raise OSError(28, 'No space left on device', str(part))

    assert stopped_simulation(path, fail) == 1
    assert capsys.readouterr().err == f'rovid simulate: {part}: No space left on device\n'
    assert simulate('--output', path) == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ['log.mcap']
    assert len(path.read_bytes()) > 4


def test_an_interrupted_simulation_leaves_the_log_that_was_there(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, part = tmp_path / 'log.mcap', tmp_path / 'log.part.mcap'
    assert stopped_simulation(path, lambda: signal.raise_signal(signal.SIGTERM)) == 143
    assert f'{part} holds the first' in capsys.readouterr().err
    with Log([part]) as log:
        assert sum(1 for _ in log.raw(list(log.topics))) == 20


@pytest.mark.parametrize('redirection', ['0<&- 2>&-', '2>/dev/full'])
def test_a_closed_stderr_is_no_reason_to_stop(redirection: str, tmp_path: Path) -> None:
    """Nor does the log get what was meant for it."""
    path = tmp_path / 'log.mcap'
    command = (f'"{sys.executable}" -m rovid_ros.commands simulate --params-file "{CONFIG}" '
               f'--duration 1 --output "{path}" --profile surge=99999@0.1 {redirection}')
    run = subprocess.run(['sh', '-c', command], cwd=REPOSITORY, env=child_environment(),
                         stdout=subprocess.PIPE, text=True)
    assert run.returncode == 0
    assert 'messages, seed 1' in run.stdout
    assert 'warning' not in run.stdout
    with Log([path]) as log:
        assert log.warnings == []


def test_no_file_is_opened_in_place_of_stdout_or_stderr(tmp_path: Path) -> None:
    code = ('import os, sys\n'
            'from rovid_ros.commands.running import open_standard_files\n'
            'open_standard_files()\n'
            'with open(sys.argv[1], "w"):\n'
            '    os.write(1, b"printed")\n'
            '    os.write(2, b"told")\n')
    path = tmp_path / 'log'
    run = subprocess.run(
        ['sh', '-c', '"$0" -c "$1" "$2" >&- 2>&-', sys.executable, code, str(path)],
        cwd=REPOSITORY, env=child_environment())
    assert run.returncode == 0
    assert path.read_text() == ''


def test_ctrl_c_during_the_imports_is_one_line() -> None:
    """The signal comes when the first slow module is asked for."""
    code = ('import signal, sys\n'
            'class Finder:\n'
            '    def find_spec(self, name, path=None, target=None):\n'
            '        if name == sys.argv[1]:\n'
            '            signal.raise_signal(signal.SIGINT)\n'
            'sys.meta_path.insert(0, Finder())\n'
            'from rovid_ros.commands.main import main\n'
            'sys.exit(main(["replay"]))\n')
    for module in ('rovid_ros.commands.running', 'rovid_ros.commands.arguments', 'numpy'):
        run = subprocess.run([sys.executable, '-c', code, module], cwd=REPOSITORY,
                             env=child_environment(), capture_output=True, text=True)
        assert run.returncode == 130
        (line,) = run.stderr.splitlines()
        assert line in ('rovid: interrupted', 'rovid replay: interrupted')
