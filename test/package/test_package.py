"""The package's metadata agree with each other and with what the code imports."""

import ast
from functools import cache
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
import re
import sys
from xml.etree import ElementTree

import pytest
import rovid_ros

# Where the name of an import differs from what setup.py calls it.
PIP_NAMES = {'yaml': 'pyyaml'}
ROSDEP_KEYS = {
    'hypothesis': 'python3-hypothesis',
    'lz4': 'python3-mcap-pip',  # rosdep has no key for lz4 and zstandard; mcap requires both
    'mcap': 'python3-mcap-pip',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
    'zstandard': 'python3-mcap-pip',
}
# Of one command or option each, imported where they are used; rosdep has no key for them.
OPTIONAL = {'plotly': 'report', 'distributed': 'cluster', 'pyarrow': 'parquet'}
NOT_ON_PYPI = {'launch', 'launch_ros'}
INSTALLED = ('rovid_core', 'rovid_ros', 'launch')


@pytest.fixture(scope='module')
def manifest(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / 'package.xml').getroot()


@cache
def imported(path: Path) -> set[str]:
    """Return the top-level name of each module that a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf8'))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module or '']
        else:
            continue
        found |= {name.partition('.')[0] for name in names}
    return found


def imports(repository: Path, folders: tuple[str, ...], names: dict[str, str]) -> set[str]:
    """Return the third-party modules that files import, under the names of a manifest."""
    own = {'rovid_core', 'rovid_ros', 'benchmarks', 'test'}
    paths = [path for folder in folders for path in (repository / folder).rglob('*.py')]
    assert paths
    found = {name for path in paths for name in imported(path)}
    return {names.get(name, name) for name in found - own - sys.stdlib_module_names}


def required(extra: str = '') -> set[str]:
    """Return the lower-case names that setup.py requires, always or for an extra."""
    found = set()
    for line in distribution('rovid_ros').requires or []:
        requirement, _, marker = line.partition(';')
        wanted = re.search(r'extra\s*==\s*[\'"]([\w-]+)', marker)
        if (wanted.group(1) if wanted else '') == extra:
            found.add(re.split(r'[^\w.-]', requirement)[0].lower())
    return found


def test_one_version(manifest: ElementTree.Element, repository: Path) -> None:
    version = manifest.findtext('version')
    assert rovid_ros.__version__ == version
    log = (repository / 'CHANGELOG.rst').read_text(encoding='utf8')
    released = re.findall(r'^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)\n-+$', log, re.MULTILINE)
    assert released[0] == version


def test_package_xml_declares_the_imports(
        manifest: ElementTree.Element, repository: Path) -> None:
    run = {element.text for element in manifest.findall('exec_depend')}
    assert imports(repository, INSTALLED, ROSDEP_KEYS) <= run | set(OPTIONAL)
    tests = {element.text for element in manifest.findall('test_depend')}
    assert imports(repository, ('test',), ROSDEP_KEYS) <= run | tests | set(OPTIONAL)


def test_setup_py_declares_the_imports(repository: Path) -> None:
    wheels = {re.sub('^ros-kilted-', '', name).replace('-', '_') for name in required('ros')}
    assert all(required(extra) == {name} for name, extra in OPTIONAL.items())
    run = required() | set(OPTIONAL) | wheels | NOT_ON_PYPI
    assert imports(repository, INSTALLED, PIP_NAMES) <= run
    peers = {re.split('[=<>]', line)[0].strip() for line in (
        repository / 'benchmarks' / 'requirements.txt').read_text().splitlines()
        if line and not line.startswith('#')}
    assert imports(repository, ('test', 'benchmarks'), PIP_NAMES) <= (
        run | required('test') | peers)


def test_each_distro_has_the_same_wheels() -> None:
    assert required('kilted') == required('ros')
    assert {name.replace('jazzy', 'kilted') for name in required('jazzy')} == required('ros')


def test_wheels_are_declared_in_package_xml(manifest: ElementTree.Element) -> None:
    run = {element.text for element in manifest.findall('exec_depend')}
    rmw = 'ros-kilted-rmw-fastrtps-cpp'  # on a robot a choice of whoever installs ROS
    assert {re.sub('^ros-kilted-', '', name).replace('-', '_')
            for name in required('ros') - {rmw}} <= run


@pytest.mark.parametrize('name', ['identifier_node', 'rovid'])
def test_entry_point(name: str) -> None:
    entry, = distribution('rovid_ros').entry_points.select(group='console_scripts', name=name)
    if name == 'identifier_node':
        pytest.importorskip('rclpy')
    assert callable(getattr(import_module(entry.module), entry.attr))


def test_launch_files_compile(repository: Path) -> None:
    paths = list((repository / 'launch').glob('*.launch.py'))
    assert paths
    for path in paths:
        tree = ast.parse(path.read_text(encoding='utf8'), path)
        functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
        assert 'generate_launch_description' in functions
