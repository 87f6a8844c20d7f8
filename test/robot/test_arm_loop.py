"""The arm's loop, period by period: reference, stiffness, contact force, limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.arm_loop import (
    FORCE,
    MEASURED,
    NO_TRIP,
    POSE,
    TRIP,
    Machine,
    Memory,
    Rules,
    Task,
    Touch,
    packed,
    run_period,
    start_memory,
    unpacked,
)
from arm_brachy.robot.force_torque import ToolLoad
from arm_brachy.robot.impedance import Gains
from arm_brachy.robot.panda_holder import RISEN, tool_of
from arm_brachy.robot.panda_parameters import CARTESIAN_LIMITS
from arm_brachy.robot.probe_arm_params import PERIOD, ProbeArmParams
from arm_brachy.robot.reference import lead_limits, rotation, rotation_vector
from arm_brachy.robot.rigid_body import Arm
from arm_brachy.robot.simulation import ArmSimulation
from arm_brachy.robot.switched import SwitchedGains

PARAMS = ProbeArmParams()
GAINS, LEAD = PARAMS.impedance, PARAMS.reference
TOOL = tool_of(PARAMS)
ARM = Arm.panda().carrying(TOOL, [0.0, 0.0, PARAMS.tool_length])
START = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.785])
SPRING = 300.0   # N/m of soft tissue under a probe: 2 E a, 6 kPa, 25 mm
FREE, NOTHING = np.zeros((6, 6)), np.zeros(6)


def machine(posture):
    limits = panda.JOINT_LIMITS
    return Machine(ARM.dh, ARM.mass, ARM.centre, ARM.inertia, ARM.tip, ARM.gravity, limits.low,
                   limits.high, limits.velocity, limits.torque, limits.torque_rate, posture,
                   panda.FRICTION_LEVEL, panda.FRICTION_SLOPE, panda.FRICTION_SHIFT,
                   PARAMS.friction_known, TOOL.mass, TOOL.centre, PARAMS.tool_length)


def rules():
    """No limit trips: what the controller does by itself is looked at."""
    return Rules(PERIOD, PARAMS.touch, PARAMS.release, PARAMS.release_time, RISEN / PARAMS.rise,
                 np.inf, np.inf, np.zeros(3), np.inf, -np.inf, -np.inf, np.inf,
                 PARAMS.side_rate * PERIOD, False)


class Loop:
    """`run_period` with a sensor without errors; the joints stand still unless moved."""

    def __init__(self, posture=START):
        self.R, self.p = ARM.pose(START)
        self._packed = packed(start_memory(START, self.R, self.p, ARM.gravity_torque(START),
                                           ToolLoad(TOOL.mass, TOOL.centre, np.zeros(6))))
        self.memory = unpacked(Memory, self._packed)
        self.task = Task(POSE, self.R, self.p.copy(), np.zeros(3), np.zeros(3), 0.0,
                         PARAMS.approach_speed, 0.0, PARAMS.clearance)
        fixed = machine(np.asarray(posture)), rules(), Gains(**vars(GAINS)), SwitchedGains(
            **vars(PARAMS.switched))
        self._fixed = (*map(packed, fixed), *lead_limits(LEAD))

    def order(self, **changes):
        self.task = self.task._replace(**changes)

    def period(self, wrench=NOTHING):
        """Return what moves the joints; wrench : (6,) on the probe's face, which the sensor has.

        The tissue only pushes: a wrench that pulls the face is none.
        """
        R, p = ARM.pose(self.memory.q)
        moved = run_period(*self._fixed, packed(self.task), packed(Touch(R, p, wrench, FREE)),
                           self._packed, np.zeros(6), 0.0)
        assert self.memory.flags[TRIP] == NO_TRIP
        return moved


class Bench(Loop):
    """The loop with the arm in it, and a spring above a surface that may move."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.simulation = ArmSimulation(ARM, START, period=PERIOD)

    def run(self, seconds, *, surface=None, wrench=NOTHING):
        """Measured forces [N], joint states, torques; surface : time -> height [m]."""
        forces, states, torques = [], [], []
        memory = self.memory
        for k in range(round(seconds / PERIOD)):
            self.simulation.read_into(memory.q, memory.dq)
            pushed = wrench.copy()
            if surface is not None:
                pushed[2] += max(0.0, SPRING * (surface(k * PERIOD) - ARM.pose(memory.q)[1][2]))
            self.simulation.advance(self.period(pushed))
            forces.append(memory.values[MEASURED])
            states.append(np.concatenate([memory.q, memory.dq]))
            torques.append(memory.torque.copy())
        return np.array(forces), np.array(states), np.array(torques)

    def pose(self):
        return ARM.pose(self.simulation.state()[0])


@pytest.fixture
def benches():
    made = []

    def make(**settings):
        made.append(Bench(**settings))
        return made[-1]
    yield make
    for bench in made:
        bench.simulation.close()


@pytest.fixture
def bench(benches):
    return benches()


# The reference.

def led(loop, seconds):
    """Positions, velocities and angular velocities of the reference, joints standing still."""
    track = []
    for _ in range(round(seconds / PERIOD)):
        loop.period()
        track.append(np.concatenate([loop.memory.p, loop.memory.v, loop.memory.w]))
    return np.array(track)


