"""Driver and supervisor as managed nodes, in this process: what they do in which state."""

import time

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from arm_brachy import cell as composition
from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError, CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import Session
from arm_brachy.devices.actuator_driver import AbstractActuatorDriver, BankState
from arm_brachy.nodes import convert
from arm_brachy.nodes.actuator_driver import ActuatorDriverNode
from arm_brachy.nodes.supervisor import SupervisorNode
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState

pytestmark = [pytest.mark.ros, pytest.mark.wall]
DRIVER, SUPERVISOR = graph.ACTUATOR_DRIVER.name, graph.SUPERVISOR.name
STILL = 0.05e-3     # [m]
DONE = graph.TICK_DONE.at(node=DRIVER)


class Bench(Node):
    """Makes the nodes under test, commands them and hears them; its name is the clock's."""

    def __init__(self, scenario):
        super().__init__(graph.CELL_CLOCK.name)
        self.scenario, self.session, self.nodes = scenario, None, {}
        self.executor_ = SingleThreadedExecutor()
        self.executor_.add_node(self)
        self.heard = {}
        for topic in (graph.ACTUATORS, graph.OUTCOME, graph.SAFETY, DONE):
            box = self.heard[topic.name] = []
            self.create_subscription(message_type(topic.type), topic.name, box.append,
                                     offered(topic))
        self.pubs = {t.name: self.create_publisher(message_type(t.type), t.name, offered(t))
                     for t in (graph.COMMAND, graph.CLOCK)}

    def start(self, kind, peers=(DRIVER, SUPERVISOR), **given):
        """Make a node and spin it."""
        given = {'scenario': str(self.scenario), 'pace': 'wall', 'peers': list(peers), **given}
        node = kind(parameter_overrides=[Parameter(k, value=v) for k, v in given.items()])
        self.nodes[node.get_name()] = node
        self.executor_.add_node(node)
        return node

    def end(self):
        for node in self.nodes.values():
            if hasattr(node, 'close'):
                node.close()
        for node in (*self.nodes.values(), self):
            node.destroy_node()

    def watch(self, condition, seconds=10.0):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.executor_.spin_once(timeout_sec=0.02)
        return condition()

    def rest(self, seconds=0.3):
        self.watch(lambda: False, seconds)

    def call(self, kind, name, request):
        client = self.create_client(kind, name)
        assert self.watch(client.service_is_ready), name
        future = client.call_async(request)
        assert self.watch(future.done), name
        self.destroy_client(client)
        return future.result()

    def trigger(self, name):
        return self.call(Trigger, name, Trigger.Request())

    def change(self, node, *transitions, number=0):
        """As `ros2 lifecycle set`; returns whether all of them succeeded."""
        def ask(label):
            request = ChangeState.Request()
            request.transition.label, request.transition.id = label, number
            return self.call(ChangeState, f'{node}/change_state', request).success
        return all([ask(label) for label in transitions])

    def state(self, node):
        return self.call(GetState, f'{node}/get_state', GetState.Request()).current_state.label

    def move(self, *q):
        msg = ActuatorCommand(header=convert.header(self.get_clock().now().nanoseconds,
                                                    'cell_base'), position=list(q))
        pub = self.pubs[graph.COMMAND.name]
        if self.session is not None:
            msg = self.session.seal(pub.topic_name, serialize_message(msg), time.time_ns())
        pub.publish(msg)

    def tick(self, number, period=0.05):
        """Tick as the clock does, once the reader of the tick is there."""
        pub = self.pubs[graph.CLOCK.name]
        assert self.watch(lambda: pub.get_subscription_count() > 0)
        pub.publish(Clock(clock=Time(seconds=number * period).to_msg()))

    def answered(self, number, seconds=5.0):
        return self.watch(lambda: any(d.tick == number for d in self.heard[DONE.name]), seconds)

    @property
    def q(self):
        return np.array(self.heard[graph.ACTUATORS.name][-1].position)

    @property
    def word(self):
        return self.heard[graph.SAFETY.name][-1]

    def said(self, text):
        """Whether an outcome holds the text."""
        return any(text in o.advice for o in self.heard[graph.OUTCOME.name])

    def says(self, state, reason=''):
        """Wait until the supervisor says it."""
        return self.watch(lambda: self.heard[graph.SAFETY.name] and self.word.state == state
                          and reason in self.word.reason)

    def encoders_go_on(self):
        """Whether new encoder states come."""
        box = self.heard[graph.ACTUATORS.name]
        seen = len(box)
        return self.watch(lambda: len(box) > seen + 3)


