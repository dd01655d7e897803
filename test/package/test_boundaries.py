"""Who may import whom, and that everything but the node does without ROS."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
import subprocess
import sys

import pytest

# The core gets time and randomness as values, so that the same input gives the same bits.
NOT_IN_CORE = {'calendar', 'datetime', 'random', 'secrets', 'sched', 'time', 'uuid'}
SEEDED = 'simulation'  # the one room with random generators, seeded by their callers
OFFLINE = 'trials'  # the one room that evaluates whole trials, with scipy

# What each room may import of the project: always rooms that stand below it.
CORE_ROOMS = {
    'model': set(),
    'settings': {'model'},
    'ordering': {'model', 'settings'},
    'velocity': {'model', 'settings'},
    'inputs': {'model', 'settings', 'velocity'},
    'thrust': {'model', 'settings', 'inputs'},
    'identify': {'model', 'settings'},
    'pipeline': {'model', 'settings', 'ordering', 'inputs', 'velocity', 'thrust', 'identify'},
    'simulation': {'model', 'settings', 'velocity', 'thrust'},
    'trials': {'model', 'settings', 'thrust', 'identify', 'pipeline', 'simulation'},
}
EVERYTHING_BUT_THE_NODE = {
    'config', 'files', 'messages', 'logs', 'discovery', 'results', 'comparison', 'report',
    'survey', 'commands'}
ROS_ROOMS = {
    'config': set(),
    'files': {'config'},
    'messages': {'config'},
    'logs': {'config', 'files', 'messages'},
    'discovery': {'config', 'messages', 'logs'},
    'results': {'messages'},
    'comparison': {'logs', 'messages', 'results'},
    'report': {'files', 'results'},
    'survey': {'files', 'logs', 'results'},
    'commands': EVERYTHING_BUT_THE_NODE | {'node'},  # the node only where it is asked for
    'node': EVERYTHING_BUT_THE_NODE - {'comparison', 'report', 'discovery', 'survey'},
}

WITHOUT_ROS = """
import importlib.abc
import sys

ROS = {'rclpy', 'launch', 'launch_ros', 'ament_index_python', 'builtin_interfaces',
       'rcl_interfaces', 'rpyutils', 'std_srvs'}