@pytest.mark.parametrize('distance', [0.001, 0.02, 0.4])
def test_a_step_is_reached_without_overshoot_within_every_limit(distance):
    loop, way = Loop(), distance * np.array([1.0, -2.0, 2.0]) / 3.0
    loop.order(p=loop.p + way)
    track = led(loop, 1.5 + distance / LEAD.speed)
    assert np.allclose(loop.memory.p, loop.p + way, atol=1e-3 * distance)
    along = (track[:, :3] - loop.p) @ way / distance
    assert along.max() <= distance * (1 + 1e-6)
    speed = np.linalg.norm(track[:, 3:6], axis=1)
    acceleration = np.linalg.norm(np.diff(track[:, 3:6], axis=0), axis=1) / PERIOD
    jerk = np.linalg.norm(np.diff(track[:, 3:6], n=2, axis=0), axis=1) / PERIOD**2
    assert speed.max() <= LEAD.speed * 1.001
    assert acceleration.max() <= LEAD.acceleration * 1.001
    assert jerk.max() <= CARTESIAN_LIMITS.jerk


def test_it_turns_the_short_way_and_stops_at_the_goal():
    loop = Loop()
    turn = Rotation.from_rotvec([0.0, 0.0, 3.0]).as_matrix()
    loop.order(R=turn @ loop.R)
    track = led(loop, 6.0)
    assert np.allclose(loop.memory.R, turn @ loop.R, atol=1e-4)
    assert np.all(track[:, 8] >= -1e-9)
    assert np.linalg.norm(track[:, 6:], axis=1).max() <= LEAD.turning * 1.001


def test_a_goal_that_moves_is_followed_with_the_lag_of_the_first_rate():
    loop, speed = Loop(), 0.02
    for k in range(4000):
        loop.order(p=loop.p + [speed * k * PERIOD, 0.0, 0.0])
        loop.period()
    lag = speed * 3999 * PERIOD - (loop.memory.p - loop.p)[0]
    assert np.isclose(lag, speed / LEAD.rate, rtol=0.02)


# Impedance and force.

def test_it_holds_its_pose_and_yields_to_a_force_as_its_stiffness_says(bench):
    push = np.array([4.0, -6.0, 0.1, 0.0, 0.0, 0.0])
    bench.run(3.0, wrench=push)
    R, p = bench.pose()
    assert np.allclose(p - bench.p, push[:3] / GAINS.stiffness, atol=2e-4)
    assert np.linalg.norm(rotation_vector(R @ bench.R.T)) < 5e-3


def test_a_moment_turns_it_as_its_stiffness_says(bench):
    push = np.array([0.0, 0.0, 0.1, 0.4, 0.0, 0.0])
    bench.run(3.0, wrench=push)
    R, _ = bench.pose()
    assert np.allclose(rotation_vector(R @ bench.R.T), push[3:] / GAINS.turning_stiffness,
                       atol=5e-4)


def test_force_on_a_still_body_settles_and_on_a_breathing_one_stays_close(bench):
    """Goals: 0.01 N in steady state, 0.1 N RMS and 0.3 N at most while the surface breathes."""
    bench.order(mode=FORCE, goal=3.0)
    height = bench.p[2] + 0.001
    still, _, _ = bench.run(3.0, surface=lambda t: height)
    assert np.abs(still[-500:] - 3.0).max() < 0.01
    breathing, _, _ = bench.run(8.0, surface=lambda t: height + 3e-3 * np.sin(np.pi / 2 * t))
    error = breathing - 3.0
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.abs(error).max() < 0.3


def test_the_force_along_the_axis_leaves_the_pose_across_it_alone(bench):
    bench.order(mode=FORCE, goal=3.0)
    forces, _, _ = bench.run(3.0, surface=lambda t: bench.p[2])
    R, p = bench.pose()
    assert np.abs(forces[-500:] - 3.0).max() < 0.01
    assert np.allclose(p[:2], bench.p[:2], atol=3e-4)
    assert np.linalg.norm(rotation_vector(R @ bench.R.T)) < 5e-3


def test_it_turns_about_the_contact_point(bench):
    """The orientation strategy: the tip stays where it is while the probe tilts by 20 degrees."""
    bench.order(R=rotation(np.array([np.radians(20.0), 0.0, 0.0])) @ bench.R)
    bench.run(2.0)
    R, p = bench.pose()
    assert np.linalg.norm(rotation_vector(bench.task.R @ R.T)) < 5e-3
    assert np.linalg.norm(p - bench.p) < 5e-4


def test_torques_keep_their_size_and_rate_though_the_reference_jumps(bench):
    before = bench.memory.torque.copy()
    far = bench.p + [0.3, 0.4, 0.2]
    bench.order(p=far)
    bench.memory.p[:] = far
    _, _, torques = bench.run(0.5)
    limits = panda.JOINT_LIMITS
    assert np.all(np.abs(torques) <= limits.torque)
    change = np.abs(np.diff(torques, axis=0, prepend=before[None]))
    assert np.all(change <= limits.torque_rate * PERIOD * (1 + 1e-9))
    assert np.any(change >= limits.torque_rate * PERIOD * (1 - 1e-9))


def test_a_joint_limit_pushes_back(bench):
    """Asked to turn the probe further than joint 7 goes, the arm holds it before its limit."""
    bench.order(R=bench.R @ rotation(np.array([0.0, 0.0, np.radians(170.0)])))
    _, states, _ = bench.run(5.0)
    inside = panda.JOINT_LIMITS.high - states[:, :7]
    assert np.all(inside > 0.0) and np.all(states[:, :7] > panda.JOINT_LIMITS.low)
    assert inside[:, 6].min() < GAINS.margin


def test_the_null_space_moves_the_elbow_without_the_probe(benches):
    bench = benches(posture=START + [0.6, 0, -0.6, 0, 0.3, 0, 0])
    bench.run(3.0)
    q, _ = bench.simulation.state()
    assert np.abs(q - START).max() > 0.1
    assert np.linalg.norm(bench.pose()[1] - bench.p) < 1e-3