@pytest.fixture
def bench(ros_domain_id, live_scenario):
    """The bench alone; the bank is slow, so that nothing is urgent."""
    rclpy.init()
    node = Bench(live_scenario('actuators: {max_speed_mm_s: 3}'))
    yield node
    node.end()
    rclpy.try_shutdown()


@pytest.fixture
def cell(bench):
    """The bench with driver and supervisor as they start by themselves."""
    for kind in (ActuatorDriverNode, SupervisorNode):
        bench.start(kind)
    assert bench.says(SafetyState.RUN) and bench.encoders_go_on()
    bench.rest()
    return bench


def test_a_deactivated_driver_holds_refuses_by_name_and_goes_on_measuring(cell):
    assert cell.state(DRIVER) == 'active'
    cell.move(0.02, 0.0, 0.0, 0.0)
    assert cell.watch(lambda: cell.q[0] > 1e-3)
    assert cell.change(DRIVER, 'deactivate')
    assert cell.state(DRIVER) == 'inactive'
    cell.rest()
    held = cell.q[0]
    assert held < 0.018 and cell.encoders_go_on()
    cell.move(0.02, 0.0, 0.0, 0.0)
    assert cell.watch(lambda: cell.said(
        'actuator_driver is inactive: activate it (ros2 lifecycle set /actuator_driver activate)'))
    for service in ('actuator_driver/home', 'actuator_driver/release'):
        assert 'is inactive: activate it' in cell.trigger(service).message
    cell.rest()
    assert abs(cell.q[0] - held) < STILL and cell.word.state == SafetyState.RUN
    assert cell.change(DRIVER, 'activate')
    cell.rest()
    assert abs(cell.q[0] - held) < STILL    # nothing it was told before
    cell.move(0.0, 0.0, 0.0, 0.0)
    assert cell.watch(lambda: cell.q[0] < STILL)


def test_an_inactive_supervisor_says_hold_and_once_active_until_it_is_reset(cell):
    cell.move(0.02, 0.0, 0.0, 0.0)
    assert cell.watch(lambda: cell.q[0] > 1e-3)
    assert cell.change(SUPERVISOR, 'deactivate')
    assert cell.says(SafetyState.HOLD, 'supervisor is inactive: activate it')
    cell.heard[graph.SAFETY.name].clear()
    assert cell.says(SafetyState.HOLD, 'supervisor is inactive: activate it')   # never mute
    assert 'is inactive' in cell.trigger('supervisor/reset').message
    assert cell.change(SUPERVISOR, 'activate')
    assert cell.says(SafetyState.HOLD, 'supervisor was deactivated')
    cell.rest()
    assert cell.word.state == SafetyState.HOLD
    assert cell.trigger('supervisor/reset').success
    assert cell.says(SafetyState.RUN)


def test_no_transition_releases_an_emergency_stop(cell):
    assert cell.change(SUPERVISOR, 'deactivate')
    assert cell.trigger('supervisor/emergency_stop').success
    assert cell.says(SafetyState.STOP, 'emergency stop on request')
    for node in (SUPERVISOR, DRIVER):
        assert cell.state(node) == 'active' or cell.change(node, 'activate')
        assert cell.change(node, 'deactivate', 'cleanup')
        assert cell.state(node) == 'unconfigured'
        assert cell.change(node, 'configure', 'activate')
    cell.rest()
    assert cell.word.state == SafetyState.STOP
    assert 'not RUN' in cell.trigger('actuator_driver/release').message
    assert cell.watch(lambda: cell.trigger('supervisor/reset').success)
    assert cell.says(SafetyState.RUN)
    assert cell.change(DRIVER, 'deactivate', 'cleanup', 'configure', 'activate')
    cell.move(0.02, 0.0, 0.0, 0.0)
    assert cell.watch(lambda: cell.said('emergency stop; call release'))
    cell.rest()
    assert np.abs(cell.q).max() < STILL
    assert cell.trigger('actuator_driver/release').success


