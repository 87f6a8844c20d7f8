"""Services and action of the manipulator, live at wall pace; a bench plays encoders and EM."""

import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, PoseStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError, InputError, Interrupted
from arm_brachy.core.scene import load_scene
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert
from arm_brachy.nodes.goal_client import GoalClient
from arm_brachy.nodes.keyed_goal import action_of
from arm_brachy.nodes.keyed_trigger import ticket_request
from arm_brachy.nodes.mpc_manipulator import MpcManipulatorNode
from arm_brachy.nodes.ticker import message_type, offered
from arm_brachy_msgs.action import MoveTarget
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState
from arm_brachy_msgs.srv import SetGoal

pytestmark = [pytest.mark.ros, pytest.mark.wall]


class Rig(Node):
    """Encoders at `q`, the target where it rests; keeps commands and states of the controller.

    permission : what it says as supervisor, None = nothing;  session : whose seal that carries
    stood : whether the target has stood since the last test
    """

    def __init__(self, target, position, pads, session=None, **kwargs):
        super().__init__('rig', **kwargs)
        self.session = session
        self.names, self.q = pads, np.zeros(len(pads))
        self.position, self.blind, self.permission = np.array(position), False, SafetyState.RUN
        self.commands, self.states, self.stood = [], [], False
        self._encoders = self.create_publisher(JointState, graph.ACTUATORS.name,
                                               offered(graph.ACTUATORS))
        self._safety = self.create_publisher(SafetyState, graph.SAFETY.name,
                                             offered(graph.SAFETY))
        topic = graph.EM_POSE.at(tool=target)
        self._pose = self.create_publisher(PoseStamped, topic.name, offered(topic))
        for topic, sink in ((graph.COMMAND, self.commands), (graph.MANIPULATION, self.states)):
            self.create_subscription(message_type(topic.type), topic.name, sink.append,
                                     offered(topic))
        self.create_timer(0.025, self._play)

    def after(self, seconds, action):
        """Do something once, while somebody else spins."""
        def act():
            timer.cancel()
            action()
        timer = self.create_timer(seconds, act)

    def _play(self):
        now = self.get_clock().now().nanoseconds
        # not in the order of the scene: names say what is what
        self._encoders.publish(JointState(header=convert.header(now, 'cell_base'),
                                          name=self.names[::-1],
                                          position=convert.floats(self.q[::-1])))
        if self.permission is not None:
            said = SafetyState(header=convert.header(now, 'cell_base'), state=self.permission,
                               reason='says the rig')
            self._safety.publish(said if self.session is None else self.session.seal(
                self._safety.topic_name, serialize_message(said), time.time_ns()))
        if not self.blind:
            pose = PoseStamped(header=convert.header(now, 'cell_base'))
            pose.pose.position = convert.point(self.position)
            self._pose.publish(pose)

    def watch(self, condition, seconds=15.0):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.05)
        return condition()

    def call(self, kind, name, request):
        """Call a service while playing on."""
        client = self.create_client(kind, name)
        assert self.watch(lambda: client.service_is_ready(), 40), name
        future = client.call_async(request)
        assert self.watch(future.done, 30), name
        return future.result()

    def set_goal(self, target, goal, axes, relative=True, frame=''):
        """Ask for a goal."""
        return self.call(SetGoal, 'mpc_manipulator/set_goal', SetGoal.Request(
            header=convert.header(0, frame), target=target, relative=relative,
            goal=Point(x=goal[0], y=goal[1], z=goal[2]), axes=axes))


