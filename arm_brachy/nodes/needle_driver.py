"""ROS 2 shell of the needle: commands in, measured depth and tip out."""

from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.control.safety import Permission
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.session import RUN_AGAIN
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.permission import PermissionWatch, command_gate
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy_msgs.msg import ActuatorCommand

HOLE = ('hole_x', 'hole_y', 'hole_z', 'roll')
BENT = ('curvature', 'off_x', 'off_y', 'off_z')


class NeedleDriverNode(Node):
    """Convert, call the driver, convert back. Without a permission to run it holds.

    in   needle/command      ActuatorCommand  names [needle]: to a depth [m], velocity: speed
                                              [hole_x, hole_y, hole_z, roll]: into a hole [m, rad]
                                              [roll]: base turned [rad]
                                              [curvature, off_x, off_y, off_z]: that the told
                                              tip follows [1/m], and its distance from there [m]
         cell/safety         SafetyState      HOLD brakes, STOP stands still until ~/release
         truth/needle_force  WrenchStamped    of the tissue, the tick before
    out  needle/state        JointState       every tick: [needle, roll]; depth as last measured
         needle/tip          PoseStamped      outside the hole; stamp = measurement
         truth/needle_path   PoseArray        path that it cuts, template to tip
    srv  ~/release           Trigger; in a cell with a key for a release_ticket
    par  scenario
    """

    def __init__(self, **kwargs):
        super().__init__(graph.NEEDLE_DRIVER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame = setup.frame
        self._driver = cell.build_needle(setup.cell)
        self._axis, self._force = None, 0.0
        self._permission, self._reason = Permission.HOLD, ''
        ticker = Ticker(self, graph.NEEDLE_DRIVER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                        session=setup.session)
        self._state_pub = ticker.publisher(graph.NEEDLE_STATE)
        self._tip_pub = ticker.publisher(graph.NEEDLE_TIP)
        self._truth_pub = ticker.publisher(graph.TRUTH_NEEDLE_PATH)
        self._health = Health(self, ticker, self._frame)
        self._watch, self._gate = PermissionWatch(setup, self._permit), command_gate(setup)
        self._commands, self._refused = 0, 0
        for topic in graph.NEEDLE_DRIVER.subscribes:
            ticker.subscribe(topic)
        self.release = KeyedTrigger(self, setup.session, 'release', self._release)
        ticker.start()

    def _permit(self, permission, reason):
        self._permission, self._reason = permission, reason
        if permission is Permission.STOP:
            self._driver.stop()
        elif permission is Permission.HOLD:
            self._driver.hold()

    def _work(self, tick, t_ns, inputs):
        self._watch.hear(t_ns, inputs[graph.SAFETY.name], self._health)
        for msg in inputs[graph.TRUTH_NEEDLE_FORCE.name]:
            if self._axis is not None:
                self._force = -float(convert.xyz(msg.wrench.force) @ self._axis)
        for msg in inputs[graph.NEEDLE_COMMAND.name]:
            self._on_command(t_ns, msg)
        state = self._driver.read(t_ns * 1e-9, self._force)
        self._axis = state.axes[-1]
        self._health.note(t_ns, state.outcome, state.message)
        self._state_pub(convert.needle_state(t_ns, self._frame, state))
        if state.tip_p is not None:
            self._tip_pub(convert.pose_stamped(round(state.measured_t * 1e9), self._frame,
                                               state.tip_R, state.tip_p))
        self._truth_pub(convert.needle_shaft(t_ns, self._frame, state.shaft, state.axes))
        self._health.beat(t_ns, lambda: {'moving': state.moving, 'commands': self._commands,
                                         'refused': self._refused})

    def _on_command(self, t_ns, msg):
        """Carry out a command; what the driver refuses is in the outcome of its next state."""
        self._commands += 1
        refusal = self._gate.refusal(t_ns * 1e-9, convert.order(msg))
        if refusal is not None:
            self._refuse(t_ns, refusal.kind, f'{graph.NEEDLE_COMMAND.name}: {refusal.message}')
            return
        try:
            if msg.mode == ActuatorCommand.MODE_STOP:
                self._driver.stop()
            elif msg.mode == ActuatorCommand.MODE_HOLD:
                self._driver.hold()
            elif self._permission is not Permission.RUN:
                self._refuse(t_ns, 'not permitted', 'needle: the safety state is not RUN: '
                             f'{self._reason}')
            else:
                self._move(t_ns, tuple(msg.names), msg)
        except CommandRefused:
            self._refused += 1

    def _move(self, t_ns, names, msg):
        values = list(msg.position)
        if names == HOLE and len(values) == len(HOLE):
            self._driver.place(values[:3], values[3])
        elif names == HOLE[-1:] and len(values) == 1:
            self._driver.turn(values[0])
        elif names == BENT and len(values) == len(BENT):
            self._driver.bends(values[0], values[1:])
        elif names in (('needle',), ()) and len(values) == 1 and len(msg.velocity) <= 1:
            self._driver.command(values[0], *msg.velocity)
        else:
            self._refuse(t_ns, 'unknown joints', f'needle: {list(names)} with {len(values)} '
                         f'positions; must be needle, roll, {", ".join(BENT)} or '
                         f'{", ".join(HOLE)}, with one position each')

    def _refuse(self, t_ns, kind, message):
        self._refused += 1
        self._health.turn_away(t_ns, kind, message)

    def _release(self):
        if self._permission is not Permission.RUN:
            raise CommandRefused(f'needle: the safety state is not RUN; to run again: {RUN_AGAIN}')
        self._driver.release()
        return 'released'

    def close(self):
        """Stand still."""
        self._driver.stop()


def main(args=None):
    """Run the node."""
    spin_node(NeedleDriverNode, args)
