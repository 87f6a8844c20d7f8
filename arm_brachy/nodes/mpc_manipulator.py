"""ROS 2 shell of the target manipulator: target and encoders in, pad commands out."""

import numpy as np
from rclpy.node import Node
from std_srvs.srv import Trigger

from arm_brachy import cell, graph
from arm_brachy.control.goal import Goal, GoalKind
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.health import Health
from arm_brachy.nodes.keyed_goal import GoalProof
from arm_brachy.nodes.move_target import MoveTargetServer
from arm_brachy.nodes.permission import PermissionWatch
from arm_brachy.nodes.spin import spin_node
from arm_brachy.nodes.ticker import Ticker
from arm_brachy_msgs.srv import SetGoal


class MpcManipulatorNode(Node):
    """Convert, call, convert back; it commands only while it pursues a goal.

    in   actuators/state     JointState   encoders
         em/<tool>/pose      PoseStamped  of every tool, with `feedback: em`
         estimate/<estimator>/<target>  PoseWithCovarianceStamped  with that estimator as feedback;
             those of others are received, as the table of the graph promises, and not used
         cell/safety         SafetyState  all but RUN, or (wall pace) silence, drops the goal
    out  actuators/command   ActuatorCommand    every control period while a goal is pursued
         manipulation/state  ManipulationState  every control period
    srv  ~/set_goal SetGoal; in a cell with a key after its set_goal_ticket
         ~/abort and ~/hold Trigger, open to all
    act  ~/move_target MoveTarget: as ~/set_goal, with the same ticket, feedback and an end
    par  scenario
    """

    def __init__(self, **kwargs):
        super().__init__(graph.MPC_MANIPULATOR.name, **kwargs)
        setup = parameters.node_setup(self)
        self._frame, self._names = setup.frame, [p.name for p in setup.cell.scene.pads]
        self._control = cell.build_controller(setup.cell)
        self._permission = PermissionWatch(setup, self._control.permit)
        ticker = Ticker(self, graph.MPC_MANIPULATOR, self._work, lockstep=setup.lockstep,
                        tick_ns=setup.tick_ns, peers=setup.peers, absent=setup.absent,
                        session=setup.session)
        self._command_pub = ticker.publisher(graph.COMMAND)
        self._state_pub = ticker.publisher(graph.MANIPULATION)
        self._health = Health(self, ticker, self._frame)
        self._heard = {topic.name: target for topic, target in _heard(setup.cell)}
        for topic in _received(setup.cell):
            ticker.subscribe(topic)
        ticker.subscribe(graph.ACTUATORS)
        ticker.subscribe(graph.SAFETY)
        self._proof = GoalProof(self, setup.session)
        self.create_service(SetGoal, '~/set_goal', self._on_goal)
        self.create_service(Trigger, '~/abort', self._on_abort)
        self.create_service(Trigger, '~/hold', self._on_hold)
        self._moves = MoveTargetServer(self, self._pursue, self._control.abort)
        ticker.start()

    def _work(self, tick, t_ns, inputs):
        self._permission.hear(t_ns, inputs[graph.SAFETY.name], self._health)
        for name, target in self._heard.items():
            for msg in self._of_our_frame(t_ns, name, inputs[name]):
                self._control.hear(target, convert.nanoseconds(msg) * 1e-9,
                                   convert.position(msg))
        if inputs[graph.ACTUATORS.name]:
            self._feel(t_ns, inputs[graph.ACTUATORS.name][-1])
        step = self._control.step(t_ns * 1e-9)
        if step is not None:
            self._publish(t_ns, step)
        self._health.beat(t_ns, lambda: {'target': self._control.target,
                                         'active': self._control.active,
                                         'samples gated': self._control.gated})

    def _of_our_frame(self, t_ns, name, poses):
        """Poses in the base frame; any other is named and left out."""
        for msg in poses:
            if msg.header.frame_id == self._frame:
                yield msg
            else:
                self._health.turn_away(t_ns, 'foreign frame', f'{name}: frame_id = '
                                       f'{msg.header.frame_id!r}; must be {self._frame!r}')

    def _feel(self, t_ns, msg):
        """Take the encoders in the scene's order of pads."""
        try:
            self._control.feel(cell.in_driver_order(msg.name, msg.position, self._names))
        except CommandRefused as refusal:
            self._health.refuse(t_ns, Outcome.REJECTED, f'{graph.ACTUATORS.name}: {refusal}')

    def _publish(self, t_ns, step):
        self._health.note(t_ns, step.outcome, step.message)
        if self._control.active and np.all(np.isfinite(step.command)):
            self._command_pub(convert.actuator_command(t_ns, self._frame, self._names,
                                                       step.command))
        self._state_pub(convert.manipulation_state(t_ns, self._frame, self._control, step))
        self._moves.step(t_ns, self._frame, step, self._control.active)

    def _on_goal(self, request, response):
        try:
            answer = self._pursue(request)
        except CommandRefused as refusal:
            response.accepted, response.message = False, str(refusal)
            return response
        self._moves.end('another goal was set')
        response.accepted, response.feasible = True, answer.feasible
        response.message = answer.message
        response.start = convert.point(answer.start)
        response.reference = convert.point(answer.reference)
        response.closest = convert.point(answer.closest)
        return response

    def _pursue(self, request):
        """The Answer to a goal that is set. Raises CommandRefused, and logs why."""
        try:
            if refusal := self._proof.refusal(request):
                raise CommandRefused(refusal)
            return self._control.pursue(self._goal(request))
        except CommandRefused as refusal:
            self.get_logger().warning(str(refusal))
            raise

    def _goal(self, request):
        """The Goal asked for. Raises CommandRefused for one in another frame."""
        if request.header.frame_id not in ('', self._frame):
            raise CommandRefused(f'goal for {request.target}: frame_id = '
                                 f'{request.header.frame_id!r}; must be {self._frame!r} or empty')
        kind = GoalKind.DISPLACEMENT if request.relative else GoalKind.POSITION
        return Goal(request.target, tuple(convert.xyz(request.goal)), kind,
                    tuple(bool(a) for a in request.axes))

    def _on_abort(self, request, response):
        self._control.abort()
        self._moves.end('aborted on request; the pads stay')
        response.success, response.message = True, 'the goal is dropped; the pads stay'
        return response

    def _on_hold(self, request, response):
        self._control.hold()
        response.success, response.message = True, 'holding; set a goal to go on'
        return response


def _heard(setup):
    """(graph.Topic, target) of everything that says where a target is."""
    feedback = setup.scenario.feedback
    for target in cell.heard_targets(setup):
        yield (graph.EM_POSE.at(tool=target) if feedback == 'em'
               else graph.estimate(feedback).at(target=target)), target


def _received(setup):
    """Those topics, and what estimators say that run beside."""
    yield from (topic for topic, _ in _heard(setup))
    for name in graph.estimators_of(setup.scenario):
        if name != setup.scenario.feedback:
            yield from (graph.estimate(name).at(target=t.name) for t in setup.scene.targets)


def main(args=None):
    """Run the node."""
    spin_node(MpcManipulatorNode, args)
