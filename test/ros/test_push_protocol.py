"""The push protocol live at wall pace, before a rig that plays actuators and supervisor."""

import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.control.move_events import Status
from arm_brachy.nodes import convert
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy.scenario import load_cell
from arm_brachy_msgs.msg import SafetyState, TaskState

pytestmark = [pytest.mark.ros, pytest.mark.wall]

SCENARIO = Path(__file__).with_name('probe_short.yaml')
MM = 1e-3


def test_states_are_numbered_as_in_the_message():
    assert {s.name: s.value for s in Status} == {s.name: getattr(TaskState, s.name)
                                                for s in Status}


class Rig(Node):
    """Actuators that stand where they were last told to, and a supervisor."""

    def __init__(self, names):
        super().__init__('rig')
        self.names, self.q, self.permission = names, np.zeros(len(names)), SafetyState.RUN
        self.commands, self.states, self.homed = [], [], 0
        self._encoders = self.create_publisher(JointState, graph.ACTUATORS.name,
                                               offered(graph.ACTUATORS))
        self._safety = self.create_publisher(SafetyState, graph.SAFETY.name,
                                             offered(graph.SAFETY))
        for topic, sink in ((graph.COMMAND, self._obey), (graph.TASK, self.states.append)):
            self.create_subscription(message_type(topic.type), topic.name, sink, offered(topic))
        self.create_service(Trigger, 'actuator_driver/home', self._on_home)
        self.create_timer(0.025, self._play)

    def _obey(self, msg):
        self.commands.append(msg)
        if self.permission == SafetyState.RUN:
            self.q = np.array(msg.position)

    def _on_home(self, request, response):
        self.homed, self.q, response.success = self.homed + 1, np.zeros(len(self.names)), True
        return response

    def _play(self):
        now = self.get_clock().now().nanoseconds
        # not in the order of the scene: names say what is what
        self._encoders.publish(JointState(
            header=convert.header(now, 'cell_base'), name=self.names[::-1],
            position=convert.floats(self.q[::-1]), velocity=convert.floats(0.0 * self.q)))
        if self.permission is not None:
            self._safety.publish(SafetyState(header=convert.header(now, 'cell_base'),
                                             state=self.permission, reason='says the rig'))

    def watch(self, condition, seconds=20.0):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.05)
        return condition()

    def resume(self):
        """Call the service while playing on."""
        client = self.create_client(Trigger, 'push_protocol/resume')
        assert self.watch(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        assert self.watch(future.done)
        return future.result()


@pytest.fixture
def rig(start_node, ros_domain_id):
    cell = load_cell(SCENARIO)
    rclpy.init()
    node = Rig([p.name for p in cell.scene.pads])
    node.process = start_node(
        'push_protocol', f'scenario:={SCENARIO}', 'pace:=wall',
        'peers:=["push_protocol", "actuator_driver", "supervisor"]').process
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_live_moves_are_made_sent_home_and_the_node_ends(rig):
    assert rig.watch(lambda: rig.states and rig.states[-1].state == TaskState.FINISHED, 60)
    q = np.array([c.position for c in rig.commands])
    assert q.max(axis=0) == pytest.approx(np.array([5, 0, 1.3, 0]) * MM, abs=1e-9)
    assert [(s.name, s.message) for s in rig.states if s.state == TaskState.ACTIVE] == [
        ('pair', 'load'), ('pair', 'hold'), ('fast', 'load'), ('fast', 'hold'),
        ('fast', 'unload'), ('fast', 'hold')]
    assert [s.name for s in rig.states if s.state == TaskState.DONE] == ['pair', 'fast']
    first = next(c for c in rig.commands if max(c.position) > 0.0)
    assert list(first.velocity[:3]) == pytest.approx([5 * MM, 5 * MM, 5 * MM * 1.3 / 3])
    assert rig.homed == 1
    assert rig.watch(lambda: rig.process.poll() is not None) and rig.process.returncode == 0


def interrupted(rig):
    """Wait until the first pad is on its way, then let the supervisor stop it."""
    assert rig.watch(lambda: rig.q[0] > 1 * MM, 60)
    rig.permission = SafetyState.STOP
    assert rig.watch(lambda: rig.states[-1].message == 'held')
    rig.watch(lambda: False, 0.2)   # what was under way
    return len(rig.commands)


def test_a_stop_interrupts_until_somebody_says_to_resume(rig):
    count = interrupted(rig)
    answer = rig.resume()
    assert not answer.success and 'STOP (says the rig)' in answer.message
    where, rig.permission = rig.q.copy(), SafetyState.RUN
    rig.watch(lambda: False, 0.5)
    assert len(rig.commands) == count
    assert rig.resume().success
    assert rig.watch(lambda: len(rig.commands) > count)
    assert rig.commands[count].position == pytest.approx(where, abs=0.5 * MM)
    assert rig.watch(lambda: any(s.state == TaskState.DONE for s in rig.states))
    assert not rig.resume().success


def test_a_silent_supervisor_interrupts(rig):
    assert rig.watch(lambda: rig.q[0] > 1 * MM, 60)
    rig.permission = None
    assert rig.watch(lambda: rig.states[-1].message == 'held')


def test_a_scenario_without_moves_is_refused(start_node, short_scenario):
    node = start_node('push_protocol', f'scenario:={short_scenario}')
    assert node.process.wait(30) == 2
    node.finish()
    assert len(node.lines) == 1
    assert 'moves is empty; must list a move at least' in node.lines[0]
