"""ROS 2 shell of one bank of linear actuators: commands in, encoder states out."""

from arm_brachy import cell, graph
from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import RUN_AGAIN
from arm_brachy.devices.actuator import SimulatedBank
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.managed_node import AbstractManagedNode
from arm_brachy.nodes.permission import command_gate, safety_gate
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState


class ActuatorDriverNode(AbstractManagedNode):
    """Convert, call the driver, convert back. Without a fresh permission to run it holds.

    Unconfigured it has no bank and answers no tick: without encoders there is nothing to say.
    Inactive it holds, publishes as ever and refuses what moves or allows motion.

    At wall pace a supervisor that falls silent is a hold that only ~/release ends, and what it
    says counts on arrival; in lockstep the clock waits for it, so there is no silence.

    in   actuators/command  ActuatorCommand  refused whole if any entry is bad, old, of the future,
                                             of another frame or overtaken; ignored if given
                                             before the last ~/home
         cell/safety        SafetyState      RUN, HOLD or STOP
         truth/points       BodyPoints       simulated bank only: what pushes back on the pads
    out  actuators/state    JointState       every tick; stamp = tick
         truth/pads         PadState         simulated bank only
    srv  ~/home, ~/release  Trigger; in a cell with a key for a home_ticket, a release_ticket
         ~/change_state and the others of a managed node
    par  scenario, autostart, home_at_start, and every quantity of ActuatorParams
    """

    def __init__(self, **kwargs):
        super().__init__(graph.ACTUATOR_DRIVER.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._lockstep = setup.frame, setup.lockstep
        self._names = [p.name for p in setup.cell.scene.pads]
        self._directions = cell.pad_directions(setup.cell.plant)
        params = parameters.device_parameters(self, setup.cell.scenario.actuators)
        self._driver = cell.build_actuators(setup.cell, params)
        self._check_pace(setup)
        self._sealed = setup.session is not None
        home_at_start = parameters.flag(
            self, 'home_at_start', setup.cell.scenario.actuator_driver == 'simulated',
            'go home unasked; hardware waits for ~/home, and so does a bank without autostart in '
            'a cell with a key')
        # whoever activates needs no key, and moves nothing
        self._home_due = home_at_start and (self.autostart or not self._sealed)
        self._guarded = graph.SUPERVISOR.name in setup.peers
        self._patience = setup.cell.scenario.limits.silence
        self._permission = SafetyState.HOLD if self._guarded else SafetyState.RUN
        self._permission_ns, self._lost, self._cut = 0, False, False
        self._commands_gate, self._safety_gate = command_gate(setup), safety_gate(setup)
        self._effort, self._commands, self._refused, self._home_ns = None, 0, 0, 0
        self._ticker = ticker = Ticker(
            self, graph.ACTUATOR_DRIVER, self._work, lockstep=setup.lockstep,
            tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
            session=setup.session)
        self._state_pub = ticker.publisher(graph.ACTUATORS)
        self._truth_pub = ticker.publisher(graph.TRUTH_PADS)
        self._health = Health(self, ticker, self._frame)
        ticker.asleep = self.asleep
        for topic in graph.ACTUATOR_DRIVER.subscribes:
            if topic is graph.SAFETY and not setup.lockstep:
                ticker.listen(topic, self._on_word, lockstep=False)
            else:
                ticker.subscribe(topic)
        self.home = KeyedTrigger(self, setup.session, 'home', self._home)
        self.release = KeyedTrigger(self, setup.session, 'release', self._release)
        if not self._sealed:
            self.get_logger().warning('no session_key: whoever is in this DDS domain may command')
        ticker.start()
        self.begin()  # last: nobody would close the bank if a line after it failed

    def _check_pace(self, setup):
        if setup.lockstep and not isinstance(self._driver, SimulatedBank):
            raise ConfigError(f'{setup.cell.path}: pace = lockstep with actuator_driver = '
                              f'{setup.cell.scenario.actuator_driver!r}; hardware does not wait '
                              'for a simulated clock: set pace: wall')

    def connect(self):
        """Connect to the bank; drives that were cut stay cut: whoever configures needs no key."""
        self._driver.connect()
        if self._cut:
            self._driver.stop()

    def hold(self):
        """Hold the pads where they are; what was to move unasked no longer does."""
        self._home_due = False
        self._driver.hold()

    def disconnect(self):
        """Cut the drives until ~/release, and let the bank go."""
        self._cut = True
        self._driver.close()

    def _work(self, tick, t_ns, inputs):
        for msg in inputs.get(graph.SAFETY.name, ()):
            self._on_safety(t_ns, msg)
        for msg in inputs[graph.TRUTH_POINTS.name]:
            self._effort = cell.push_back(msg.pad_force, self._directions)
        for msg in inputs[graph.COMMAND.name]:
            self._on_command(t_ns, msg)
        self._check_permission(t_ns)
        self._home_at_start(t_ns)
        state = self._driver.read(t_ns * 1e-9, self._effort)
        if self.active:
            self._health.note(t_ns, state.outcome, state.message)
        else:
            self._health.note(t_ns, Outcome.HELD, self.why_not_active())
        self._state_pub(convert.joint_state(t_ns, self._frame, self._names, state))
        if state.pad is not None:
            self._truth_pub(convert.pad_state(t_ns, self._frame, self._names, state.pad))
        self._health.beat(t_ns, lambda: {
            'homed': state.homed.all(), 'moving': state.moving.any(), 'commands': self._commands,
            'refused': self._refused, 'commands sealed': self._sealed})

    def _on_word(self, msg, info):
        self._on_safety(self.get_clock().now().nanoseconds, msg)

    def _on_safety(self, t_ns, msg):
        refusal = self._safety_gate.refusal(t_ns * 1e-9, convert.allowance(msg))
        if refusal is not None:
            self._refuse(t_ns, refusal.kind, f'{graph.SAFETY.name}: {refusal.message}')
            return
        self._permission, self._permission_ns = msg.state, convert.nanoseconds(msg)
        if msg.state == SafetyState.STOP:
            self._stop()
        elif msg.state == SafetyState.HOLD and self.connected:
            self._driver.hold()

    def _stop(self):
        """Cut the drives; what was to move unasked no longer does."""
        self._home_due, self._cut = False, True
        if self.connected:
            self._driver.stop()

    def _home_at_start(self, t_ns):
        if self._home_due and not self._forbidden():
            self._home_due = False
            try:
                self._driver.home()
            except CommandRefused as refusal:
                self._refuse(t_ns, 'by the bank', str(refusal))

    def _check_permission(self, t_ns):
        """Silence of the supervisor is a hold, whatever it said last and says next."""
        if self._ticker.lockstep or not self._guarded or self._permission != SafetyState.RUN:
            return
        silence = (t_ns - self._permission_ns) * 1e-9
        if silence > self._patience:
            self._permission, self._lost, self._home_due = SafetyState.HOLD, True, False
            self._driver.hold()
            self._health.refuse(t_ns, Outcome.HELD, f'no word from the supervisor for '
                                f'{silence:.1f} s; holding until ~/release')

    def _not_running(self):
        if not self.active:
            return self.why_not_active()
        if self._permission == SafetyState.RUN:
            return ''
        return f'actuators: the safety state is not RUN; to run again: {RUN_AGAIN}'

    def _forbidden(self):
        """Why nothing may move, in one line; '' if it may."""
        lost = f'actuators: the supervisor had fallen silent; to run again: {RUN_AGAIN}'
        return self._not_running() or (lost if self._lost else '')

    def _on_command(self, t_ns, msg):
        self._commands += 1
        if msg.mode == ActuatorCommand.MODE_MOVE and \
                0 < convert.nanoseconds(msg) <= self._home_ns:
            return  # under way when the pads were sent home: outdated, no mistake
        refusal = self._commands_gate.refusal(t_ns * 1e-9, convert.order(msg))
        if refusal is not None:
            self._refuse(t_ns, refusal.kind, f'{graph.COMMAND.name}: {refusal.message}')
        elif msg.mode == ActuatorCommand.MODE_STOP:
            self._stop()
        elif msg.mode == ActuatorCommand.MODE_HOLD:
            self._driver.hold()
        elif forbidden := self._forbidden():
            self._refuse(t_ns, 'not permitted' if self.active else self.state, forbidden)
        else:
            self._move(t_ns, msg)

    def _move(self, t_ns, msg):
        """Move; what the driver itself refuses it says in the outcome of its next state."""
        try:
            q = cell.in_driver_order(msg.names, msg.position, self._names)
            speed = cell.in_driver_order(msg.names, msg.velocity, self._names) \
                if len(msg.velocity) else None
        except CommandRefused as refusal:
            self._refuse(t_ns, 'by the bank', str(refusal))
            return
        try:
            self._driver.move(q, speed)
        except CommandRefused:
            self._refused += 1

    def _refuse(self, t_ns, kind, message):
        self._refused += 1
        self._health.turn_away(t_ns, kind, message)

    def _home(self):
        if forbidden := self._forbidden():
            raise CommandRefused(forbidden)
        self._driver.home()
        self._home_ns = self._ticker.last_ns if self._ticker.lockstep \
            else self.get_clock().now().nanoseconds
        return 'going home'

    def _release(self):
        if forbidden := self._not_running():
            raise CommandRefused(forbidden)
        self._driver.release()
        self._lost = self._cut = False
        return 'released'

    def close(self):
        """Hold where the pads are and let the hardware go."""
        self.let_go()


def main(args=None):
    """Run the node."""
    spin_node(ActuatorDriverNode, args)
