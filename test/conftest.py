"""What every test runs under, and the fixtures that more than one folder uses."""

import os
from pathlib import Path

# Matrices in tests are small: threads of BLAS cost more than they gain. Before numpy is imported.
os.environ.setdefault('OMP_NUM_THREADS', '1')
# Read by the message classes when they are imported, so before any test module is collected:
# without it rclpy publishes a field of the wrong type and says nothing.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

import numpy as np  # noqa: E402
import pytest  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
HIGHEST_DOMAIN_ID = 101  # DDS ports of higher ids collide with Linux's ephemeral ports


@pytest.fixture(autouse=True)
def numpy_errors_raise():
    """A division by zero, an overflow or a NaN out of numbers is an error, not a warning."""
    with np.errstate(divide='raise', invalid='raise', over='raise'):
        yield


@pytest.fixture
def ros_domain_id(monkeypatch):
    """ROS_DOMAIN_ID of this process, set in its environment: graphs of two workers never meet."""
    return _private_domain(monkeypatch)


@pytest.fixture(scope='module')
def lasting_domain_id():
    """The same for nodes that all tests of a module share."""
    with pytest.MonkeyPatch.context() as patch:
        yield _private_domain(patch)


def _private_domain(patch):
    domain_id = 1 + os.getpid() % HIGHEST_DOMAIN_ID
    patch.setenv('ROS_DOMAIN_ID', str(domain_id))
    patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return domain_id


@pytest.fixture(scope='session')
def recordings():
    """Folder of the laboratories' recordings, which are not part of the project."""
    folder = Path(os.environ.get('ARM_BRACHY_RECORDINGS', ROOT.parent / 'shared' / 'recordings'))
    if not folder.is_dir():
        pytest.skip(f'no recordings at {folder}; name their folder in ARM_BRACHY_RECORDINGS')
    return folder
