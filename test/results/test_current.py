"""The current of the water in topics, JSON, text and diagnostics."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from rovid_core.identify.estimate import Current, DofEstimate, Estimate
from rovid_core.settings.run import Settings
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import OutputLog
from rovid_ros.results.current import current_text
from rovid_ros.results.documents import current_document
from rovid_ros.results.outputs import CURRENT_TOPICS, OK, Outputs, TOPICS, WARN

from test.support.outputs import fields_of

TIME = 1_700_000_000_123_456_789
CURRENT = Current(0.21, -0.08, (4e-4, 1e-4, 9e-4), 1.5, 'known')


def settings(**changes: Any) -> Settings:
    return settings_from({
        'dofs': ['surge', 'yaw'], 'identifier.method': 'ekf', 'surge.initial.mass': 200.0,
        'yaw.initial.mass': 50.0, 'position.topic': '/position', 'attitude.topic': '/attitude',
        'thrusters.topic': '/thrust', 'thrusters.gain': [1.0],
        'thrusters.allocation': [1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        **{key.replace('__', '.'): value for key, value in changes.items()}})


def estimate(current: Current | None) -> Estimate:
    dofs = tuple(DofEstimate(name, (0.01, 0.0, 0.0, 0.0)) for name in ('surge', 'yaw'))
    return Estimate(TIME, dofs, (0,), current)


def fields(current: Current | None, **changes: Any) -> dict[str, dict[str, Any]]:
    return {out.topic: fields_of(out)
            for out in Outputs(settings(**changes)).messages(estimate(current))}


@pytest.mark.parametrize(('frames', 'frame', 'vector', 'covariance'), [
    ('enu', 'map', (0.21, -0.08), [4e-4, 1e-4, 1e-4, 9e-4]),
    ('ned', 'map_ned', (-0.08, 0.21), [9e-4, 1e-4, 1e-4, 4e-4])])
def test_the_current_is_told_in_the_world_of_the_messages(
        frames: str, frame: str, vector: tuple[float, float], covariance: list[float]) -> None:
    told = fields(CURRENT, frames=frames)
    assert list(told) == [*TOPICS, *CURRENT_TOPICS]
    assert told['rov/current']['header']['frame_id'] == frame
    assert told['rov/current']['vector'] == {**dict(zip('xy', vector)), 'z': 0.0}
    assert told['rov/current_covariance']['data'] == covariance
    assert told['rov/current_covariance']['layout']['dim'][0] == {
        'label': 'x,y', 'size': 2, 'stride': 4}
    status = told['rov/estimate']['status'][-1]
    values = {entry['key']: entry['value'] for entry in status['values']}
    assert (status['name'], status['level'], status['message']) == ('current', OK, 'known')
    assert [float(values[name]) for name in 'xy'] == [*vector]
    assert float(values['x_std'])**2 == pytest.approx(covariance[0])


@pytest.mark.parametrize('current', [
    None, CURRENT._replace(status='unobservable', advice='turn by 45 degrees or more')])
def test_a_current_that_cannot_be_seen_is_not_a_number(current: Current | None) -> None:
    told = fields(current)
    vector = told['rov/current']['vector']
    assert [math.isnan(vector[axis]) for axis in 'xyz'] == [True, True, False]
    assert all(map(math.isnan, told['rov/current_covariance']['data']))
    status = told['rov/estimate']['status'][-1]
    assert status['level'] == WARN
    assert 'turn by 45 degrees' in status['message']
    document = current_document(settings(), current)
    assert document and (document['x'], document['status']) == (None, 'unobservable')
    json.dumps(document, allow_nan=False)
    assert 'turn by 45 degrees' in current_text(document)


@pytest.mark.parametrize(('status', 'advice'), [
    ('unobservable', 'thrust on other headings'), ('inconsistent', 'a tether of 1.0 N fits')])
def test_what_is_missing_or_fits_better_is_said_once(status: str, advice: str) -> None:
    current = CURRENT._replace(chi2=12.0, status=status, advice=advice)
    said = fields(current)['rov/estimate']['status'][-1]
    assert (said['level'], said['message']) == (WARN, f'{status}: {advice}')
    document = current_document(settings(), current)
    assert document and current_text(document).endswith(f'{status} ({advice})')


def test_the_line_of_a_current_has_its_numbers() -> None:
    document = current_document(settings(), CURRENT)
    assert document and current_text(document) == (
        'current of the water: x 0.2100 ± 0.02000 m/s, y -0.08000 ± 0.03000 m/s, known')


@pytest.mark.parametrize('changes', [
    {'current__prior': 0}, {'identifier__method': 'aid'},
    {'position__topic': '', 'velocity__topic': '/dvl', 'velocity__relative_to': 'water'},
    {'attitude__topic': '', 'angular_velocity__topic': '/gyro', 'position__topic': '',
     'velocity__topic': '/dvl'}])
def test_nothing_is_told_where_no_current_is_estimated(changes: dict[str, Any]) -> None:
    assert list(fields(None, **changes)) == [*TOPICS]
    assert current_document(settings(**changes), None) is None


def test_a_dvl_over_ground_sees_the_current() -> None:
    changes = {'position__topic': '', 'velocity__topic': '/dvl'}
    assert settings(**changes).estimates_current


def test_a_log_holds_the_current(tmp_path: Path) -> None:
    path = tmp_path / 'out.mcap'
    with OutputLog(path) as log:
        for out in Outputs(settings()).messages(estimate(CURRENT)):
            log.write_raw(f'/{out.topic}', out.type, out.cdr, TIME)
        log.finish()
    with Log([path]) as read:
        message, = read.messages(['/rov/current'])
    assert (message.data.vector.x, message.data.vector.y) == (CURRENT.x, CURRENT.y)