@pytest.fixture(scope='module')
def cell(start_lasting_node, short_scenario, live_scenario):
    """The Rig beside a manipulator that is up; all tests of the module share them."""
    scene = load_scene((short_scenario.parent / '../../config/scenes/breast.yaml').resolve())
    target = next(t for t in scene.targets if t.name == 'target_1')
    rclpy.init()
    node = Rig('target_1', target.position, [p.name for p in scene.pads])
    start_lasting_node('mpc_manipulator', f'scenario:={live_scenario()}', 'pace:=wall',
               'peers:=["mpc_manipulator", "actuator_driver", "em_tracker", "supervisor"]')
    assert node.watch(lambda: len(node.states) > 20, 60)  # two seconds of a standing target
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def rig(cell):
    """The Rig: no goal, the target stands, pads are retracted, everything is permitted."""
    cell.q[:], cell.blind, cell.permission = 0.0, False, SafetyState.RUN
    cell.call(Trigger, 'mpc_manipulator/abort', Trigger.Request())
    cell.watch(lambda: False, 0.3)
    cell.states.clear()
    least, cell.stood = 4 if cell.stood else 20, True
    assert cell.watch(lambda: len(cell.states) > least and not cell.states[-1].active, 60)
    cell.commands.clear()
    return cell


X, XY, XYZ = [True, False, False], [True, True, False], [True, True, True]


def test_no_command_before_a_goal_then_pushes_then_abort_and_hold(rig):
    assert rig.commands == []
    answer = rig.set_goal('target_1', (-2e-3, 0.0, 0.0), X)
    assert answer.accepted and answer.feasible
    assert answer.start.x == pytest.approx(rig.position[0], abs=1e-6)
    assert answer.reference.x == pytest.approx(rig.position[0] - 2e-3, abs=1e-6)
    assert rig.watch(lambda: rig.commands and max(rig.commands[-1].position) > 1e-3)
    assert all(c.mode == ActuatorCommand.MODE_MOVE for c in rig.commands)
    assert rig.call(Trigger, 'mpc_manipulator/hold', Trigger.Request()).success
    rig.watch(lambda: False, 0.5)
    held = rig.commands[-1].position
    rig.watch(lambda: False, 0.5)
    assert rig.commands[-1].position == held
    assert rig.call(Trigger, 'mpc_manipulator/abort', Trigger.Request()).success
    rig.watch(lambda: False, 0.3)
    count = len(rig.commands)
    rig.watch(lambda: False, 0.5)
    assert len(rig.commands) == count
    assert rig.states[-1].active is False


def test_a_goal_out_of_reach_is_answered_with_the_closest_point_and_why(rig):
    """Pads of one plane can lift a target, never press it onto the base."""
    answer = rig.set_goal('target_1', (0.0, 0.0, -10e-3), [False, False, True])
    assert answer.accepted and not answer.feasible
    assert answer.message
    reached = answer.closest.z - answer.start.z
    assert -10e-3 < reached <= 1e-6
    assert rig.watch(lambda: rig.states[-1].active)
    assert rig.watch(lambda: not rig.states[-1].feasible)
    assert rig.states[-1].outcome == 'INFEASIBLE'


@pytest.mark.parametrize(('target', 'goal', 'axes', 'said'), [
    ('target_9', (0.0, 0.0, 0.0), X, 'target_9'),
    ('target_2', (0.0, 0.0, 0.0), X, 'carries no sensor'),
    ('target_1', (float('nan'), 0.0, 0.0), X, 'finite'),
    ('target_1', (0.0, 0.0, 0.0), [False, False, False], 'no axis'),
])
def test_a_bad_goal_is_refused_with_a_reason(rig, target, goal, axes, said):
    answer = rig.set_goal(target, goal, axes)
    assert not answer.accepted
    assert said in answer.message
    assert '\n' not in answer.message
    rig.watch(lambda: False, 0.3)
    assert rig.commands == []


