"""The Panda's dynamics: our recursion, PyBullet's and what must hold for any arm."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.friction import joint_friction
from arm_brachy.robot.rigid_body import Arm, Payload
from arm_brachy.robot.simulation import ArmSimulation
from arm_brachy.robot.urdf import panda_urdf

STEP = 1e-6
PROBE = Payload(0.45, np.array([0.0, 0.01, 0.06]), np.diag([8e-4, 7e-4, 3e-4]))
TIP = np.array([0.0, 0.0, 0.18])
BENT = np.array([0.3, -0.4, 0.2, -1.8, 0.1, 1.7, 0.5])


def random_states(n, seed=3):
    rng = np.random.default_rng(seed)
    low, high = panda.JOINT_LIMITS.low, panda.JOINT_LIMITS.high
    for _ in range(n):
        yield (low + (high - low) * rng.uniform(size=7), rng.normal(size=7),
               2.0 * rng.normal(size=7))


@pytest.fixture(scope='module', params=['bare', 'with probe'])
def arm(request):
    bare = Arm.panda()
    return bare if request.param == 'bare' else bare.carrying(PROBE, TIP)


@pytest.fixture
def simulated(arm):
    made = []

    def at(q, **options):
        made.append(ArmSimulation(arm, q, **options))
        return made[-1]

    yield at
    for simulation in made:
        simulation.close()


def test_the_straight_arm_stands_where_the_data_sheet_says():
    """At q = 0 joints 1, 3 and 5 are in line: d1 + d3 + d5 less the flange high, 88 mm out."""
    R, p = Arm.panda().pose(np.zeros(7))
    assert np.allclose(p, [0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.107], atol=1e-12)
    assert np.allclose(R, np.diag([1.0, -1.0, -1.0]), atol=1e-12)


def test_mass_matrix_and_torques_agree_with_pybullet(arm, simulated):
    simulation = simulated(np.zeros(7))
    for q, dq, ddq in random_states(25):
        assert np.allclose(arm.mass_matrix(q), simulation.mass_matrix(q), atol=2e-6)
        assert np.allclose(arm.torque(q, dq, ddq), simulation.torque(q, dq, ddq), atol=5e-5)


def test_mass_velocity_and_gravity_terms_add_up_to_the_torque(arm):
    for q, dq, ddq in random_states(10):
        parts = arm.mass_matrix(q) @ ddq + arm.coriolis_torque(q, dq) + arm.gravity_torque(q)
        assert np.allclose(arm.torque(q, dq, ddq), parts, atol=1e-9)


def potential(arm, q):
    """Potential energy [J]: each link's centre of mass as the tip of a shorter arm."""
    energy = 0.0
    for i in range(7):
        upto = Arm(arm.dh[:i + 1], arm.mass[:i + 1], arm.centre[:i + 1], arm.inertia[:i + 1],
                   arm.centre[i], arm.gravity)
        energy -= arm.mass[i] * arm.gravity @ upto.pose(q[:i + 1])[1]
    return energy


def test_gravity_torque_is_the_gradient_of_potential_energy(arm):
    for q, _, _ in random_states(5):
        gradient = [(potential(arm, q + d) - potential(arm, q - d)) / (2 * STEP)
                    for d in STEP * np.eye(7)]
        assert np.allclose(arm.gravity_torque(q), gradient, atol=1e-6)


def test_power_of_the_velocity_terms_is_that_of_the_changing_mass(arm):
    """dM/dt - 2 C is skew: dq . C dq = 1/2 dq . (dM/dt) dq."""
    for q, dq, _ in random_states(5):
        change = (arm.mass_matrix(q + STEP * dq) - arm.mass_matrix(q - STEP * dq)) / (2 * STEP)
        assert np.isclose(dq @ arm.coriolis_torque(q, dq), 0.5 * dq @ change @ dq, atol=1e-7)


