"""ROS 2 shell of the clinician's side: walks through the scenario's tasks."""

from rclpy.node import Node
from std_srvs.srv import Trigger

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy.control.sequencer import Action, at_home
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.permission import safety_gate
from arm_brachy.nodes.procedure_conductor import ProcedureConductor
from arm_brachy.nodes.progress import Progress
from arm_brachy.nodes.service_calls import ServiceCalls
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy_msgs.msg import SafetyState, TaskState
from arm_brachy_msgs.srv import SetGoal

PATIENCE_NS = 5_000_000_000   # with a goal that is refused


class OperatorNode(Node):
    """Set a goal, wait, send the pads home, next task; the tick is answered with the service.

    At wall pace the first task waits until the supervisor has said RUN for the first time, and a
    goal that is refused is asked for again for some seconds.

    in   actuators/state  JointState
         cell/safety      SafetyState
         manipulation/state  ManipulationState  (its tick comes before ours)
    out  cell/task        TaskState
    calls mpc_manipulator/set_goal, mpc_manipulator/abort, actuator_driver/home
    par  scenario
    """

    def __init__(self, **kwargs):
        super().__init__(graph.OPERATOR.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._lockstep = setup.frame, setup.lockstep
        self._tasks = setup.cell.scenario.tasks
        self._sequencer = cells.build_sequencer(setup.cell)
        self._calls = ServiceCalls(self)
        self._conductor = None
        self._again, self._asked_ns = None, 0      # a task whose goal was refused at first
        if self._tasks:     # without any it calls nobody, and waits for nobody who would serve
            self._goal_client = self._calls.goals(setup.session)
            self._abort_client = self._calls.client(Trigger, 'mpc_manipulator/abort')
            self._home_client = self._calls.keyed(setup.session, 'actuator_driver/home')
        self._state, self._at_home, self._progress = None, False, Progress()
        ticker = Ticker(self, graph.OPERATOR, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                        session=setup.session)
        ticker.unready = self._calls.unready
        self._safety_gate = safety_gate(setup)
        self._permitted = setup.lockstep or graph.SUPERVISOR.name not in setup.peers
        self._task_pub = ticker.publisher(graph.TASK)
        self._health = Health(self, ticker, self._frame)
        if setup.cell.scenario.procedure is not None:
            self._conductor = ProcedureConductor(setup, ticker, self._calls, self._health,
                                                 self._task_pub)
        targets = [t.name for t in setup.cell.scene.targets]
        for topic in graph.received(graph.OPERATOR, setup.peers, targets=targets):
            ticker.subscribe(topic)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        inputs[graph.SAFETY.name] = [m for m in inputs.get(graph.SAFETY.name, ())
                                     if self._believed(t_ns, m)]
        for msg in inputs[graph.SAFETY.name]:
            self._permitted = self._permitted or msg.state == SafetyState.RUN
        for msg in inputs.get(graph.ACTUATORS.name, ()):
            self._at_home = at_home(msg.position, msg.velocity)
        if not self._permitted:
            return None
        if self._conductor is not None:
            return self._conduct(tick, t_ns, inputs)
        if self._again is not None:
            return self._set_goal(t_ns, self._again)
        action = self._sequencer.step(t_ns * 1e-9, self._at_home)
        if action is Action.SET_GOAL:
            return self._set_goal(t_ns, self._tasks[self._sequencer.index])
        if action is Action.RELEASE:
            return self._release(t_ns)
        if action is Action.FINISH:
            self._finish(t_ns)
        self._health.beat(t_ns, lambda: {'phase': self._sequencer.phase.value,
                                         'task': self._sequencer.index})
        if not self._lockstep:
            self._progress.sometimes(tick=tick, phase=self._sequencer.phase.value)
        return None

    def _believed(self, t_ns, msg):
        """False for what cannot be the supervisor's word of now."""
        refusal = self._safety_gate.refusal(t_ns * 1e-9, convert.allowance(msg))
        if refusal is not None:
            self._health.turn_away(t_ns, refusal.kind, f'{graph.SAFETY.name}: {refusal.message}')
        return refusal is None

    def _conduct(self, tick, t_ns, inputs):
        """A tick of a procedure."""
        one = self._conductor
        one.hear(t_ns, inputs)
        if one.over:
            self._leave()
            return None
        pending, finished = one.step(t_ns)
        if finished:
            one.say_finished(t_ns)
        self._health.beat(t_ns, one.figures)
        if not self._lockstep:
            self._progress.sometimes(tick=tick, **one.figures())
        return pending

    def _leave(self):
        if not self._lockstep:  # a tick after the end was said: everyone has heard it
            self._progress.now(finished=True)
            raise SystemExit(0)

    def _set_goal(self, t_ns, task):
        request = SetGoal.Request(
            header=convert.header(t_ns, self._frame), target=task.target, relative=True,
            goal=convert.point(task.displacement), axes=[a in task.axes for a in 'xyz'])
        finished = self._calls.begin()
        future = self._goal_client.call_async(request)
        future.add_done_callback(
            lambda f: self._goal_set(t_ns, task, request, f.result(), finished))
        return finished

    def _asks_again(self, t_ns):
        """At wall pace, for a while: a sensor that comes up late refuses no goal."""
        self._asked_ns = t_ns if self._again is None else self._asked_ns
        asks = not self._lockstep and t_ns - self._asked_ns < PATIENCE_NS
        self._again = None
        return asks

    def _goal_set(self, t_ns, task, request, answer, finished):
        if not answer.accepted and self._asks_again(t_ns):
            self.get_logger().info(f'{task.name}: {answer.message}; asked again',
                                   throttle_duration_sec=1.0)
            self._again = task
            finished.set_result(None)
            return
        state = TaskState.ACTIVE if answer.accepted else TaskState.REFUSED
        self._state = TaskState(
            header=request.header, state=state, index=self._sequencer.index, name=task.name,
            target=task.target, start=answer.start, goal=answer.reference, axes=request.axes,
            message=answer.message)
        self._task_pub(self._state)
        if not answer.accepted:
            self._health.refuse(t_ns, Outcome.REJECTED, answer.message)
        self.get_logger().info(f'{task.name}: {answer.message or "goal accepted"}')
        finished.set_result(None)

    def _release(self, t_ns):
        self._say(t_ns, TaskState.DONE)
        finished = self._calls.begin()
        aborted = self._abort_client.call_async(Trigger.Request())

        def go_home(_):
            self._home_client.call_async().add_done_callback(
                lambda f: self._homing(t_ns, f.result(), finished))

        aborted.add_done_callback(go_home)
        return finished

    def _homing(self, t_ns, answer, finished):
        self._say(t_ns, TaskState.HOMING, '' if answer.success else answer.message)
        finished.set_result(None)

    def _finish(self, t_ns):
        if self._state is None or self._state.state != TaskState.FINISHED:
            self._say(t_ns, TaskState.FINISHED, self._sequencer.verdict)
        else:
            self._leave()

    def _say(self, t_ns, state, message=''):
        msg = TaskState() if self._state is None else self._state
        msg.header, msg.state, msg.message = convert.header(t_ns, self._frame), state, message
        self._state = msg
        self._task_pub(msg)


def main(args=None):
    """Run the node."""
    spin_node(OperatorNode, args)
