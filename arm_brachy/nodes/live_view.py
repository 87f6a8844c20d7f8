"""ROS 2 shell of the page of a live cell: what cell_viewer draws in, a page and orders out."""

import io
import json
import threading
from functools import partial

import numpy as np
from PIL import Image as Picture
from rclpy.node import Node

from arm_brachy import graph
from arm_brachy.core.errors import InputError
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert, convert_viewing, parameters
from arm_brachy.nodes.keyed_goal import KeyedGoals
from arm_brachy.nodes.keyed_trigger import KeyedClient
from arm_brachy.nodes.names import targets_of, topic_names
from arm_brachy.nodes.progress import Progress
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import call_every, listen_to
from arm_brachy.viewing.live import Feed, frame, live_page
from arm_brachy.viewing.server import Answer, PageServer
from arm_brachy_msgs.srv import SetGoal

PATIENCE_S = 10.0       # with the answer of a service
LOOK_S = 1.0            # between two looks at who publishes what
MM = 1e-3
ORDERS = {'hold': ('mpc_manipulator/hold',), 'stop': ('supervisor/emergency_stop',),
          'home': ('mpc_manipulator/abort', 'actuator_driver/home')}
KEYED = ('actuator_driver/home',)      # of them, what a cell with a key does for a ticket alone


class LiveViewNode(Node):
    """Show the cell of this DDS domain in the browser; no part of a cell, nobody waits for it.

    in   cell/markers, truth/markers, manipulation/state, actuators/state, force/<pad>/wrench,
         ultrasound/overlay or ultrasound/image
    out  a page at http://127.0.0.1:<port>/
    calls mpc_manipulator/set_goal, /hold, /abort, actuator_driver/home,
          supervisor/emergency_stop, when the person at the page asks; none moves a pad unless the
          supervisor allows it
    par  port : 0 takes a free one;  session_key : of the cell, if it has one
    """

    def __init__(self, **kwargs):
        super().__init__('live_view', **kwargs)
        port = parameters.text(self, 'port', '0', 'of 127.0.0.1; 0 takes a free one')
        if not port.isdigit():
            raise InputError(f'live_view: port = {port!r}; must be a whole number')
        self._feed, self._values, self._truth, self._picture = Feed(), {}, (), None
        self._anchors, self._heard = {}, set()
        key = parameters.text(self, 'session_key', '', 'file with the key of the session')
        session = Session.load(key) if key else None
        self._goals = KeyedGoals(self, session)
        self._orders = {name: KeyedClient(self, session if name in KEYED else None, name)
                        for names in ORDERS.values() for name in names}
        for topic, hear in ((graph.MARKERS, self._on_markers),
                            (graph.TRUTH_MARKERS, self._on_truth),
                            (graph.MANIPULATION, self._on_manipulation),
                            (graph.ACTUATORS, self._on_actuators),
                            (graph.ULTRASOUND_IMAGE, self._on_picture)):
            listen_to(self, topic, hear, lockstep=False)
        self._server = PageServer(int(port), {
            '/': self._page, '/events': lambda query: Answer('text/event-stream',
                                                             self._feed.flow()),
            '/picture': lambda query: self._picture}, {'/goal': self._goal, '/do': self._do})
        self._server.start()
        Progress().now(address=self._server.address)
        call_every(self, LOOK_S, self._look)

    def _look(self):
        """Listen to the force of every pad that somebody measures."""
        for name in topic_names(self):
            if graph.WRENCH.matches(name) and name not in self._heard:
                self._heard.add(name)
                pad = name.split('/')[1]
                listen_to(self, graph.WRENCH.at(pad=pad), lambda msg, pad=pad: self._note(
                    'force of the tissue / N', pad, np.linalg.norm(convert.xyz(msg.wrench.force))),
                    lockstep=False)

    def _page(self, query):
        page = live_page(targets_of(self), self._server.token)
        return Answer('text/html; charset=utf-8', page.encode())

    def _note(self, plot, line, value):
        self._values.setdefault(plot, {})[line] = round(float(value), 4)

    def _on_manipulation(self, msg):
        if msg.active:
            self._note('error of the target / mm', msg.target,
                       np.linalg.norm(convert.xyz(msg.error)) / MM)

    def _on_actuators(self, msg):
        for name, q in zip(msg.name, msg.position, strict=True):
            self._note('travel of the pads / mm', name, q / MM)

    def _on_truth(self, msg):
        self._truth = tuple(convert_viewing.shapes(msg))

    def _on_markers(self, msg):
        t = convert.nanoseconds(msg.markers[0]) * 1e-9
        self._feed.put(frame(t, [*self._truth, *convert_viewing.shapes(msg)], self._values))

    def _on_picture(self, msg):
        out = io.BytesIO()
        Picture.fromarray(np.frombuffer(msg.data, np.uint8).reshape(msg.height, msg.width)).save(
            out, 'PNG', compress_level=1)
        self._picture = Answer('image/png', out.getvalue())

    def _goal(self, body):
        """Bring a target to where it was first asked to go from, plus a displacement [mm]."""
        try:
            asked = json.loads(body)
            target, mm = str(asked['target']), {a: float(v) for a, v in asked['mm'].items()}
            shift = np.array([mm.get(a, 0.0) for a in 'xyz']) * MM
        except (ValueError, KeyError, TypeError, AttributeError):
            return _said('this is no goal')
        if not np.isfinite(shift).all() or not mm:
            return _said('this is no goal')
        start = self._anchors.get(target)
        request = SetGoal.Request(target=target, relative=start is None,
                                  goal=convert.point(shift if start is None else start + shift),
                                  axes=[a in mm for a in 'xyz'])
        request.header.stamp = self.get_clock().now().to_msg()
        answer = _answer(self._goals.client, partial(self._goals.call_async, request))
        if answer is None:
            return _said('mpc_manipulator does not answer: no goal can be set in this cell')
        if answer.accepted and start is None:
            self._anchors[target] = convert.xyz(answer.start)
        return _said(answer.message or f'{target}: goal accepted')

    def _do(self, body):
        """One of ORDERS."""
        try:
            names = ORDERS[json.loads(body)['what']]
        except (ValueError, KeyError, TypeError):
            return _said('no such order')
        self._anchors.clear()
        said = []
        for name in names:
            order = self._orders[name]
            answer = _answer(order.client, order.call_async)
            said.append(f'{name} does not answer' if answer is None
                        else answer.message or f'{name}: done')
        return _said('; '.join(said))

    def close(self):
        """Close the page."""
        self._server.shutdown()
        self._server.server_close()


def _answer(client, ask):
    """Answer of the service that `ask` calls, None without one in time.

    Not for the thread that rclpy spins in.
    """
    if not client.wait_for_service(PATIENCE_S):
        return None
    answered = threading.Event()
    future = ask()
    future.add_done_callback(lambda _: answered.set())
    return future.result() if answered.wait(PATIENCE_S) else None


def _said(text):
    return Answer('text/plain; charset=utf-8', text.encode())


def main(args=None):
    """Run the node."""
    spin_node(LiveViewNode, args)