def test_in_a_cell_with_a_key_only_the_goal_of_a_ticket_is_set(short_scenario, tmp_path, cell):
    """Neither a stranger's goal, nor another one than was announced, nor the same one twice."""
    sessions = [Session.create(tmp_path / f'{name}.key') for name in ('bag', 'other')]
    node = MpcManipulatorNode(parameter_overrides=[Parameter(k, value=v) for k, v in {
        'scenario': str(short_scenario), 'pace': 'wall', 'peers': ['mpc_manipulator'],
        'session_key': str(tmp_path / 'bag.key')}.items()], namespace='keyed')
    try:
        ours, other = (SetGoal.Request(target='target_1', relative=True, goal=Point(x=x), axes=X)
                       for x in (-2e-3, -5e-3))
        full = '/keyed/mpc_manipulator/set_goal'

        def announce(session, request):
            given, = ticket_request(session, full, action_of(full, request)).parameters
            return node.set_parameters([Parameter.from_parameter_msg(given)])[0]

        def refused(request):
            return 'needs the session key' in node._on_goal(request, SetGoal.Response()).message
        assert refused(ours) and 'another session' in announce(sessions[1], ours).reason
        assert refused(ours)
        assert announce(sessions[0], ours).successful
        assert refused(other) and not refused(ours) and refused(ours)
        move = MoveTarget.Goal(target='target_1', relative=True, goal=Point(x=-2e-3), axes=X)
        assert node._proof.refusal(move)
        assert announce(sessions[0], move).successful
        assert not node._proof.refusal(move) and node._proof.refusal(move)
    finally:
        node.destroy_node()


def test_a_goal_in_another_frame_is_refused(rig):
    answer = rig.set_goal('target_1', (-2e-3, 0.0, 0.0), X, frame='probe')
    assert not answer.accepted
    assert "frame_id = 'probe'; must be 'cell_base' or empty" in answer.message
    assert rig.set_goal('target_1', (-2e-3, 0.0, 0.0), X, frame='cell_base').accepted


def test_encoders_are_told_apart_by_name(rig):
    rig.q[0] = 5e-3
    rig.watch(lambda: False, 0.5)
    assert rig.set_goal('target_1', (-1e-3, 0.0, 0.0), X).accepted
    assert rig.watch(lambda: rig.commands)
    assert rig.commands[0].names == rig.names
    assert rig.commands[0].position[0] >= 5e-3 and max(rig.commands[0].position[1:]) < 5e-3


@pytest.mark.parametrize(('state', 'name'), [(SafetyState.HOLD, 'HOLD'),
                                             (SafetyState.STOP, 'STOP')])
def test_what_is_not_permitted_drops_the_goal_and_refuses_the_next(rig, state, name):
    assert rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X).accepted
    assert rig.watch(lambda: rig.states[-1].active)
    rig.permission = state
    assert rig.watch(lambda: not rig.states[-1].active)
    answer = rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X)
    assert not answer.accepted
    assert f'{name} (says the rig)' in answer.message
    assert 'actuator_driver/release' in answer.message


def test_a_silent_supervisor_drops_the_goal_for_good(rig):
    assert rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X).accepted
    assert rig.watch(lambda: rig.states[-1].active)
    rig.permission = None
    assert rig.watch(lambda: not rig.states[-1].active)
    assert 'no word' in rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X).message
    rig.permission = SafetyState.RUN
    count = len(rig.commands)
    rig.watch(lambda: False, 0.5)
    assert len(rig.commands) == count
    assert rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X).accepted


def test_losing_the_tracker_holds_the_command(rig):
    assert rig.set_goal('target_1', (-3e-3, 0.0, 0.0), X).accepted
    assert rig.watch(lambda: len(rig.commands) > 3)
    rig.blind = True
    assert rig.watch(lambda: rig.states[-1].outcome == 'STALE_INPUT')
    held = rig.commands[-1].position
    rig.watch(lambda: False, 1.0)
    assert rig.commands[-1].position == held


@pytest.fixture
def moves(rig):
    """Callable: ask for a move; returns its handle, a future of its result, its feedback."""
    client = ActionClient(rig, MoveTarget, 'mpc_manipulator/move_target')
    assert rig.watch(client.server_is_ready, 40)

    def ask(goal, axes=X, target='target_1', **times):
        told = []
        sent = client.send_goal_async(
            MoveTarget.Goal(target=target, relative=True, axes=axes, **times,
                            goal=Point(x=goal[0], y=goal[1], z=goal[2])),
            feedback_callback=lambda msg: told.append(msg.feedback))
        assert rig.watch(sent.done, 30) and sent.result().accepted
        return sent.result(), sent.result().get_result_async(), told
    yield ask
    client.destroy()


