"""``rovid export``: the same numbers in other formats, and the same motion in Gazebo."""

from collections.abc import Callable, Mapping, Sequence
import csv
import json
import math
from pathlib import Path
import re
import resource
import sys
from typing import Any
from xml.etree import ElementTree

from hypothesis import given, strategies as st
import pytest
from rovid_core.model.dofs import DOFS, PARAMETERS, PHYSICAL
from rovid_core.model.plant import advance, lumped, physical
from rovid_ros.commands.main import main
from rovid_ros.commands.running import read_settings
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.results.documents import Identified
from rovid_ros.results.export import export

TRUE = {'surge': (250.0, 290.0, 43.5, 2.9), 'heave': (270.0, 2000.0, 240.0, 10.0),
        'yaw': (60.0, 70.0, 13.5, 0.5)}
"""Effective mass, quadratic drag, linear drag and bias, all with less added than dry mass."""


def entry(values: Sequence[float], **more: Any) -> dict[str, Any]:
    """Return a DOF as the JSON of replay and compare has it."""
    parameters = lumped(*values)
    return {**dict(zip(PARAMETERS, parameters)), **dict(zip(PHYSICAL, physical(parameters))),
            'std': None, **more}


def replayed(dofs: Mapping[str, Any]) -> dict[str, Any]:
    return {'method': 'aid', 'steps': 10, 'dofs': {
        dof: entry(values, status='converging') for dof, values in dofs.items()}}


def model(method: str, log: str, mass: float, **mae: float | None) -> dict[str, Any]:
    """Return a model of a comparison: of surge, told apart by its mass."""
    scores = {f'{name}.mcap': {'mae': value, 'fit': 0.9} for name, value in mae.items()}
    return {'method': method, 'trained_on': log,
            'dofs': {'surge': entry((mass, 1.0, 1.0, 0.0), scores=scores)}}


@pytest.fixture
def config(repository: Path) -> str:
    return str(repository / 'config' / 'jhurov.yaml')


