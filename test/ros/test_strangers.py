"""Strangers in the domain of a cell with a key: what they say moves nothing, and is named.

Driver and supervisor run in this process, at wall pace; a bench plays the controller that has the
key, and the strangers that have none.
"""

import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert
from arm_brachy.nodes.actuator_driver import ActuatorDriverNode
from arm_brachy.nodes.keyed_trigger import KeyedClient, ticket_request
from arm_brachy.nodes.push_protocol import PushProtocolNode
from arm_brachy.nodes.supervisor import SupervisorNode
from arm_brachy.nodes.surface_scanner import SurfaceScannerNode
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState, TickDone

pytestmark = [pytest.mark.ros, pytest.mark.wall]
CONFIG = Path(__file__).resolve().parents[2] / 'config'


class Bench(Node):
    """Publishes with a seal or without, and hears what the two nodes say."""

    def __init__(self, session, executor):
        super().__init__('mpc_manipulator')
        self.session, self.executor_ = session, executor
        self.heard = {}
        for topic in (graph.ACTUATORS, graph.OUTCOME, graph.SAFETY, graph.DIAGNOSTICS):
            box = self.heard[topic.name] = []
            self.create_subscription(message_type(topic.type), topic.name, box.append,
                                     offered(topic))
        self.alive = graph.TICK_DONE.at(node='supervisor')
        self.pubs = {t.name: self.create_publisher(message_type(t.type), t.name, offered(t))
                     for t in (graph.COMMAND, graph.SAFETY, self.alive)}

    def watch(self, condition, seconds=10.0):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.executor_.spin_once(timeout_sec=0.02)
        return condition()

    @property
    def now_ns(self):
        return self.get_clock().now().nanoseconds

    @property
    def q(self):
        return np.array(self.heard[graph.ACTUATORS.name][-1].position)

    @property
    def permission(self):
        return self.heard[graph.SAFETY.name][-1]

    def said(self, text):
        """True once an outcome holds the text."""
        return any(text in o.advice for o in self.heard[graph.OUTCOME.name])

    def order(self, *q, ago=0.0, frame='cell_base', mode=ActuatorCommand.MODE_MOVE):
        stamp = max(0, self.now_ns - round(ago * 1e9))
        return ActuatorCommand(header=convert.header(stamp, frame), mode=mode, position=list(q))

    def run(self):
        return SafetyState(header=convert.header(self.now_ns, 'cell_base'), state=SafetyState.RUN)

    def send(self, topic, msg, session=None):
        """Publish a message, with the seal of a session; returns what went over the wire."""
        pub = self.pubs[topic.name]
        if session is not None:
            msg = session.seal(pub.topic_name, serialize_message(msg), time.time_ns())
        pub.publish(msg)
        return msg

    def call(self, kind, name, request):
        client = self.create_client(kind, name)
        assert self.watch(client.service_is_ready), name
        future = client.call_async(request)
        assert self.watch(future.done), name
        return future.result()

    def trigger(self, name):
        return self.call(Trigger, name, Trigger.Request())

    def keyed(self, service, session=None):
        """Call as a node of the cell does; session : another one is a stranger's."""
        client = KeyedClient(self, session or self.session, service)
        assert self.watch(client.client.service_is_ready), service
        future = client.call_async()
        assert self.watch(future.done), service
        return future.result()

    def run_again(self):
        """Back to RUN and released, as the person with the key does it."""
        assert self.watch(lambda: self.keyed('supervisor/reset').success)
        assert self.watch(lambda: self.permission.state == SafetyState.RUN)
        assert self.watch(lambda: self.keyed('actuator_driver/release').success)


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    """The bench, in a cell that runs."""
    folder, patch = tmp_path_factory.mktemp('strangers'), pytest.MonkeyPatch()
    patch.setenv('ROS_DOMAIN_ID', '46')
    patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    text = (Path(__file__).parent / 'short.yaml').read_text().replace('../../config', str(CONFIG))
    (folder / 'live.yaml').write_text(text + 'limits: {silence_s: 2}\n')
    Session.create(folder / 'bag.key')
    rclpy.init()
    executor, nodes = SingleThreadedExecutor(), []
    given = {'scenario': str(folder / 'live.yaml'), 'pace': 'wall',
             'session_key': str(folder / 'bag.key'),
             'peers': ['actuator_driver', 'supervisor', 'mpc_manipulator']}
    given_to_supervisor = given | {'peers': ['actuator_driver', 'supervisor']}
    for kind, parameters in ((ActuatorDriverNode, given), (SupervisorNode, given_to_supervisor)):
        nodes.append(kind(parameter_overrides=[Parameter(k, value=v)
                                               for k, v in parameters.items()]))
    bench = Bench(Session.load(folder / 'bag.key'), executor)
    for node in (*nodes, bench):
        executor.add_node(node)
    assert bench.watch(lambda: bench.heard[graph.SAFETY.name]
                       and bench.permission.state == SafetyState.RUN
                       and len(bench.heard[graph.ACTUATORS.name]) > 20, 30)
    yield bench
    nodes[0].close()
    for node in (*nodes, bench):
        node.destroy_node()
    rclpy.try_shutdown()
    patch.undo()