def test_a_move_tells_how_far_it_is_and_succeeds_when_the_target_rests_there(rig, moves):
    _, future, told = moves((-2e-3, 0.0, 0.0), settle_s=0.3)
    assert rig.watch(lambda: len(told) > 3)
    assert told[-1].error.x == pytest.approx(-2e-3, abs=0.3e-3) and not told[-1].reached
    assert not future.done()
    start = rig.position.copy()
    rig.position, rig.stood = start - np.array([2e-3, 0.0, 0.0]), False
    try:
        assert rig.watch(future.done, 30)
    finally:
        rig.position = start
    status, result = future.result().status, future.result().result
    assert status == GoalStatus.STATUS_SUCCEEDED and result.reached
    assert abs(result.error.x) < 0.2e-3
    assert result.reference.x == pytest.approx(start[0] - 2e-3, abs=1e-5)


def test_a_move_is_preempted_by_an_action_and_by_the_service(rig, moves):
    _, first, _ = moves((-2e-3, 0.0, 0.0))
    _, second, _ = moves((0.0, -2e-3, 0.0), [False, True, False])
    assert rig.watch(first.done)
    assert rig.set_goal('target_1', (-1e-3, 0.0, 0.0), X).accepted
    assert rig.watch(second.done)
    for future in (first, second):
        assert future.result().status == GoalStatus.STATUS_ABORTED
        assert future.result().result.message == 'another goal was set'
    assert rig.watch(lambda: rig.states[-1].active)     # by the service's goal


def test_a_move_that_is_cancelled_leaves_the_pads_where_they_are(rig, moves):
    handle, future, told = moves((-2e-3, 0.0, 0.0))
    assert rig.watch(lambda: told)
    cancelled = handle.cancel_goal_async()
    assert rig.watch(cancelled.done) and len(cancelled.result().goals_canceling) == 1
    assert rig.watch(future.done)
    assert future.result().status == GoalStatus.STATUS_CANCELED
    rig.watch(lambda: False, 0.3)
    count = len(rig.commands)
    rig.watch(lambda: False, 0.5)
    assert len(rig.commands) == count and not rig.states[-1].active


@pytest.mark.parametrize(('ask', 'said'), [
    ({'target': 'target_9'}, 'target_9'), ({'settle_s': -1.0}, 'settle_s'),
    ({'timeout_s': float('nan')}, 'timeout_s')])
def test_a_move_that_cannot_be_says_why_in_its_result(moves, rig, ask, said):
    _, future, _ = moves((-2e-3, 0.0, 0.0), **ask)
    assert rig.watch(future.done)
    answer = future.result()
    assert answer.status == GoalStatus.STATUS_ABORTED and not answer.result.reached
    assert answer.result.outcome == 'REJECTED' and said in answer.result.message


def test_a_move_ends_with_the_word_of_the_supervisor_or_with_its_time(rig, moves):
    _, future, told = moves((-2e-3, 0.0, 0.0), timeout_s=0.5)
    assert rig.watch(future.done)
    assert 'not reached within 0.5 s' in future.result().result.message
    _, future, told = moves((-2e-3, 0.0, 0.0))
    assert rig.watch(lambda: told)
    rig.permission = SafetyState.HOLD
    assert rig.watch(future.done)
    assert future.result().status == GoalStatus.STATUS_ABORTED
    assert 'says the rig' in future.result().result.message


