"""ROS 2 shell of the optical tracker: true points in, marker frames out."""

from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


class OpticalTrackerNode(Node):
    """Convert, sample, convert back.

    in   truth/points     BodyPoints
    out  optical/markers  OpticalFrame  one per frame; stamp = acquisition
    par  scenario, and every quantity of OpticalParams
    """

    def __init__(self, **kwargs):
        super().__init__(graph.OPTICAL_TRACKER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        params = parameters.device_parameters(self, setup.cell.scenario.optical)
        self._tracker = cell.build_optical_tracker(setup.cell, params)
        self._feed = cell.PointFeed(cell.marker_names(setup.cell))
        ticker = Ticker(self, graph.OPTICAL_TRACKER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._pub = ticker.publisher(graph.OPTICAL)
        self._health = Health(self, ticker, self._frame)
        self._frames, self._hidden = 0, 0
        ticker.subscribe(graph.TRUTH_POINTS)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.TRUTH_POINTS.name]:
            for sample in cell.optical_samples(self._tracker, self._feed, convert.reading(msg)):
                self._frames += 1
                self._hidden += int((~sample.visible).sum())
                self._pub(convert.optical_frame(self._frame, sample))
        self._health.beat(t_ns, lambda: {'frames': self._frames, 'hidden': self._hidden})


def main(args=None):
    """Run the node."""
    spin_node(OpticalTrackerNode, args)
