"""The examples to start with: a log and the configuration that its user has."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.settings.run import Settings
from rovid_ros.commands.examples import example_truth, EXAMPLES
from rovid_ros.commands.main import main
from rovid_ros.commands.replay import replay
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.player import PipelinePlayer


@pytest.fixture(scope='module', params=EXAMPLES)
def written(request: Any, tmp_path_factory: Any) -> tuple[str, Path, Settings]:
    """Return the name of an example, its log of 15 s and its configuration."""
    log = tmp_path_factory.mktemp('example') / 'dive.mcap'
    assert main(['simulate', '--example', request.param, '--duration', '15',
                 '--output', str(log)]) == 0
    return request.param, log, settings_from(load(log.with_suffix('.yaml')))


@pytest.mark.long
def test_configuration_reads_its_log(written: tuple[str, Path, Settings]) -> None:
    name, log, settings = written
    result = replay([log], settings, PipelinePlayer(settings))
    assert {dof for dof, values in result.dofs.items() if values['steps'] > 10} == {*settings.dofs}


def test_truth_is_in_the_log_and_not_in_the_configuration(
        written: tuple[str, Path, Settings]) -> None:
    name, log, settings = written
    assert not settings.simulation.dofs
    truth = example_truth(name)
    assert truth.thrusters.time_constant > settings.thrusters.time_constant
    assert truth.thrusters.reverse < settings.thrusters.reverse
    with log.open('rb') as file:
        said = next(record.metadata for record in make_reader(file).iter_metadata()
                    if record.name == 'rovid_truth')
    for dof in settings.dofs:
        assert float(said[f'{dof}.mass']) == truth.simulation.dofs[dof].mass
        assert float(said[f'{dof}.mass']) != settings.dof[dof].mass


def test_changed_configuration_is_not_lost(
        written: tuple[str, Path, Settings], capsys: pytest.CaptureFixture[str]) -> None:
    name, log, _ = written
    again = ['simulate', '--example', name, '--duration', '0.1', '--output', str(log)]
    configuration = log.with_suffix('.yaml')
    text = configuration.read_text()
    configuration.write_text(text + '# mine\n')
    before = log.read_bytes()
    assert main(again) == 1
    assert 'another configuration' in capsys.readouterr().err
    assert configuration.read_text().endswith('# mine\n') and log.read_bytes() == before
    configuration.write_text(text)


@pytest.mark.parametrize('arguments', [
    [], ['--output', 'x.mcap'], ['--example', 'auv', '--params-file', 'x.yaml'],
    ['--example', 'submarine']])
def test_needs_a_file_or_an_example(arguments: list[str]) -> None:
    assert main(['simulate', *arguments]) == 2