def test_a_transition_that_the_state_does_not_have_is_refused_and_the_node_lives(cell, capfd):
    for label, number in (('', 3), ('', 0), ('', 99), ('activate', 0), ('nonsense', 0)):
        assert not cell.change(DRIVER, label, number=number), (label, number)
    assert 'actuator_driver is active: got transition nonsense; must be among deactivate, ' \
           'shutdown' in capfd.readouterr().err
    assert cell.state(DRIVER) == 'active' and cell.encoders_go_on()


def test_without_autostart_the_driver_says_what_it_waits_for_and_publishes_nothing(bench, capfd):
    bench.start(ActuatorDriverNode, autostart=False)
    bench.start(SupervisorNode, autostart=False)
    said = capfd.readouterr().err
    assert 'actuator_driver: unconfigured; ros2 lifecycle set /actuator_driver configure' in said
    assert 'supervisor: unconfigured; ros2 lifecycle set /supervisor configure' in said
    assert bench.says(SafetyState.HOLD, 'supervisor is unconfigured: configure and activate it')
    bench.rest()
    assert bench.heard[graph.ACTUATORS.name] == []
    assert 'waiting for ros2 lifecycle set /actuator_driver configure' in capfd.readouterr().err
    assert bench.change(DRIVER, 'configure')
    assert bench.encoders_go_on()
    assert bench.change(DRIVER, 'activate') and bench.change(SUPERVISOR, 'configure', 'activate')
    assert bench.says(SafetyState.RUN)


def test_in_lockstep_a_tick_waits_for_whoever_configures_the_driver(bench, capfd):
    bench.start(ActuatorDriverNode, (graph.CELL_CLOCK.name, DRIVER), pace='lockstep',
                autostart=False)
    assert not bench.answered(0, 1.5)
    assert 'waiting for ros2 lifecycle set /actuator_driver configure' in capfd.readouterr().err
    assert bench.change(DRIVER, 'configure')
    assert bench.answered(0)
    bench.tick(1)
    assert bench.answered(1)    # inactive it holds and answers
    assert bench.change(DRIVER, 'cleanup')
    bench.tick(2)
    assert not bench.answered(2, 0.5)
    assert 'unconfigured; ros2 lifecycle set /actuator_driver configure' in capfd.readouterr().err
    assert bench.change(DRIVER, 'configure', 'activate')
    assert bench.answered(2)


def test_whoever_activates_a_bank_in_a_cell_with_a_key_does_not_send_it_home(bench, tmp_path):
    bench.session = Session.create(tmp_path / 'bag.key')
    bench.start(ActuatorDriverNode, (DRIVER,), autostart=False,
                session_key=str(tmp_path / 'bag.key'))
    assert bench.change(DRIVER, 'configure', 'activate') and bench.encoders_go_on()
    bench.rest()
    bench.move(0.002, 0.0, 0.0, 0.0)
    assert bench.watch(lambda: bench.said('not homed'))


def test_a_managed_node_that_is_destroyed_leaves_the_graph(bench):
    node = bench.start(ActuatorDriverNode)
    assert bench.watch(lambda: DRIVER in bench.get_node_names())
    bench.executor_.remove_node(bench.nodes.pop(DRIVER))
    node.close()
    node.destroy_node()
    assert bench.watch(lambda: DRIVER not in bench.get_node_names())
    assert bench.count_publishers('actuator_driver/transition_event') == 0


class Hardware(AbstractActuatorDriver):
    """A bank that notes what it was told; broken : name of a call that fails -> its exception."""

    calls, broken = [], {}

    def __init__(self, names, strokes, params):
        self.n = len(names)
        Hardware.calls = []

    def note(self, call):
        self.calls.append(call)
        if call in self.broken:
            raise self.broken[call]

    def connect(self):
        self.note('connect')

    def home(self):
        self.note('home')

    def move(self, q, speed=None):
        self.note('move')

    def hold(self):
        self.note('hold')

    def stop(self):
        self.note('stop')

    def release(self):
        self.note('release')

    def read(self, t, effort=None):
        nothing = np.zeros(self.n)
        return BankState(t, nothing, nothing, nothing, nothing > 0, nothing > 0, None, Outcome.OK,
                         '')

    def close(self):
        self.note('close')


