"""The cell in one process, without ROS: the objects of the lockstep graph, in its order.

Within a tick data flow downstream: actuators, tissue, sensors, estimators, controller, operator,
supervisor; of a scenario with moves the push protocol stands for controller and operator.
Feedback is one tick late, as the table in `graph` says (`NodeSpec.previous`): commands,
permissions and what pushes back on the pads act in the tick after the one that made them. A
service that is called (goal, abort, homing) is served within its tick. Scenario and seed
therefore give the same numbers here as in a recording of the graph.

Left out: pace (there is no clock on the wall), meshes over time, diagnostics, the tissue model's
own predictions.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from arm_brachy import cell as cells
from arm_brachy import graph
from arm_brachy.control import push_protocol
from arm_brachy.control.goal import Goal, GoalKind
from arm_brachy.control.procedure_steps import MOVE
from arm_brachy.control.procedure_steps import Phase as Step
from arm_brachy.control.safety import Permission, Safety
from arm_brachy.control.sequencer import Action, Phase, at_home
from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.actuator import SimulatedBank
from arm_brachy.devices.em_tracker import ToolStatus
from arm_brachy.evaluation.timeseries import TaskWindow
from arm_brachy.inprocess_log import RunLog
from arm_brachy.inprocess_probe import ProbeSide

SENSORS = ('em', 'optical', 'force')


def run(cell, *, sensors=('em',), go_home=True):
    """Run a scenario from the first tick until all is over and the pads are home.

    cell : scenario.Cell;  sensors : which of SENSORS take part. With an estimator as feedback
    there is no EM tracker, and where estimators run the optical tracker does. Without 'force'
    nobody watches the force limit, which makes no difference to a run that stays below it.
    go_home : False ends the run with the last task or move
    Returns evaluation.timeseries.RunData. Raises ConfigError for a sensor or driver it cannot run.
    Test: closed_loop/test_inprocess.py
    """
    loop = InProcess(cell, sensors)
    while not (loop.finished or loop.work_over and not go_home):
        loop.tick()
    return loop.data()


class InProcess:
    """The cell between two ticks; what a person or a test may do in between acts in the next.

    t : [s] of the last tick;  finished : all is over and the pads are home
    driver, body, tracker, safety : the parts, as in the graph;  control, sequencer : of tasks
    protocol : of moves;  the other two or one are None, control without pads too
    estimators : name -> LiveEstimator
    step : the last ManipulatorStep, None before the first
    """

    def __init__(self, cell, sensors=('em',)):
        """cell : scenario.Cell;  sensors : see `run`."""
        for unknown in set(sensors) - set(SENSORS):
            raise ConfigError(f'sensor {unknown!r}; must be among {", ".join(SENSORS)}')
        scenario = cell.scenario
        self._cell, self._sensors = cell, _taking_part(scenario, sensors)
        self._pads = tuple(p.name for p in cell.scene.pads)
        self._directions = cells.pad_directions(cell.plant)
        self.driver = _simulated_driver(cell)
        self.body = cells.build_tissue(cell, 'plant')
        self.tracker = cells.build_em_tracker(cell, scenario.em)
        self.optical = cells.build_optical_tracker(cell, scenario.optical)
        self.force = cells.build_force_sensor(cell, scenario.force)
        self.estimators = {name: cells.build_estimator(cell, name)
                           for name in graph.estimators_of(scenario)}
        self.safety = Safety(scenario.limits.pad_force, others={
            'probe': scenario.limits.probe_force, 'needle': scenario.limits.needle_force})
        self.control = self.sequencer = self.protocol = None
        if scenario.moves:
            self.protocol = cells.build_protocol(cell)
        else:
            self.control = cells.build_controller(cell) if self._pads else None
            self.sequencer = cells.build_sequencer(cell)
        points = {'em': cell.em_tools, 'optical': cells.marker_names(cell), 'force': ()}
        self._feeds = {name: cells.PointFeed(points[name]) for name in SENSORS}
        self._permission, self._home_due = Permission.HOLD, True
        self._effort, self._command = None, None
        self._ticks, self.step, self.finished = 0, None, False
        self._log, self._goal = RunLog(cell), None
        self.probe = None if scenario.procedure is None else ProbeSide(cell, self._log)
        self._permit(Permission.HOLD, 'no word from the supervisor yet')

    @property
    def t(self):
        """Time of the last tick [s]."""
        return self._ticks * self._cell.tick_ns * 1e-9

    @property
    def work_over(self):
        """True once the last task or move is over."""
        if self.protocol is not None:
            return self.protocol.moves_over
        if self.probe is not None:
            return self.probe.procedure.phase in (Step.HOMING, Step.FINISHED)
        last = len(self._cell.scenario.tasks) - 1
        return self.sequencer.index >= last and self.sequencer.phase in (Phase.HOMING,
                                                                         Phase.FINISHED)

    def tick(self):
        """Advance the cell by one tick of its clock."""
        if self._ticks > 0:
            self._hear_supervisor()
        self._ticks += 1
        state = self._drive()
        instruments = () if self.probe is None else self.probe.before(self.t, self._permission)
        reading = self.body.step(self.t, state.pad, *instruments)
        if self.probe is not None:
            self.probe.after(self.t, reading)
        self._log.note('tissue_simulator', reading.outcome)
        self._log.add('points', self.t, reading.points)
        heard = self._sense_target(reading)
        frames = self._sense_rest(reading)
        heard += self._estimate(state, frames)
        self._effort = cells.push_back(reading.pad_force, self._directions)
        if self.protocol is not None:
            self._push(state)
        else:
            if self.control is not None:
                self._steer(state, heard)
            if self.probe is None:
                self._operate(state)
            else:
                self._conduct(state, heard)

    def data(self):
        """What happened so far as RunData; a task or move that is not over yet is left out."""
        return self._log.data(self.body.point_names, self.body.mesh)

    def _hear_supervisor(self):
        """What it said at the end of the tick before; until it has spoken nothing moves."""
        self._permission = self.safety.permission
        self._permit(self._permission, self.safety.reason)
        if self._permission is Permission.STOP:
            self._home_due = False
            self.driver.stop()
        elif self._permission is Permission.HOLD:
            self.driver.hold()

    def _permit(self, permission, reason):
        for one in (self.control, self.protocol, self.probe):
            if one is not None:
                one.permit(permission, reason)

    def _drive(self):
        """The command of the tick before, then motion; returns BankState."""
        command, self._command = self._command, None
        if command is not None:
            self._obey(*command)
        if self._home_due and self._permission is Permission.RUN:
            self._home_due = False
            self._home_at_start()
        state = self.driver.read(self.t, self._effort)
        self._log.note('actuator_driver', state.outcome, state.message)
        self._log.add('encoder', self.t, state.q)
        self._log.add('pads', self.t, state.pad)
        return state

    def _home_at_start(self):
        try:
            self.driver.home()
        except CommandRefused as refusal:
            self._log.count('actuator_driver', Outcome.REJECTED, str(refusal))

    def _obey(self, q, speed):
        if self._permission is not Permission.RUN:
            self._log.count('actuator_driver', Outcome.REJECTED,
                            'actuators: move while the safety state is not RUN; reset the '
                            'supervisor')
            return
        # What the bank refuses it says in its next state.
        with suppress(CommandRefused):
            self.driver.move(q, speed)

    def _sense_target(self, reading):
        """Let the EM tracker look; returns what it delivered: (tool, t [s], position (3,))."""
        if 'em' not in self._sensors:
            return []
        heard = []
        for sample in cells.em_samples(self.tracker, self._feeds['em'], reading):
            t = _stamp(sample)
            self._log.add(('em', sample.tool), t,
                          (*sample.position, sample.quality, sample.status.value))
            if sample.status is ToolStatus.OK:
                heard.append((sample.tool, t, sample.position))
        return heard

    def _sense_rest(self, reading):
        """Let the other sensors look; returns the optical frames that were delivered."""
        frames = []
        if 'optical' in self._sensors:
            frames = cells.optical_samples(self.optical, self._feeds['optical'], reading)
            for frame in frames:
                self._log.add('optical', _stamp(frame), frame.points)
                self._log.add('visible', _stamp(frame), frame.visible)
        if 'force' in self._sensors:
            for sample in cells.force_samples(self.force, self._feeds['force'], reading):
                self._log.add(('force', sample.pad), _stamp(sample), sample.force)
                self.safety.force(sample.pad, sample.force)
        return frames

    def _estimate(self, state, frames):
        """Let the estimators work; returns what the one heard says, as `_sense_target`."""
        heard = []
        for name, live in self.estimators.items():
            live.feel(self.t, state.q)
            if self.probe is not None:
                live.bear(self.t, self.probe.loads())
            for frame in frames:
                live.see(_stamp(frame), frame.ids, frame.points)
            step = live.step(self.t)
            if step is None:
                continue
            self._log.note(f'{name}_estimator', step.outcome, step.message)
            if step.estimate is not None:
                self._log.estimate(name, step.estimate)
                if name == self._cell.scenario.feedback:
                    t = round(step.estimate.t * 1e9) * 1e-9
                    if self.probe is not None and step.estimate.x is not None:
                        self.probe.hear_mesh(self.t, step.estimate.x)
                    heard += [(target, t, point) for target, point in zip(
                        step.estimate.targets, step.estimate.points, strict=True)]
        return heard

    def _steer(self, state, heard):
        for tool in cells.heard_targets(self._cell):
            for _, t, position in (h for h in heard if h[0] == tool):
                self.control.hear(tool, t, position)
        self.control.feel(state.q)
        step = self.control.step(self.t)
        if step is None:
            return
        self.step = step
        self._log.note('mpc_manipulator', step.outcome, step.message)
        if self.control.active and np.all(np.isfinite(step.command)):
            self._give(step.command)

    def _give(self, q, speed=None):
        """A command, which the driver hears in the next tick."""
        self._command = q, speed
        self._log.add('command', self.t, q)

    def _push(self, state):
        step = self.protocol.step(self.t, state.q, state.velocity)
        self._log.note('push_protocol', step.outcome, step.message)
        self._log.events += step.events
        if step.command is not None:
            self._give(step.command, step.speed)
        if step.action is push_protocol.Action.HOME:
            refusal = self._send_home()
            if refusal:
                self._log.count('push_protocol', Outcome.REJECTED, refusal)
        self.finished = step.action is push_protocol.Action.FINISH

    def _conduct(self, state, heard):
        """A tick of a procedure."""
        target = self._cell.scenario.procedure.target
        for _, t, position in (h for h in heard if h[0] == target):
            self.probe.procedure.hear_target(t, position)
        self.probe.watch(self.safety, self.t)
        self.finished = self.probe.conduct(self.t, at_home(state.q, state.velocity), self)

    def set_goal(self, position):
        """Bring the procedure's target to a position (3,) [m]; returns a refusal, '' if none."""
        answer, refusal = self._pursue(position)
        if answer is not None:
            asked = self._cell.scenario.procedure
            self._goal = (asked, self.t, answer, np.array([a in asked.axes for a in 'xyz']))
        return refusal

    def shift_goal(self, position):
        """As set_goal, for a correction of the goal, which is no task of its own."""
        answer, refusal = self._pursue(position)
        if answer is not None and self._goal is not None:
            asked, start, first, axes = self._goal
            self._goal = asked, start, replace(first, reference=answer.reference), axes
        return refusal

    def _pursue(self, position):
        asked = self._cell.scenario.procedure
        axes = tuple(a in asked.axes for a in 'xyz')
        try:
            return self.control.pursue(Goal(asked.target, tuple(position), GoalKind.POSITION,
                                            axes)), ''
        except CommandRefused as refusal:
            return None, str(refusal)

    def rest(self):
        """Drop the goal; the pads stay where they are."""
        self.end_move()
        self.control.abort()

    def release(self):
        """Drop the goal and send the pads home; returns a refusal, '' if none."""
        self.rest()
        return self._send_home()

    def end_move(self):
        """The target has arrived: what comes later is no part of the task."""
        if self._goal is not None:
            asked, start, answer, axes = self._goal
            mode = f'{self._cell.scenario.control.loop}_loop'
            self._log.windows.append(TaskWindow(
                MOVE, asked.target, start, self.t, answer.start, answer.reference, axes,
                mode))
            self._goal = None

    def _operate(self, state):
        action = self.sequencer.step(self.t, at_home(state.q, state.velocity))
        if action is Action.SET_GOAL:
            self._set_goal(self._cell.scenario.tasks[self.sequencer.index])
        elif action is Action.RELEASE:
            self._release()
        elif action is Action.FINISH:
            self.finished = True

    def _set_goal(self, task):
        axes = tuple(a in task.axes for a in 'xyz')
        try:
            answer = self.control.pursue(
                Goal(task.target, task.displacement, GoalKind.DISPLACEMENT, axes))
        except CommandRefused as refusal:
            self._log.count('operator', Outcome.REJECTED, str(refusal))
            return
        self._goal = (task, self.t, answer, np.array(axes))

    def _release(self):
        if self._goal is not None:
            task, start, answer, axes = self._goal
            mode = f'{self._cell.scenario.control.loop}_loop'
            self._log.windows.append(TaskWindow(
                task.name, task.target, start, self.t, answer.start, answer.reference, axes, mode))
            self._goal = None
        self.control.abort()
        if self._permission is Permission.RUN:
            self._send_home()

    def _send_home(self):
        """Start homing; returns why the driver refuses, '' if it does not."""
        try:
            self.driver.home()
        except CommandRefused as refusal:
            return str(refusal)
        self._command = None  # under way when the pads were sent home: outdated
        return ''


def _taking_part(scenario, sensors):
    """Sensors (tuple) of a run; without one in the tissue where an estimator is the feedback."""
    wanted = set(sensors)
    if graph.estimators_of(scenario):
        wanted.add('optical')
    if graph.EM_TRACKER.name not in graph.cell_of(scenario):
        wanted.discard('em')
    return tuple(name for name in SENSORS if name in wanted)


def _simulated_driver(cell):
    """The bank of the scenario, connected."""
    driver = cells.build_actuators(cell, cell.scenario.actuators)
    if not isinstance(driver, SimulatedBank):
        raise ConfigError(f'{cell.path}: actuator_driver = {cell.scenario.actuator_driver!r} '
                          'moves hardware; a run in one process needs a simulated driver')
    driver.connect()
    return driver


def _stamp(sample):
    """Time of acquisition [s] as it comes back from a message: whole nanoseconds."""
    return round(sample.t * 1e9) * 1e-9
