"""Live actuator driver and supervisor at wall pace: bad commands, stop, and the loss of a peer."""

import math
import signal
import time

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import cell as composition
from arm_brachy import graph
from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.actuator_driver import AbstractActuatorDriver, BankState
from arm_brachy.nodes import convert
from arm_brachy.nodes.actuator_driver import ActuatorDriverNode
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState, StepOutcome

pytestmark = [pytest.mark.ros, pytest.mark.wall]


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

    def move(self, *q, stamp_ns=None, frame='cell_base', mode=ActuatorCommand.MODE_MOVE):
        """Command four pads, positions in m; stamped now unless told otherwise."""
        stamp_ns = self.now_ns if stamp_ns is None else stamp_ns
        self.pub.publish(ActuatorCommand(header=convert.header(stamp_ns, frame), mode=mode,
                                         position=list(q)))

    @property
    def now_ns(self):
        """Time on the wall."""
        return self.get_clock().now().nanoseconds

    def at_rest(self, ticks=5):
        """Spin until the encoders have read the same for some ticks; returns what they read."""
        def resting():
            last = [list(s.position) for s in self.states[-ticks:]]
            return all(q == last[0] for q in last)
        del self.states[:-1]
        assert self.watch(lambda: len(self.states) > ticks and resting())
        return self.q

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
def start(start_node, live_scenario):
    """Callable: starts the driver or the supervisor of a slow bank, so that nothing is urgent."""
    common = (f'scenario:={live_scenario("actuators: {max_speed_mm_s: 3}")}', 'pace:=wall',
              'peers:=["actuator_driver", "supervisor"]')
    return lambda name: start_node(name, *common)


@pytest.fixture
def cell(start, bench):
    """Driver and supervisor, alive and allowing motion."""
    nodes = {n: start(n) for n in ('actuator_driver', 'supervisor')}
    assert bench.watch(lambda: bench.states and allowed(bench), 40)
    assert isinstance(bench.states[-1], JointState)
    bench.at_rest()
    return nodes


def allowed(bench):
    return bool(bench.safety) and bench.safety[-1].state == SafetyState.RUN


def refused(bench):
    return [o for o in bench.outcomes if isinstance(o, StepOutcome) and o.outcome == 'REJECTED']


def test_a_bad_command_is_refused_whole_and_the_bank_stays(cell, bench):
    for q, said in (((math.nan, 0.0, 0.0, 0.0), 'nan'),
                    ((0.001, 0.099, 0.0, 0.0), 'must be 0 to 30'),
                    ((0.001, -0.002, 0.0, 0.0), '-2'), ((0.001, 0.002), 'shape')):
        bench.outcomes.clear()
        bench.move(*q)
        assert bench.watch(lambda: refused(bench)), q
        bench.rest(1.0)
        assert len(refused(bench)) == 1
        assert said in refused(bench)[0].advice.lower()
        assert np.abs(bench.q).max() < 0.05e-3  # the good part of it is not obeyed either
    bench.move(0.002, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: abs(bench.q[0] - 0.002) < 0.05e-3)


def test_emergency_stop_holds_until_reset(cell, bench):
    bench.move(0.02, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] > 2e-3)
    assert bench.call('supervisor/emergency_stop').success
    assert bench.watch(lambda: bench.safety[-1].state == SafetyState.STOP)
    held = bench.at_rest()
    bench.move(0.0, 0.0, 0.0, 0.0)
    bench.rest(1.0)
    assert np.allclose(bench.q, held, atol=0.05e-3)
    answer = bench.call('supervisor/reset')
    assert answer.success and 'actuator_driver/release' in answer.message
    assert bench.watch(lambda: allowed(bench))
    assert bench.watch(lambda: bench.call('actuator_driver/release').success)
    bench.move(0.0, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] < 0.1e-3)


def test_losing_the_supervisor_holds_the_bank_until_it_is_released(cell, bench, start):
    bench.move(0.029, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] > 1e-3)
    cell['supervisor'].finish(signal.SIGKILL)
    assert bench.watch(lambda: any('no word' in o.advice for o in bench.outcomes))
    held = bench.at_rest()
    assert held[0] < 0.0285
    bench.safety.clear()
    start('supervisor')
    assert bench.watch(lambda: allowed(bench), 40)
    bench.move(0.029, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: any('release' in o.advice for o in refused(bench)))
    assert not bench.call('actuator_driver/home').success
    assert np.array_equal(bench.at_rest(20), held)
    assert bench.call('actuator_driver/release').success
    bench.move(0.0, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.q[0] < 0.1e-3)


