"""The log that lies beside the tests, as one of a user's: read, checked, replayed, compared."""

from dataclasses import replace
import json
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rovid_ros.commands.main import main
from rovid_ros.commands.replay import replay, report
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.logs.player import PipelinePlayer

LOG = Path(__file__).parents[1] / 'data' / 'jhurov_dive.mcap'
CONFIG = Path(__file__).parents[2] / 'config' / 'jhurov.yaml'
TRUE = {'surge': (290.0, 290.0), 'heave': (2400.0, 2000.0), 'yaw': (90.0, 70.0)}
"""Effective mass and quadratic drag."""


def test_it_is_read_as_by_another_reader() -> None:
    with AnyReader([LOG]) as reader, Log([LOG]) as log:
        theirs = [(time, connection.topic, raw) for connection, time, raw in reader.messages()]
        ours = [(raw.time, raw.channel.topic, raw.data) for raw in log.raw(log.topics)]
    assert len(ours) == 4201
    assert sorted(ours) == sorted(theirs)


def test_its_check_finds_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['check', str(CONFIG), str(LOG)]) == 0
    assert 'error' not in capsys.readouterr().out


def test_a_low_fit_of_a_model_that_has_converged_is_explained() -> None:
    settings = settings_from(load(CONFIG))
    result = replay([LOG], settings, PipelinePlayer(settings))
    for fit, status, said in ((0.2, 'converged', True), (0.9, 'converged', False),
                              (0.2, 'converging', False)):
        text = report(replace(result, dofs={
            dof: {**values, 'fit': fit, 'status': status}
            for dof, values in result.dofs.items()}))
        assert ('surge, heave, yaw: the status speaks of the last minute' in text) == said


def test_its_replay_finds_the_vehicle(tmp_path: Path) -> None:
    assert main(['replay', str(LOG), '--params-file', str(CONFIG),
                 '--json', str(tmp_path / 'found.json')]) == 0
    found = json.loads((tmp_path / 'found.json').read_text())
    assert found['rejected'] == {}
    for dof, true in TRUE.items():
        one = found['dofs'][dof]
        assert (one['mass'], one['quadratic_drag']) == pytest.approx(true, rel=0.005)
        assert one['mae'] < 0.02
