"""ROS 2 shell of the probing protocol: the scenario's moves as pad commands."""

from rclpy.node import Node

from arm_brachy import cell, graph
from arm_brachy.control.push_protocol import Action
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import RESUME
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_trigger import KeyedTrigger
from arm_brachy.nodes.permission import PermissionWatch
from arm_brachy.nodes.progress import Progress
from arm_brachy.nodes.service_calls import ServiceCalls
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker


class PushProtocolNode(Node):
    """Convert, call, convert back; in place of operator and controller, nothing is fed back.

    in   actuators/state    JointState       encoders: whether the pads are home, and follow
         cell/safety        SafetyState      all but RUN, or (wall pace) silence, interrupts
    out  actuators/command  ActuatorCommand  every tick while the moves are made
         cell/task          TaskState        every phase of every move
    srv  ~/resume Trigger, after an interruption; in a cell with a key for a resume_ticket
    calls actuator_driver/home
    par  scenario
    """

    def __init__(self, **kwargs):
        super().__init__(graph.PUSH_PROTOCOL.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._lockstep = setup.frame, setup.lockstep
        self._names = [p.name for p in setup.cell.scene.pads]
        self._protocol = cell.build_protocol(setup.cell)
        self._permission = PermissionWatch(setup, self._protocol.permit)
        self._encoders, self._progress = None, Progress()
        self._calls = ServiceCalls(self)
        self._home_client = self._calls.keyed(setup.session, 'actuator_driver/home')
        ticker = Ticker(self, graph.PUSH_PROTOCOL, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                        session=setup.session)
        ticker.unready = self._calls.unready
        self._command_pub = ticker.publisher(graph.COMMAND)
        self._task_pub = ticker.publisher(graph.TASK)
        self._health = Health(self, ticker, self._frame)
        for topic in graph.PUSH_PROTOCOL.subscribes:
            ticker.subscribe(topic)
        self.resume = KeyedTrigger(self, setup.session, 'resume', self._resume, hint=RESUME)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        self._permission.hear(t_ns, inputs[graph.SAFETY.name], self._health)
        if inputs[graph.ACTUATORS.name]:
            self._feel(t_ns, inputs[graph.ACTUATORS.name][-1])
        if self._encoders is None:
            return None
        step = self._protocol.step(t_ns * 1e-9, *self._encoders)
        self._publish(t_ns, step)
        self._health.beat(t_ns, lambda: {'stage': self._protocol.stage.value,
                                         'made': self._protocol.made})
        if not self._lockstep:
            self._show(tick, step)
        return self._go_home(t_ns) if step.action is Action.HOME else None

    def _feel(self, t_ns, msg):
        """Take the encoders in the scene's order of pads."""
        try:
            self._encoders = [cell.in_driver_order(msg.name, values, self._names)
                              for values in (msg.position, msg.velocity)]
        except CommandRefused as refusal:
            self._health.refuse(t_ns, Outcome.REJECTED, f'{graph.ACTUATORS.name}: {refusal}')

    def _publish(self, t_ns, step):
        for event in step.events:
            self._task_pub(convert.move_state(t_ns, self._frame, event))
        self._health.note(t_ns, step.outcome, step.message)
        if step.command is not None:
            self._command_pub(convert.actuator_command(t_ns, self._frame, self._names,
                                                       step.command, step.speed))

    def _show(self, tick, step):
        """Tell the launcher; end a tick after the end, when everyone has heard of it."""
        self._progress.sometimes(tick=tick, phase=self._protocol.stage.value)
        if step.action is Action.FINISH and not step.events:
            self._progress.now(finished=True)
            raise SystemExit(0)

    def _go_home(self, t_ns):
        finished = self._calls.begin()

        def answered(future):
            answer = future.result()
            if not answer.success:
                self._health.refuse(t_ns, Outcome.REJECTED, answer.message)
            finished.set_result(None)

        self._home_client.call_async().add_done_callback(answered)
        return finished

    def _resume(self):
        self._protocol.resume()
        return 'going on'


def main(args=None):
    """Run the node."""
    spin_node(PushProtocolNode, args)
