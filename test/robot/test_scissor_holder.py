"""The scissor linkage as holder of the probe: kinematics, bending, force, limits, refusals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.config import from_mapping
from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.robot import scissor_loop as loop
from arm_brachy.robot.probe_arm import ProbeArm, ProbeArmParams
from arm_brachy.robot.probe_holder import Errand, Way
from arm_brachy.robot.probe_phases import RUN, Phase
from arm_brachy.robot.reference import rotation, rotation_vector
from arm_brachy.robot.scissor_drawing import ScissorDrawing
from arm_brachy.robot.scissor_holder import GRAVITY, ScissorHolder
from arm_brachy.robot.scissor_parameters import ScissorHolderParams
from arm_brachy.robot.scissor_place import base_axes, linkage_line
from arm_brachy.robot.scissor_rcm import ScissorParams, tip
from arm_brachy.robot.scissor_stiffness import Section, carrier_compliance, layout
from arm_brachy.robot.scissor_urdf import BASE, link_frames

PARAMS = ProbeArmParams(probe_holder='scissor_rcm', strategy='orientation', clearance=0.015)
OWN = PARAMS.scissor_rcm
CENTRE = np.array(OWN.centre)
RADIUS, SPRING, BREATH = 0.065, 300.0, 3e-3       # m, N/m, m
TICK = 0.05
ALONG = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
STILL = np.zeros(3)


@pytest.fixture(scope='module')
def one():
    made = ScissorHolder(PARAMS, np.random.default_rng(3))
    yield made
    made.close()


@pytest.fixture
def holder(one):
    """At rest at home."""
    one._memory.q[:] = one._joints(*one.home, None)
    for array in (one._memory.dq, one._memory.dlead, one._memory.true_wrench):
        array[:] = 0.0
    one._memory.lead[:] = one._memory.q
    return one


def postures(holder, n, seed=0):
    """(n, 4) joints within their travel."""
    low, high = holder._linkage.low, holder._linkage.high
    return low + (high - low) * np.random.default_rng(seed).uniform(0.02, 0.98, (n, 4))


def put(holder, q):
    holder._memory.q[:] = q
    return holder.state()


def test_the_carrier_stays_on_its_sphere_and_the_axis_goes_through_the_centre(holder):
    turn = base_axes(OWN.axis)
    for q in postures(holder, 60):
        at = put(holder, q)
        carrier = at.p - q[loop.ADVANCE] * at.R[:, 2] - CENTRE
        assert abs(np.linalg.norm(carrier) - OWN.linkage.radius) < 1e-9
        assert np.allclose(carrier, turn @ tip(OWN.linkage, q[0], q[1]), atol=1e-9)
        assert np.allclose(np.cross(at.p - CENTRE, at.R[:, 2]), 0.0, atol=1e-12)


def test_inverse_kinematics_find_the_joints_again(holder):
    for q in postures(holder, 60):
        at = put(holder, q)
        assert np.allclose(holder._joints(at.R, at.p, q), q, atol=1e-9)
        assert holder.obstacle(at.R, at.p) == ''


def test_rates_of_joints_give_the_motion_that_was_asked_for(holder):
    """Against finite differences of the pose; only what the axis can do is asked for."""
    step = 1e-6
    for q in postures(holder, 10):
        rates = np.random.default_rng(1).normal(size=4)
        (R, p), (R2, p2) = (loop.pose(holder._linkage, q + s * rates) for s in (-step, step))
        v, w = (p2 - p) / (2 * step), rotation_vector(R2 @ R.T) / (2 * step)
        assert np.allclose(loop.probe_jacobian(holder._linkage, q) @ rates, [*v, *w], atol=1e-7)
        assert np.allclose(loop.joint_rates(holder._linkage, q, v, w), rates, atol=1e-6)


def test_the_probe_is_off_its_encoders_by_compliance_times_wrench(holder):
    wrench = np.array([0.6, -0.4, 3.0, 0.02, 0.05, -0.01])
    reading = SimpleNamespace(wrench=wrench, stiffness=np.zeros((6, 6)))
    at = holder.state()
    holder.run(Errand(Way.BRAKE, at.R, at.p, STILL, STILL), reading, 1)
    at = holder.state()
    moved = np.concatenate([at.p_true - at.p, rotation_vector(at.R_true @ at.R.T)])
    # By hand: the carrier's compliance, turned to W, at the end of the probe's arm.
    theta_0, theta_1, _, advance = at.q
    axes = base_axes(OWN.axis) @ rotation(np.array([0.0, 0.0, theta_0]))
    arm = advance * at.R[:, 2]
    force, moment = wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])
    bent = carrier_compliance(OWN.linkage, theta_1) @ np.concatenate([axes.T @ force,
                                                                      axes.T @ moment])
    shift, turn = axes @ bent[:3], axes @ bent[3:]
    by_hand = np.concatenate([shift + np.cross(turn, arm), turn])
    assert np.allclose(moved, by_hand, rtol=0.01, atol=1e-3 * np.abs(by_hand[:3]).max())
    assert np.allclose(moved, holder.compliance() @ wrench, rtol=1e-6, atol=1e-12)
    assert 1e-6 < np.linalg.norm(moved[:3]) < 1e-4


def test_soft_links_bend_until_contact_and_links_are_in_balance():
    """A compliance beyond that of the tissue; explicit iteration would diverge there."""
    soft = replace(PARAMS, scissor_rcm=replace(OWN, linkage=ScissorParams(E=5e8)))
    holder = ScissorHolder(soft, np.random.default_rng(0))
    K = np.zeros((6, 6))
    K[2, 2] = 1e5
    at = holder.state()
    reading = SimpleNamespace(wrench=np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0]), stiffness=K)
    holder.run(Errand(Way.BRAKE, at.R, at.p, STILL, STILL), reading, 1)
    at, C = holder.state(), holder.compliance()
    assert C[2, 2] * K[2, 2] > 1.0
    force = 4.0 - K[2, 2] * (at.p_true - at.p)[2]
    assert np.isclose((at.p_true - at.p)[2], C[2, 2] * force, rtol=1e-6)


def test_torques_hold_the_links_and_the_tool(holder):
    """The gradient of the potential energy of arcs and tool, by finite differences."""
    link = OWN.linkage
    mass = OWN.density * Section.of(link).area * link.radius * link.beta
    tool = holder._tool
    down = base_axes(OWN.axis).T @ GRAVITY

    def energy(q):
        hinges, arcs = layout(link, q[1])
        turn = rotation(np.array([0.0, 0.0, q[0]]))
        s = (np.arange(200) + 0.5) / 200
        out = 0.0
        for arc in arcs:
            line = np.outer(1 - s, hinges[arc.start]) + np.outer(s, hinges[arc.end])
            line *= link.radius / np.linalg.norm(line, axis=1)[:, None]
            out -= mass * down @ turn @ line.mean(axis=0)
        R, p = loop.pose(holder._linkage, q)
        return out - tool.mass * down @ (p + R @ (tool.centre - [0, 0, PARAMS.tool_length]))

    for q in postures(holder, 4, seed=2):
        steps = 1e-5 * np.eye(4)
        slope = [(energy(q + d) - energy(q - d)) / 2e-5 for d in steps]
        assert np.allclose(put(holder, q).torque, slope, rtol=0.01, atol=0.01)


def test_every_limit_of_the_joints_is_kept_in_every_period(holder):
    """A goal far off and a stop at full speed."""
    start = holder.state()
    low, high = holder._linkage.low, holder._linkage.high
    q = low + 0.9 * (high - low)
    q[loop.SPIN] = start.q[loop.SPIN] + 0.8
    goal = put(holder, q)
    put(holder, start.q)
    log = []
    for way, periods in ((Way.POSE, 300), (Way.BRAKE, 150), (Way.POSE, 2200)):
        for _ in range(periods):
            holder.run(Errand(way, goal.R, goal.p, STILL, STILL), None, 1)
            log.append([holder._memory.q.copy(), holder._memory.dq.copy()])
    q, dq = np.swapaxes(log, 0, 1)
    linkage = holder._linkage
    assert np.all(q >= linkage.low) and np.all(q <= linkage.high)
    assert np.all(np.abs(dq) <= linkage.speed * (1 + 1e-12))
    assert np.all(np.abs(np.diff(dq, axis=0)) <= linkage.acceleration * 1e-3 * (1 + 1e-9))
    assert np.abs(dq[:, :2]).max() > 0.9 * linkage.speed[0]       # it was at the limit
    assert np.allclose(q[-1], goal.q, atol=1e-3)


class Sphere:
    """Skin about the centre that breathes, with friction of a tenth of the normal force."""

    def __init__(self):
        self.spring, self.last = SPRING, None

    def answer(self, t, R, p):
        off = p - CENTRE - [0.0, 0.0, BREATH * np.sin(np.pi / 2.0 * t)]
        n = off / np.linalg.norm(off)
        depth = max(0.0, RADIUS - np.linalg.norm(off))
        way = np.zeros(3) if self.last is None else p - self.last
        way -= n * (n @ way)
        size = np.linalg.norm(way)
        drag = -0.1 * self.spring * depth * way / size if size > 1e-6 else np.zeros(3)
        self.last = p
        K = np.zeros((6, 6))
        K[:3, :3] = self.spring * np.outer(n, n) if depth > 0.0 else 0.0
        return SimpleNamespace(wrench=np.concatenate([self.spring * depth * n + drag, STILL]),
                               stiffness=K)

    @staticmethod
    def cloud():
        rng = np.random.default_rng(1)
        u = rng.normal(size=(8000, 3))
        u[:, 2] = np.abs(u[:, 2])
        points = CENTRE + RADIUS * u / np.linalg.norm(u, axis=1, keepdims=True)
        return points + 0.3e-3 * rng.normal(size=points.shape)


class Bench:
    """Arm, skin and a needle of 10 mm/s 27 mm over the base, tick by tick."""

    def __init__(self, wait=2.5, start=-0.045):
        self.arm, self.skin = ProbeArm(PARAMS, np.random.default_rng(3)), Sphere()
        self.arm.permit(RUN, '')
        self.arm.hear_cloud(self.skin.cloud())
        self.wait, self.start, self.rng = wait, start, np.random.default_rng(5)
        self.k, self.reading, self.steps, self.aside = 0, None, [], []

    def tip(self, t):
        return (self.start + 0.010 * np.clip(t - self.wait, 0.0, 5.0)) * ALONG + [0, 0, 0.027]

    def run(self, seconds):
        R = np.column_stack([[0.0, 0.0, 1.0], np.cross(ALONG, [0.0, 0.0, 1.0]), ALONG])
        for _ in range(round(seconds / TICK)):
            t = self.k * TICK
            self.arm.hear_tip(t, R, self.tip(t) + 0.1e-3 * self.rng.normal() * ALONG)
            if self.k == 1:
                self.arm.follow()
            step = self.arm.step(t, self.reading)
            self.reading = self.skin.answer(t, step.R_true, step.p_true)
            self.steps.append(step)
            self.aside.append(step.R_true[:, 1] @ (self.tip(t) - step.p_true))
            self.k += 1
        return self.steps[-1]


@pytest.fixture(scope='module')
def followed():
    bench = Bench()
    bench.run(8.0)
    yield bench
    bench.arm.close()


def test_the_image_plane_follows_the_tip_and_the_force_its_goal(followed):
    """Goals: 0.5 mm for 95 % of an insertion at 10 mm/s, 0.1 N RMS while the body breathes."""
    there = np.array([s.phase is Phase.FOLLOW and s.t < 7.5 and not s.waiting
                      for s in followed.steps])
    assert there.sum() > 60
    assert np.percentile(np.abs(np.array(followed.aside)[there]), 95) < 0.5e-3
    force = np.concatenate([s.force for s, f in zip(followed.steps, there, strict=True) if f])
    assert np.sqrt(np.mean((force - PARAMS.force)**2)) < 0.1
    first = np.concatenate([s.force for s in followed.steps if s.t < 4.0])
    assert PARAMS.force < first.max() < PARAMS.force + 0.3


def test_a_retraction_ends_off_the_skin_and_at_home(followed):
    followed.arm.retract()
    step = followed.run(3.0)
    assert step.phase is Phase.IDLE and step.outcome is Outcome.OK
    R, p = followed.arm.holder.home
    assert np.allclose(step.p, p, atol=1e-3) and np.allclose(step.R, R, atol=0.03)
    assert np.linalg.norm(step.p_true - CENTRE) - RADIUS > 0.03


def test_a_hard_push_makes_it_retreat_within_the_tick():
    bench = Bench(wait=1e9)
    bench.run(3.5)
    assert bench.steps[-1].in_contact
    bench.skin.spring *= 8.0
    step = bench.run(2 * TICK)
    assert (step.phase, step.outcome) == (Phase.RETRACT, Outcome.LIMIT_PASSED)
    assert 'force' in step.message
    step = bench.run(0.5)
    assert np.linalg.norm(step.p_true - CENTRE) - RADIUS > 0.005
    bench.arm.close()


def test_poses_that_it_cannot_take_are_named(holder):
    R, p = holder.home
    assert 'misses the centre by 10.0 mm' in holder.obstacle(R, p + [0.01, 0.0, 0.0])
    assert 'travel of the stage' in holder.obstacle(R, p + [0.0, 0.0, 0.2])
    # About an axis across the first hinge's: towards it the links close, away they stretch.
    for angle, part in ((57.0, 'no links touch'), (-65.0, 'from its axis'), (-20.0, '')):
        turn = rotation(np.radians(angle) * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
        said = holder.obstacle(turn @ R, CENTRE + turn @ (p - CENTRE))
        assert part in said and bool(said) == bool(part), angle
    far = replace(PARAMS, home=(0.0, 0.0, 0.5), reach=1.0)
    with pytest.raises(InputError, match='travel of the stage'):
        ScissorHolder(far, np.random.default_rng(0))


@pytest.mark.parametrize(('given', 'said'), [
    ({}, "strategy = 'translational' with probe_holder = 'scissor_rcm'; must be orientation"),
    ({'strategy': 'orientation', 'control': 'switched'}, "control = 'switched'"),
    ({'strategy': 'orientation', 'scissor_rcm': {'nearest_mm': 200}}, 'must increase'),
    ({'strategy': 'orientation', 'scissor_rcm': {'axis': [0, 0, 0]}}, 'must not be zero'),
    ({'strategy': 'orientation', 'scissor_rcm': {'linkage': {'links': 0}}}, '2 to 20 links'),
    ({'strategy': 'orientation', 'scissor_rcm': {'linkage': {'beta_deg': 50}}}, '180 deg')])
def test_what_it_cannot_do_is_refused_in_one_line(given, said):
    with pytest.raises(ConfigError) as caught:
        from_mapping(ProbeArmParams, {'probe_holder': 'scissor_rcm', **given}, 'cell.yaml')
    assert said in str(caught.value) and '\n' not in str(caught.value)
    assert str(caught.value).startswith('cell.yaml')


def test_the_tool_is_weighed_and_nothing_is_felt_in_the_air(holder):
    at = holder.state()
    forces = holder.run(Errand(Way.BRAKE, at.R, at.p, STILL, STILL), None, 400)
    assert abs(forces.mean()) < 0.03


@pytest.mark.parametrize('links', [4, 5])
def test_the_urdf_has_the_frames_of_the_kinematics(links):
    own = ScissorHolderParams(linkage=ScissorParams(links=links, beta=np.pi / 2 / links))
    made = ScissorHolder(replace(PARAMS, scissor_rcm=own), np.random.default_rng(0))
    drawing = ScissorDrawing(own, base_axes(own.axis), CENTRE)
    for q in postures(made, 5):
        drawing.place(q)
        at, (R, p) = put(made, q), drawing.frame('scissor_probe')
        assert np.allclose(R, at.R, atol=1e-6) and np.allclose(p, at.p, atol=1e-6)
        told = {BASE: (base_axes(own.axis), CENTRE)}
        for parent, child, turn, shift in link_frames(own.linkage, q):      # as on /tf
            R, p = told[parent]
            told[child] = R @ turn, p + R @ shift
        for link in told.keys() - {BASE}:
            assert np.allclose(told[link][0], drawing.frame(link)[0], atol=1e-6)
            assert np.allclose(told[link][1], drawing.frame(link)[1], atol=1e-6)
        line = linkage_line(own, q)[1:-1]
        ends = {'left': line[-1], 'right': line[0]}
        for side, end in ends.items():
            R, p = drawing.frame(f'scissor_{side}_{links}')
            out = R @ [np.sin(own.linkage.beta), 0.0, np.cos(own.linkage.beta)]
            assert np.allclose(p + own.linkage.radius * out, end, atol=1e-6)
    drawing.close()


def test_the_picture_shows_the_linkage(holder):
    picture = holder.picture(160, 120)
    assert picture.shape == (120, 160, 3)
    background = np.all(picture == picture[0, 0], axis=2)
    assert 0.02 < 1.0 - background.mean() < 0.5