@pytest.fixture(scope='module')
def keyed(short_scenario, live_scenario, tmp_path_factory, cell):
    """A Rig and a manipulator with a key, in a namespace; whoever spins spins them, too."""
    bag = tmp_path_factory.mktemp('keyed') / 'bag'
    session = Session.create(f'{bag}.key', os.environ['ROS_DOMAIN_ID'], 'bench')
    node = MpcManipulatorNode(parameter_overrides=[Parameter(k, value=v) for k, v in {
        'scenario': str(live_scenario()), 'pace': 'wall', 'session_key': f'{bag}.key',
        'peers': ['mpc_manipulator', 'actuator_driver', 'em_tracker', 'supervisor']}.items()],
        namespace='bench')
    rig = Rig('target_1', cell.position, cell.names, session, namespace='bench')
    rig.bag, executor = bag, rclpy.get_global_executor()
    for one in (node, rig):
        executor.add_node(one)
    assert cell.watch(lambda: len(rig.states) > 20, 60)
    yield rig
    for one in (node, rig):
        executor.remove_node(one)
        one.destroy_node()


@pytest.fixture
def client(keyed):
    """Callable: the goal client in this process, until it ends; Ctrl-C is as before after it."""
    before = {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)}
    start, made = keyed.position, []
    keyed.call(Trigger, 'mpc_manipulator/abort', Trigger.Request())
    keyed.watch(lambda: False, 1.2)     # its mean of a second is that of a standing target

    def pursue(**given):
        made.append(GoalClient(parameter_overrides=[Parameter(k, value=v) for k, v in {
            'session_key': f'{keyed.bag}.key', 'target': 'target_1', 'axes': 'x', 'x_mm': -2.0,
            **given}.items()], namespace='bench'))
        made[-1].pursue()
    yield pursue
    keyed.position = start
    for one in made:
        one.destroy_node()
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_person_with_the_key_sets_a_goal_and_is_told_of_its_end(keyed, client, capsys):
    def arrive():
        keyed.position = keyed.position - np.array([2e-3, 0.0, 0.0])
    keyed.after(2.0, arrive)
    client(settle_s=0.3)
    first, *others, last = capsys.readouterr().out.splitlines()
    assert 'goal accepted, error x -2.0' in first and 'error x -2.0' in others[0]
    assert 'target_1: reached: error x' in last and 'dead band for 0.3 s' in last


def test_a_goal_that_is_not_reached_says_why(keyed, client):
    with pytest.raises(ArmBrachyError, match='not reached within 0.5 s; error x -') as ended:
        client(timeout_s=0.5)
    assert ended.value.exit_status == 1
    with pytest.raises(InputError, match='target_9'):
        client(target='target_9')


def test_ctrl_c_cancels_the_goal(keyed, client):
    keyed.after(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(Interrupted, match='cancelled; the pads stay'):
        client()
    assert not keyed.states[-1].active or keyed.watch(lambda: not keyed.states[-1].active)


def test_another_goal_and_the_end_of_the_cell_end_it(keyed, client, tmp_path):
    """A stranger's service call is refused, and says what a person does."""
    refusals = []
    stranger = keyed.create_client(SetGoal, 'mpc_manipulator/set_goal')
    keyed.after(0.5, lambda: stranger.call_async(SetGoal.Request(
        target='target_1', relative=True, axes=X)).add_done_callback(
            lambda f: refusals.append(f.result().message)))
    keyed.after(1.0, lambda: Path(f'{keyed.bag}.key').rename(tmp_path / 'key'))
    with pytest.raises(ArmBrachyError, match='the cell has ended'):
        client()
    (tmp_path / 'key').rename(f'{keyed.bag}.key')
    assert 'arm-brachy goal BAG target_1' in refusals[0]


def test_the_command_finds_the_cell_by_its_bag(keyed, client, command):
    """Its own process; asked for another target and a place out of reach of these pads."""
    process = subprocess.Popen([command, 'goal', keyed.bag, 'target_1', '--z', '-10'], text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    keyed.states.clear()
    assert keyed.watch(lambda: any(s.active for s in keyed.states)
                       or process.poll() is not None, 40)
    process.send_signal(signal.SIGINT)
    assert keyed.watch(lambda: process.poll() is not None, 20)
    out, error = process.communicate()
    assert process.returncode == 130 and 'error: target_1: cancelled' in error, error
    assert 'target_1: goal accepted, error z -10.0' in out