@pytest.fixture
def bench(cell):
    """The bench, pads at home and nothing heard yet."""
    cell.send(graph.COMMAND, cell.order(0.0, 0.0, 0.0, 0.0), cell.session)
    assert cell.watch(lambda: np.abs(cell.q).max() < 0.1e-3)
    cell.heard[graph.OUTCOME.name].clear()
    return cell


@pytest.mark.parametrize(('wrong', 'said'), [
    ({'ago': 1.8e9}, 'ago; allowed 2 s'),
    ({'ago': -2e8}, 'in the future'),
    ({'frame': 'map'}, "frame_id = 'map'"),
    ({'mode': 77}, 'mode 77; must be one of 0, 1, 2'),
])
def test_the_driver_refuses_what_no_controller_says(bench, wrong, said):
    bench.send(graph.COMMAND, bench.order(0.02, 0.0, 0.0, 0.0, **wrong), bench.session)
    assert bench.watch(lambda: bench.said(said))
    bench.watch(lambda: False, 0.3)
    assert np.abs(bench.q).max() < 0.1e-3


def test_a_flood_without_the_key_moves_nothing_and_is_said_once_a_second(bench):
    stranger = bench.create_publisher(ActuatorCommand, graph.COMMAND.name, offered(graph.COMMAND))
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        stranger.publish(bench.order(0.02, 0.02, 0.02, 0.02))
        bench.executor_.spin_once(timeout_sec=0.0)
    assert bench.watch(lambda: bench.said('actuators/command: no seal'))
    bench.watch(lambda: False, 0.5)
    assert np.abs(bench.q).max() < 0.1e-3
    said = [o for o in bench.heard[graph.OUTCOME.name] if 'no seal' in o.advice]
    assert len(said) <= 4

    def counted():
        return [int(v.value) for d in bench.heard[graph.DIAGNOSTICS.name] for s in d.status
                for v in s.values if v.key == 'refused: no seal, actuators/command']
    assert bench.watch(lambda: counted() and counted()[-1] > 20)
    bench.destroy_publisher(stranger)


def test_a_recorded_command_sent_again_and_a_seal_of_another_key_are_refused(bench, tmp_path):
    sent = bench.send(graph.COMMAND, bench.order(0.004, 0.0, 0.0, 0.0), bench.session)
    assert bench.watch(lambda: abs(bench.q[0] - 0.004) < 0.1e-3)
    bench.send(graph.COMMAND, bench.order(0.0, 0.0, 0.0, 0.0), bench.session)
    assert bench.watch(lambda: np.abs(bench.q).max() < 0.1e-3)
    bench.pubs[graph.COMMAND.name].publish(sent)
    bench.send(graph.COMMAND, bench.order(0.02, 0.0, 0.0, 0.0),
               Session.create(tmp_path / 'other.key'))
    assert bench.watch(lambda: bench.said('sent again') and bench.said('wrong seal'))
    bench.watch(lambda: False, 0.3)
    assert np.abs(bench.q).max() < 0.1e-3


