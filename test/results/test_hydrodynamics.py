"""Exports for controllers and simulators: read as they read them, the motion is the same."""

from collections.abc import Callable
import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rovid_core.model.dofs import DOFS, PARAMETERS, PHYSICAL
from rovid_core.model.plant import lumped, physical
from rovid_ros.commands.main import main
import yaml

# effective mass, quadratic drag, linear drag, bias
MODELS = {
    'surge': (20.0, 90.0, 9.0, 0.0), 'sway': (27.0, 140.0, 12.0, 0.5),
    'heave': (34.0, 165.0, 18.0, -2.5), 'yaw': (0.55, 1.3, 0.125, 0.0)}
DRY = {'surge': 13.5, 'sway': 13.5, 'heave': 13.5, 'yaw': 0.37}
ADDED = ('Xdu', 'Ydv', 'Zdw', 'Kdp', 'Mdq', 'Ndr')
LINEAR = ('Xu', 'Yv', 'Zw', 'Kp', 'Mq', 'Nr')
QUADRATIC = ('Xuu', 'Yvv', 'Zww', 'Kpp', 'Mqq', 'Nrr')

Law = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    dofs = {}
    for dof, values in MODELS.items():
        parameters = lumped(*values)
        dofs[dof] = {**dict(zip(PARAMETERS, parameters)),
                     **dict(zip(PHYSICAL, physical(parameters))), 'std': None}
    (tmp_path / 'out.json').write_text(json.dumps({'method': 'ekf', 'steps': 1, 'dofs': dofs}))
    parameters = {
        'dofs': list(MODELS), 'position': {'topic': '/p'}, 'attitude': {'topic': '/a'},
        'thrusters': {'topic': '/w', 'type': 'geometry_msgs/msg/WrenchStamped',
                      'field': 'wrench'},
        **{dof: {'initial': {'mass': 1.0}, 'dry_mass': DRY[dof]} for dof in MODELS}}
    (tmp_path / 'rov.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
    return tmp_path


@pytest.fixture
def export(files: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def call(*arguments: str, code: int = 0) -> str:
        assert main(['export', str(files / 'out.json'), '--params-file',
                     str(files / 'rov.yaml'), *arguments]) == code
        out, err = capsys.readouterr()
        return out if code == 0 else err
    return call


def check(law: Law) -> None:
    """Compare M, D_l and D_q, all positive, with the models."""
    for matrix, which in zip(law, (0, 2, 1)):
        assert matrix.shape == (6, 6)
        for i, dof in enumerate(DOFS):
            if dof in MODELS:
                assert matrix[i, i] == pytest.approx(MODELS[dof][which], rel=1e-12)
        assert np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0


def read_urdf(text: str) -> tuple[Law, dict[str, float]]:
    """Read as the library ``hydrodynamics`` does: M = M_RB - diag(added), D = -linear - ..."""
    element = ElementTree.fromstring(text)
    element = element if element.tag == 'hydrodynamics' else element.find('.//hydrodynamics')

    def values(path: str, names: tuple[str, ...]) -> np.ndarray:
        found = element.find(path)  # type: ignore[union-attr]
        return np.array([float(found.attrib[name]) for name in names])  # type: ignore[union-attr]

    mass, = values('inertial/mass', ('value',))
    moments = values('inertial/inertia', ('ixx', 'iyy', 'izz'))
    return (np.diag([mass] * 3 + [*moments]) - np.diag(values('inertial/added_mass', ADDED)),
            -np.diag(values('damping/linear', LINEAR)),
            -np.diag(values('damping/quadratic', QUADRATIC))), {
                'buoyancy': values('hydrostatics/buoyancy', ('value',))[0], 'mass': mass,
                'centre': values('hydrostatics/center_of_buoyancy', ('x', 'y', 'z')).sum()}


def test_urdf(export: Callable[..., str]) -> None:
    law, more = read_urdf(export('--format', 'urdf'))
    check(law)
    assert more['mass'] == 13.5
    # heave: weight less buoyancy is -2.5 N
    assert more['buoyancy'] == pytest.approx(13.5 * 9.81 + 2.5)


ROBOT = """\
<?xml version="1.0"?>
<!-- <hydrodynamics><damping><linear Xu="1"/></damping></hydrodynamics> -->
<robot name="blue"  xmlns:xacro="http://ros.org/wiki/xacro">
  <link name='base_link'><inertial><mass value="99"/></inertial></link>
  <ros2_control name="x" type="system"><hydrodynamics>
    <inertial>
      <mass value="11.5"/>  <!-- dry -->
      <inertia ixx="0.2" iyy="0.3" izz="0.4"/>
      <center_of_gravity x="0" y="0" z="0"/>
      <added_mass Xdu="-1" Ydv='-2' Zdw="-3"
                  Kdp="-0.5" Mdq="-0.6" Ndr="-7"/>
    </inertial>
    <damping><linear Xu="1" Yv="1" Zw="1" Kp="-0.07" Mq="-0.08" Nr="1"/>
      <quadratic Xuu="1" Yvv="1" Zww="1" Kpp="-1.5" Mqq="-1.6" /></damping>
    <hydrostatics><buoyancy value="1"/><center_of_buoyancy x="0" y="0" z="0.01"/></hydrostatics>
  </hydrodynamics></ros2_control>
</robot>
"""


def test_urdf_into_a_file_leaves_the_rest(files: Path, export: Callable[..., str]) -> None:
    robot = files / 'robot.urdf'
    robot.write_text(ROBOT)
    export('--format', 'urdf', '--into', str(robot))
    text = robot.read_text()
    law, more = read_urdf(text)
    check(law)  # with the mass and moments of the file
    assert more['buoyancy'] == pytest.approx(11.5 * 9.81 + 2.5)
    assert law[1][3, 3] == 0.07 and law[2][4, 4] == 1.6 and law[0][3, 3] == 0.2 + 0.5
    numbers = re.compile(r'"-?[\d.e-]+"|\'-?[\d.]+\'')
    new = re.sub(' Nrr="[^"]*"', '', text)  # it was not there
    assert re.sub(numbers, '#', new).replace('Mqq=# />', 'Mqq=#/>') == re.sub(
        numbers, '#', ROBOT).replace('Mqq=# />', 'Mqq=#/>')
    assert text.splitlines()[1] == ROBOT.splitlines()[1]  # a comment is no element
    export('--format', 'urdf', '--into', str(robot))
    assert robot.read_text() == text


def test_urdf_into_a_file_without_the_element(files: Path, export: Callable[..., str]) -> None:
    robot = files / 'robot.urdf'
    before = '<robot name="a">\n  <link name="b"/>\n</robot>\n'
    robot.write_text(before)
    export('--format', 'urdf', '--into', str(robot))
    check(read_urdf(robot.read_text())[0])
    assert robot.read_text().startswith('<robot name="a">\n  <link name="b"/>\n')
    assert robot.read_text().endswith('</robot>\n')


@pytest.mark.parametrize(('text', 'says'), [
    ('<robot', 'is not XML'), ('<robot/>', 'has no element to put it into'),
    (ROBOT.replace('<linear', '<linaer'), 'has no <damping><linear>'),
    (ROBOT.replace('"11.5"', '"${mass}"'), "value of its <mass> is '${mass}'"),
    (ROBOT.replace('"11.5"', '"1150"'), 'is above the identified effective mass'),
    (ROBOT.replace('</robot>', '<hydrodynamics/></robot>'), 'has 2 <hydrodynamics>'),
    ('\xff', 'is not UTF-8'), ('', 'is not XML')])
def test_file_that_cannot_be_edited_is_left_alone(
        files: Path, export: Callable[..., str], text: str, says: str) -> None:
    robot = files / 'robot.urdf'
    robot.write_bytes(text.encode('latin-1'))
    err = export('--format', 'urdf', '--into', str(robot), code=1)
    assert says in err and err.count('\n') == 1
    assert robot.read_bytes() == text.encode('latin-1')


def test_ros_params_of_blue(export: Callable[..., str]) -> None:
    text = export('--format', 'ros-params')
    found = yaml.safe_load(text)['/**']['ros__parameters']['hydrodynamics']
    rigid = np.diag([found['mass']] * 3 + found['moments_of_inertia'])
    check((rigid - np.diag(found['added_mass']), -np.diag(found['linear_damping']),
           -np.diag(found['quadratic_damping'])))
    assert all(x <= 0.0 for key in ('added_mass', 'linear_damping', 'quadratic_damping')
               for x in found[key])
    assert found['weight'] - found['buoyancy'] == pytest.approx(-2.5)


def test_ros_params_of_uuv_simulator(export: Callable[..., str]) -> None:
    found: dict[str, Any] = yaml.safe_load(
        export('--format', 'ros-params', '--dialect', 'uuv_simulator'))
    inertia = found['inertial']
    rigid = np.diag([found['mass']] * 3 + [inertia[name] for name in ('ixx', 'iyy', 'izz')])
    check((rigid + np.array(found['Ma']), -np.diag(found['linear_damping']),
           -np.diag(found['quad_damping'])))
    assert (found['mass'] - found['volume'] * found['density']) * 9.81 == pytest.approx(-2.5)


def test_fossen(export: Callable[..., str]) -> None:
    found = json.loads(export('--format', 'fossen'))
    check(tuple(np.array(found[name]) for name in ('M', 'D_l', 'D_q')))  # type: ignore[arg-type]
    assert found['g'] == pytest.approx([0.0, 0.5, -2.5, 0.0, 0.0, 0.0])
    # at its steady speed the thrust is the drag and the bias
    v = np.array([0.5, -0.3, 0.2, 0.0, 0.0, 1.0])
    tau = np.array(found['D_l']) @ v + np.array(found['D_q']) @ (abs(v) * v) + found['g']
    for i, dof in enumerate(DOFS):
        if dof in MODELS:
            alpha, beta, gamma, delta = lumped(*MODELS[dof])
            assert alpha * tau[i] + beta * v[i] * abs(v[i]) + gamma * v[i] + delta == (
                pytest.approx(0.0, abs=1e-12))


@pytest.mark.parametrize(('arguments', 'says'), [
    (['--format', 'csv', '--into', 'x'], '--into goes with'),
    (['--format', 'urdf', '--dialect', 'blue'], '--dialect goes with')])
def test_wrong_usage(export: Callable[..., str], arguments: list[str], says: str) -> None:
    assert says in export(*arguments, code=2)


def test_unknown_dry_masses_are_named(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['export', str(files / 'out.json'), '--format', 'fossen']) == 1
    said = capsys.readouterr().err
    assert 'surge.dry_mass: is unknown' in said
    assert said.rstrip().endswith('yaw.dry_mass')  # all at once


def test_what_was_not_identified_is_said(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['export', str(files / 'out.json'), '--params-file', str(files / 'rov.yaml'),
                 '--format', 'fossen']) == 0
    assert 'not identified: roll, pitch: 0\n' in capsys.readouterr().err
