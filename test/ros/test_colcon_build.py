"""The same tree as an ordinary ROS 2 workspace: what `colcon build` installs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_SOURCE = ('.*', 'build', 'install', 'log', 'runs', '__pycache__', '*.egg-info')

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.validate]


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A copy of the tree, built as a person would build it."""
    folder = tmp_path_factory.mktemp('workspace')
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*NOT_SOURCE), dirs_exist_ok=True)
    prefix = os.environ.get('AMENT_PREFIX_PATH', sys.prefix)
    environment = {**os.environ, 'AMENT_PREFIX_PATH': prefix, 'CMAKE_PREFIX_PATH': prefix,
                   'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'}
    built = subprocess.run(
        ['colcon', 'build', '--base-paths', '.', 'msg_defs', '--event-handlers', 'console_direct+',
         '--cmake-args', '-DBUILD_TESTING=OFF', f'-DPython3_EXECUTABLE={sys.executable}'],
        cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout[-3000:] + built.stderr[-3000:]
    return folder


def test_both_packages_are_built(workspace):
    packages = {path.name for path in (workspace / 'install').iterdir() if path.is_dir()}
    assert {'arm_brachy', 'arm_brachy_msgs'} <= packages
    assert 'tf2_msgs' not in packages  # every ROS installation brings its own


def test_nodes_are_where_ros2_run_looks(workspace):
    folder = workspace / 'install/arm_brachy/lib/arm_brachy'
    executables = {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}
    nodes = {path.stem for path in (ROOT / 'arm_brachy/nodes').glob('[!_]*.py')
             if 'def main(' in path.read_text()}
    assert executables == nodes | {'arm-brachy'}


def test_every_file_of_config_and_the_launch_file_are_in_share(workspace):
    share = workspace / 'install/arm_brachy/share/arm_brachy'
    config = (path for path in (workspace / 'config').rglob('*') if path.is_file())
    wanted = {*(path.relative_to(workspace) for path in config),
              Path('launch_scripts/cell.launch.py')}
    assert {path for path in wanted if not (share / path).is_file()} == set()


def test_the_sourced_workspace_uses_its_own_files(workspace):
    # from another folder: Python would find the package of the folder it is started in
    code = ('import arm_brachy_msgs.msg; from arm_brachy.core.paths import config_dir; '
            'print(config_dir())')
    found = subprocess.run(
        ['bash', '-c', 'source "$0/install/setup.bash" && exec "$1" -c "$2"',
         str(workspace), sys.executable, code],
        cwd='/', capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert found.stdout.strip() == str(workspace / 'install/arm_brachy/share/arm_brachy/config')
