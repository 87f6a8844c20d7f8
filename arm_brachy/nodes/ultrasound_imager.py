"""ROS 2 shell of the ultrasound probe: true body, probe and needle in, images and tip out."""

import numpy as np
from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker

FRESH_NS = 250_000_000   # of a tip as told: an older one is gone


class UltrasoundImagerNode(Node):
    """Convert, look, convert back.

    in   truth/mesh/topology, truth/mesh/positions, truth/probe, truth/probe_contact, truth/needle
         probe/pose, needle/tip   PoseStamped  where to draw the holes and to search for the tip
         needle/aim               PoseArray    where to draw what is foretold of the tip
    out  ultrasound/image         Image mono8  x along the elements, y deep
         ultrasound/overlay       Image rgb8   holes, tip, and where it will be, drawn in
         ultrasound/camera_info   CameraInfo   pixels per metre
         ultrasound/tip           PoseStamped  where the tip was found, orientation as told
         ultrasound/target        PoseWithCovarianceStamped  where the target is, once located
    par  scenario, image_frame
    """

    def __init__(self, **kwargs):
        super().__init__(graph.ULTRASOUND_IMAGER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        self._image_frame = parameters.text(self, 'image_frame', 'ultrasound_image',
                                            'frame_id of the images')
        self._imager = cell.build_imager(setup.cell)
        self._params = setup.cell.scenario.ultrasound.image
        self._latest, self._images, self._found = {}, 0, 0
        ticker = Ticker(self, graph.ULTRASOUND_IMAGER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._image_pub = ticker.publisher(graph.ULTRASOUND_IMAGE)
        self._overlay_pub = ticker.publisher(graph.ULTRASOUND_OVERLAY)
        self._info_pub = ticker.publisher(graph.ULTRASOUND_INFO)
        self._tip_pub = ticker.publisher(graph.ULTRASOUND_TIP)
        self._target_pub = ticker.publisher(graph.ULTRASOUND_TARGET)
        self._health = Health(self, ticker, self._frame)
        for topic in graph.ULTRASOUND_IMAGER.subscribes:
            ticker.subscribe(topic)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for name, messages in inputs.items():
            if messages:
                self._latest[name] = messages[-1]
        for msg in inputs.get(graph.NEEDLE_AIM.name, ()):
            self._hear_aim(t_ns, msg)
        frame = self._see(t_ns)
        if frame is None:
            return
        self._images += 1
        self._health.note(t_ns, frame.outcome, frame.message)
        self._image_pub(convert.image(t_ns, self._image_frame, frame.picture))
        self._overlay_pub(convert.image(t_ns, self._image_frame, frame.overlay))
        self._info_pub(convert.image_info(t_ns, self._image_frame, self._params))
        if frame.tip_W is not None:
            self._found += 1
            R, _ = convert.pose_of(self._latest[graph.NEEDLE_TIP.name].pose)
            self._tip_pub(convert.pose_stamped(t_ns, self._frame, R, frame.tip_W))
        if frame.cavity is not None:
            self._target_pub(convert.estimated_pose(
                self._frame, t_ns * 1e-9, frame.cavity.centre, frame.cavity.covariance))
        self._health.beat(t_ns, lambda: {'images': self._images, 'tips': self._found})

    def _hear_aim(self, t_ns, msg):
        try:
            self._imager.hear_aim(convert.nanoseconds(msg) * 1e-9, convert.positions_in(msg))
        except InputError as refusal:
            self._health.refuse(t_ns, Outcome.REJECTED, f'{graph.NEEDLE_AIM.name}: {refusal}')

    def _see(self, t_ns):
        """The Frame of this tick, None while body or probe have not been heard of."""
        body, probe = (self._latest.get(t.name) for t in (graph.TRUTH_POSITIONS,
                                                          graph.TRUTH_PROBE))
        if body is None or probe is None:
            return None
        x = np.asarray(body.positions).reshape(-1, 3)
        self._check(x)
        contact, shaft, told = (self._latest.get(t.name) for t in (
            graph.TRUTH_CONTACT, graph.TRUTH_NEEDLE, graph.PROBE_POSE))
        tip = self._latest.get(graph.NEEDLE_TIP.name)
        fresh = tip is not None and t_ns - convert.nanoseconds(tip) <= FRESH_NS
        return self._imager.see(
            t_ns * 1e-9, x, convert.pose_of(probe.pose),
            np.zeros(1) if contact is None else np.asarray(contact.pressure),
            None if shaft is None else convert.positions_in(shaft),
            None if told is None else convert.pose_of(told.pose),
            convert.pose_of(tip.pose) if fresh else None)

    def _check(self, x):
        if len(x) != self._imager.nodes:
            raise InputError(f'{graph.TRUTH_POSITIONS.name}: {len(x)} nodes; must be the '
                             f'{self._imager.nodes} of the plant: give all nodes one scenario')


def main(args=None):
    """Run the node."""
    spin_node(UltrasoundImagerNode, args)