def test_a_stop_before_the_first_homing_leaves_the_bank_where_it_is(start, bench):
    start('supervisor')
    assert bench.watch(lambda: bench.safety, 40)
    assert bench.safety[-1].state == SafetyState.HOLD
    assert bench.safety[-1].reason == 'waiting for actuator_driver'
    assert bench.call('supervisor/emergency_stop').success
    start('actuator_driver')
    assert bench.watch(lambda: bench.states, 40)
    assert bench.watch(lambda: bench.call('supervisor/reset').success)
    assert bench.watch(lambda: allowed(bench))
    assert bench.watch(lambda: bench.call('actuator_driver/release').success)
    bench.at_rest(20)
    bench.move(0.002, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: any('not homed' in o.advice for o in refused(bench)))
    assert bench.call('actuator_driver/home').success
    bench.at_rest()
    bench.move(0.002, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: abs(bench.q[0] - 0.002) < 0.05e-3)


def test_a_command_from_before_the_homing_is_neither_obeyed_nor_refused(cell, bench):
    before = bench.now_ns
    assert bench.call('actuator_driver/home').success
    bench.at_rest()
    bench.move(0.002, 0.0, 0.0, 0.0, stamp_ns=before)
    assert np.abs(bench.at_rest(20)).max() < 0.05e-3
    assert refused(bench) == []
    bench.move(0.002, 0.0, 0.0, 0.0, stamp_ns=bench.now_ns)
    assert bench.watch(lambda: abs(bench.q[0] - 0.002) < 0.05e-3)


class Hardware(AbstractActuatorDriver):
    """A bank that notes what the last one made was told; it fails to hold."""

    calls = ()

    def __init__(self, names, strokes, params):
        self.n = len(names)
        Hardware.calls = []

    def connect(self):
        self.calls.append('connect')

    def home(self):
        self.calls.append('home')

    def move(self, q, speed=None):
        self.calls.append('move')

    def hold(self):
        self.calls.append('hold')
        raise CommandRefused('no answer')

    def stop(self):
        self.calls.append('stop')

    def release(self):
        self.calls.append('release')

    def read(self, t, effort=None):
        self.calls.append('read')
        nothing = np.zeros(self.n)
        return BankState(t, nothing, nothing, nothing, nothing > 0, nothing > 0, None, Outcome.OK,
                         '')

    def close(self):
        self.calls.append('close')


@pytest.fixture
def hardware(monkeypatch, live_scenario, bench):
    """Callable: makes the driver's node around a Hardware, in this process."""
    monkeypatch.setattr(composition, 'load_driver', lambda name: Hardware)

    def make(pace):
        given = {'scenario': str(live_scenario('actuator_driver: ours')), 'pace': pace,
                 'peers': ['actuator_driver', 'supervisor']}
        return ActuatorDriverNode(parameter_overrides=[Parameter(k, value=v)
                                                       for k, v in given.items()])

    return make


def test_hardware_is_refused_in_lockstep(hardware):
    with pytest.raises(ConfigError, match="lockstep with actuator_driver = 'ours'; hardware does"):
        hardware('lockstep')


def test_a_stop_acts_on_arrival_and_closing_cuts_the_drives_even_if_it_cannot_hold(hardware,
                                                                                   bench):
    node = hardware('wall')
    calls = Hardware.calls
    try:
        for timer in node.timers:  # no tick comes
            timer.cancel()
        pub = bench.create_publisher(SafetyState, graph.SAFETY.name, offered(graph.SAFETY))
        pub.publish(SafetyState(state=SafetyState.STOP))
        end = time.monotonic() + 10.0
        while 'stop' not in calls and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.05)
        assert calls == ['connect', 'stop']
        with pytest.raises(CommandRefused):
            node.close()
        assert calls[-2:] == ['hold', 'close']
    finally:
        node.destroy_node()
