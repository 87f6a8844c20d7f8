"""ROS 2 shell of the soft body: pad positions in, points, wrenches and mesh out."""

from rclpy.node import Node
from sensor_msgs.msg import JointState

from arm_brachy import cell, graph
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy.tissue.needle_path import tangents


class TissueNode(Node):
    """Convert, step the body, convert back.

    Plant (tissue_simulator): in truth/pads, out truth/points, truth/mesh/...; where there is a
        probe_controller, in truth/probe, out truth/probe_contact; where there is a needle_driver,
        in truth/needle_path, out truth/needle, truth/needle_force; with an ultrasound_imager a
        mesh every tick
    Model (tissue_model): in actuators/state, out model/points, model/mesh/...
    par  scenario
    """

    def __init__(self, spec, side, pads_topic, points, topology, positions, **kwargs):
        """side : 'plant' or 'model'; the five topics as in the table above."""
        super().__init__(spec.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._pads_topic, self._positions_topic = setup.frame, pads_topic, positions
        self._body = cell.build_tissue(setup.cell, side)
        peers = setup.peers if side == 'plant' else ()
        self._mesh_period_ns = round(1e9 / setup.cell.scenario.mesh_rate)
        if graph.ULTRASOUND_IMAGER.name in peers:
            self._mesh_period_ns = setup.tick_ns
        self._mesh_due_ns = 0
        ticker = Ticker(self, spec, self._work, lockstep=setup.lockstep, tick_ns=setup.tick_ns,
                        peers=setup.peers, absent=setup.absent)
        self._points_pub = ticker.publisher(points)
        self._topology_pub = ticker.publisher(topology)
        self._positions_pub = ticker.publisher(positions)
        self._health = Health(self, ticker, self._frame)
        ticker.subscribe(pads_topic)
        self._probe = self._needle = self._contact_pub = self._needle_pub = None
        self._axes = None   # (k, 3) of the needle's path
        if graph.PROBE_CONTROLLER.name in peers:
            self._contact_pub = ticker.publisher(graph.TRUTH_CONTACT)
            ticker.subscribe(graph.TRUTH_PROBE)
        if graph.NEEDLE_DRIVER.name in peers:
            self._needle_pub = ticker.publisher(graph.TRUTH_NEEDLE_FORCE)
            self._shaft_pub = ticker.publisher(graph.TRUTH_NEEDLE)
            ticker.subscribe(graph.TRUTH_NEEDLE_PATH)
        made_ns = 0 if setup.lockstep else self.get_clock().now().nanoseconds
        self._topology_pub(convert.mesh_topology(made_ns, self._frame, self._body.mesh,
                                                 self._body.surface))
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        stamp, position = t_ns, ()  # a body without pads moves on its own
        if self._body.pad_names:
            states = inputs[self._pads_topic.name]
            if not states:
                return
            msg = states[-1]  # wall pace only: a body that fell behind skips to the newest
            names = msg.name if isinstance(msg, JointState) else msg.names
            stamp = convert.nanoseconds(msg)
            position = cell.in_driver_order(names, msg.position, self._body.pad_names)
        self._hear_instruments(inputs)
        reading = self._body.step(stamp * 1e-9, position, self._probe, self._needle)
        self._health.note(stamp, reading.outcome)
        self._points_pub(convert.body_points(
            stamp, self._frame, self._body.point_names, reading.points, reading.rotations,
            self._body.pad_names, reading.pad_displacement, reading.pad_force,
            reading.pad_moment))
        if stamp >= self._mesh_due_ns:
            self._mesh_due_ns = (stamp // self._mesh_period_ns + 1) * self._mesh_period_ns
            self._positions_pub(convert.mesh_positions(stamp, self._frame, reading.x))
        self._say_instruments(stamp, reading)
        self._health.beat(stamp, lambda: {'tick': tick, 'iterations': reading.iterations})

    def _hear_instruments(self, inputs):
        """The newest poses; without a new one an instrument is where it was."""
        probe = inputs.get(graph.TRUTH_PROBE.name)
        needle = inputs.get(graph.TRUTH_NEEDLE_PATH.name)
        if probe:
            self._probe = convert.pose_of(probe[-1].pose)
        if needle:
            self._needle, self._axes = convert.needle_of(needle[-1])

    def _say_instruments(self, stamp, reading):
        if self._contact_pub is not None and reading.probe is not None:
            self._contact_pub(convert.probe_contact(stamp, self._frame, reading.probe))
        if self._needle_pub is not None:
            self._needle_pub(convert.needle_wrench(stamp, self._frame, reading.needle_force,
                                                   self._needle))
            if reading.shaft is not None:
                self._shaft_pub(convert.needle_shaft(
                    stamp, self._frame, reading.shaft, tangents(reading.shaft, self._axes)))


def plant():
    """The body that plays the patient."""
    return TissueNode(graph.TISSUE_SIMULATOR, 'plant', graph.TRUTH_PADS, graph.TRUTH_POINTS,
                      graph.TRUTH_TOPOLOGY, graph.TRUTH_POSITIONS)


def main(args=None):
    """Run the node."""
    spin_node(plant, args)