@pytest.fixture
def hardware(monkeypatch, bench, live_scenario):
    """Callable: makes the driver's node around a Hardware, which has nobody beside it."""
    monkeypatch.setattr(composition, 'load_driver', lambda name: Hardware)
    bench.scenario = live_scenario('actuator_driver: ours')

    def make(broken=None, **given):
        monkeypatch.setattr(Hardware, 'broken', broken or {})
        return bench.start(ActuatorDriverNode, (DRIVER,), **given)
    return make


NO_PORT = ArmBrachyError('no answer on /dev/ttyUSB0; switch the bank on')


def test_hardware_that_does_not_answer_fails_the_transition_and_may_be_tried_again(
        hardware, bench, capfd):
    hardware({'connect': NO_PORT}, autostart=False)
    assert not bench.change(DRIVER, 'configure')
    assert bench.state(DRIVER) == 'unconfigured'
    assert 'actuator_driver is unconfigured: configure failed: no answer on /dev/ttyUSB0; ' \
           'switch the bank on' in capfd.readouterr().err
    Hardware.broken = {}
    assert bench.change(DRIVER, 'configure')
    assert Hardware.calls == ['connect', 'connect'] and bench.encoders_go_on()


def test_a_stop_that_an_unconfigured_driver_hears_cuts_the_drives_it_connects_to(
        hardware, bench):
    hardware(autostart=False)
    pub = bench.create_publisher(SafetyState, graph.SAFETY.name, offered(graph.SAFETY))
    pub.publish(SafetyState(state=SafetyState.STOP))
    bench.rest()
    assert Hardware.calls == []
    pub.publish(SafetyState(header=convert.header(bench.get_clock().now().nanoseconds,
                                                  'cell_base'), state=SafetyState.RUN))
    bench.rest()
    assert bench.change(DRIVER, 'configure', 'activate')
    assert Hardware.calls == ['connect', 'stop']
    assert bench.trigger('actuator_driver/release').success
    assert bench.change(DRIVER, 'deactivate', 'cleanup', 'configure')
    assert Hardware.calls[2:] == ['release', 'hold', 'close', 'connect', 'stop']


def test_a_node_that_starts_itself_ends_with_what_kept_it_from_connecting(hardware):
    with pytest.raises(ArmBrachyError, match='no answer on /dev/ttyUSB0'):
        hardware({'connect': NO_PORT})


def test_a_bank_that_does_not_hold_is_disconnected(hardware, bench, capfd):
    hardware({'hold': CommandRefused('the bus is silent')})
    assert not bench.change(DRIVER, 'deactivate')
    assert Hardware.calls == ['connect', 'hold', 'close']
    assert bench.state(DRIVER) == 'unconfigured'
    assert 'is unconfigured: deactivate failed: the bus is silent' in capfd.readouterr().err


def test_a_bug_of_a_bank_is_an_error_with_its_traceback_and_the_bank_is_let_go(
        hardware, bench, capfd):
    hardware({'connect': KeyError('axis 3')}, autostart=False)
    assert not bench.change(DRIVER, 'configure')
    assert bench.state(DRIVER) == 'unconfigured' and Hardware.calls == ['connect', 'close']
    said = capfd.readouterr().err
    assert 'Traceback' in said and "KeyError: 'axis 3'" in said


def test_shutdown_holds_disconnects_and_ends(hardware, bench):
    hardware()
    with pytest.raises(SystemExit) as end:
        bench.change(DRIVER, 'shutdown')
        bench.rest(5.0)
    assert end.value.code == 0 and Hardware.calls == ['connect', 'hold', 'close']


def test_a_supervisor_that_is_shut_down_says_hold_before_it_ends(cell):
    with pytest.raises(SystemExit) as end:
        cell.change(SUPERVISOR, 'shutdown')
        cell.rest(5.0)
    assert end.value.code == 0
    assert cell.says(SafetyState.HOLD, 'supervisor is finalized')
