"""What several test files share."""

from collections.abc import Iterator
import gc
import os
from pathlib import Path
import signal
import socket

from hypothesis import HealthCheck, settings
import pytest

from test.support.processes import child_environment

# How long an example takes says more about what else the machine does. The suite repeats its
# examples, as one that fails by chance tells nothing of a change; to ask for a number of examples
# looks for new ones.
settings.register_profile('suite', max_examples=int(os.environ.get('ROVID_EXAMPLES', '50')),
                          deadline=None, suppress_health_check=[HealthCheck.too_slow],
                          derandomize='ROVID_EXAMPLES' not in os.environ)
settings.load_profile('suite')

# A shell that runs the suite in the background has it ignore Ctrl-C, and all its children with it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

REPOSITORY = Path(__file__).resolve().parents[1]


def pytest_collection_finish() -> None:
    """
    Look for garbage in what the tests make, and in that alone.

    What is imported and collected stays until the end. To go through it again and again took
    several hundredths of the time.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope='session')
def repository() -> Path:
    """Return the folder of the sources."""
    return REPOSITORY


@pytest.fixture(scope='session')
def config(repository: Path) -> Path:
    """Return the parameter file of a simulated vehicle."""
    return repository / 'config' / 'jhurov.yaml'


@pytest.fixture(scope='session')
def data() -> Path:
    """Return the folder of the recorded logs that are not part of the repository."""
    folder = Path(os.environ.get('ROVID_DATA', REPOSITORY.parent / 'shared' / 'data'))
    if not folder.is_dir():
        pytest.skip(f'no recorded logs in {folder} (set ROVID_DATA)')
    return folder


@pytest.fixture(scope='session', autouse=True)
def own_dds_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep this process and its children from any other ROS traffic, and out of ~/.ros."""
    with pytest.MonkeyPatch.context() as patch, socket.socket() as claim:
        patch.setenv('ROS_DOMAIN_ID', str(_free_domain(claim)))
        # what the profile says, which is loopback alone; LOCALHOST would add shared memory
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SYSTEM_DEFAULT')
        patch.setenv('FASTDDS_DEFAULT_PROFILES_FILE',
                     str(REPOSITORY / 'test' / 'support' / 'dds_profile.xml'))
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
        yield


def _free_domain(claim: socket.socket) -> int:
    """Choose a domain; the port that stands for it stays bound as long as this process runs."""
    for domain in range(60, 102):  # up to 101 DDS keeps out of the ephemeral ports
        try:
            claim.bind(('127.0.0.1', 17400 + domain))
        except OSError:
            continue
        return domain
    raise RuntimeError('all ROS domains from 60 to 101 are in use by other test processes')


@pytest.fixture
def environment() -> dict[str, str]:
    """Return the environment for a child process."""
    return child_environment()