Run = Callable[..., tuple[int, str, str]]
Exported = Callable[..., tuple[str, str]]


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Return what exports a document or the text of a file: exit code, stdout and stderr."""
    def call(document: Any, *arguments: str) -> tuple[int, str, str]:
        path = tmp_path / 'estimates.json'
        path.write_text(document if isinstance(document, str) else json.dumps(document))
        code = main(['export', str(path), *arguments])
        return (code, *capsys.readouterr())
    return call


@pytest.fixture
def exported(run: Run) -> Exported:
    def call(document: Any, *arguments: str) -> tuple[str, str]:
        code, out, err = run(document, *arguments)
        assert code == 0, err
        return out, err
    return call


# --- yaml and csv


def test_yaml_gives_the_same_numbers_back(exported: Exported, tmp_path: Path) -> None:
    document = replayed(TRUE)
    out, err = exported(document, '--format', 'yaml')
    assert err == ''
    path = tmp_path / 'initial.yaml'
    path.write_text(out)
    assert load(path) == {f'{dof}.initial.{name}': document['dofs'][dof][name]
                          for dof in TRUE for name in PHYSICAL}


drag = st.floats(0.0, 1e100).map(lambda value: value if value > 1e-100 else 0.0)


@given(st.floats(1e-100, 1e100), drag, drag, st.floats(-1e100, 1e100))
def test_yaml_gives_any_number_back(
        tmp_path_factory: pytest.TempPathFactory, mass: float, quadratic: float, linear: float,
        bias: float) -> None:
    found = Identified('sway', lumped(mass, quadratic, linear, bias), 'aid')
    path = tmp_path_factory.getbasetemp() / 'any.yaml'
    path.write_text(export([found], 'yaml', Path('x.json')).text)
    again = load(path)
    for name, value in found.physical.items():
        assert again[f'sway.initial.{name}'] == (
            value if abs(value) >= sys.float_info.min else 0.0)
        assert isinstance(again[f'sway.initial.{name}'], float)


def test_yaml_fits_into_the_parameter_file(
        exported: Exported, config: str, tmp_path: Path) -> None:
    """What is merged is what the identifier then starts from."""
    path = tmp_path / 'initial.yaml'
    path.write_text(exported(replayed(TRUE), '--format', 'yaml')[0])
    settings = settings_from({**load(Path(config)), **load(path)})
    assert settings.dof['yaw'].mass == 1.0 / lumped(*TRUE['yaw'])[0]
    assert settings.dof['heave'].bias == pytest.approx(10.0)


def test_yaml_writes_no_drag_that_the_key_refuses(
        exported: Exported, config: str, tmp_path: Path) -> None:
    out, err = exported(replayed({'surge': (250.0, 290.0, -3.5, 0.0)}), '--format', 'yaml')
    assert 'warning: surge.initial.linear_drag' in err and '-3.5' in err
    assert '-3.5' in out
    path = tmp_path / 'initial.yaml'
    path.write_text(out)
    assert settings_from({**load(Path(config)), **load(path)}).dof['surge'].linear_drag == 0.0


def test_a_term_that_the_model_lacks_is_zero(exported: Exported) -> None:
    out, _ = exported(replayed({'surge': (250.0, 290.0, 0.0, 0.0)}), '--format', 'yaml')
    assert 'linear_drag: 0.0 ' in out and 'bias: 0.0 ' in out


def test_csv_has_one_row_per_dof_with_units(exported: Exported) -> None:
    document = replayed(dict(reversed(TRUE.items())))
    out, err = exported(document, '--format', 'csv')
    assert err == ''
    rows = list(csv.DictReader(out.splitlines()))
    assert [row['dof'] for row in rows] == ['surge', 'heave', 'yaw']
    for row in rows:
        for name in (*PARAMETERS, *PHYSICAL):
            assert float(row[name]) == document['dofs'][row['dof']][name]
    assert rows[0]['mass_unit'] == 'kg' and rows[0]['delta_unit'] == 'm/s^2'
    assert rows[2]['mass_unit'] == 'kg m^2' and rows[2]['alpha_unit'] == '1/(kg m^2)'


def test_output_goes_to_a_file(exported: Exported, tmp_path: Path) -> None:
    path = tmp_path / 'initial.yaml'
    printed, _ = exported(replayed(TRUE), '--format', 'yaml')
    out, _ = exported(replayed(TRUE), '--format', 'yaml', '--output', str(path))
    assert path.read_text() == printed
    assert out == f'written   {path}\n'


def test_a_full_disk_costs_no_file(exported: Exported, tmp_path: Path) -> None:
    path = tmp_path / 'initial.yaml'
    path.write_text('what was there')
    exported(replayed(TRUE), '--format', 'yaml')  # leaves the estimates
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400, before[1]))
    try:
        assert main(['export', str(tmp_path / 'estimates.json'), '--format', 'yaml',
                     '--output', str(path)]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == 'what was there'


@pytest.mark.parametrize('status', ['waiting', 'invalid'])
def test_a_dof_without_an_estimate_is_told(exported: Exported, status: str) -> None:
    document = replayed(TRUE)
    document['dofs']['heave']['status'] = status
    _, err = exported(document, '--format', 'csv')
    assert err.count('\n') == 1
    assert f'warning: heave: is {status}' in err


@pytest.mark.parametrize('compared', [False, True])
def test_masses_that_are_no_kilograms_are_told(exported: Exported, compared: bool) -> None:
    document = {'models': [model('output_error', 'a.mcap', 200.0, a=0.1)]} if compared else (
        replayed(TRUE))
    out, err = exported(document, '--format', 'csv')
    assert ',kg,' in out and 'warning' not in err
    for dof in (document['models'][0] if compared else document)['dofs'].values():
        dof['newtons'] = False
    out, err = exported(document, '--format', 'csv')
    assert ',cmd s^2/m,' in out and ',cmd s^2/m^2,' in out and 'kg' not in out
    assert err.count('warning: cmd is what a command of 1 pushes') == 1


# --- the JSON of compare

MODELS = {'models': [
    model('least_squares', 'a.mcap', 100.0, a=0.001, b=0.011),
    model('output_error', 'a.mcap', 200.0, a=0.004, b=0.002),
    model('output_error', 'logs/b.mcap', 300.0, a=0.006, b=0.001),
    model('aid', 'a.mcap', 400.0, a=0.0001, b=None),  # does not predict b
]}


@pytest.mark.parametrize(('arguments', 'mass', 'says'), [
    ([], 200.0, 'output_error, trained on a.mcap, mean mae 0.003000 m/s'),
    (['--method', 'least_squares'], 100.0, 'least_squares, trained on a.mcap'),
    (['--trained-on', 'logs/b.mcap'], 300.0, 'output_error, trained on logs/b.mcap'),
    (['--trained-on', 'b.mcap'], 300.0, 'output_error, trained on logs/b.mcap'),
    (['--method', 'aid', '--trained-on', 'a.mcap'], 400.0, 'aid, trained on a.mcap'),
])
def test_the_model_that_predicts_best(
        exported: Exported, arguments: list[str], mass: float, says: str) -> None:
    out, err = exported(MODELS, '--format', 'csv', *arguments)
    assert float(next(csv.DictReader(out.splitlines()))['mass']) == pytest.approx(mass)
    assert f'surge: {says}' in err


def test_the_best_model_is_per_dof(exported: Exported) -> None:
    document = json.loads(json.dumps(MODELS))
    for i, mae in enumerate((0.003, 0.002, 0.001, 0.004)):
        document['models'][i]['dofs']['yaw'] = entry(
            (10.0 + i, 1.0, 1.0, 0.0), scores={'a.mcap': {'mae': mae}})
    out, _ = exported(document, '--format', 'csv')
    masses = [float(row['mass']) for row in csv.DictReader(out.splitlines())]
    assert masses == pytest.approx([200.0, 12.0])


def test_a_model_without_parameters_is_not_the_best(exported: Exported) -> None:
    document = json.loads(json.dumps(MODELS))
    document['models'][1]['dofs']['surge']['alpha'] = None
    out, _ = exported(document, '--format', 'csv')
    assert '300.0' in out  # the next best


@pytest.mark.parametrize(('arguments', 'says'), [
    (['--method', 'output_eror'], "did you mean 'output_error'"),
    (['--trained-on', 'c.mcap'], 'has a.mcap, logs/b.mcap'),
    (['--method', 'aid', '--trained-on', 'b.mcap'], 'has a.mcap'),
])
def test_a_model_that_there_is_not(
        run: Run, arguments: list[str], says: str) -> None:
    code, out, err = run(MODELS, '--format', 'csv', *arguments)
    assert (code, out, err.count('\n')) == (1, '', 1)
    assert says in err


# --- sdf

AXES = dict(zip(DOFS, ('xU', 'yV', 'zW', 'kP', 'mQ', 'nR')))


def coefficients(text: str) -> dict[str, float]:
    plugin = ElementTree.fromstring(text)
    assert plugin.attrib == {'filename': 'gz-sim-hydrodynamics-system',
                             'name': 'gz::sim::systems::Hydrodynamics'}
    return {child.tag: float(child.text or '') for child in plugin if child.tag != 'link_name'}


class GazeboLink:
    """
    A link in one degree of freedom with the plugin on it.

    Written from the equations of Hydrodynamics::PreUpdate: the wrench is
    - Ma v' + D v with D = - linear - quadratic |v|, and its negative is put on the link; v' is
    the backward difference of the velocities at this step and the one before.
    """

    def __init__(self, dof: str, values: Mapping[str, float], mass: float) -> None:
        axis = AXES[dof]
        self.added = values[f'{axis[0]}Dot{axis[1]}']
        self.linear, self.quadratic = values[axis], values[f'{axis}abs{axis[1]}']
        self.mass = mass
        self.velocity = self.previous = 0.0

    def step(self, force: float, dt: float) -> None:
        rate = (self.velocity - self.previous) / dt
        damping = -self.linear - self.quadratic * abs(self.velocity)
        wrench = -self.added * rate + damping * self.velocity
        self.previous = self.velocity
        self.velocity += dt / self.mass * (force - wrench)


def exported_to_gazebo(exported: Exported, config: str, true: Mapping[str, Any],
                       *arguments: str) -> tuple[str, str]:
    return exported(replayed(true), '--format', 'sdf', '--params-file', config, *arguments)


@pytest.mark.parametrize('dof', TRUE)
def test_gazebo_moves_as_identified(exported: Exported, config: str, dof: str) -> None:
    out, _ = exported_to_gazebo(exported, config, TRUE)
    dry = read_settings(Path(config)).dof[dof].dry_mass
    link = GazeboLink(dof, coefficients(out), dry)
    parameters, bias = lumped(*TRUE[dof]), TRUE[dof][3]
    dt, velocity, fastest, worst = 0.0005, 0.0, 0.0, 0.0
    for i in range(60_000):
        force = 60.0 * math.sin(2.0 * math.pi * 0.1 * i * dt) + (40.0 if i > 30_000 else 0.0)
        velocity = advance(parameters, velocity, force, dt)
        link.step(force - bias, dt)  # the bias is not the plugin's
        fastest = max(fastest, abs(velocity))
        worst = max(worst, abs(link.velocity - velocity))
    assert fastest > 0.1
    assert worst < 0.002 * fastest


@pytest.mark.parametrize(('mass', 'diverges'), [(275.0, False), (285.0, True)])
def test_added_mass_above_the_dry_mass_is_told(
        exported: Exported, config: str, mass: float, diverges: bool) -> None:
    """The warning is right: there the plugin's scheme diverges, and below it does not."""
    out, err = exported_to_gazebo(exported, config, {'surge': (mass, 290.0, 43.5, 0.0)})
    link = GazeboLink('surge', coefficients(out), 140.0)
    for _ in range(2000):
        if abs(link.velocity) < 1e6:
            link.step(100.0, 0.001)
    assert (abs(link.velocity) > 1e3) == diverges
    assert ('diverges' in err) == diverges


