"""The package as colcon installs it: the node that ``ros2 run`` starts, on real DDS."""

import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

import rovid_ros
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE
from std_srvs.srv import Trigger

from test.support.live_drive import ros_peer

COLCON = shutil.which('colcon', path=Path(sys.executable).parent) or shutil.which('colcon')
pytestmark = pytest.mark.skipif(COLCON is None, reason='colcon is not installed')


@pytest.fixture(scope='module', params=['', '--symlink-install'], ids=['copied', 'symlinked'])
def installed(request: pytest.FixtureRequest, repository: Path,
              tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """Build the package in a workspace; return the install space and its environment."""
    workspace = tmp_path_factory.mktemp('workspace')
    shutil.copytree(
        repository, workspace / 'src' / 'rovid_ros',
        ignore=shutil.ignore_patterns('.*', '*.egg-info', '__pycache__', 'build', 'log'))
    command = [COLCON, 'build', *request.param.split()]
    build = subprocess.run(command, cwd=workspace, capture_output=True, text=True, timeout=120)
    assert build.returncode == 0, build.stdout + build.stderr
    sourced = subprocess.run(['bash', '-c', '. install/setup.bash && env -0'], cwd=workspace,
                             capture_output=True, text=True, check=True, timeout=60)
    pairs = (line.partition('=') for line in sourced.stdout.split('\0') if line)
    return workspace / 'install' / 'rovid_ros', {name: value for name, _, value in pairs}


def run(command: list[str], env: dict[str, str], folder: Path) -> str:
    """Return what a command writes, started outside the sources."""
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True,
                          check=True, timeout=60)
    return done.stdout.strip()


def test_files_are_where_ros2_looks(installed: tuple[Path, dict[str, str]]) -> None:
    prefix, _ = installed
    assert os.access(prefix / 'lib/rovid_ros/identifier_node', os.X_OK)
    assert os.access(prefix / 'lib/rovid_ros/rovid', os.X_OK)
    assert (prefix / 'share/ament_index/resource_index/packages/rovid_ros').exists()
    for name in ('package.xml', 'config/jhurov.yaml', 'config/plotjuggler_layout.xml',
                 'config/foxglove_layout.json', 'launch/identifier.launch.py'):
        assert (prefix / 'share/rovid_ros' / name).is_file()


def test_sourced_workspace_has_the_command(installed: tuple[Path, dict[str, str]]) -> None:
    prefix, env = installed
    assert shutil.which('rovid', path=env['PATH']) == str(prefix / 'lib/rovid_ros/rovid')
    assert rovid_ros.__version__ in run(['rovid', '--version'], env, prefix)
    code = 'import rovid_ros; print(rovid_ros.__file__)'
    assert Path(run([sys.executable, '-c', code], env, prefix)).is_relative_to(prefix.parents[1])


def test_installed_node_runs_and_stops(installed: tuple[Path, dict[str, str]]) -> None:
    prefix, env = installed
    command = [prefix / 'lib/rovid_ros/identifier_node', '--ros-args', '--params-file',
               prefix / 'share/rovid_ros/config/jhurov.yaml']
    with ros_peer() as peer, subprocess.Popen(
            command, env=env, stderr=subprocess.PIPE, text=True) as process:
        try:
            health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
            peer.until(lambda: 'identifier_node' in peer.node.get_node_names())
            peer.until(lambda: health)
            assert peer.call(Trigger, '/identifier_node/reset').success
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert 'Traceback' not in errors
