"""Several parameter files and overrides on the command line of a command, as the node has them."""

from pathlib import Path

import pytest
from rovid_ros.commands.main import main
from rovid_ros.config.parameter_file import override, ParameterFileError, ParameterSource


def written(path: Path, text: str) -> Path:
    path.write_text(f'/**:\n  ros__parameters:\n{text}')
    return path


def test_later_files_win_and_overrides_over_all(tmp_path: Path) -> None:
    one = written(tmp_path / 'one.yaml', '    max_gap: 1.0\n    max_wait: 0.1\n    frames: enu\n')
    two = written(tmp_path / 'two.yaml', '    max_gap: 2.0\n    max_wait: 0.2\n')
    source = ParameterSource((one, two), ('max_wait:=0.3', 'dofs:=[surge, yaw]'))
    assert source.values() == {
        'max_gap': 2.0, 'max_wait': 0.3, 'frames': 'enu', 'dofs': ['surge', 'yaw']}
    assert [source.place_of(key) for key in ('max_wait', 'max_gap', 'frames', 'sway.terms')] == [
        '-p max_wait:=0.3', f'{two}:3', f'{one}:5', f'{one}, {two}']


@pytest.mark.parametrize('rule, expected', [
    ('velocity.cutoff:=1e-1', {'velocity.cutoff': 0.1}), ('enable:=off', {'enable': False}),
    ('max_gap:=0,75', {'max_gap': '0,75'}),
    ("position.topic:='/usbl'", {'position.topic': '/usbl'}), ('a:=010', {'a': 8}),
    ('identifier_node:max_gap:=2', {'max_gap': 2}), ('thrusters.names:=[]', {
        'thrusters.names': []})])
def test_an_override_is_read_as_in_a_file(rule: str, expected: dict[str, object]) -> None:
    assert override(rule) == expected


@pytest.mark.parametrize('rule', ['max_gap=2', ':=2', 'max_gap:=', 'max_gap:=[1', 'a:={b: 1}}'])
def test_what_is_no_override_is_refused_in_a_line(rule: str) -> None:
    with pytest.raises(ParameterFileError) as refused:
        override(rule)
    assert str(refused.value).startswith(f'-p {rule}: ')
    assert '\n' not in str(refused.value)


def test_a_command_takes_them(
        tmp_path: Path, repository: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file, out = repository / 'config' / 'jhurov.yaml', tmp_path / 'out.mcap'
    more = written(tmp_path / 'more.yaml', '    simulation.position_rate: 4.0\n')
    arguments = ['--params-file', str(file), '--params-file', str(more),
                 '-p', 'dofs:=[surge]', '--output', str(out)]
    assert main(['simulate', *arguments, '--duration', '3']) == 0
    said = capfd.readouterr().out
    assert f"--params-file {file} --params-file {more} -p 'dofs:=[surge]'" in said
    assert main(['replay', str(out), *arguments[:6]]) == 0
    assert 'yaw' not in capfd.readouterr().out
    assert main(['replay', str(out), *arguments[:6], '-p', 'max_gap:=-2']) == 1
    assert '-p max_gap:=-2: max_gap: got -2, takes a number' in capfd.readouterr().err
    capfd.readouterr()
    assert main(['check', str(file), '--params-file', str(more), '-p', 'dofs:=[surge]']) == 0
    said = capfd.readouterr().out
    assert f'{file}, {more}' in said
    assert 'thrusters drive 1 degrees of freedom' in said
    assert main(['check', str(file), '-p', 'max_gap:=-2']) == 1
    assert '-p max_gap:=-2' in capfd.readouterr().out
