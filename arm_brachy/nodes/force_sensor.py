"""ROS 2 shell of the force-torque sensors behind the pads: true wrenches in, wrenches out."""

from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


class ForceSensorNode(Node):
    """Convert, sample, convert back.

    in   truth/points        BodyPoints
    out  force/<pad>/wrench  WrenchStamped  tissue on pad, about the disc's centre, in the frame
                                            of the pad: axes of the base
    par  scenario, and every quantity of ForceSensorParams
    """

    def __init__(self, **kwargs):
        super().__init__(graph.FORCE_SENSOR.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        params = parameters.device_parameters(self, setup.cell.scenario.force)
        self._sensor = cell.build_force_sensor(setup.cell, params)
        self._feed = cell.PointFeed(())
        ticker = Ticker(self, graph.FORCE_SENSOR, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._pubs = {p.name: ticker.publisher(graph.WRENCH.at(pad=p.name))
                      for p in setup.cell.scene.pads}
        self._health = Health(self, ticker, self._frame)
        self._samples, self._saturated = 0, 0
        ticker.subscribe(graph.TRUTH_POINTS)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.TRUTH_POINTS.name]:
            for sample in cell.force_samples(self._sensor, self._feed, convert.reading(msg)):
                self._samples += 1
                self._saturated += bool(sample.saturated)
                self._pubs[sample.pad](convert.wrench(sample.pad, sample))
        self._health.beat(t_ns, lambda: {'samples': self._samples, 'saturated': self._saturated})


def main(args=None):
    """Run the node."""
    spin_node(ForceSensorNode, args)
