"""The nodes of needle, imager and scanner: one tick each, messages in, messages out."""

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.core.errors import InputError
from arm_brachy.nodes import convert
from arm_brachy.nodes.needle_driver import NeedleDriverNode
from arm_brachy.nodes.recorder import Thinning
from arm_brachy.nodes.surface_scanner import SurfaceScannerNode
from arm_brachy.nodes.ultrasound_imager import UltrasoundImagerNode
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.build import load_scene_mesh
from arm_brachy_msgs.msg import ProbeContact, ProbeState, SafetyState

pytestmark = pytest.mark.ros
TICK = 50_000_000


@pytest.fixture(scope='module')
def body(short_scenario):
    """Nodes of the plant at rest."""
    return load_scene_mesh(load_cell(short_scenario).plant).nodes


@pytest.fixture
def make(ros_domain_id, short_scenario):
    """Callable: a node of a class on its own, and lists of what it publishes by attribute."""
    made = []
    rclpy.init()

    def build(kind, *peers, **publishers):
        name = kind.__name__.removesuffix('Node')
        row = next(r for r in graph.PROBE_NODES if r.name.replace('_', '') == name.lower())
        node = kind(parameter_overrides=[
            Parameter('scenario', value=str(short_scenario)), Parameter('pace', value='wall'),
            Parameter('peers', value=[row.name, *peers])])
        made.append(node)
        out = {attribute: [] for attribute in publishers}
        for attribute, box in out.items():
            setattr(node, attribute, box.append)

        def tick(k, **inputs):
            full = {t.name: [] for t in row.subscribes}
            full.update({getattr(graph, key).name: [msg] for key, msg in inputs.items()})
            node._work(k, k * TICK, full)
        return node, out, tick
    yield build
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def wired(msg):
    """The message after a way over the wire; the way checks its fields."""
    return deserialize_message(serialize_message(msg), type(msg))


def command(k, names, values, speed=()):
    return convert.actuator_command(k * TICK, 'cell_base', names, values, speed)


def safety(k, state=SafetyState.RUN):
    return SafetyState(header=convert.header(k * TICK, 'cell_base'), state=state)


def test_the_needle_goes_to_its_depth_turns_and_stops(make):
    node, out, tick = make(NeedleDriverNode, 'supervisor', _state_pub=1, _tip_pub=1, _truth_pub=1)
    tick(1, NEEDLE_COMMAND=command(1, ['needle'], [0.02], [0.02]))
    assert out['_state_pub'][-1].position[0] == 0.0 and not out['_tip_pub']
    tick(2, SAFETY=safety(2), NEEDLE_COMMAND=command(2, ['needle'], [0.02], [0.02]))
    for k in range(3, 50):
        tick(k, SAFETY=safety(k))
    state, tip, shaft = (wired(out[n][-1]) for n in ('_state_pub', '_tip_pub', '_truth_pub'))
    assert isinstance(state, JointState) and list(state.name) == ['needle', 'roll']
    assert abs(state.position[0] - 0.02) < 1e-3
    assert 0 < convert.nanoseconds(tip) <= convert.nanoseconds(state) == 49 * TICK
    points = convert.positions_in(shaft)
    R, p = convert.pose_of(tip.pose)
    assert np.linalg.norm(points[-1] - p) < 1e-3 and tip.header.frame_id == 'cell_base'
    assert np.allclose(convert.pose_of(shaft.poses[-1])[0][:, 2], R[:, 2], atol=0.01)
    tick(50, SAFETY=safety(50), NEEDLE_COMMAND=command(50, ['roll'], [0.5]))
    assert out['_state_pub'][-1].position[1] == 0.5
    told, curved = tip, command(50, ['curvature', 'off_x', 'off_y', 'off_z'], [5, 0, 0, 0])
    tick(50, SAFETY=safety(50), NEEDLE_COMMAND=curved)
    aside = convert.xyz(out['_tip_pub'][-1].pose.position) - convert.xyz(told.pose.position)
    assert 2e-4 < np.linalg.norm(aside) < 2e-3      # 20^2 / 2 (5 - 2.5) / 1000 = 0.5 mm, and noise
    pull = WrenchStamped()
    pull.wrench.force = convert.vector(-9.0 * R[:, 2])
    tick(51, SAFETY=safety(51), NEEDLE_COMMAND=command(51, ['needle'], [0.05]),
         TRUTH_NEEDLE_FORCE=pull)
    tick(52, SAFETY=safety(52))
    assert abs(out['_state_pub'][-1].effort[0] - 9.0) < 0.2
    assert abs(out['_state_pub'][-1].position[0] - 0.02) < 1e-3     # force_limit_N
    tick(53, SAFETY=safety(53, SafetyState.STOP))
    assert not node.release._on_call(None, Trigger.Response()).success
    tick(54, SAFETY=safety(54))
    assert node.release._on_call(None, Trigger.Response()).success


