"""What the operator's node does in a scenario with a procedure: messages in, orders out."""

from functools import partial

import numpy as np
from std_srvs.srv import Trigger

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy.control.procedure_steps import MOVE, Kind
from arm_brachy.control.safety import Permission
from arm_brachy.control.sequencer import at_home
from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert
from arm_brachy_msgs.msg import ActuatorCommand, TaskState
from arm_brachy_msgs.srv import SetGoal

TRIGGERS = {Kind.RETRACT: 'probe_controller/retract'}
KEYED = {Kind.SCAN: 'surface_scanner/scan', Kind.FOLLOW: 'probe_controller/follow'}
NEEDLE_NAMES = {Kind.PLACE: ('hole_x', 'hole_y', 'hole_z', 'roll'), Kind.TURN: ('roll',),
                Kind.BEND: ('curvature', 'off_x', 'off_y', 'off_z')}


class ProcedureConductor:
    """Feeds a Procedure, carries out its orders one after another within the tick.

    in   needle/state, probe/state, ultrasound/tip, ultrasound/target, surface/cloud,
         estimate/<feedback>/<target>, actuators/state, cell/safety
    out  needle/command  ActuatorCommand   names [needle]: depth; [hole_x, hole_y, hole_z, roll]:
                                           into a hole; [roll]: turned at its base;
                                           [curvature, off_x, off_y, off_z]: its path as the
                                           images show it
         needle/aim      PoseArray         where the tip will be, and is to be, for the picture
         procedure/state DiagnosticArray   at every new step: plan and outcome
         cell/task       TaskState         while the pads move the target, and at the end
    calls mpc_manipulator/set_goal, /abort, actuator_driver/home, surface_scanner/scan,
          probe_controller/follow, /retract
    """

    def __init__(self, setup, ticker, calls, health, task_pub):
        """ticker : Ticker;  calls : ServiceCalls;  task_pub : publishes a TaskState."""
        scenario = setup.cell.scenario
        self.procedure = cells.build_procedure(setup.cell)
        self._frame, self._calls, self._health, self._task_pub = (
            setup.frame, calls, health, task_pub)
        self._goal = calls.goals(setup.session)
        self._abort = calls.client(Trigger, 'mpc_manipulator/abort')
        self._home = calls.keyed(setup.session, 'actuator_driver/home').call_async
        self._triggers = {
            **{kind: calls.keyed(setup.session, name).call_async for kind, name in KEYED.items()},
            **{kind: partial(calls.client(Trigger, name).call_async, Trigger.Request())
               for kind, name in TRIGGERS.items()}}
        self._needle_pub = ticker.publisher(graph.NEEDLE_COMMAND)
        self._aim_pub = ticker.publisher(graph.NEEDLE_AIM)
        self._state_pub = ticker.publisher(graph.PROCEDURE)
        self._estimate = graph.estimate(scenario.feedback).at(
            target=scenario.procedure.target).name
        self._axes = [a in scenario.procedure.axes for a in 'xyz']
        self._phase = None      # of the procedure, when it gave the orders that are carried out
        self._said, self._task = None, TaskState(name=MOVE, target=scenario.procedure.target)

    def hear(self, t_ns, inputs):
        """Take what has come: topic name -> messages."""
        p = self.procedure
        for msg in inputs.get(graph.SAFETY.name, ()):
            p.permit(Permission(msg.state), msg.reason)
        for msg in inputs.get(self._estimate, ()):
            p.hear_target(convert.nanoseconds(msg) * 1e-9, convert.xyz(msg.pose.pose.position))
        for msg in inputs.get(graph.NEEDLE_STATE.name, ()):
            self._take(t_ns, graph.NEEDLE_STATE, p.hear_needle, convert.needle_seen, msg)
        for msg in inputs.get(graph.PROBE_STATE.name, ()):
            self._take(t_ns, graph.PROBE_STATE, p.hear_probe, convert.probe_seen, msg)
        for msg in inputs.get(graph.ULTRASOUND_TIP.name, ()):
            p.hear_image(convert.nanoseconds(msg) * 1e-9, convert.xyz(msg.pose.position))
        for msg in inputs.get(graph.ULTRASOUND_TARGET.name, ()):
            p.hear_target_image(convert.nanoseconds(msg) * 1e-9, convert.position(msg))
        for _ in inputs.get(graph.SURFACE.name, ()):
            p.hear_surface()
        for msg in inputs.get(graph.ACTUATORS.name, ()):
            p.hear_pads(at_home(msg.position, msg.velocity))

    def _take(self, t_ns, topic, hear, meaning, msg):
        """Hear what a message means; one that means nothing is named and left out."""
        try:
            hear(meaning(msg))
        except InputError as problem:
            self._health.refuse(t_ns, Outcome.REJECTED, f'{topic.name}: {problem}')

    def step(self, t_ns):
        """Carry out what the procedure orders; returns (future or None, finished)."""
        p = self.procedure
        orders = p.step(t_ns * 1e-9)
        self._health.note(t_ns, p.outcome, p.message)
        self._say_state(t_ns)
        finished = any(o.kind is Kind.FINISH for o in orders)
        orders = [o for o in orders if o.kind is not Kind.FINISH]
        if not orders:
            return None, finished
        done = self._calls.begin()
        self._phase = p.phase
        self._next(t_ns, orders, done)
        return done, finished

    def _next(self, t_ns, orders, done):
        """Carry out the first order and, when it is answered, the rest."""
        if not orders or self.procedure.phase is not self._phase:
            done.set_result(None)   # all done, or the rest is of a step that failed
            return
        order, rest = orders[0], orders[1:]
        if order.kind in (Kind.SET_GOAL, Kind.SHIFT):
            self._set_goal(t_ns, order, lambda: self._next(t_ns, rest, done))
        elif order.kind is Kind.ARRIVED:
            self._say_task(t_ns, TaskState.DONE)
            self._next(t_ns, rest, done)
        elif order.kind in (Kind.REST, Kind.RELEASE):
            self._drop_goal(t_ns, order.kind, lambda: self._next(t_ns, rest, done))
        elif order.kind in self._triggers:
            self._call(t_ns, order.kind, self._triggers[order.kind],
                       lambda: self._next(t_ns, rest, done))
        elif order.kind is Kind.SHOW:
            self._aim_pub(convert.places(t_ns, self._frame, np.reshape(order.value, (2, 3))))
            self._next(t_ns, rest, done)
        else:
            self._needle_pub(self._needle_command(t_ns, order))
            self._next(t_ns, rest, done)

    def _needle_command(self, t_ns, order):
        if order.kind is Kind.STAY:
            return ActuatorCommand(header=convert.header(t_ns, self._frame),
                                   mode=ActuatorCommand.MODE_HOLD, names=['needle'])
        if order.kind is Kind.DRIVE:
            depth, speed = order.value
            return convert.actuator_command(t_ns, self._frame, ['needle'], [depth], [speed])
        return convert.actuator_command(t_ns, self._frame, NEEDLE_NAMES[order.kind], order.value)

    def _call(self, t_ns, kind, ask, then):
        ask().add_done_callback(lambda f: self._answered(t_ns, kind, f.result(), then))

    def _answered(self, t_ns, kind, answer, then):
        if not answer.success:
            self._refused(t_ns, kind, answer.message)
        then()

    def _refused(self, t_ns, kind, message):
        self._health.refuse(t_ns, Outcome.REJECTED, message)
        self.procedure.refused(message, kind)

    def _set_goal(self, t_ns, order, then):
        """Of a new task, of which is told, or of the same one."""
        request = SetGoal.Request(
            header=convert.header(t_ns, self._frame), target=self._task.target, relative=False,
            goal=convert.point(order.value), axes=self._axes)

        def answered(future):
            answer = future.result()
            if order.kind is Kind.SET_GOAL:
                self._task.start, self._task.goal = answer.start, answer.reference
                self._task.axes = request.axes
                self._say_task(t_ns, TaskState.ACTIVE if answer.accepted else TaskState.REFUSED,
                               answer.message)
            elif answer.accepted and self._task.state == TaskState.ACTIVE:
                self._task.goal = answer.reference
            if not answer.accepted:
                self._refused(t_ns, order.kind, answer.message)
            then()

        self._goal.call_async(request).add_done_callback(answered)

    def _drop_goal(self, t_ns, kind, then):
        """The pads stay or go home, whether they had a goal or not."""
        if self._task.state == TaskState.ACTIVE:
            self._say_task(t_ns, TaskState.DONE)
        self._abort.call_async(Trigger.Request()).add_done_callback(
            lambda _: then() if kind is Kind.REST else self._call(t_ns, kind, self._home, then))

    def say_finished(self, t_ns):
        """The end, with what went wrong if anything did."""
        self._say_task(t_ns, TaskState.FINISHED, self.procedure.message)

    @property
    def over(self):
        """True once the end has been said."""
        return self._task.state == TaskState.FINISHED

    def _say_task(self, t_ns, state, message=''):
        self._task.header, self._task.state = convert.header(t_ns, self._frame), state
        self._task.message = message
        self._task_pub(self._task)

    def _say_state(self, t_ns):
        p = self.procedure
        if (p.phase, p.outcome) == self._said:
            return
        self._said = (p.phase, p.outcome)
        self._state_pub(convert.diagnostics(t_ns, 'procedure', p.outcome, p.message, p.figures()))

    def figures(self):
        """For /diagnostics."""
        return {'phase': self.procedure.phase.value}