def test_sdf_signs_and_the_dofs_that_are_not_identified(exported: Exported, config: str) -> None:
    out, err = exported_to_gazebo(exported, config, TRUE)
    values = coefficients(out)
    assert len(values) == 18
    assert values['xDotU'] == pytest.approx(140.0 - 250.0)
    assert values['nDotR'] == pytest.approx(38.0 - 60.0)
    assert values['zWabsW'] == pytest.approx(-2000.0)
    assert values['nR'] == pytest.approx(-13.5)
    for name in ('yDotV', 'yV', 'yVabsV', 'kDotP', 'kP', 'kPabsP', 'mDotQ', 'mQ', 'mQabsQ'):
        assert values[name] == 0.0
    assert 'not identified and so 0: sway, roll, pitch' in err
    assert 'left out: bias' in err and 'heave 10.0' in err
    assert '<!-- pitch: not identified -->' in out
    assert all(len(line) < 100 for line in out.splitlines())


def test_sdf_gives_the_added_mass_for_the_link_too(exported: Exported, config: str) -> None:
    out, _ = exported_to_gazebo(exported, config, TRUE)
    match = re.search('<fluid_added_mass>.*</fluid_added_mass>', out, re.DOTALL)
    assert match
    link = {child.tag: float(child.text or '') for child in ElementTree.fromstring(match[0])}
    values = coefficients(out)
    assert link == {'xx': -values['xDotU'], 'zz': -values['zDotW'], 'rr': -values['nDotR']}