def test_a_needle_command_that_means_nothing_is_refused_in_one_line(make):
    node, out, tick = make(NeedleDriverNode)
    said = []
    node._health._say = lambda t_ns, outcome, message: said.append(message)
    tick(1, NEEDLE_COMMAND=command(1, ['thread'], [0.02]))
    tick(30, NEEDLE_COMMAND=command(30, ['needle'], []))
    tick(60, NEEDLE_COMMAND=command(60, ['needle'], [0.01]))
    tick(90, NEEDLE_COMMAND=command(1, ['needle'], [0.02]))
    assert len(said) == 3
    assert all('needle, roll, curvature, off_x, off_y, off_z or hole_x' in s for s in said[:2])
    assert 'needle/command: stamped' in said[2] and 'ago' in said[2]


def test_the_imager_shows_the_needle_and_says_where_its_tip_is(make, body):
    _, out, tick = make(UltrasoundImagerNode, _image_pub=1, _overlay_pub=1, _info_pub=1,
                        _tip_pub=1)
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    pose = convert.pose_stamped(TICK, 'cell_base', np.column_stack(
        [np.cross(along, [0.0, 0.0, -1.0]), along, [0.0, 0.0, -1.0]]), [0.0, 0.0, 0.055])
    tip_R = np.column_stack([np.cross([0.0, 0.0, 1.0], along), [0.0, 0.0, 1.0], along])
    shaft = np.array([0.0, 0.0, 0.03]) + np.linspace(-0.06, 0.0, 21)[:, None] * along
    tick(1)
    assert not out['_image_pub']
    tick(2, TRUTH_POSITIONS=convert.mesh_positions(2 * TICK, 'cell_base', body), TRUTH_PROBE=pose,
         PROBE_POSE=pose, TRUTH_CONTACT=ProbeContact(pressure=[5e3] * 8),
         TRUTH_NEEDLE=convert.needle_shaft(0, 'cell_base', shaft, np.tile(along, (21, 1))),
         NEEDLE_TIP=convert.pose_stamped(2 * TICK, 'cell_base', tip_R, shaft[-1]))
    picture, drawn, info, tip = (wired(out[n][0]) for n in ('_image_pub', '_overlay_pub',
                                                            '_info_pub', '_tip_pub'))
    assert isinstance(picture, Image) and isinstance(info, CameraInfo)
    assert (picture.encoding, drawn.encoding) == ('mono8', 'rgb8')
    assert len(picture.data) == picture.height * picture.step == 640 * 640
    assert len(drawn.data) == drawn.height * drawn.step == 3 * 640 * 640
    assert picture.header == drawn.header == info.header and picture.header.frame_id
    assert np.linalg.norm(convert.xyz(tip.pose.position) - shaft[-1]) < 5e-4
    v = info.k[4] * 0.025 + info.k[5]
    pixels = np.frombuffer(bytes(picture.data), np.uint8).reshape(640, 640)
    assert pixels[round(v) - 2:round(v) + 3, 317:323].min() > 200   # the head of the needle
    tick(20)
    assert len(out['_image_pub']) == 2 and len(out['_tip_pub']) == 1    # the told tip is old


def test_a_foretold_tip_that_is_not_two_places_is_refused_in_one_line(make):
    node, _, tick = make(UltrasoundImagerNode)
    said = []
    node._health._say = lambda t_ns, outcome, message: said.append(message)
    tick(1, NEEDLE_AIM=convert.places(TICK, 'cell_base', np.zeros((1, 3))))
    tick(2, NEEDLE_AIM=convert.places(2 * TICK, 'cell_base', np.zeros((2, 3))))
    assert len(said) == 1 and said[0].startswith('needle/aim: ') and 'must be two' in said[0]


def test_the_scanner_scans_once_and_when_asked(make, body):
    node, out, tick = make(SurfaceScannerNode, _pub=1)
    tick(1)
    assert not out['_pub']
    for k in (2, 3):
        tick(k, TRUTH_POSITIONS=convert.mesh_positions(k * TICK, 'cell_base', body))
    cloud, = map(wired, out['_pub'])
    points = convert.cloud_points(cloud)
    assert isinstance(cloud, PointCloud2) and points.shape == (cloud.width, 3)
    assert 0.055 < points[:, 2].max() < 0.062 and np.isfinite(points).all()
    assert node.scan._on_call(None, Trigger.Response()).success
    tick(4)
    assert len(out['_pub']) == 2 and convert.nanoseconds(out['_pub'][1]) == 3 * TICK


def test_a_recorder_keeps_the_first_image_of_each_period():
    thinning = Thinning(5.0)
    kept = [k for k in range(1, 21) if thinning.keeps(k * TICK)]
    assert kept == [1, 4, 8, 12, 16, 20]
    slow = Thinning(50.0)
    assert all(slow.keeps(k * TICK) for k in range(5))


@pytest.mark.parametrize(('meaning', 'msg', 'said'), [
    (convert.needle_seen, JointState(), 'no joint'),
    (convert.probe_seen, ProbeState(outcome='FINE'), "outcome 'FINE'; must be a name"),
])
def test_a_state_that_means_nothing_is_refused_by_name(meaning, msg, said):
    with pytest.raises(InputError, match=said):
        meaning(msg)
