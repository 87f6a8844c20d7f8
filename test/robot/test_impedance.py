"""The probe's controller on the simulated Panda: stiffness, contact force, limits."""

import numpy as np
import pytest

from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.friction import joint_friction
from arm_brachy.robot.impedance import Command, ImpedanceController, ImpedanceParams
from arm_brachy.robot.reference import rotation, rotation_vector
from arm_brachy.robot.rigid_body import Arm, Payload
from arm_brachy.robot.simulation import ArmSimulation

DT = 1e-3
PROBE = Payload(0.45, np.array([0.0, 0.01, 0.06]), np.diag([8e-4, 7e-4, 3e-4]))
ARM = Arm.panda().carrying(PROBE, [0.0, 0.0, 0.18])
START = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.785])
PARAMS = ImpedanceParams()
KNOWN = 0.8      # share of the joints' friction that the controller knows of
SPRING = 300.0   # N/m of soft tissue under a probe: 2 E a, 6 kPa, 25 mm


class Bench:
    """Arm, controller, and a spring above a surface that may move."""

    def __init__(self):
        self.simulation = ArmSimulation(ARM, START)
        self.controller = ImpedanceController(ARM, PARAMS, START)
        self.R, self.p = ARM.pose(START)
        self.command = Command(self.R, self.p.copy(), np.zeros(3), np.zeros(3))
        self.torques = [ARM.gravity_torque(START)]

    def run(self, seconds, *, surface=None, wrench=None):
        """Forces on the probe [N] and joint states; surface : function of time -> height [m]."""
        forces, states = [], []
        for k in range(round(seconds / DT)):
            q, dq = self.simulation.state()
            p = ARM.pose(q)[1]
            force = 0.0 if surface is None else max(0.0, SPRING * (surface(k * DT) - p[2]))
            torque = self.controller.step(q, dq, force, self.command)
            self.torques.append(torque)
            pushed = np.zeros(6) if wrench is None else wrench.copy()
            pushed[2] += force
            self.simulation.step(torque + KNOWN * joint_friction(dq), pushed)
            forces.append(force)
            states.append(np.concatenate([q, dq]))
        return np.array(forces), np.array(states)


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.simulation.close()


def test_it_holds_its_pose_and_yields_to_a_force_as_its_stiffness_says(bench):
    push = np.array([4.0, -6.0, 0.0, 0.0, 0.0, 0.0])
    bench.run(3.0, wrench=push)
    R, p = ARM.pose(bench.simulation.state()[0])
    assert np.allclose(p - bench.p, push[:3] / PARAMS.stiffness, atol=2e-4)
    assert np.linalg.norm(rotation_vector(R @ bench.R.T)) < 5e-3


def test_a_moment_turns_it_as_its_stiffness_says(bench):
    push = np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0])
    bench.run(3.0, wrench=push)
    R, _ = ARM.pose(bench.simulation.state()[0])
    assert np.allclose(rotation_vector(R @ bench.R.T), push[3:] / PARAMS.turning_stiffness,
                       atol=5e-4)


def test_force_on_a_still_body_settles_and_on_a_breathing_one_stays_close(bench):
    """Goals: 0.01 N in steady state, 0.1 N RMS and 0.3 N at most while the surface breathes."""
    bench.command.force, bench.command.in_contact = 3.0, True
    height = bench.p[2] + 0.001
    still, _ = bench.run(3.0, surface=lambda t: height)
    assert np.abs(still[-500:] - 3.0).max() < 0.01
    breathing, _ = bench.run(8.0, surface=lambda t: height + 3e-3 * np.sin(np.pi / 2 * t))
    error = breathing - 3.0
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.abs(error).max() < 0.3


def test_the_force_along_the_axis_leaves_the_pose_across_it_alone(bench):
    bench.command.force, bench.command.in_contact = 3.0, True
    bench.run(3.0, surface=lambda t: bench.p[2])
    R, p = ARM.pose(bench.simulation.state()[0])
    assert np.allclose(p[:2], bench.p[:2], atol=3e-4)
    assert np.linalg.norm(rotation_vector(R @ bench.R.T)) < 5e-3


def test_it_turns_about_the_contact_point(bench):
    """The orientation strategy: the tip stays where it is while the probe tilts by 20 degrees."""
    bench.command.R = rotation(np.array([np.radians(20.0), 0.0, 0.0])) @ bench.R
    bench.run(2.0)
    R, p = ARM.pose(bench.simulation.state()[0])
    assert np.linalg.norm(rotation_vector(bench.command.R @ R.T)) < 5e-3
    assert np.linalg.norm(p - bench.p) < 5e-4


def test_torques_keep_their_size_and_rate_whatever_is_commanded(bench):
    bench.command.p = bench.p + [0.3, 0.4, 0.2]      # as a lost planner might say
    bench.run(0.5)
    torques = np.array(bench.torques)
    limits = panda.JOINT_LIMITS
    assert np.all(np.abs(torques) <= limits.torque)
    assert np.all(np.abs(np.diff(torques, axis=0)) <= limits.torque_rate * DT * (1 + 1e-9))


def test_joint_limits_push_back(bench):
    """Pulled towards a pose beyond joint 4's range, no joint passes its limit."""
    bench.command.p = bench.p + [0.5, 0.0, 0.5]
    _, states = bench.run(3.0)
    limits = panda.JOINT_LIMITS
    assert np.all(states[:, :7] > limits.low) and np.all(states[:, :7] < limits.high)


def test_the_null_space_moves_the_elbow_without_the_probe(bench):
    bench.controller = ImpedanceController(ARM, PARAMS, START + [0.6, 0, -0.6, 0, 0.3, 0, 0])
    bench.run(3.0)
    q, _ = bench.simulation.state()
    assert np.abs(q - START).max() > 0.1
    assert np.linalg.norm(ARM.pose(q)[1] - bench.p) < 1e-3
