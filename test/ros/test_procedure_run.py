"""A short procedure through the graph, and what the loss of a node leaves."""

import os
import signal
from pathlib import Path

import pytest

from arm_brachy import launcher
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.offline import load_run
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]
SHORT = Path(__file__).resolve().parent / 'procedure_short.yaml'


@pytest.mark.validate
def test_the_procedure_ends_well_and_is_reported(command_runner, tmp_path, ros_domain_id):
    folder = tmp_path / 'run'
    done = command_runner('run', SHORT, '--out', folder)
    assert done.returncode in (0, 1), done.stderr    # 1: a goal missed is no failure of the graph
    data = load_run(folder / 'bag')
    assert data.procedure.outcome == 'OK'
    assert [t.name for t in data.tasks] == ['bring_target']
    assert 'tip to target' in (folder / 'report.html').read_text()
    assert 'within 0.5 mm of the image plane' in done.stdout


def test_a_dead_needle_driver_ends_the_run_and_is_named(tmp_path, ros_domain_id):
    """In lockstep nobody moves without an answer of everybody: a lost node stops the cell."""
    cell, killed = load_cell(SHORT), []
    runner = None

    def kill(name, values):
        if values['t'] > 1.0 and not killed:
            killed.append(values['t'])
            os.kill(runner.pid_of('needle_driver'), signal.SIGKILL)

    runner = launcher.Launcher(launcher.cell_processes(cell, cell.path, tmp_path / 'bag'),
                               'cell_clock', tmp_path / 'logs', kill)
    with pytest.raises(ArmBrachyError, match='needle_driver ended with status -9'):
        runner.run()
