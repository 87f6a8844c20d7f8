"""The page of a live cell: it shows what is drawn, and asks the cell's own services."""

import http.client
import json
import re
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import Point, PoseStamped
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from arm_brachy import graph
from arm_brachy.nodes.convert_viewing import markers, shapes
from arm_brachy.viewing.drawing import Stage, Truth, draw_truth
from arm_brachy.viewing.server import TOKEN
from arm_brachy.viewing.surface import thinned
from arm_brachy_msgs.srv import SetGoal

pytestmark = pytest.mark.ros
NODES = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
START = np.array([0.01, 0.02, 0.03])


class Cell:
    """Stands for the nodes that the page hears and asks."""

    def __init__(self, node):
        self.node, self.goals, self.ordered = node, [], []
        self.truth = node.create_publisher(MarkerArray, graph.TRUTH_MARKERS.name, 10)
        self.drawn = node.create_publisher(MarkerArray, graph.MARKERS.name, 10)
        node.create_publisher(PoseStamped, 'em/target_1/pose', 10)
        node.create_service(SetGoal, 'mpc_manipulator/set_goal', self._goal)
        for name in ('mpc_manipulator/abort', 'actuator_driver/home'):
            node.create_service(Trigger, name, lambda q, a, name=name: self._order(name, a))

    def _goal(self, request, answer):
        self.goals.append(request)
        answer.accepted, answer.start = True, Point(x=START[0], y=START[1], z=START[2])
        answer.message = 'on the way'
        return answer

    def spin(self, until, seconds=60):
        """Serve until something holds; False if it never does."""
        deadline = time.monotonic() + seconds
        while not until() and time.monotonic() < deadline:
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return until()

    def _order(self, name, answer):
        self.ordered.append(name)
        answer.success = True
        return answer


@pytest.fixture
def cell(ros_domain_id):
    rclpy.init()
    node = rclpy.create_node('stands_for_a_cell')
    yield Cell(node)
    node.destroy_node()
    rclpy.try_shutdown()


def ask(port, method, path, body=None, **headers):
    link = http.client.HTTPConnection('127.0.0.1', port, timeout=30)
    link.request(method, path, body, headers)
    return link.getresponse().read().decode()


def post(spin, port, token, path, value):
    """Answer of the page's server, which waits for services that this process plays."""
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(ask, port, 'POST', path, json.dumps(value), **{TOKEN: token})
        assert spin(asked.done)
        return asked.result()


def surface(x, shift):
    return draw_truth(Stage(), Truth((thinned(NODES, FACES, 9), x + shift)))


def test_shapes_come_back_from_their_markers():
    shape, = surface(NODES * [1, 1, 0.95], [0, 0, 0])
    back, = shapes(markers(0, 'cell_base', [shape]))
    assert back.layer == shape.layer and back.kind is shape.kind
    corners = [one.points[one.triangles] for one in (back, shape)]
    assert np.allclose(*corners, atol=1e-5)
    assert np.allclose(back.shades[back.triangles], np.clip(shape.shades, 0, 1)[shape.triangles],
                       atol=1 / 31)


def test_the_page_shows_what_is_drawn_and_asks_the_services(cell, start_node):
    live = start_node('live_view', 'port:="0"')
    spin = cell.spin
    assert spin(lambda: any('address' in line for line in live.lines))
    said = next(line for line in live.lines if 'address' in line)
    port = int(json.loads(said)['progress']['address'].rsplit(':', 1)[1].strip('/'))
    assert spin(lambda: cell.drawn.get_subscription_count() == 1)
    assert spin(lambda: cell.truth.get_subscription_count() == 1)
    cell.truth.publish(markers(0, 'cell_base', surface(NODES, [0, 0, 0])))
    cell.drawn.publish(markers(2_500_000_000, 'cell_base', []))
    events = http.client.HTTPConnection('127.0.0.1', port, timeout=30)
    events.request('GET', '/events')
    frame = json.loads(events.getresponse().readline().removeprefix(b'data: '))
    assert frame['frames'][0][0] == 2.5
    assert frame['layers'] in (['true tissue'], [])    # two topics keep no order

    page = ask(port, 'GET', '/')
    assert '<option>target_1</option>' in page
    token = re.search(r'openLive\(DATA, "([^"]+)"\)', page)[1]
    asked = [post(spin, port, token, '/goal', {'target': 'target_1', 'mm': {'x': v}})
             for v in (-2.0, -3.0)]
    assert asked == ['on the way', 'on the way']
    first, then = cell.goals
    assert first.relative and first.goal.x == pytest.approx(-2e-3)
    assert list(first.axes) == [1, 0, 0]
    assert not then.relative and then.goal.x == pytest.approx(START[0] - 3e-3)
    assert 'home: done' in post(spin, port, token, '/do', {'what': 'home'})
    assert cell.ordered == ['mpc_manipulator/abort', 'actuator_driver/home']
    assert post(spin, port, token, '/goal', {'target': 'x', 'mm': {'x': float('inf')}}) \
        == post(spin, port, token, '/goal', {'mm': 3}) == 'this is no goal'
    assert post(spin, port, 'guess', '/do', {'what': 'home'}) == 'Forbidden'
