"""Live actuator driver and supervisor at wall pace: bad commands, stop, and the loss of a peer."""

import math
import signal
import time

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState, StepOutcome

pytestmark = [pytest.mark.ros]


class Bench(Node):
    """Commands the bank and watches it."""

    def __init__(self):
        super().__init__('bench')
        self.states, self.outcomes, self.safety = [], [], []
        self.pub = self.create_publisher(ActuatorCommand, graph.COMMAND.name,
                                         offered(graph.COMMAND))
        for topic, sink in ((graph.ACTUATORS, self.states), (graph.OUTCOME, self.outcomes),
                            (graph.SAFETY, self.safety)):
            self.create_subscription(message_type(topic.type), topic.name, sink.append,
                                     offered(topic))

    def watch(self, condition, seconds=10.0):
        """Spin until `condition` is true; returns whether it became so."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.05)
        return condition()

    def rest(self, seconds):
        """Spin for a while."""
        self.watch(lambda: False, seconds)

    def move(self, *q):
        """Command four pads, positions in m."""
        self.pub.publish(ActuatorCommand(position=list(q)))

    @property
    def q(self):
        """Last encoder positions [m]."""
        return np.array(self.states[-1].position)

    def call(self, name):
        """Call a Trigger service."""
        client = self.create_client(Trigger, name)
        assert client.wait_for_service(20), name
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self, future, timeout_sec=20)
        return future.result()


@pytest.fixture
def bench(ros_domain_id):
    rclpy.init()
    node = Bench()
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def cell(start_node, bench, short_scenario):
    """Driver and supervisor, alive and allowing motion."""
    common = (f'scenario:={short_scenario}', 'pace:=wall',
              'peers:=["actuator_driver", "supervisor"]')
    nodes = {n: start_node(n, *common) for n in ('actuator_driver', 'supervisor')}
    assert bench.watch(lambda: bench.states and bench.safety, 40)
    assert isinstance(bench.states[-1], JointState)
    assert bench.safety[-1].state == SafetyState.RUN
    bench.rest(0.5)
    return nodes


def refused(bench):
    return [o for o in bench.outcomes if isinstance(o, StepOutcome) and o.outcome == 'REJECTED']


@pytest.mark.parametrize(('q', 'said'), [
    ((math.nan, 0.0, 0.0, 0.0), 'nan'),
    ((0.001, 0.099, 0.0, 0.0), 'must be 0 to 30'),
    ((0.001, -0.002, 0.0, 0.0), '-2'),
    ((0.001, 0.002), 'shape'),
])
def test_a_bad_command_is_refused_whole_and_the_bank_stays(cell, bench, q, said):
    bench.move(*q)
    assert bench.watch(lambda: refused(bench))
    bench.rest(1.0)
    assert len(refused(bench)) == 1
    assert said in refused(bench)[0].advice.lower()
    assert np.abs(bench.q).max() < 0.05e-3  # the good part of the command is not obeyed either
    bench.move(0.002, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: abs(bench.q[0] - 0.002) < 0.05e-3)


def test_emergency_stop_holds_until_reset(cell, bench):
    bench.move(0.02, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] > 2e-3)
    assert bench.call('supervisor/emergency_stop').success
    assert bench.watch(lambda: bench.safety[-1].state == SafetyState.STOP)
    bench.rest(0.5)
    held = bench.q
    bench.move(0.0, 0.0, 0.0, 0.0)
    bench.rest(1.0)
    assert np.allclose(bench.q, held, atol=0.05e-3)
    assert bench.call('supervisor/reset').success
    assert bench.watch(lambda: bench.safety[-1].state == SafetyState.RUN)
    bench.rest(0.3)
    assert bench.call('actuator_driver/release').success
    bench.move(0.0, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] < 0.1e-3)


def test_losing_the_supervisor_holds_the_bank(cell, bench):
    bench.move(0.029, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] > 1e-3)
    cell['supervisor'].finish(signal.SIGKILL)
    assert bench.watch(lambda: any('no word' in o.advice for o in bench.outcomes))
    bench.rest(0.5)
    held = bench.q
    assert held[0] < 0.0285
    bench.rest(1.0)
    assert np.array_equal(bench.q, held)
