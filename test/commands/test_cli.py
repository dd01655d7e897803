"""The command line: help, wrong usage, one line for every error, the progress bar."""

from collections.abc import Sequence
import io
import os
from pathlib import Path
import subprocess
import sys
from threading import Thread

import pytest
from rovid_ros import build
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.main import COMMANDS, main
from rovid_ros.commands.running import check_written, CommandError, Interrupted, run_to_exit_code
from rovid_ros.files.whole_files import write_json
from rovid_ros.results.text import number, percent, table, told_delay, unit


@pytest.fixture
def config(repository: Path) -> str:
    """Return a good parameter file."""
    return str(repository / 'config' / 'jhurov.yaml')


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the line on stderr, and check that it is the only output."""
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1, err
    return err


@pytest.mark.parametrize('arguments', [
    ['--help'], ['--version'], *([command, '--help'] for command in COMMANDS)])
def test_help_and_version(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ''
    assert out


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    main(['--version'])
    assert capsys.readouterr().out == f'rovid {build()}\n'


def test_no_command_at_all_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert 'replay' in capsys.readouterr().err


@pytest.mark.parametrize(('arguments', 'says'), [
    (['repaly'], "'repaly'"),
    (['repaly'], "did you mean 'replay'?"),
    (['export', 'x', '--format', 'ymal'], "did you mean 'yaml'?"),
    (['replay', 'log.mcap', '--params-file', 'x', '--outptu', 'y'],
     'rovid replay: unrecognized arguments: --outptu y (see rovid replay --help)'),
    (['replay', 'log.mcap', '--params-file', 'x', '--out', 'y'], '--out y'),
    (['--foo'], 'rovid: unrecognized arguments: --foo'),
    (['replay', 'log.mcap', '--params-file', 'x', '--start', '1e300'], 'from 0 up to 1e+09'),
    (['replay', 'log.mcap', '--params-file', 'x', '--duration', '1e300'], 'up to 1e+09'),
    (['replay', 'log.mcap', '--params-file', 'x', '--duration', '1e-12'], 'from 0.001'),
    (['replay', 'log.mcap', '--params-file', 'x', '--output', 'x.db3'], 'ends in .mcap'),
    (['simulate', '--params-file', 'x', '--output', 'x.db3'], 'ends in .mcap'),
    (['simulate', '--params-file', 'x', '--output', 'y', '--duration', '1e300'], "got '1e300'"),
    (['simulate', '--params-file', 'x', '--output', 'y', '--duration', '1e-12'], "got '1e-12'"),
    (['replay', '--params-file', 'x'], 'LOG'),
    (['replay', 'log.mcap'], '--params-file'),
    (['replay', 'log.mcap', '--params-file', 'x', '--start', '-1'], "got '-1'"),
    (['replay', 'log.mcap', '--params-file', 'x', '--start', 'nan'], "got 'nan'"),
    (['replay', 'log.mcap', '--params-file', 'x', '--duration', '0'], 'from 0.001'),
    (['replay', 'log.mcap', '--params-file', 'x', '--rate', '2'], '--rate goes with --ros'),
    (['replay', 'log.mcap', '--params-file', 'x', '--rate', '0'], 'above 0'),
    (['replay', 'log.mcap', '--params-file', 'x', '--rates'], '--rates'),
    (['check'], 'FILE'),
    (['check', 'x', 'log.mcap', '--live'], '--live and a LOG exclude each other'),
    (['check', 'x', '--timeout', '3'], '--timeout goes with --live'),
    (['check', 'x', '--namespace', '/rov1'], '--namespace goes with --live'),
    (['check', 'x', '--start', '3'], '--start goes with a LOG'),
    (['check', 'x', '--live', '--timeout', '0'], 'above 0'),
    (['simulate', '--params-file', 'x'], '--output'),
    (['simulate', '--params-file', 'x', '--output', 'y', '--seed', '-1'], "got '-1'"),
    (['simulate', '--params-file', 'x', '--output', 'y', '--profile', 'srge=1@1'], 'surge'),
])
def test_wrong_usage_is_one_line_and_exit_code_2(
        arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    line = one_line(capsys)
    assert says in line
    assert '--help' in line


def test_an_unknown_method_is_wrong_usage(
        config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', 'log.mcap', '--params-file', config, '--method', 'adi']) == 2
    assert "did you mean 'aid'" in one_line(capsys)


@pytest.mark.parametrize(('arguments', 'says'), [
    (['replay', 'no.mcap', '--params-file', '{config}'], 'no.mcap'),
    (['replay', '{config}', '--params-file', '{config}'], 'is not a log'),
    (['replay', 'no.mcap', '--params-file', 'no.yaml'], 'no.yaml'),
    (['replay', 'no.mcap', '--params-file', '{config}', '--output', 'no/such/out.mcap'],
     'the directory no/such does not exist'),
    (['replay', 'no.mcap', '--params-file', '{config}', '--json', '/'], 'is a directory'),
    (['check', '{config}', '--json', 'no/such/out.json'], 'no/such does not exist'),
    (['check', '{config}', '--json', '{config}'], 'is read by this command'),
    (['replay', 'a.mcap', '--params-file', '{config}', '--output', 'a.mcap'],
     'is read by this command'),
    (['simulate', '--params-file', '{config}', '--output', 'x', '--profile', 'sway=1@1'],
     'simulation.sway.mass'),
])
def test_an_input_at_fault_is_one_line_and_exit_code_1(
        arguments: Sequence[str], says: str, config: str, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([argument.format(config=config) for argument in arguments]) == 1
    assert says in one_line(capsys)
    assert list(tmp_path.iterdir()) == []


def test_an_error_in_the_parameters_names_file_and_key(
        config: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'wrong.yaml'
    path.write_text(Path(config).read_text().replace('max_gap: 0.0', 'max_gap: -1.0'))
    assert main(['replay', 'no.mcap', '--params-file', str(path)]) == 1
    number = path.read_text()[:path.read_text().index('max_gap')].count('\n') + 1
    assert one_line(capsys).startswith(
        f'rovid replay: {path}:{number}: max_gap: got -1.0, takes')


def test_a_defect_keeps_its_traceback() -> None:
    def broken() -> None:
        raise ValueError('a bug')

    with pytest.raises(ValueError, match='a bug'):
        run_to_exit_code('rovid', broken)


@pytest.mark.parametrize(('error', 'code', 'line'), [
    (CommandError('two\nlines'), 1, 'rovid: two lines\n'),
    (Interrupted('interrupted; kept'), 130, 'rovid: interrupted; kept\n'),
    (Interrupted('interrupted', 143), 143, 'rovid: interrupted\n'),
    (KeyboardInterrupt(), 130, 'rovid: interrupted\n'),
    (OSError(28, 'No space left on device', 'out.mcap'), 1,
     'rovid: out.mcap: No space left on device\n'),
    (OSError(28, 'No space left on device'), 1, 'rovid: No space left on device\n'),
])
def test_errors_become_lines(error: BaseException, code: int, line: str,
                             capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise error

    assert run_to_exit_code('rovid', fail) == code
    assert capsys.readouterr().err == line


def test_a_file_that_is_read_is_never_written(tmp_path: Path) -> None:
    bag, link = tmp_path / 'bag', tmp_path / 'link.mcap'
    bag.mkdir()
    log = bag / 'a.mcap'
    log.touch()
    link.symlink_to(log)
    for path, read in ((log, log), (link, log), (log, link), (log, bag)):
        with pytest.raises(CommandError, match='is read by this command'):
            check_written([path], [read])
    with pytest.raises(CommandError, match='written twice'):
        check_written([tmp_path / 'x', None, tmp_path / 'bag' / '..' / 'x'], [])
    check_written([tmp_path / 'x', tmp_path / 'y', None], [bag])


def test_a_link_to_itself_is_no_traceback(tmp_path: Path) -> None:
    loop = tmp_path / 'loop.mcap'
    loop.symlink_to(loop)
    check_written([loop], [loop.parent / 'x'])


def test_the_module_is_the_command(repository: Path, environment: dict[str, str]) -> None:
    out = subprocess.run(
        [sys.executable, '-m', 'rovid_ros.commands', '--version'], cwd=repository, env=environment,
        check=True, capture_output=True, text=True).stdout
    assert out == f'rovid {build()}\n'


def test_only_the_command_that_runs_is_imported(
        repository: Path, environment: dict[str, str]) -> None:
    code = ('import sys; from rovid_ros.commands.main import main; main(["--version"]); '
            'print([m for m in ("numpy", "rosbags", "mcap", "yaml", "rclpy") '
            'if m in sys.modules])')
    out = subprocess.run(
        [sys.executable, '-c', code], env={**environment, 'PYTHONPATH': str(repository)},
        check=True, capture_output=True, text=True).stdout
    assert out.splitlines()[-1] == '[]'


class Terminal(io.StringIO):
    """A terminal that keeps what is drawn on it."""

    def isatty(self) -> bool:
        """Say yes."""
        return True


def test_progress_shows_on_a_terminal_and_wipes_itself() -> None:
    terminal = Terminal()
    with Progress('replay', lambda: 0.5, stream=terminal, delay=0.0) as progress:
        progress.tick()
        assert '[###############...............]  50 %' in terminal.getvalue()
        width = len(terminal.getvalue()) - 1
    assert terminal.getvalue().endswith('\r' + ' ' * width + '\r')


def test_progress_is_silent_for_a_quick_run_and_for_a_pipe() -> None:
    quick, pipe = Terminal(), io.StringIO()
    for stream, delay in ((quick, 1.0), (pipe, 0.0)):
        with Progress('replay', lambda: 0.5, stream=stream, delay=delay) as progress:
            progress.tick()
        assert stream.getvalue() == ''


@pytest.mark.parametrize(('value', 'text'), [
    (0.0, '0'), (-0.0, '0'), (290.0, '290.0'), (12345.6, '12,346'), (0.0034482, '0.003448'),
    (-1.5e-7, '-1.500e-07'), (2.5e9, '2.500e+09'), (None, '-'), (float('nan'), '-'),
    (float('inf'), '-'),
])
def test_numbers_have_four_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_thrust_before_its_stamps_is_no_delay() -> None:
    assert told_delay(0.1532, 0.04489) == 'the thrust is delayed by 0.1532 ± 0.04489 s'
    assert told_delay(-0.049, 0.01) == (
        'the thrust acts 0.04900 ± 0.01000 s sooner than its stamps say')


def test_a_fit_is_never_minus_zero() -> None:
    assert [percent(fit) for fit in (-0.0004, -0.0, 0.98765, -0.5)] == [
        '0.0 %', '0.0 %', '98.8 %', '-50.0 %']


def test_units_follow_the_degree_of_freedom() -> None:
    assert (unit('surge', 'mass'), unit('yaw', 'mass')) == ('kg', 'kg m²')


def test_a_table_lines_up() -> None:
    assert table([['', 'a'], ['bb', '100']]) == '       a\nbb   100'


def test_json_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / 'out.json'
    write_json(path, {'a': 1})
    with pytest.raises(ValueError, match='JSON'):
        write_json(path, {'a': float('nan')})
    assert path.read_text() == '{\n  "a": 1\n}\n'
    assert list(tmp_path.iterdir()) == [path]


def test_json_goes_through_a_link(tmp_path: Path) -> None:
    path, link = tmp_path / 'folder' / 'out.json', tmp_path / 'link.json'
    path.parent.mkdir()
    link.symlink_to(path)
    for value in (1, 2):  # at first there is nothing behind the link
        write_json(link, value)
        assert link.is_symlink()
        assert path.read_text() == f'{value}\n'
    assert list(path.parent.iterdir()) == [path]


def test_json_goes_into_a_pipe(tmp_path: Path) -> None:
    path = tmp_path / 'pipe'
    os.mkfifo(path)
    read: list[str] = []
    reader = Thread(target=lambda: read.append(path.read_text()), daemon=True)
    reader.start()
    write_json(path, [1])
    reader.join(10.0)
    assert read == ['[\n  1\n]\n']
    assert path.is_fifo()


def test_json_goes_to_stdout_after_what_was_printed(
        tmp_path: Path, repository: Path, environment: dict[str, str]) -> None:
    code = ('from pathlib import Path; from rovid_ros.files.whole_files import write_json; '
            'print("before"); write_json(Path("/dev/stdout"), 1); print("after")')
    with (tmp_path / 'out').open('w') as file:
        subprocess.run([sys.executable, '-c', code], cwd=repository, env=environment,
                       check=True, stdout=file)
    assert (tmp_path / 'out').read_text() == 'before\n1\nafter\n'


def test_json_that_cannot_be_written_names_the_given_path(tmp_path: Path) -> None:
    path = tmp_path / 'absent' / 'out.json'
    with pytest.raises(FileNotFoundError) as error:
        write_json(path, 1)
    assert error.value.filename == str(path)
