"""The simulated Panda as holder of the probe: arm in PyBullet, sensor, controller at 1 kHz."""

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.arm_drawing import arm_surfaces
from arm_brachy.robot.arm_loop import (
    GOAL,
    IN_CONTACT,
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
from arm_brachy.robot.force_torque import BiasTracker, ForceTorqueSensor, calibrate
from arm_brachy.robot.impedance import Gains
from arm_brachy.robot.inverse_kinematics import inverse_kinematics
from arm_brachy.robot.probe_arm_params import PERIOD
from arm_brachy.robot.probe_holder import HolderState
from arm_brachy.robot.probe_planner import PLANNERS
from arm_brachy.robot.reference import lead_limits, rotation
from arm_brachy.robot.rigid_body import Arm, Payload
from arm_brachy.robot.simulation import ArmSimulation
from arm_brachy.robot.switched import SwitchedGains

_READY = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.0])   # its ready posture, hand straight
_TILTS = np.radians([[0.0, 0.0], [25.0, 0.0], [-25.0, 0.0], [0.0, 25.0], [0.0, -25.0]])
_REST = 500                                              # readings in each of these
_NEAR = 2e-3                                             # m from the end of a retreat
RISEN = 4.74      # w t after which a critically damped step is at 95 % of its end
_TURNS = 60                                              # of the inverse kinematics in a tick


def tool_of(params):
    """Return the Payload of probe and mount: a cylinder's inertia about its centre of mass."""
    m, r, h = params.tool_mass, params.tool_radius, params.tool_length
    across = m * (3.0 * r**2 + h**2) / 12.0
    return Payload(m, np.array(params.tool_centre), np.diag([across, across, m * r**2 / 2.0]))


