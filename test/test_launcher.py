"""The launcher on processes that are not nodes: how they end, and which domain they get."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field

import pytest

from arm_brachy import launcher
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.launcher import Launcher

FINISHED = 'import json; print(json.dumps({"progress": {"finished": True}}))'


@dataclass(frozen=True)
class Script:
    """Stands for a NodeProcess."""

    name: str
    code: str
    parameters: dict = field(default_factory=dict)
    namespace: str = ''

    def argv(self):
        return [sys.executable, '-c', self.code]


@pytest.fixture(autouse=True)
def any_domain(monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)


def test_a_leader_may_end_with_its_last_line(tmp_path):
    assert Launcher([Script('leader', FINISHED)], 'leader', tmp_path).run()


def test_a_dead_process_is_named_with_its_status_and_last_line(tmp_path):
    script = Script('tracker', 'import sys; print("no cable", file=sys.stderr); sys.exit(2)')
    with pytest.raises(ArmBrachyError, match='tracker ended with status 2: no cable') as caught:
        Launcher([script], 'tracker', tmp_path).run()
    assert caught.value.exit_status == 2


def test_a_stopped_process_is_named_within_two_seconds(tmp_path):
    """Nobody else would say so: it does not die, and what waits for it waits for ever."""
    stops = 'import os, signal; os.kill(os.getpid(), signal.SIGSTOP)'
    begun = time.monotonic()
    with pytest.raises(ArmBrachyError, match='cell_clock is stopped'):
        Launcher([Script('cell_clock', stops)], 'cell_clock', tmp_path).run()
    assert time.monotonic() - begun < 2.0 + launcher.PATIENCE_S    # closing included


CLOSES = """
import time
try:
    open('begun', 'w').close()
    time.sleep(60)
except KeyboardInterrupt:
    open('closed', 'w').close()
"""
LAUNCHES = f"""
import sys
from pathlib import Path
from types import SimpleNamespace
from arm_brachy.launcher import Launcher

leader = SimpleNamespace(name='leader', parameters={{}}, namespace='',
                         argv=lambda: [sys.executable, '-c', {CLOSES!r}])
Launcher([leader], 'leader', Path.cwd()).run()
"""


def test_what_a_killed_launcher_started_closes_on_its_own(tmp_path):
    run = subprocess.Popen([sys.executable, '-c', LAUNCHES], cwd=tmp_path,
                           env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert wait_for(tmp_path / 'begun')
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    assert wait_for(tmp_path / 'closed')


def wait_for(path, seconds=20.0):
    """Whether a file is there in time."""
    end = time.monotonic() + seconds
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    return path.exists()


def domain_of(tmp_path, on_progress=lambda name, values: None):
    """Run once; returns the ROS_DOMAIN_ID that the process saw."""
    seen = []
    code = ('import json, os, time; print(json.dumps({"progress": {"finished": True, '
            '"domain": os.environ["ROS_DOMAIN_ID"]}}), flush=True); time.sleep(30)')

    def note(name, values):
        seen.append(values['domain'])
        on_progress(name, values)

    assert Launcher([Script('leader', code)], 'leader', tmp_path, note).run()
    return seen[0]


def test_cells_share_a_domain_only_under_different_names(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '102')
    with launcher.Domain('left') as one, launcher.Domain('right') as other, launcher.Domain():
        assert one == other == '102'
        with pytest.raises(ArmBrachyError, match='namespace /left of ROS_DOMAIN_ID = 102 is in u'):
            launcher.Domain('left').__enter__()
    with launcher.Domain('lab/left'), launcher.Domain('lab_left'):
        pass


@pytest.mark.parametrize(('text', 'name'), [('', ''), ('/', ''), ('/left/', 'left'),
                                            ('lab_2/left', 'lab_2/left')])
def test_a_namespace_is_taken_without_its_outer_slashes(text, name):
    assert launcher.cell_namespace(text) == name


@pytest.mark.parametrize('text', ['2nd', 'a b', 'a//b', 'left-hand', 'a.b', '\u00e4'])
def test_what_ros_allows_no_namespace_to_be_is_refused(text):
    with pytest.raises(InputError, match='begin with no digit'):
        launcher.cell_namespace(text)


def test_two_runs_never_share_a_domain(tmp_path):
    inner = []
    outer = domain_of(tmp_path, lambda *_: inner.append(domain_of(tmp_path)))
    assert inner[0] != outer


def test_an_exported_domain_in_use_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '102')

    def again(*_):
        with pytest.raises(ArmBrachyError, match='ROS_DOMAIN_ID = 102 is in use'):
            domain_of(tmp_path)

    assert domain_of(tmp_path, again) == '102'