@pytest.mark.parametrize('link', ['base_link', 'hull', 'a<b&c'])
def test_link_name(exported: Exported, config: str, link: str) -> None:
    arguments = [] if link == 'base_link' else ['--link', link]
    out, _ = exported_to_gazebo(exported, config, TRUE, *arguments)
    assert ElementTree.fromstring(out).findtext('link_name') == link


def test_text_from_outside_stays_in_its_comment(exported: Exported, config: str) -> None:
    document = replayed(TRUE)
    document['method'] = 'a -- b--->\n  evil: 1'
    out, _ = exported(document, '--format', 'sdf', '--params-file', config)
    assert len(coefficients(out)) == 18
    out, _ = exported(document, '--format', 'yaml')
    assert not re.search('^ *evil', out, re.MULTILINE)


def test_drag_that_drives_is_told(exported: Exported, config: str) -> None:
    out, err = exported_to_gazebo(exported, config, {'surge': (250.0, -2.0, 43.5, 0.0)})
    assert coefficients(out)['xUabsU'] == pytest.approx(2.0)
    assert 'warning: surge: the quadratic drag is -2.000 N s²/m²' in err


@pytest.mark.parametrize(('dofs', 'with_file', 'says'), [
    (TRUE, False, ['surge.dry_mass', 'unknown', '--params-file']),
    ({'roll': (30.0, 1.0, 1.0, 0.0)}, True, ['roll.dry_mass', 'unknown']),
    ({'surge': (139.0, 1.0, 1.0, 0.0)}, True, ['surge.dry_mass', '140.0 kg', '139.0']),
])
def test_dry_mass_is_needed(run: Run, config: str,
                            dofs: Mapping[str, Any], with_file: bool, says: list[str]) -> None:
    file = ['--params-file', config] if with_file else []
    code, out, err = run(replayed(dofs), '--format', 'sdf', *file)
    assert (code, out, err.count('\n')) == (1, '', 1)
    for text in says:
        assert text in err


def test_a_dry_mass_of_zero_is_unknown(
        run: Run, config: str, tmp_path: Path) -> None:
    path = tmp_path / 'zero.yaml'
    path.write_text(Path(config).read_text().replace('dry_mass: 38.0', 'dry_mass: 0.0'))
    code, _, err = run(replayed(TRUE), '--format', 'sdf', '--params-file', str(path))
    assert (code, err.count('\n')) == (1, 1)
    assert 'yaw.dry_mass: is unknown' in err