class NoRos(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if top in ROS or top.endswith('_msgs') or top.startswith('rosidl'):
            raise ImportError(f'{name} is blocked by this test')

sys.meta_path.insert(0, NoRos())
"""


@cache
def parsed(path: Path) -> ast.Module:
    """Return the tree of a file."""
    return ast.parse(path.read_text(encoding='utf8'))


def imports(path: Path) -> set[str]:
    """Return the full name of every module that a file imports, inside functions too."""
    names = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{path}: a relative import'
            names |= {f'{node.module}.{alias.name}' for alias in node.names}
    return names


def module_files(repository: Path, package: str) -> list[Path]:
    paths = sorted((repository / package).rglob('*.py'))
    assert len(paths) > 3
    return paths


def rooms_that_are_imported(path: Path, package: str) -> set[str]:
    """Return the rooms of a package that a file imports from."""
    parts = [name.split('.') for name in imports(path)]
    return {part[1] for part in parts if part[0] == package and len(part) > 2}


@pytest.mark.parametrize(('package', 'rooms'), [
    ('rovid_core', CORE_ROOMS), ('rovid_ros', ROS_ROOMS)])
def test_rooms_import_only_what_stands_below_them(
        repository: Path, package: str, rooms: dict[str, set[str]]) -> None:
    there = {path.parent.name for path in (repository / package).glob('*/__init__.py')}
    assert there == rooms.keys()
    for room, allowed in rooms.items():
        for path in (repository / package / room).rglob('*.py'):
            beyond = rooms_that_are_imported(path, package) - allowed - {room}
            assert not beyond, f'{path} imports from {", ".join(sorted(beyond))}'


def test_core_imports_nothing_of_rovid_ros(repository: Path) -> None:
    for path in module_files(repository, 'rovid_core'):
        assert not any(name.startswith('rovid_ros') for name in imports(path)), path


def test_rooms_of_the_core_have_no_circle() -> None:
    below: set[str] = set()
    for room, allowed in CORE_ROOMS.items():  # from the bottom up
        assert allowed <= below, room
        below.add(room)


def without_ros(code: str, repository: Path, environment: dict[str, str]) -> None:
    """Run code in a process in which no ROS module can be imported."""
    run = subprocess.run([sys.executable, '-c', WITHOUT_ROS + code], cwd=repository,
                         env=environment, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout + run.stderr


def test_core_imports_only_numpy_and_the_standard_library(repository: Path) -> None:
    allowed = (sys.stdlib_module_names | {'numpy', 'rovid_core'}) - NOT_IN_CORE
    for path in module_files(repository, 'rovid_core'):
        extra = {'random'} if SEEDED in path.parts else set()
        if OFFLINE in path.parts:
            extra = {'scipy'}
        for name in imports(path):
            assert name.partition('.')[0] in allowed | extra, f'{path} imports {name}'


def test_the_online_path_does_without_scipy(
        repository: Path, environment: dict[str, str]) -> None:
    code = ('import sys, rovid_core.pipeline.stream, rovid_core.trials.score, '
            'rovid_core.simulation.sensors; '
            'assert not any(name.startswith("scipy") for name in sys.modules)')
    subprocess.run([sys.executable, '-c', code], cwd=repository, env=environment, check=True)


def test_core_draws_no_random_numbers(repository: Path) -> None:
    for path in module_files(repository, 'rovid_core'):
        random = [node for node in ast.walk(parsed(path))
                  if isinstance(node, ast.Attribute) and node.attr in ('random', 'default_rng')]
        random += [name for name in imports(path) if name.startswith('numpy.random')]
        assert not random or SEEDED in path.parts, f'{path} uses numpy.random'


def test_rclpy_only_in_the_node(repository: Path) -> None:
    for path in module_files(repository, 'rovid_ros'):
        if 'node' not in path.parts:
            tree = parsed(path)
            top = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
            assert 'rclpy' not in ast.unparse(ast.Module(top, [])), f'{path} imports rclpy'


def test_everything_but_the_node_imports_without_ros(
        repository: Path, environment: dict[str, str]) -> None:
    names = ['.'.join(path.relative_to(repository).with_suffix('').parts)
             for package in ('rovid_core', 'rovid_ros')
             for path in module_files(repository, package)
             if 'node' not in path.parts and not path.name.startswith('__')]
    without_ros(f'import importlib\nfor name in {names}: importlib.import_module(name)',
                repository, environment)


def test_the_block_blocks(repository: Path, environment: dict[str, str]) -> None:
    pytest.importorskip('rclpy')
    with pytest.raises(AssertionError, match='blocked by this test'):
        without_ros('import rclpy', repository, environment)


def test_simulate_and_replay_without_ros(
        repository: Path, environment: dict[str, str], tmp_path: Path) -> None:
    config, log = repository / 'config' / 'jhurov.yaml', tmp_path / 'log.mcap'
    for arguments in (
            ['simulate', '--params-file', config, '--output', log, '--duration', '20'],
            ['replay', log, '--params-file', config, '--json', tmp_path / 'result.json']):
        without_ros('from rovid_ros.commands.main import main\n'
                    f'sys.exit(main({[*map(str, arguments)]}))', repository, environment)
    assert (tmp_path / 'result.json').stat().st_size > 0


def imported_at_once(path: Path) -> list[str]:
    """Return the names that a file imports when it is itself imported."""
    body = parsed(path).body
    return [name for node in body if isinstance(node, ast.Import | ast.ImportFrom)
            for name in ([alias.name for alias in node.names] if isinstance(node, ast.Import)
                         else [f'{node.module}.{alias.name}' for alias in node.names])]


def test_every_module_can_be_imported_first(repository: Path) -> None:
    """Where no import leads back to a module, the order of imports does not matter."""
    files = {'.'.join(path.relative_to(repository).with_suffix('').parts): path
             for package in ('rovid_core', 'rovid_ros')
             for path in module_files(repository, package)}
    files = {name.removesuffix('.__init__'): path for name, path in files.items()}
    graph = {name: {found for imported in imported_at_once(path)
                    for found in (imported, imported.rpartition('.')[0]) if found in files}
             for name, path in files.items()}
    assert len(graph['rovid_ros.node.node']) > 10
    TopologicalSorter(graph).prepare()  # raises a CycleError that names the modules
