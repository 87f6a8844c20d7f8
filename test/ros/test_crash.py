"""What is left when something dies: no process, and the recording."""

import os
import signal
import subprocess
import time

import pytest

from arm_brachy import launcher
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.recover import recover
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]
LOSS_S = 0.25
GROWTHS = 8  # writes after which a bag holds messages, not only its attachments


def wait_until(condition, seconds):
    """Poll; returns whether it came true."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def growing(bag):
    """Condition: the files of a bag have grown again and again."""
    sizes = set()

    def condition():
        sizes.add(sum(f.stat().st_size for f in bag.glob('*.mcap')))
        return len(sizes) > GROWTHS

    return condition


@pytest.mark.wall
def test_a_killed_recorder_loses_at_most_a_quarter_second(short_scenario, tmp_path, ros_domain_id):
    """At one simulated second per second, what is lost in simulated time is lost in real time."""
    cell, bag, killed_at = load_cell(short_scenario), tmp_path / 'bag', []
    runner = None

    def kill(name, values):
        if values['t'] > 2.0 and not killed_at:
            killed_at.append(values['t'])
            os.kill(runner.pid_of('recorder'), signal.SIGKILL)

    runner = launcher.Launcher(
        launcher.cell_processes(cell, cell.path, bag, speed_limit=1.0), 'cell_clock',
        tmp_path / 'logs', kill)
    with pytest.raises(ArmBrachyError, match='recorder ended with status -9'):
        runner.run()
    report = recover(bag, tmp_path / 'mended')
    with BagReader(tmp_path / 'mended') as reader:
        last = reader.span_ns[1] * 1e-9
    assert last >= killed_at[0] - LOSS_S - 1e-9    # of rounding
    assert report['messages']['/clock'] > 30


@pytest.mark.wall       # a start that is slow says what it does
@pytest.mark.parametrize('presses', [pytest.param(1, marks=pytest.mark.validate), 2])
def test_ctrl_c_ends_everything_and_keeps_the_recording(command, short_scenario, tmp_path,
                                                       still_alive, presses):
    run = subprocess.Popen([str(command), 'run', str(short_scenario), '--out',
                            str(tmp_path / 'run'), '--speed-limit', '1'],
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    bag = tmp_path / 'run' / 'bag'
    assert wait_until(growing(bag), 90)
    time.sleep(1.0)     # some ticks more, also beside other tests
    for _ in range(presses):
        run.send_signal(signal.SIGINT)
        time.sleep(0.3)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert 'interrupted' in said and len(said.strip().splitlines()) == 1
    with BagReader(bag) as reader:  # refuses a truncated file
        assert reader.topics()['/clock'].count > 5
    assert (bag / 'metadata.yaml').is_file()
    assert still_alive(tmp_path) == []


@pytest.mark.validate
def test_a_killed_launcher_leaves_no_process_and_a_closed_bag(command, short_scenario, tmp_path,
                                                             still_alive):
    run = subprocess.Popen([str(command), 'run', str(short_scenario), '--out',
                            str(tmp_path / 'run'), '--speed-limit', '1'],
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    bag = tmp_path / 'run' / 'bag'
    assert wait_until(growing(bag), 90)
    run.kill()
    run.wait()
    assert wait_until(lambda: still_alive(tmp_path) == [], 20)
    with BagReader(bag) as reader:
        assert reader.topics()['/clock'].count > 5


@pytest.mark.validate
def test_a_dead_node_ends_the_run_with_its_last_words(short_scenario, tmp_path, ros_domain_id):
    cell, killed = load_cell(short_scenario), []
    runner = None

    def kill(name, values):
        if values['t'] > 1.0 and not killed:
            killed.append(True)
            os.kill(runner.pid_of('em_tracker'), signal.SIGKILL)

    runner = launcher.Launcher(launcher.cell_processes(cell, cell.path, tmp_path / 'bag'),
                               'cell_clock', tmp_path / 'logs', kill)
    with pytest.raises(ArmBrachyError, match='em_tracker ended with status -9') as caught:
        runner.run()
    assert caught.value.exit_status == 1
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.topics()['/clock'].count > 5
