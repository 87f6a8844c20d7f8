"""ROS 2 shell of the electromagnetic tracker: true points in, poses and statuses out."""

from geometry_msgs.msg import TransformStamped, Vector3
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from arm_brachy import cell, graph
from arm_brachy.devices.em_tracker import ToolStatus
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


class EmTrackerNode(Node):
    """Convert, sample, convert back.

    in   truth/points       BodyPoints
    out  em/<tool>/pose     PoseStamped  one per frame with a pose; stamp = acquisition
         em/<tool>/status   ToolStatus   one per frame
         /tf                TFMessage    the same poses as frames
    par  scenario, and every quantity of EmTrackerParams
    """

    def __init__(self, **kwargs):
        super().__init__(graph.EM_TRACKER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        params = parameters.device_parameters(self, setup.cell.scenario.em)
        self._tracker = cell.build_em_tracker(setup.cell, params)
        self._feed = cell.PointFeed(setup.cell.em_tools)
        ticker = Ticker(self, graph.EM_TRACKER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._pose_pubs = {t: ticker.publisher(graph.EM_POSE.at(tool=t))
                           for t in setup.cell.em_tools}
        self._status_pubs = {t: ticker.publisher(graph.EM_STATUS.at(tool=t))
                             for t in setup.cell.em_tools}
        self._tf_pub = ticker.publisher(graph.TF)
        self._frames = dict.fromkeys(setup.cell.em_tools, 0)
        self._health = Health(self, ticker, self._frame)
        ticker.subscribe(graph.TRUTH_POINTS)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.TRUTH_POINTS.name]:
            for sample in cell.em_samples(self._tracker, self._feed, convert.reading(msg)):
                self._publish(sample)
        self._health.beat(t_ns, lambda: self._frames)

    def _publish(self, sample):
        self._frames[sample.tool] = sample.frame_number
        self._status_pubs[sample.tool](convert.tool_status(self._frame, sample))
        if sample.status is ToolStatus.OK:
            pose = convert.tool_pose(self._frame, sample)
            self._pose_pubs[sample.tool](pose)
            self._tf_pub(TFMessage(transforms=[_transform(pose, sample.tool)]))


def _transform(pose, tool):
    p = pose.pose.position
    msg = TransformStamped(header=pose.header, child_frame_id=f'em_{tool}')
    msg.transform.translation = Vector3(x=p.x, y=p.y, z=p.z)
    msg.transform.rotation = pose.pose.orientation
    return msg


def main(args=None):
    """Run the node."""
    spin_node(EmTrackerNode, args)
