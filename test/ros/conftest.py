"""Runs of the whole graph that several tests look at, and a way to start single nodes."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from arm_brachy import launcher

HERE = Path(__file__).resolve().parent
SCENARIO = HERE / 'short.yaml'
COMMAND = Path(sys.prefix) / 'bin' / 'arm-brachy'


def arm_brachy(*args, **kwargs):
    """Run the command to its end; returns the CompletedProcess with text output."""
    return subprocess.run([str(COMMAND), *map(str, args)], capture_output=True, text=True,
                          timeout=480, check=False, **kwargs)


def processes_of(folder):
    """Command lines of live processes that name `folder`."""
    found = []
    for entry in Path('/proc').iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        try:
            line = (entry / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
            state = (entry / 'stat').read_text().rsplit(')', 1)[1].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if str(folder) in line and state != 'Z':
            found.append(line)
    return found


@pytest.fixture(scope='session')
def command():
    """Path of the command `arm-brachy`."""
    return COMMAND


@pytest.fixture(scope='session')
def command_runner():
    """Callable that runs `arm-brachy` with arguments to its end."""
    return arm_brachy


@pytest.fixture
def still_alive():
    """Callable: command lines of live processes that name a folder."""
    return processes_of


@pytest.fixture(scope='session')
def short_scenario():
    """Path of the scenario."""
    return SCENARIO


@pytest.fixture(scope='module')
def live_scenario(tmp_path_factory):
    """Callable: writes the scenario with more YAML and patience with a loaded machine."""
    def write(more=''):
        config = SCENARIO.parents[2] / 'config'
        text = SCENARIO.read_text().replace('../../config', str(config))
        path = tmp_path_factory.mktemp('live') / 'live.yaml'
        path.write_text(f'{text}limits: {{silence_s: 2}}\n{more}\n')
        return path
    return write


@pytest.fixture(scope='session')
def quiet_run(tmp_path_factory):
    """Folder of a finished run, and what the command printed."""
    folder = tmp_path_factory.mktemp('quiet') / 'run'
    done = arm_brachy('run', SCENARIO, '--out', folder)
    assert done.returncode == 0, done.stderr + done.stdout
    return folder, done.stdout


@pytest.fixture(scope='session')
def two_cells(tmp_path_factory):
    """Two runs at once in one domain, in namespaces: name -> (folder, what it printed)."""
    root, names = tmp_path_factory.mktemp('cells'), ('left', 'right')
    with launcher.Domain() as domain:
        runs = {name: subprocess.Popen(
            [str(COMMAND), 'run', str(SCENARIO), '--namespace', name, '--out', str(root / name)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, 'ROS_DOMAIN_ID': domain}) for name in names}
        printed = {name: run.communicate(timeout=480)[0] for name, run in runs.items()}
    assert [run.returncode for run in runs.values()] == [0, 0], printed
    return {name: (root / name, printed[name]) for name in names}


@pytest.fixture(scope='session')
def loaded_run(tmp_path_factory):
    """The same of a run while every core of the machine is kept busy."""
    folder = tmp_path_factory.mktemp('loaded') / 'run'
    burners = [subprocess.Popen([sys.executable, '-c', 'while True: pass'])
               for _ in range(os.cpu_count())]
    try:
        done = arm_brachy('run', SCENARIO, '--out', folder)
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    assert done.returncode == 0, done.stderr + done.stdout
    return folder, done.stdout


class LiveNode:
    """One node as a process of its own."""

    def __init__(self, name, *parameters):
        args = [sys.executable, '-m', 'arm_brachy.nodes', name, '--ros-args']
        for parameter in parameters:
            args += ['-p', parameter]
        self.process = subprocess.Popen(args, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                        text=True)
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        self.lines.extend(iter(self.process.stdout.readline, ''))

    def finish(self, number=signal.SIGINT, timeout=30):
        """Send a signal, wait; returns the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(timeout)
        self._reader.join(5)
        return status


    def end(self):
        """End it as a person would, so that it cleans up; by force if that does not help."""
        try:
            self.finish(signal.SIGINT)
        except subprocess.TimeoutExpired:
            self.finish(signal.SIGKILL)


@pytest.fixture
def start_node(ros_domain_id):
    """Callable that starts a LiveNode; all are ended with the test."""
    yield from _started()


def _started():
    nodes = []

    def start(name, *parameters):
        nodes.append(LiveNode(name, *parameters))
        return nodes[-1]

    yield start
    for node in nodes:
        node.end()


@pytest.fixture(scope='module')
def start_lasting_node(lasting_domain_id):
    """As `start_node`, for nodes that all tests of a module share."""
    yield from _started()