# --- what is refused


def changed(**values: Any) -> dict[str, Any]:
    document = replayed({'surge': TRUE['surge']})
    document['dofs']['surge'].update(values)
    return document


@pytest.mark.parametrize(('document', 'says'), [
    ('{"dofs": ', 'is not JSON'),
    ('', 'is not JSON'),
    ('[' * 100_000, 'is not JSON'),
    ('9' * 5000, 'JSON'),
    ([], 'is not the JSON of rovid replay or rovid compare'),
    ({'surge': {}}, 'is not the JSON of rovid replay or rovid compare'),
    ({'dofs': {}}, 'dofs: got {}'),
    ({'dofs': None}, 'dofs: got null'),
    ({'dofs': {'surge': 3}}, 'dofs.surge: got 3'),
    ({'dofs': {'srge': {}}}, "did you mean 'surge'"),
    ({'dofs': {'surge': {'mass': 3.0}}}, 'dofs.surge.alpha: is missing'),
    (changed(beta=None), 'dofs.surge.beta: got null'),
    (changed(gamma='3'), 'dofs.surge.gamma: got "3"'),
    (changed(delta=True), 'dofs.surge.delta: got true'),
    (changed(delta=math.nan), 'dofs.surge.delta: got NaN'),
    (changed(delta=10 ** 400), 'dofs.surge.delta: got 1000'),
    (changed(alpha=0.0), 'dofs.surge.alpha: got 0.0, takes a number above 0'),
    (changed(alpha=-0.01), 'dofs.surge.alpha: got -0.01, takes a number above 0'),
    (changed(alpha=1e-320), 'dofs.surge.alpha: got 1e-320'),
    ({'models': []}, 'models: got []'),
    ({'models': {'a': 1}}, 'models: got {"a": 1}'),
    ({'models': [{'method': 'aid'}]}, 'models[0]: takes an object with trained_on'),
    ({'models': [{'method': 'aid', 'trained_on': 'a'}]}, 'models[0].dofs: got null'),
    ({'models': [model('aid', 'a', 1.0), {**model('aid', 'b', 1.0), 'dofs': {'surge': {}}}]},
     None),
    ({'models': [{'method': 'aid', 'trained_on': 'a', 'dofs': {'surge': {}}}]},
     'models[0].dofs.surge.alpha: is missing'),
])
def test_bad_input_is_one_line(
        run: Run, document: Any, says: str | None) -> None:
    code, out, err = run(document, '--format', 'csv')
    if says is None:  # one usable model is enough
        assert code == 0
        return
    assert (code, out, err.count('\n')) == (1, '', 1)
    assert says in err
    assert 'estimates.json: ' in err


@pytest.mark.parametrize(('arguments', 'code', 'says'), [
    (['--format', 'dae'], 2, "'dae'"),
    ([], 2, '--format'),
    (['--format', 'csv', '--link', 'hull'], 2, '--link goes with --format sdf'),
    (['--format', 'sdf', '--link', ' '], 2, 'the name of a link'),
    (['--format', 'csv', '--method', 'aid'], 1, '--method'),
    (['--format', 'csv', '--output', '/nowhere/out.csv'], 1, '/nowhere'),
    (['--format', 'sdf', '--params-file', 'no.yaml'], 1, 'no.yaml'),
])
def test_wrong_usage(run: Run, arguments: list[str], code: int,
                     says: str) -> None:
    got, out, err = run(replayed(TRUE), *arguments)
    assert (got, out, err.count('\n')) == (code, '', 1)
    assert says in err


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['export', '--help']) == 0
    out, err = capsys.readouterr()
    assert err == '' and '{yaml,sdf,csv,urdf,' in out


def test_no_file_and_not_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['export', str(tmp_path / 'no.json'), '--format', 'csv']) == 1
    assert 'no.json' in capsys.readouterr().err
    path = tmp_path / 'a.mcap'
    path.write_bytes(b'\x89MCAP0\r\n')
    assert main(['export', str(path), '--format', 'csv']) == 1
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and 'is not JSON' in err


def test_estimates_are_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / 'estimates.json'
    path.write_text(json.dumps(replayed(TRUE)))
    assert main(['export', str(path), '--format', 'csv', '--output', str(path)]) == 1
    assert json.loads(path.read_text()) == replayed(TRUE)