class PandaHolder:
    """Face: probe_holder.ProbeHolder. Starts at rest at home, the tool weighed."""

    joint_names = panda.JOINT_NAMES
    planners = PLANNERS

    def __init__(self, params, rng):
        """params : ProbeArmParams;  rng : numpy Generator, for the sensor

        Raises InputError if the home pose is out of reach.
        """
        self._params, self._tool = params, tool_of(params)
        self._arm = Arm.panda().carrying(self._tool, [0.0, 0.0, params.tool_length])
        self._R_WB = rotation(np.array([0.0, 0.0, params.base_turn]))
        self._p_WB = np.array(params.base)
        self.home = _home(params)
        self._q_home = inverse_kinematics(self._arm, *self._in_base(*self.home), _READY,
                                          margin=params.joint_margin)
        self._sensor = ForceTorqueSensor(params.sensor, self._tool, rng, PERIOD)
        load = self._weighed()
        self._tracker, self._periods = BiasTracker(load), 1
        self._stiffness = np.zeros((6, 6))     # of a tissue that was never heard of
        self._simulation = ArmSimulation(self._arm, self._q_home, period=PERIOD)
        R, p = self._arm.pose(self._q_home)
        self._packed = packed(start_memory(self._q_home, R, p,
                                           self._arm.gravity_torque(self._q_home), load))
        self._memory = unpacked(Memory, self._packed)
        fixed = *self._set_up(), Gains(**vars(params.impedance)), SwitchedGains(
            **vars(params.switched))
        self._fixed = (*map(packed, fixed), *lead_limits(params.reference))
        self._compile()

    def _compile(self):
        """Have the loop compiled now, by a period of a spare memory: no tick waits for that."""
        R, p = self._in_base(*self.home)
        task = Task(POSE, R, p, np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0, self._params.clearance)
        run_period(*self._fixed, packed(task), packed(self._touch(None)), self._packed.copy(),
                   np.zeros(6), 0.0)

    def _set_up(self):
        arm, params, limits = self._arm, self._params, panda.JOINT_LIMITS
        machine = Machine(
            arm.dh, arm.mass, arm.centre, arm.inertia, arm.tip, arm.gravity, limits.low,
            limits.high, limits.velocity, limits.torque, limits.torque_rate, self._q_home,
            panda.FRICTION_LEVEL, panda.FRICTION_SLOPE, panda.FRICTION_SHIFT,
            params.friction_known, self._tool.mass, self._tool.centre, params.tool_length)
        rules = Rules(
            PERIOD, params.touch, params.release, params.release_time, RISEN / params.rise,
            params.force_most, params.speed_most, self._R_WB.T @ -self._p_WB, params.reach,
            params.floor - self._p_WB[2], params.joint_margin, params.joint_share,
            params.side_rate * PERIOD, params.control == 'switched')
        return machine, rules

    def _weighed(self):
        """ToolLoad from means of readings at rest in a few orientations, nothing touching."""
        rotations, readings = [], []
        for tilt in _TILTS:
            q = self._q_home.copy()
            q[[4, 5]] += tilt
            R = self._arm.pose(q)[0]
            rotations.append(R)
            readings.append(np.mean([self._sensor.read(R, self._arm.gravity, np.zeros(6))
                                     for _ in range(_REST)], axis=0))
        return calibrate(np.array(readings), np.array(rotations), self._arm.gravity)

    def _in_base(self, R, p):
        return self._R_WB.T @ R, self._R_WB.T @ (p - self._p_WB)

    def _in_world(self, R, p):
        return self._R_WB @ R, self._p_WB + self._R_WB @ p

    def state(self):
        """See ProbeHolder."""
        memory = self._memory
        q, dq = self._simulation.state()
        R, p = self._in_world(*self._arm.pose(q))
        return HolderState(R, p, R.copy(), p.copy(), q, dq, memory.torque.copy(),
                           memory.wrench.copy(), bool(memory.flags[IN_CONTACT]),
                           int(memory.flags[TRIP]), float(memory.values[GOAL]))

    def run(self, errand, reading, periods):
        """See ProbeHolder."""
        memory, turn = self._memory, self._R_WB.T
        R, p = self._in_base(errand.R, errand.p)
        task = packed(Task(
            int(errand.way), R, p, turn @ errand.v, turn @ errand.w, float(errand.axial),
            float(errand.seek), float(errand.force), self._params.clearance))
        touch = packed(self._touch(reading))
        errors = self._sensor.errors(periods)
        memory.reading[:] = 0.0
        self._periods = periods
        forces = np.empty(periods)
        simulation, fixed = self._simulation, self._fixed
        for k in range(periods):
            simulation.read_into(memory.q, memory.dq)
            simulation.advance(run_period(*fixed, task, touch, self._packed, errors[k],
                                          k * PERIOD))
            forces[k] = memory.values[MEASURED]
        return forces

    def _touch(self, reading):
        R, p = self._arm.pose(self._simulation.state()[0])
        if reading is None:
            return Touch(R, p, self._memory.true_wrench.copy(), self._stiffness)
        turn = np.kron(np.eye(2), self._R_WB)
        self._stiffness = turn.T @ np.asarray(reading.stiffness, dtype=float) @ turn
        return Touch(R, p, turn.T @ np.asarray(reading.wrench, dtype=float), self._stiffness)

    def begin_retreat(self, away):
        """See ProbeHolder."""
        R, p = self._arm.pose(self._simulation.state()[0])
        self._memory.retreat[:] = p - away * R[:, 2]
        self.clear_trip()

    def clear_trip(self):
        """See ProbeHolder."""
        self._memory.flags[TRIP] = NO_TRIP

    def retreated(self):
        """See ProbeHolder."""
        p = self._arm.pose(self._simulation.state()[0])[1]
        return bool(np.linalg.norm(p - self._memory.retreat) < _NEAR)

    def obstacle(self, R, p):
        """See ProbeHolder."""
        q, _ = self._simulation.state()
        try:
            inverse_kinematics(self._arm, *self._in_base(R, p), q,
                               margin=self._params.joint_margin, turns=_TURNS)
        except InputError as problem:
            return str(problem)
        return ''

    def weigh(self, hurry=1.0):
        """See ProbeHolder."""
        R, _ = self._arm.pose(self._simulation.state()[0])
        felt = self._tracker.step(self._memory.reading / self._periods, R, self._arm.gravity,
                                  self._periods, hurry)
        self._memory.bias[:] = self._tracker.load.bias
        return felt

    def picture(self, width, height, skin=None):
        """See ProbeHolder."""
        surfaces = arm_surfaces(self._arm, self._simulation.state()[0])
        if skin is not None:
            x = (np.asarray(skin[0]) - self._p_WB) @ self._R_WB
            surfaces.append((x, skin[1], _SKIN))
        shown = [self._simulation.show(*surface) for surface in surfaces]
        target = self._R_WB.T @ (_LOOK_AT - self._p_WB)
        out = self._simulation.picture(width, height, target=target, distance=_CAMERA,
                                       yaw=_YAW, pitch=_PITCH)
        for body in shown:
            self._simulation.hide(body)
        return out

    def close(self):
        """See ProbeHolder."""
        self._simulation.close()


def _home(params):
    """(R, p) in W: the probe looks down, its picture across the needle."""
    c, s = np.cos(params.home_turn), np.sin(params.home_turn)
    y, z = np.array([c, s, 0.0]), np.array([0.0, 0.0, -1.0])
    return np.column_stack([np.cross(y, z), y, z]), np.array(params.home)


# The camera of `picture`: at what it looks, from how far, from where.
_LOOK_AT = np.array([0.1, -0.1, 0.2])      # m, W
_CAMERA, _YAW, _PITCH = 1.4, np.radians(50.0), np.radians(-20.0)
_SKIN = (0.9, 0.72, 0.62, 1.0)
