"""ROS 2 shell of the surface scanner: true body in, a cloud of its skin out."""

import numpy as np
from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


class SurfaceScannerNode(Node):
    """Convert, scan, convert back: once as soon as there is a body, then on request.

    in   truth/mesh/topology, truth/mesh/positions
    out  surface/cloud  PointCloud2  latched; stamp = of the body
    srv  ~/scan         Trigger      the cloud comes with the next tick; in a cell with a key for
                        a scan_ticket, since the probe follows the skin
    par  scenario
    """

    def __init__(self, **kwargs):
        super().__init__(graph.SURFACE_SCANNER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        self._scanner = cell.build_surface_scanner(setup.cell)
        self._body, self._asked, self._points = None, True, 0
        ticker = Ticker(self, graph.SURFACE_SCANNER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._pub = ticker.publisher(graph.SURFACE)
        self._health = Health(self, ticker, self._frame)
        for topic in graph.SURFACE_SCANNER.subscribes:
            ticker.subscribe(topic)
        self.scan = KeyedTrigger(self, setup.session, 'scan', self._scan,
                                 hint="the cell's own operator scans, nobody else")
        ticker.start()

    def _scan(self):
        self._asked = True
        return 'the cloud comes with the next tick'

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.TRUTH_POSITIONS.name]:
            self._body = msg
        if self._asked and self._body is not None:
            self._asked = False
            points = self._scanner.scan(np.asarray(self._body.positions).reshape(-1, 3))
            self._points = len(points)
            self._pub(convert.cloud(convert.nanoseconds(self._body), self._frame, points))
        self._health.beat(t_ns, lambda: {'points': self._points})


def main(args=None):
    """Run the node."""
    spin_node(SurfaceScannerNode, args)
