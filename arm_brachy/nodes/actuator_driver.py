"""ROS 2 shell of one bank of linear actuators: commands in, encoder states out."""

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from std_srvs.srv import Trigger

from arm_brachy import cell, graph
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState

SAFETY_PATIENCE_NS = 500_000_000  # older than this, a permission to run no longer counts


class ActuatorDriverNode(Node):
    """Convert, call the driver, convert back. Without a fresh permission to run it holds.

    in   actuators/command  ActuatorCommand  refused whole if any entry is bad
         cell/safety        SafetyState      RUN, HOLD or STOP
         truth/points       BodyPoints       simulated bank only: what pushes back on the pads
    out  actuators/state    JointState       every tick; stamp = tick
         truth/pads         PadState         simulated bank only
    srv  ~/home, ~/release  Trigger
    par  scenario, and every quantity of ActuatorParams
    """

    def __init__(self, **kwargs):
        super().__init__(graph.ACTUATOR_DRIVER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._lockstep = setup.frame, setup.lockstep
        self._names = [p.name for p in setup.cell.scene.pads]
        self._directions = cell.pad_directions(setup.cell.plant)
        params = parameters.device_parameters(self, setup.cell.scenario.actuators)
        self._driver = cell.build_actuators(setup.cell, params)
        self._driver.connect()
        self._home_due = self.declare_parameter(
            'home_at_start', setup.cell.scenario.actuator_driver == 'simulated',
            ParameterDescriptor(description='go home unasked; hardware waits for ~/home')).value
        self._guarded = graph.SUPERVISOR.name in setup.peers
        self._permission = SafetyState.HOLD if self._guarded else SafetyState.RUN
        self._permission_ns = 0
        self._effort, self._commands, self._refused = None, 0, 0
        ticker = Ticker(self, graph.ACTUATOR_DRIVER, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent)
        self._state_pub = ticker.publisher(graph.ACTUATORS)
        self._truth_pub = ticker.publisher(graph.TRUTH_PADS)
        self._health = Health(self, ticker, self._frame)
        for topic in graph.ACTUATOR_DRIVER.subscribes:
            ticker.subscribe(topic)
        self.create_service(Trigger, '~/home', self._on_home)
        self.create_service(Trigger, '~/release', self._on_release)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs[graph.SAFETY.name]:
            self._on_safety(msg)
        for msg in inputs[graph.TRUTH_POINTS.name]:
            self._effort = cell.push_back(msg.pad_force, self._directions)
        for msg in inputs[graph.COMMAND.name]:
            self._on_command(t_ns, msg)
        self._check_permission(t_ns)
        self._home_at_start()
        state = self._driver.read(t_ns * 1e-9, self._effort)
        self._health.note(t_ns, state.outcome, state.message)
        self._state_pub(convert.joint_state(t_ns, self._frame, self._names, state))
        if state.pad is not None:
            self._truth_pub(convert.pad_state(t_ns, self._frame, self._names, state.pad))
        self._health.beat(t_ns, lambda: {
            'homed': state.homed.all(), 'moving': state.moving.any(), 'commands': self._commands,
            'refused': self._refused})

    def _on_safety(self, msg):
        self._permission, self._permission_ns = msg.state, convert.nanoseconds(msg)
        if msg.state == SafetyState.STOP:
            self._driver.stop()
        elif msg.state == SafetyState.HOLD:
            self._driver.hold()

    def _home_at_start(self):
        if self._home_due and self._permission == SafetyState.RUN:
            self._home_due = False
            self._driver.home()

    def _check_permission(self, t_ns):
        """Silence of the supervisor is a hold, whatever it said last."""
        stale = self._guarded and t_ns - self._permission_ns > SAFETY_PATIENCE_NS
        if stale and self._permission == SafetyState.RUN:
            self._permission = SafetyState.HOLD
            self._driver.hold()
            self._health.refuse(t_ns, Outcome.HELD, 'no word from the supervisor for '
                                f'{(t_ns - self._permission_ns) * 1e-9:.1f} s; holding')

    def _on_command(self, t_ns, msg):
        self._commands += 1
        if msg.mode == ActuatorCommand.MODE_STOP:
            self._driver.stop()
        elif msg.mode == ActuatorCommand.MODE_HOLD:
            self._driver.hold()
        elif self._permission != SafetyState.RUN:
            self._refuse(t_ns, 'actuators: move while the safety state is not RUN; reset the '
                               'supervisor first')
        else:
            self._move(t_ns, msg)

    def _move(self, t_ns, msg):
        """Move; what the driver itself refuses it says in the outcome of its next state."""
        speed = msg.velocity if len(msg.velocity) else None
        try:
            q = cell.in_driver_order(msg.names, msg.position, self._names)
        except CommandRefused as refusal:
            self._refuse(t_ns, str(refusal))
            return
        try:
            self._driver.move(q, speed)
        except CommandRefused:
            self._refused += 1

    def _refuse(self, t_ns, message):
        self._refused += 1
        self._health.refuse(t_ns, Outcome.REJECTED, message)

    def _on_home(self, request, response):
        return self._serve(response, self._driver.home, 'going home')

    def _on_release(self, request, response):
        return self._serve(response, self._driver.release, 'released')

    def _serve(self, response, action, done):
        try:
            if self._permission != SafetyState.RUN:
                raise CommandRefused('actuators: the safety state is not RUN; reset the '
                                     'supervisor first')
            action()
            response.success, response.message = True, done
        except CommandRefused as refusal:
            response.success, response.message = False, str(refusal)
        return response

    def close(self):
        """Hold where the pads are and let the hardware go."""
        self._driver.hold()
        self._driver.close()


def main(args=None):
    """Run the node."""
    spin_node(ActuatorDriverNode, args)
