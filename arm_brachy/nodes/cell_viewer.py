"""ROS 2 shell of the drawing of the cell: what the cell says in, shapes and frames out."""

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy.nodes import convert, convert_viewing, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker, message_type
from arm_brachy.viewing.drawing import Seen, Truth, draw, draw_truth
from arm_brachy.viewing.surface import thinned

PROBE_FRAME, TIP_FRAME = 'probe', 'needle_tip'
IMAGE_IN_PROBE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y deep
TRACKERS = ('em_tracker', 'optical_tracker')   # they report in the base frame, registered


class CellViewerNode(Node):
    """Convert, draw, convert back. Downstream of everything: no node of the cell hears it.

    in   what sensors, estimators and controllers say; truth/... for truth/markers alone
    out  cell/markers       MarkerArray  measured, estimated, wanted; 5 Hz
         truth/markers      MarkerArray  the simulated plant; 5 Hz
         /tf                TFMessage    pads by their encoders, needle tip, probe, arm; every tick
         /tf_static         TFMessage    trackers, template, base of the arm, image; once
         joint_states       JointState   actuators and arm; every tick
         robot_description  String       URDF, once
    par  scenario, image_frame, and every quantity of viewing.params.ViewerParams
    Stamps are those of the data. Frames go out before the shapes that are drawn with them.
    """

    def __init__(self, **kwargs):
        super().__init__(graph.CELL_VIEWER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._cell = cell = setup.cell
        self._frame = setup.frame
        self._params = parameters.device_parameters(self, cell.scenario.viewer)
        image_frame = parameters.text(self, 'image_frame', 'ultrasound_image',
                                      'frame_id of the images')
        self._stage = cells.build_stage(cell, self._params)
        self._pads, self._targets = ([one.name for one in ones]
                                     for ones in (cell.scene.pads, cell.scene.targets))
        self._period_ns = round(1e9 / self._params.rate)
        self._latest, self._due_ns, self._drawn, self._thin = {}, 0, 0, {}
        ticker = Ticker(self, graph.CELL_VIEWER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._markers_pub, self._truth_pub, self._tf_pub, self._joints_pub = (
            ticker.publisher(topic) for topic in (graph.MARKERS, graph.TRUTH_MARKERS, graph.TF,
                                                  graph.JOINT_STATES))
        static_pub, text_pub = (ticker.publisher(topic)
                                for topic in (graph.TF_STATIC, graph.DESCRIPTION))
        self._health = Health(self, ticker, self._frame)
        heard = graph.received(
            graph.CELL_VIEWER, setup.peers, tools=cell.em_tools, pads=self._pads,
            targets=self._targets)
        self._types = {topic.name: message_type(topic.type) for topic in heard}
        self._surface = _surface_topics(cell.scenario, self._types)
        self._wrenches, self._tools = ({name: template.at(**{kind: name}).name for name in names}
                                       for template, kind, names in (
            (graph.WRENCH, 'pad', self._pads), (graph.EM_POSE, 'tool', cell.em_tools)))
        self._estimates = {(name, target): graph.estimate(name).at(target=target).name
                           for name in graph.ESTIMATORS for target in self._targets}
        for topic in heard:
            ticker.subscribe(topic, raw=True)   # most of what comes is never drawn
        made_ns = 0 if setup.lockstep else self.get_clock().now().nanoseconds
        static_pub(TFMessage(transforms=self._static(made_ns, cell, image_frame)))
        text_pub(String(data=cells.build_description(cell, self._frame)))
        ticker.start()

    def _static(self, t_ns, cell, image_frame):
        """Frames that do not move."""
        fixed = [(self._frame, tracker, np.eye(3), np.zeros(3)) for tracker in TRACKERS]
        if cell.scenario.procedure is not None:
            template = cells.build_template(cell)
            fixed += [(self._frame, 'template', template.R, template.p),
                      (self._frame, cells.arm_base_name(cell), *cells.arm_base(cell)),
                      (PROBE_FRAME, image_frame, IMAGE_IN_PROBE, np.zeros(3))]
        return [convert_viewing.transform(t_ns, *one) for one in fixed]

    def _work(self, tick, t_ns, inputs):
        fresh = {name for name, messages in inputs.items() if messages}
        self._latest.update({name: inputs[name][-1] for name in fresh})
        frames = [*self._pad_frames(fresh), *self._tool_frames(fresh), *self._arm_frames(fresh)]
        if frames:
            self._tf_pub(TFMessage(transforms=frames))
        self._say_joints(fresh)
        if t_ns >= self._due_ns:
            self._due_ns = (t_ns // self._period_ns + 1) * self._period_ns
            self._draw(t_ns)
        self._health.beat(t_ns, lambda: {'drawings': self._drawn})

    def _message(self, name):
        """The newest message of a topic, None if there is none yet."""
        data = self._latest.get(name)
        return None if data is None else deserialize_message(data, self._types[name])

    def _new(self, topic, fresh):
        return self._message(topic.name) if topic.name in fresh else None

    def _current(self, name, t_ns):
        """The newest message of a topic unless it is stale."""
        msg = self._message(name)
        if msg is None or t_ns - convert.nanoseconds(msg) > self._params.stale * 1e9:
            return None
        return msg

    def _travel(self, msg):
        """Pad -> [m] of an actuators/state."""
        given = dict(zip(msg.name, msg.position, strict=True))
        return {name: given[name] for name in self._pads if name in given}

    def _pad_frames(self, fresh):
        msg = self._new(graph.ACTUATORS, fresh)
        if msg is None:
            return
        travel, stamp = self._travel(msg), convert.nanoseconds(msg)
        for pad in self._stage.pads:
            if pad.name in travel:
                yield convert_viewing.transform(stamp, self._frame, pad.name, np.eye(3),
                                                pad.at(travel[pad.name]))

    def _tool_frames(self, fresh):
        for topic, frame in ((graph.NEEDLE_TIP, TIP_FRAME), (graph.PROBE_POSE, PROBE_FRAME)):
            msg = self._new(topic, fresh)
            if msg is not None:
                yield convert_viewing.transform(convert.nanoseconds(msg), self._frame, frame,
                                                *convert.pose_of(msg.pose))

    def _arm_frames(self, fresh):
        msg = self._new(graph.PROBE_JOINTS, fresh)
        if msg is not None:
            for link in cells.arm_frames(self._cell, msg.position):
                yield convert_viewing.transform(convert.nanoseconds(msg), *link)

    def _say_joints(self, fresh):
        states = [msg for topic in (graph.ACTUATORS, graph.PROBE_JOINTS)
                  if (msg := self._new(topic, fresh)) is not None]
        if states:
            self._joints_pub(convert_viewing.joined_joints(
                min(map(convert.nanoseconds, states)), states))

    def _draw(self, t_ns):
        self._drawn += 1
        actuators = self._message(graph.ACTUATORS.name)
        stamp = t_ns if actuators is None else convert.nanoseconds(actuators)
        self._markers_pub(convert_viewing.markers(
            stamp, self._frame, draw(self._stage, self._seen(t_ns, actuators))))
        if graph.TRUTH_POINTS.name in self._types:
            self._truth_pub(convert_viewing.markers(
                stamp, self._frame, draw_truth(self._stage, self._truth())))

    def _seen(self, t_ns, actuators):
        optical, state = (self._current(t.name, t_ns) for t in (graph.OPTICAL, graph.MANIPULATION))
        tip, depth, probe, found = (self._current(t.name, t_ns) for t in (
            graph.NEEDLE_TIP, graph.NEEDLE_STATE, graph.PROBE_POSE, graph.ULTRASOUND_TIP))
        points = None if optical is None else convert.marker_frame(optical)[2]
        told, *topics = self._surface
        return Seen(
            travel={} if actuators is None else self._travel(actuators),
            forces={pad: convert.xyz(msg.wrench.force)
                    for pad, msg in self._of_each(self._wrenches, t_ns)},
            surface=self._mesh(*topics), surface_from=told,
            markers=np.zeros((0, 3)) if points is None else points[np.isfinite(points[:, 0])],
            tools={name: convert.xyz(msg.pose.position)
                   for name, msg in self._of_each(self._tools, t_ns)},
            estimates={key: (convert.position(msg), _covariance(msg))
                       for key, msg in self._of_each(self._estimates, t_ns)},
            goal=None if state is None or not state.active else (convert.xyz(state.reference),
                                                                 state.target),
            tip=None if tip is None else convert.pose_of(tip.pose),
            needle_depth=0.0 if depth is None else depth.position[0],
            probe=None if probe is None else convert.pose_of(probe.pose),
            image_tip=None if found is None else convert.xyz(found.pose.position))

    def _of_each(self, topics, t_ns):
        """(key, message) of each topic of a mapping key -> name that is heard and not stale."""
        for key, name in topics.items():
            msg = self._current(name, t_ns)
            if msg is not None:
                yield key, msg

    def _mesh(self, topology, positions):
        """(ThinSurface, x (n, 3)) of a mesh, None while it is not known."""
        moved = self._message(positions)
        if moved is None or topology not in self._latest:
            return None
        if topology not in self._thin:
            msg = self._message(topology)
            self._thin[topology] = thinned(
                np.reshape(msg.rest_positions, (-1, 3)), np.reshape(msg.surface, (-1, 3)),
                self._params.triangles)
        return self._thin[topology], np.reshape(moved.positions, (-1, 3))

    def _truth(self):
        points, needle = (self._message(t.name) for t in (graph.TRUTH_POINTS, graph.TRUTH_NEEDLE))
        return Truth(
            surface=self._mesh(graph.TRUTH_TOPOLOGY.name, graph.TRUTH_POSITIONS.name),
            targets={} if points is None else self._true_targets(points),
            needle=np.zeros((0, 3)) if needle is None else convert.positions_in(needle))

    def _true_targets(self, msg):
        where = dict(zip(msg.names, convert.positions_of(msg), strict=True))
        return {name: where[name] for name in self._targets if name in where}


def _covariance(msg):
    return np.reshape(msg.pose.covariance, (6, 6))[:3, :3]


def _surface_topics(scenario, heard):
    """Whose mesh is drawn, its topology's and its positions' topic: the one that feeds back."""
    names = dict.fromkeys((scenario.feedback, *graph.ESTIMATORS))
    for name in names:
        topology, positions = graph.estimate_topology(name), graph.estimate_positions(name)
        if positions.name in heard:
            return name, topology.name, positions.name
    return 'model', graph.MODEL_TOPOLOGY.name, graph.MODEL_POSITIONS.name


def main(args=None):
    """Run the node."""
    spin_node(CellViewerNode, args)
