"""ROS 2 shell of the arm that keeps the probe on the needle's tip; the arm is simulated in it."""

from functools import partial
from types import SimpleNamespace

import numpy as np
from rclpy.node import Node
from std_srvs.srv import Trigger

from arm_brachy import cell, graph
from arm_brachy.core.errors import CommandRefused, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.permission import PermissionWatch
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker

PROBE_FRAME = 'probe'


class ProbeControllerNode(Node):
    """Convert, step the arm, convert back; the loop of 1 kHz runs within the tick.

    At wall pace silence of the supervisor is a hold, and a long hold a retraction.

    in   needle/tip          PoseStamped    what the arm follows
         surface/cloud       PointCloud2    the skin, for surface: scan
         estimate/<feedback>/mesh/*         the skin, for surface: model
         cell/safety         SafetyState    RUN, HOLD or STOP
         truth/probe_contact ProbeContact   simulated arm only: what the tissue answers
    out  probe/state         ProbeState     every tick; stamp = tick
         probe/joint_states  JointState, probe/pose PoseStamped, probe/wrench WrenchStamped
         truth/probe         PoseStamped    simulated arm only
    srv  ~/follow, ~/release  Trigger; in a cell with a key for a follow_ticket, a release_ticket
         ~/retract, ~/hold  Trigger, open to all: off the skin, and at rest
    par  scenario, and the section probe there
    """

    def __init__(self, **kwargs):
        super().__init__(graph.PROBE_CONTROLLER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        self._arm = cell.build_probe_arm(setup.cell)
        name = setup.cell.scenario.feedback
        self._topology = graph.estimate_topology(name).name
        self._positions = graph.estimate_positions(name).name
        self._reading = None
        self._watch = PermissionWatch(setup, self._arm.permit)
        self._ticker = ticker = Ticker(
            self, graph.PROBE_CONTROLLER, self._work, lockstep=setup.lockstep,
            tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
            session=setup.session)
        self._outputs = [ticker.publisher(topic) for topic in (
            graph.PROBE_STATE, graph.PROBE_JOINTS, graph.PROBE_POSE, graph.PROBE_WRENCH,
            graph.TRUTH_PROBE)]
        self._health = Health(self, ticker, self._frame)
        for topic in graph.PROBE_CONTROLLER.subscribes:
            if topic not in graph.ESTIMATED_MESHES or topic.name in (self._topology,
                                                                     self._positions):
                ticker.subscribe(topic)
        self.follow, self.release = (
            KeyedTrigger(self, setup.session, name, partial(self._done, name))
            for name in ('follow', 'release'))
        for name in ('retract', 'hold'):
            self.create_service(Trigger, f'~/{name}', partial(self._on_call, name))
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        self._watch.hear(t_ns, inputs.get(graph.SAFETY.name, ()), self._health)
        self._hear(t_ns, inputs)
        step = self._arm.step(t_ns * 1e-9, self._reading)
        self._reading = None
        self._health.note(t_ns, step.outcome, step.message)
        frame = self._frame
        for publish, msg in zip(self._outputs, (
                convert.probe_state(t_ns, frame, step),
                convert.probe_joints(t_ns, frame, self._arm.joint_names, step),
                convert.pose_stamped(t_ns, frame, step.R, step.p),
                convert.probe_wrench(t_ns, PROBE_FRAME, step),
                convert.pose_stamped(t_ns, frame, step.R_true, step.p_true)), strict=True):
            publish(msg)
        self._health.beat(t_ns, lambda: {
            'phase': step.phase.name, 'in_contact': step.in_contact,
            'force': f'{-step.wrench[2]:.2f} N', 'waiting': step.waiting})

    def _hear(self, t_ns, inputs):
        for msg in inputs.get(graph.NEEDLE_TIP.name, ()):
            self._arm.hear_tip(convert.nanoseconds(msg) * 1e-9, *convert.pose_of(msg.pose))
        for msg in inputs.get(graph.TRUTH_CONTACT.name, ()):
            w = msg.wrench
            self._reading = SimpleNamespace(
                wrench=convert.six(w),
                stiffness=np.reshape(msg.stiffness, (6, 6)))
        for msg in inputs.get(self._topology, ()):
            self._arm.hear_topology(np.reshape(msg.surface, (-1, 3)))
        try:
            for msg in inputs.get(graph.SURFACE.name, ()):
                self._arm.hear_cloud(convert.cloud_points(msg))
            for msg in inputs.get(self._positions, ()):
                self._arm.hear_mesh(np.reshape(msg.positions, (-1, 3)))
        except InputError as problem:      # the surface that was there stays
            self._health.refuse(t_ns, Outcome.REJECTED, str(problem))

    def _done(self, name):
        getattr(self._arm, name)()
        return name

    def _on_call(self, name, request, response):
        try:
            response.success, response.message = True, self._done(name)
        except CommandRefused as refusal:
            response.success, response.message = False, str(refusal)
        return response

    def close(self):
        """Let the simulated arm go."""
        self._arm.close()


def main(args=None):
    """Run the node."""
    spin_node(ProbeControllerNode, args)
