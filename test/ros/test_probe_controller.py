"""The node of the probe's arm on its own: messages in, messages out, services."""

import time
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from std_srvs.srv import Trigger

from arm_brachy import graph
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert
from arm_brachy.nodes.probe_controller import ProbeControllerNode
from arm_brachy_msgs.msg import ProbeContact, ProbeState, SafetyState

pytestmark = pytest.mark.ros
TICK = 50_000_000
RADIUS = 0.06            # m of a ball that plays the body


@contextmanager
def running(scenario, key=''):
    """The node with a scenario (path), and with the key of a session (path)."""
    rclpy.init()
    made = ProbeControllerNode(parameter_overrides=[
        Parameter('scenario', value=str(scenario)), Parameter('pace', value='wall'),
        Parameter('session_key', value=str(key)),
        Parameter('peers', value=[graph.PROBE_CONTROLLER.name, graph.SUPERVISOR.name])])
    try:
        yield made
    finally:
        made.close()
        made.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def node(ros_domain_id, short_scenario):
    with running(short_scenario) as made:
        yield made


def ball():
    """Points (n, 3) of its upper half."""
    u = np.random.default_rng(0).normal(size=(8000, 3))
    u[:, 2] = np.abs(u[:, 2])
    return RADIUS * u / np.linalg.norm(u, axis=1, keepdims=True)


ACROSS = np.column_stack([[0, 0, 1], [1, -1, 0], [1, 1, 0]]) / np.sqrt([1.0, 2.0, 2.0])
TIP = np.array([-0.005, -0.005, 0.03])


def ticks_of(node):
    """Callable: one tick of the node with its inputs; returns what it published."""
    boxes = [[] for _ in node._outputs]
    node._outputs = [box.append for box in boxes]

    def tick(k, state, **inputs):
        full = {topic.name: [] for topic in graph.PROBE_CONTROLLER.subscribes}
        full[graph.SAFETY.name] = [SafetyState(header=convert.header(k * TICK, 'cell_base'),
                                               state=state)]
        full[graph.NEEDLE_TIP.name] = [convert.pose_stamped(k * TICK, 'cell_base', ACROSS, TIP)]
        full.update({getattr(graph, name).name: [msg] for name, msg in inputs.items()})
        node._work(k, k * TICK, full)
        return [box[-1] for box in boxes]
    return tick


def test_it_follows_the_tip_over_the_cloud_once_asked_and_allowed(node):
    tick = ticks_of(node)
    follow = node.follow._on_call
    tick(1, SafetyState.HOLD, SURFACE=convert.cloud(0, 'cell_base', ball()))
    assert not follow(Trigger.Request(), Trigger.Response()).success
    tick(2, SafetyState.RUN)
    assert follow(Trigger.Request(), Trigger.Response()).success
    contact = ProbeContact(stiffness=np.zeros(36))
    for k in range(3, 20):
        state, joints, pose, wrench, truth = tick(k, SafetyState.RUN, TRUTH_CONTACT=contact)
    state = deserialize_message(serialize_message(state), ProbeState)
    assert state.phase == ProbeState.APPROACH and state.outcome == 'OK'
    assert len(state.force) == TICK // 1_000_000
    assert len(joints.position) == len(state.torque) == 7
    R, p = convert.pose_of(pose.pose)
    assert np.allclose(R[:, 1], ACROSS[:, 2], atol=0.02)      # image plane across the needle
    assert np.allclose(convert.pose_of(truth.pose)[1], p)
    assert abs(wrench.wrench.force.z) < 0.2                   # the tool's weight is taken off
    state, *_ = tick(20, SafetyState.STOP)
    assert state.phase == ProbeState.STOPPED


def test_in_a_cell_with_a_key_it_follows_for_a_ticket_alone(ros_domain_id, short_scenario,
                                                            tmp_path):
    session, other = (Session.create(tmp_path / f'{name}.key') for name in ('bag', 'other'))
    with running(short_scenario, tmp_path / 'bag.key') as node:
        tick = ticks_of(node)
        tick(1, SafetyState.RUN, SURFACE=convert.cloud(0, 'cell_base', ball()))

        def ask(whose):
            result, = node.set_parameters([Parameter('follow_ticket', value=whose.ticket(
                '/probe_controller/follow', time.time_ns()))])
            return result
        answer = node.follow._on_call(Trigger.Request(), Trigger.Response())
        assert not answer.success and 'follow needs the session key' in answer.message
        assert 'another session' in ask(other).reason
        state, *_ = tick(2, SafetyState.RUN)
        assert state.phase == ProbeState.IDLE
        assert ask(session).successful
        state, *_ = tick(3, SafetyState.RUN)
        assert state.phase == ProbeState.APPROACH


def test_the_scissor_linkage_says_its_four_joints(ros_domain_id, live_scenario):
    """The message has room for seven torques; those that there are not are NaN."""
    scenario = live_scenario('probe: {probe_holder: scissor_rcm, strategy: orientation}')
    with running(scenario) as node:
        tick = ticks_of(node)
        tick(1, SafetyState.RUN, SURFACE=convert.cloud(0, 'cell_base', ball()))
        assert node.follow._on_call(Trigger.Request(), Trigger.Response()).success
        contact = ProbeContact(stiffness=np.zeros(36))
        for k in range(2, 30):
            state, joints, pose, *_ = tick(k, SafetyState.RUN, TRUTH_CONTACT=contact)
    state = deserialize_message(serialize_message(state), ProbeState)
    assert state.phase == ProbeState.APPROACH and state.outcome == 'OK'
    assert joints.name == ['scissor_theta_0', 'scissor_theta_1', 'scissor_spin', 'scissor_stage']
    assert len(joints.position) == 4 and np.array_equal(np.isnan(state.torque), [0] * 4 + [1] * 3)
    R, p = convert.pose_of(pose.pose)
    assert abs(R[:, 1] @ (TIP - p)) < 1e-3         # the tip is in the image plane
