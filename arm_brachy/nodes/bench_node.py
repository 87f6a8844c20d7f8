"""What the benches of `arm-brachy abuse` share: a person with the key and a stranger without.

A bench makes the key, runs the nodes under test in this process at wall pace, does its faults to
them over DDS, and prints one JSON line for each.
"""

import json
import time

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.control.faults import Bounds, draw
from arm_brachy.core.session import Session
from arm_brachy.nodes import parameters
from arm_brachy.nodes.keyed_trigger import TICKET
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.msg import SafetyState

PATIENCE_S = 20.0     # for the cell to run again after a fault
OBSERVED_S = 0.3      # after a fault, for it to show
NOTICED_S = 1.0       # until a stranger among the sensors is a hold


class BenchNode(Node):
    """Spins the nodes under test; `suffer` and `again` are those of a bench.

    par  scenario; key_file: where to make the key; faults, seed; done: how many of its faults,
         in their order, have been done before
    """

    def __init__(self, name, kinds, **kwargs):
        """kinds : of faults.Kind, those that this bench does."""
        super().__init__(name, **kwargs)
        self.setup, self.bounds = parameters.node_setup(self), Bounds()
        self._path = parameters.text(self, 'key_file', '', 'where the key is made')
        number = round(parameters.number(self, 'faults', 14.0, 'how many', 1, 1e6))
        seed = round(parameters.number(self, 'seed', 1.0, 'of the faults', 0, 1e9))
        done = round(parameters.number(self, 'done', 0.0, 'faults done before', 0, 1e6))
        mine = [(k, fault) for k, fault in enumerate(draw(number, seed)) if fault.kind in kinds]
        self._faults = mine[done:]
        self.session = Session.create(self._path)
        self.stranger = Session.create(f'{self._path}.other')
        self.executor_, self.nodes, self.word = SingleThreadedExecutor(), [], None
        self.executor_.add_node(self)
        self.listen(graph.SAFETY, self._on_word)
        self._askers = {}

    def run(self):
        """Do all faults; print what came of each."""
        try:
            self.again()
            for number, fault in self._faults:
                row = self.suffer(fault)
                print(json.dumps({'number': number, 'kind': fault.kind.name, **row,
                                  'recovered': self.again()}), flush=True)
        finally:
            for node in self.nodes:
                close = getattr(node, 'close', None)
                if close is not None:
                    close()
                node.destroy_node()

    def start(self, kind, peers, **kwargs):
        """Make a node under test and spin it; returns it."""
        given = {'scenario': str(self.setup.cell.path), 'pace': 'wall',
                 'session_key': self._path, 'peers': peers}
        node = kind(parameter_overrides=[Parameter(n, value=v) for n, v in given.items()],
                    **kwargs)
        self.nodes.append(node)
        self.executor_.add_node(node)
        return node

    def publisher(self, topic):
        """Publisher of a graph.Topic, as its own node has it."""
        return self.create_publisher(message_type(topic.type), topic.name, offered(topic))

    def listen(self, topic, sink):
        """Hear a graph.Topic."""
        self.create_subscription(message_type(topic.type), topic.name, sink, offered(topic))

    def _on_word(self, msg):
        self.word = msg

    @property
    def allowed(self):
        """True while the supervisor says RUN."""
        return self.word is not None and self.word.state == SafetyState.RUN

    def now(self):
        """Time on the wall [ns]."""
        return self.get_clock().now().nanoseconds

    def sealed(self, pub, msg, session=None):
        """Bytes of a message with the seal of a session; ours by default."""
        return (session or self.session).seal(pub.topic_name, serialize_message(msg),
                                              time.time_ns())

    def spin(self, seconds):
        """Let the cell live for some time [s]."""
        self.until(lambda: False, seconds)

    def until(self, condition, seconds):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.executor_.spin_once(timeout_sec=0.02)
        return condition()

    def freeze(self, node, seconds, meanwhile=lambda: None):
        """A node that does nothing for some time [s], as one that died or was stopped."""
        self.executor_.remove_node(node)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            meanwhile()
            self.spin(0.02)
        self.executor_.add_node(node)

    def ask(self, kind, name, request):
        """Answer of a service, None if there is none within PATIENCE_S."""
        if name not in self._askers:
            self._askers[name] = self.create_client(kind, name)
        client = self._askers[name]
        if not self.until(client.service_is_ready, PATIENCE_S):
            return None
        future = client.call_async(request)
        self.until(future.done, PATIENCE_S)
        return future.result()

    def call(self, name):
        """Call a Trigger; returns whether it did something."""
        answer = self.ask(Trigger, name, Trigger.Request())
        return answer is not None and answer.success

    def give(self, node, action, ticket=None):
        """Give a node a ticket (ours by default) for an action; returns whether it was done."""
        full = f'/{node.get_name()}/{action}'
        ticket = self.session.ticket(full, time.time_ns()) if ticket is None else ticket
        result, = node.set_parameters([Parameter(TICKET.format(action), value=ticket)])
        return result.successful

    def forge(self, node, action):
        """Ask for an action in every way that needs no key; returns how often it was done."""
        full = f'/{node.get_name()}/{action}'
        now = time.time_ns()
        tickets = (f'{full}:{now}:{"0" * 64}', self.stranger.ticket(full, now),
                   self.session.ticket('/somewhere/else', now), self.session.ticket(
                       full, now - 61 * 10**9))
        return self.call(full.strip('/')) + sum(self.give(node, action, t) for t in tickets)

    def begin_again(self, supervisor, drivers):
        """RUN again and every driver released; returns whether it came so within PATIENCE_S."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            self.until(lambda: self.word is not None, 1.0)
            if not self.allowed:
                self.give(supervisor, 'reset')
                self.spin(0.15)
            if self.allowed and all(self.give(driver, 'release') for driver in drivers):
                return True
            self.spin(0.1)
        return False

    def held_after(self, begun):
        """Seconds from `begun` until the supervisor holds; infinity if it does not."""
        held = self.until(lambda: not self.allowed, 2.0 * NOTICED_S)
        return time.monotonic() - begun if held else np.inf


def last_motion(track, begun, still):
    """When something moved last after `begun` [s]; track : [(t, (n,) position)], oldest first."""
    moved = [t for (t, q), (_, p) in zip(track[1:], track[:-1], strict=True)
             if t > begun and np.abs(q - p).max() > still]
    return moved[-1] - begun if moved else 0.0