def test_under_an_emergency_stop_no_stranger_moves_a_pad(bench, tmp_path):
    """RUN on cell/safety, ~/release and commands without the key; then the one with the key."""
    assert bench.trigger('supervisor/emergency_stop').success
    assert bench.watch(lambda: bench.permission.state == SafetyState.STOP)
    answer = bench.trigger('actuator_driver/release')
    assert not answer.success and 'session key' in answer.message
    for _ in range(50):
        bench.send(graph.SAFETY, bench.run())
        bench.send(graph.COMMAND, bench.order(0.03, 0.03, 0.03, 0.03))
        bench.executor_.spin_once(timeout_sec=0.0)
    forged = bench.keyed('actuator_driver/release', Session.create(tmp_path / 'other.key'))
    assert not forged.success and 'a ticket of another session' in forged.message
    assert bench.watch(lambda: bench.said('cell/safety: no seal'))
    bench.watch(lambda: False, 0.5)
    assert np.abs(bench.q).max() < 0.1e-3
    early = bench.keyed('actuator_driver/release')
    assert not early.success and 'safety state is not RUN' in early.message
    bench.run_again()
    bench.send(graph.COMMAND, bench.order(0.002, 0.0, 0.0, 0.0), bench.session)
    assert bench.watch(lambda: abs(bench.q[0] - 0.002) < 0.1e-3)


def test_no_stranger_sends_the_pads_home_or_ends_a_hold(bench, tmp_path):
    """Neither by the service, nor with a ticket of another key, nor with one that was used."""
    bench.send(graph.COMMAND, bench.order(0.004, 0.0, 0.0, 0.0), bench.session)
    assert bench.watch(lambda: abs(bench.q[0] - 0.004) < 0.1e-3)
    other = Session.create(tmp_path / 'other.key')
    for service in ('actuator_driver/home', 'supervisor/reset'):
        answer = bench.trigger(service)
        assert not answer.success and 'needs the session key' in answer.message
        assert 'another session' in bench.keyed(service, other).message
    assert bench.trigger('supervisor/hold').success
    assert bench.watch(lambda: bench.permission.state == SafetyState.HOLD)
    assert not bench.trigger('supervisor/reset').success
    bench.watch(lambda: False, 0.5)
    assert bench.permission.state == SafetyState.HOLD and abs(bench.q[0] - 0.004) < 0.1e-3
    bench.run_again()
    assert bench.keyed('actuator_driver/home').success
    assert bench.watch(lambda: np.abs(bench.q).max() < 0.1e-3)


def test_no_stranger_ends_a_hold_by_transitions_or_moves_a_pad(bench):
    """Whoever deactivates and activates has made the cell hold, and no more."""
    for node in ('supervisor', 'actuator_driver'):
        for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
            request = ChangeState.Request(transition=Transition(label=transition))
            assert bench.call(ChangeState, f'{node}/change_state', request).success
    bench.send(graph.COMMAND, bench.order(0.02, 0.0, 0.0, 0.0))
    assert bench.watch(lambda: bench.said('actuators/command: no seal'))
    bench.watch(lambda: False, 0.5)
    assert bench.permission.state == SafetyState.HOLD and np.abs(bench.q).max() < 0.1e-3
    assert 'supervisor was deactivated' in bench.permission.reason
    bench.run_again()
    assert bench.keyed('actuator_driver/home').success
    bench.watch(lambda: False, 0.5)