def test_jacobian_is_the_derivative_of_the_pose(arm):
    for q, _, _ in random_states(5):
        R, _ = arm.pose(q)
        numeric = np.empty((6, 7))
        for i, d in enumerate(STEP * np.eye(7)):
            (R_plus, p_plus), (R_minus, p_minus) = arm.pose(q + d), arm.pose(q - d)
            numeric[:3, i] = (p_plus - p_minus) / (2 * STEP)
            numeric[3:, i] = (Rotation.from_matrix(R_plus @ R.T).as_rotvec()
                              - Rotation.from_matrix(R_minus @ R.T).as_rotvec()) / (2 * STEP)
        assert np.allclose(arm.jacobian(q), numeric, atol=1e-8)


def test_the_simulated_tip_is_where_kinematics_say(arm, simulated):
    for q, _, _ in random_states(3):
        R, p = simulated(q).tip()
        assert np.allclose(p, arm.pose(q)[1], atol=1e-6)
        assert np.allclose(R, arm.pose(q)[0], atol=1e-6)


def test_an_arm_held_by_its_gravity_torque_stays(arm, simulated):
    held = simulated(BENT, friction=False)
    for _ in range(500):
        held.step(arm.gravity_torque(held.state()[0]))
    assert np.allclose(held.state()[0], BENT, atol=1e-5)


def test_a_wrench_at_the_tip_is_held_by_its_transposed_jacobian(arm, simulated):
    wrench = np.array([1.0, -2.0, 5.0, 0.1, 0.2, -0.3])
    held = simulated(BENT, friction=False)
    for _ in range(200):
        q, _ = held.state()
        held.step(arm.gravity_torque(q) - arm.jacobian(q).T @ wrench, wrench)
    assert np.allclose(held.state()[0], BENT, atol=1e-5)


def test_a_swinging_arm_keeps_its_energy_without_friction_and_loses_it_with(arm, simulated):
    def energy(simulation):
        q, dq = simulation.state()
        return potential(arm, q) + 0.5 * dq @ arm.mass_matrix(q) @ dq

    for friction in (False, True):
        swinging = simulated(BENT, friction=friction, period=1e-4)
        before = energy(swinging)
        for _ in range(2000):
            swinging.step(0.9 * arm.gravity_torque(BENT))
        q, dq = swinging.state()
        work = 0.9 * arm.gravity_torque(BENT) @ (q - BENT)
        kinetic = 0.5 * dq @ arm.mass_matrix(q) @ dq
        lost = before + work - energy(swinging)
        assert kinetic > 0.01
        assert (abs(lost) < 0.02 * kinetic) if not friction else (lost > 0.1 * kinetic)


def test_friction_opposes_motion_and_saturates():
    speeds = np.linspace(-2.0, 2.0, 401)[:, None] * np.ones(7)
    torque = joint_friction(speeds)
    assert np.all(torque * speeds >= 0.0)
    assert np.allclose(joint_friction(np.zeros(7)), 0.0, atol=1e-15)
    span = torque[-1] - torque[0]
    assert np.all((span > 0.98 * panda.FRICTION_LEVEL) & (span < panda.FRICTION_LEVEL))


def test_the_urdf_names_every_joint_and_weighs_what_the_arm_does(arm):
    robot = ElementTree.fromstring(panda_urdf(arm, panda.JOINT_NAMES))
    assert [j.get('name') for j in robot.iter('joint')][:7] == list(panda.JOINT_NAMES)
    weights = [float(m.get('value')) for m in robot.iter('mass')]
    assert np.isclose(sum(weights[1:]), arm.mass.sum())


def test_a_payload_adds_its_own_kinetic_energy():
    bare, loaded = Arm.panda(), Arm.panda().carrying(PROBE, TIP)
    at_centre = Arm(bare.dh, bare.mass, bare.centre, bare.inertia,
                    np.array([0.0, 0.0, panda.FLANGE]) + PROBE.centre, bare.gravity)
    for q, dq, _ in random_states(5):
        v, w = np.split(at_centre.jacobian(q) @ dq, 2)
        R, _ = at_centre.pose(q)
        kinetic = 0.5 * PROBE.mass * v @ v + 0.5 * w @ R @ PROBE.inertia @ R.T @ w
        assert np.isclose(0.5 * dq @ (loaded.mass_matrix(q) - bare.mass_matrix(q)) @ dq, kinetic)
