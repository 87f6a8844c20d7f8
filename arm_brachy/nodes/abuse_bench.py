"""Does faults to a driver and a supervisor that live at wall pace; prints one JSON line each.

What `arm-brachy abuse` starts. Driver, supervisor, a controller with the key and a stranger
without it run in this process and talk over DDS; pads are judged by the plant, not by encoders.
"""

import json
import time

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.control.faults import Bounds, draw
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.actuator_driver import ActuatorDriverNode
from arm_brachy.nodes.keyed_trigger import TICKET
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.supervisor import SupervisorNode
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState

RELEASE, RESET = '/actuator_driver/release', '/supervisor/reset'
ASKED = 4e-3          # [m] the controller asks for positions from zero to here
FORBIDDEN = 20e-3     # [m] what every fault asks for
PATIENCE_S = 10.0     # for the cell to run again after a fault
STILL = 1e-5          # [m] between ticks
OBSERVED_S = 0.3      # after a fault, for it to show
FLOOD = 300           # messages


class AbuseBench(Node):
    """The controller and the stranger; spins all nodes and watches the plant.

    par  scenario; session_key: where to make the key; faults; seed
    """

    def __init__(self, **kwargs):
        super().__init__(graph.MPC_MANIPULATOR.name, **kwargs)
        self._setup = parameters.node_setup(self)
        self._path = parameters.text(self, 'key_file', '', 'where the key is made')
        self._number = round(parameters.number(self, 'faults', 14.0, 'how many', 1, 1e6))
        self._seed = round(parameters.number(self, 'seed', 1.0, 'of the faults', 0, 1e9))
        self._session, self._stranger = Session.create(self._path), None
        self._recorded, self._pads, self._state, self._word = [], [], None, None
        self._bounds = Bounds()
        self._pubs = {t.name: self._publisher(t) for t in (graph.COMMAND, graph.SAFETY)}
        for topic, sink in ((graph.TRUTH_PADS, self._on_pads), (graph.ACTUATORS, self._on_state),
                            (graph.SAFETY, self._on_word)):
            self.create_subscription(message_type(topic.type), topic.name, sink, offered(topic))
        self._triggers = {n: self.create_client(Trigger, n) for n in (
            'supervisor/emergency_stop', 'supervisor/hold', 'supervisor/reset',
            'actuator_driver/release')}

    def run(self):
        """Do all faults; print what came of each."""
        self._start()
        try:
            self._again()
            for k, fault in enumerate(draw(self._number, self._seed)):
                print(json.dumps({'number': k, **self._suffer(fault)}), flush=True)
        finally:
            self._driver.close()
            for node in (self._driver, self._supervisor):
                node.destroy_node()

    def _start(self):
        given = {'scenario': str(self._setup.cell.path), 'pace': 'wall', 'session_key': self._path,
                 'peers': ['actuator_driver', 'supervisor', 'mpc_manipulator']}
        alone = given | {'peers': ['actuator_driver', 'supervisor']}
        self._driver, self._supervisor = (
            kind(parameter_overrides=[Parameter(n, value=v) for n, v in values.items()])
            for kind, values in ((ActuatorDriverNode, given), (SupervisorNode, alone)))
        self._executor = SingleThreadedExecutor()
        for node in (self._driver, self._supervisor, self):
            self._executor.add_node(node)

    def _publisher(self, topic):
        return self.create_publisher(message_type(topic.type), topic.name, offered(topic))

    def _on_pads(self, msg):
        self._pads.append((time.monotonic(), np.array(msg.position)))

    def _on_state(self, msg):
        self._state = msg

    def _on_word(self, msg):
        self._word = msg

    # what happens to the cell

    def _suffer(self, fault):
        """One fault; returns what came of it."""
        self._command(ASKED * np.array([fault.size, 0.5 * fault.size, 0.0, 0.0]))
        self._spin(0.1)
        self._pads.clear()
        begun = time.monotonic()
        getattr(self, '_' + fault.kind.name.lower())(fault)
        self._spin(OBSERVED_S)
        over = max((np.max(np.maximum(-q, q - ASKED)) for _, q in self._pads), default=np.inf)
        rest = self._rest(begun)
        allowed = self._word is not None and self._word.state == SafetyState.RUN
        bad = over > self._bounds.overshoot or (not allowed and rest > self._bounds.rest)
        recovered = self._again()
        over_mm = round(1e3 * abs(max(float(over), 0.0)), 4)
        return {'kind': fault.kind.name, 'overshoot_mm': over_mm,
                'rest_s': 0.0 if allowed else round(rest, 3), 'violated': bool(bad),
                'recovered': recovered}

    def _rest(self, begun):
        """When pads moved last after `begun` [s]."""
        moved = [t for (t, q), (_, p) in zip(self._pads[1:], self._pads[:-1], strict=True)
                 if np.abs(q - p).max() > STILL]
        return moved[-1] - begun if moved else 0.0

    def _forged(self, fault):
        self._repeat(fault, lambda: self._send(self._order()))

    def _other_key(self, fault):
        stranger = Session.create(self._path + '.other')
        self._repeat(fault, lambda: self._send(self._order(), stranger))

    def _replayed(self, fault):
        for data in self._recorded[-fault.count:]:
            self._pubs[graph.COMMAND.name].publish(data)

    def _tampered(self, fault):
        data = bytearray(self._recorded[-1])
        data[int(fault.size * (len(data) - 1))] ^= 1 << fault.count % 8
        self._pubs[graph.COMMAND.name].publish(bytes(data))

    def _flooded(self, fault):
        for _ in range(FLOOD):
            self._send(self._order())
            self._executor.spin_once(timeout_sec=0.0)

    def _past(self, fault):
        self._keyed(fault, ago=self._patience() * 1.1 + 1e9 * fault.size**8)

    def _future(self, fault):
        self._keyed(fault, ago=-0.3 - 1e8 * fault.size**8)

    def _foreign_frame(self, fault):
        self._keyed(fault, frame='map' if fault.size < 0.5 else '')

    def _unknown_mode(self, fault):
        self._keyed(fault, mode=3 + int(252 * fault.size))

    def _not_finite(self, fault):
        self._keyed(fault, q=(FORBIDDEN, (np.nan, np.inf, -np.inf)[fault.count % 3], 0.0, 0.0))

    def _forged_run(self, fault):
        self._call('supervisor/emergency_stop')
        run = SafetyState(header=convert.header(self._now(), self._setup.frame))
        for _ in range(fault.count):
            self._pubs[graph.SAFETY.name].publish(run)
            self._send(self._order())
        self._call('actuator_driver/release')
        self._try_ticket(f'{RELEASE}:{self._now()}:{"0" * 64}')

    def _forged_state(self, fault):
        self._call('supervisor/hold')
        forger = Node(graph.ACTUATOR_DRIVER.name)
        pub = forger.create_publisher(JointState, graph.ACTUATORS.name, offered(graph.ACTUATORS))
        self._spin(0.1)
        for k in range(fault.count):
            pub.publish(JointState(header=convert.header(self._now(), self._setup.frame),
                                   name=list(self._state.name),
                                   position=[k * 1e-3] * len(self._state.name)))
            self._spin(0.05)
        forger.destroy_publisher(pub)
        forger.destroy_node()

    def _frozen_supervisor(self, fault):
        self._executor.remove_node(self._supervisor)
        self._spin(self._patience() + 0.3 + 0.5 * fault.size)
        self._send(self._order(), self._session)
        self._spin(0.2)
        self._executor.add_node(self._supervisor)

    def _cut_stream(self, fault):
        self._spin(0.2 + 0.5 * fault.size)

    # means

    def _repeat(self, fault, action):
        for _ in range(fault.count):
            action()
            self._spin(0.01)

    def _keyed(self, fault, **wrong):
        """A controller that has the key and is wrong."""
        self._repeat(fault, lambda: self._send(self._order(**wrong), self._session))

    def _order(self, q=(FORBIDDEN,) * 4, ago=0.0, frame=None, mode=ActuatorCommand.MODE_MOVE):
        stamp = max(0, self._now() - round(ago * 1e9))
        frame = self._setup.frame if frame is None else frame
        return ActuatorCommand(header=convert.header(stamp, frame), mode=mode,
                               position=convert.floats(np.array(q)))

    def _send(self, msg, session=None):
        pub = self._pubs[graph.COMMAND.name]
        if session is None:
            pub.publish(msg)
            return
        data = session.seal(pub.topic_name, serialize_message(msg), time.time_ns())
        pub.publish(data)

    def _command(self, q):
        """The controller's own."""
        pub = self._pubs[graph.COMMAND.name]
        self._recorded.append(self._session.seal(
            pub.topic_name, serialize_message(self._order(q)), time.time_ns()))
        self._recorded = self._recorded[-20:]
        pub.publish(self._recorded[-1])

    def _now(self):
        return self.get_clock().now().nanoseconds

    def _patience(self):
        return self._setup.cell.scenario.limits.silence

    def _spin(self, seconds):
        self._until(lambda: False, seconds)

    def _until(self, condition, seconds):
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        return condition()

    def _call(self, name):
        client = self._triggers[name]
        self._until(client.service_is_ready, PATIENCE_S)
        future = client.call_async(Trigger.Request())
        self._until(future.done, PATIENCE_S)
        return future.result()

    def _try_ticket(self, ticket):
        return self._given(self._driver, 'release', ticket)

    @staticmethod
    def _given(node, action, ticket):
        result, = node.set_parameters([Parameter(TICKET.format(action), value=ticket)])
        return result.successful

    def _again(self):
        """Back to RUN, released, at home; returns whether it came so within PATIENCE_S."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            self._until(lambda: self._word is not None, 1.0)
            if self._word is not None and self._word.state != SafetyState.RUN:
                self._given(self._supervisor, 'reset', self._session.ticket(RESET, self._now()))
                self._spin(0.15)
            if self._try_ticket(self._session.ticket(RELEASE, self._now())):
                self._command(np.zeros(4))
                if self._until(lambda: self._state is not None and max(
                        abs(q) for q in self._state.position) < 1e-4, 2.0):
                    return True
        return False


def _made():
    bench = AbuseBench()
    bench.run()
    raise SystemExit(0)


def main(args=None):
    """Run the faults."""
    spin_node(_made, args)