def test_motion_without_permission_is_a_stop_within_a_second_of_its_grace(bench):
    forger = Node('actuator_driver')     # under the driver's own name
    pub = forger.create_publisher(JointState, graph.ACTUATORS.name, offered(graph.ACTUATORS))
    assert bench.watch(lambda: pub.get_subscription_count() == 2)
    assert bench.trigger('supervisor/hold').success
    begun = time.monotonic()
    names = list(bench.heard[graph.ACTUATORS.name][-1].name)

    def creep():
        q = 1e-3 * (time.monotonic() - begun)
        pub.publish(JointState(header=convert.header(bench.now_ns, 'cell_base'), name=names,
                               position=[q] * len(names)))
        bench.watch(lambda: False, 0.03)
        return bench.permission.state == SafetyState.STOP

    assert any(creep() for _ in range(100))
    assert time.monotonic() - begun < 3.0
    assert 'without permission' in bench.permission.reason
    forger.destroy_publisher(pub)
    forger.destroy_node()
    bench.run_again()


def test_two_supervisors_are_a_hold_within_a_second(bench):
    begun = time.monotonic()
    for k in range(60):
        bench.send(bench.alive, TickDone(node='supervisor', tick=k))
        if bench.watch(lambda: bench.permission.state == SafetyState.HOLD, 0.05):
            break
    assert time.monotonic() - begun < 2.0
    assert 'two nodes are alive as supervisor' in bench.permission.reason
    bench.watch(lambda: False, 1.2)
    bench.run_again()


def test_a_stranger_among_the_sensors_is_a_hold_within_a_second_and_named(bench):
    stranger, begun = Node('intruder'), time.monotonic()
    pub = stranger.create_publisher(JointState, graph.ACTUATORS.name, offered(graph.ACTUATORS))
    assert bench.watch(lambda: bench.permission.state == SafetyState.HOLD)
    assert time.monotonic() - begun < 2.0
    assert 'intruder on /actuators/state' in bench.permission.reason
    assert 'still in force' in bench.keyed('supervisor/reset').message
    stranger.destroy_publisher(pub)
    stranger.destroy_node()
    bench.watch(lambda: False, 1.0)
    bench.run_again()


def test_a_stranger_among_the_commanders_is_named(bench):
    stranger = Node('intruder')
    pub = stranger.create_publisher(ActuatorCommand, graph.COMMAND.name, offered(graph.COMMAND))

    def named():
        return any('intruder on /actuators/command' in v.value
                   for d in bench.heard[graph.DIAGNOSTICS.name] for s in d.status
                   for v in s.values if v.key == 'strangers')
    assert bench.watch(named, 5)
    stranger.destroy_publisher(pub)
    stranger.destroy_node()


@pytest.mark.parametrize(('kind', 'scenario', 'action', 'said'), [
    (SurfaceScannerNode, 'procedure_short.yaml', 'scan', "cell's own operator"),
    (PushProtocolNode, 'probe_short.yaml', 'resume', 'arm-brachy release BAG --resume')])
def test_a_scan_and_interrupted_moves_need_the_key(cell, tmp_path, kind, scenario, action, said):
    """A scan is what the probe follows, and a move that goes on moves pads."""
    sessions = [Session.create(tmp_path / f'{name}.key') for name in ('bag', 'other')]
    node = kind(namespace='apart', parameter_overrides=[Parameter(k, value=v) for k, v in {
        'scenario': str(Path(__file__).with_name(scenario)), 'pace': 'wall', 'peers': [''],
        'session_key': str(tmp_path / 'bag.key')}.items()])
    try:
        answer = getattr(node, action)._on_call(Trigger.Request(), Trigger.Response())
        assert not answer.success and 'needs the session key' in answer.message
        assert said in answer.message

        def given(session):
            ticket = ticket_request(session, f'/apart/{node.get_name()}/{action}').parameters[0]
            return node.set_parameters([Parameter.from_parameter_msg(ticket)])[0]
        assert 'another session' in given(sessions[1]).reason
        assert 'session' not in given(sessions[0]).reason
    finally:
        node.destroy_node()
