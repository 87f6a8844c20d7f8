"""The spherical scissor linkage of appendix A as holder of the probe, simulated.

theta_0 and theta_1 turn the probe about the centre of the body; a spin about the radius and a
stage along it stand on the carrier. Its axis always goes through the centre, so it has four of
six degrees of freedom and the orientation strategy alone.
Assumed: joints are stiff against the load (geared, braked servos), spin and stage are rigid beside
the links, the sag under the links' and the tool's own weight is calibrated away. What is left is
the bending of the links under contact: where the probe is differs from what the encoders say by
compliance times wrench.
"""

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.robot import scissor_loop as loop
from arm_brachy.robot.force_torque import BiasTracker, ForceTorqueSensor, calibrate
from arm_brachy.robot.panda_holder import RISEN, tool_of
from arm_brachy.robot.probe_arm_params import PERIOD
from arm_brachy.robot.probe_holder import HolderState
from arm_brachy.robot.probe_planner import CentrePlanner
from arm_brachy.robot.scissor_bending import Bending
from arm_brachy.robot.scissor_drawing import ScissorDrawing
from arm_brachy.robot.scissor_place import base_axes
from arm_brachy.robot.scissor_rcm import clear_range, joint_angles

GRAVITY = np.array([0.0, 0.0, -9.81])       # m/s2, W
_REST = 500          # readings in each posture of the weighing
_POSTURES = ((0.5, -0.4, 0.0), (0.2, 0.0, 0.5), (0.8, 0.0, -0.5), (0.5, 0.4, 1.0), (0.6, 0.0, 0.0))
_NEAR = 2e-3         # m from the end of a retreat
_OFF = 1e-3          # m by which an axis may miss the centre
_INTEGRAL = 0.5      # N s, largest: acts as 1.5 N of error at the default rate of the integral
JOINT_NAMES = ('scissor_theta_0', 'scissor_theta_1', 'scissor_spin', 'scissor_stage')


class ScissorHolder:
    """Face: probe_holder.ProbeHolder. Starts at rest at home, the tool weighed.

    Test: robot/test_scissor_holder.py
    """

    joint_names = JOINT_NAMES

    def __init__(self, params, rng):
        """params : ProbeArmParams;  rng : numpy Generator, for the sensor

        Raises InputError if the home pose is out of reach.
        """
        self._params, self._own, self._tool = params, params.scissor_rcm, tool_of(params)
        self._centre = np.array(self._own.centre)
        self._R_WC = base_axes(self._own.axis)
        self._clear = clear_range(self._own.linkage)
        self._bending = Bending(self._own.linkage, self._own.density, self._clear)
        self._linkage, self._rules = self._machine(), self._bounds()
        self.planners = {'orientation': self._planner}
        self.home = self._home()
        q = self._joints(*self.home, None)
        self._refuse_beyond_travel(q)
        self._sensor = ForceTorqueSensor(params.sensor, self._tool, rng, PERIOD)
        load = self._weighed()
        self._tracker, self._periods = BiasTracker(load), 1
        self._memory = loop.start_memory(self._linkage, q, load)
        self._stiffness = np.zeros((6, 6))     # of a tissue that was never heard of
        self._compliance = np.zeros((6, 6))
        self._drawing = None

    def _planner(self, *args):
        return CentrePlanner(self._centre, *args)

    def _machine(self):
        own, tool, link = self._own, self._tool, self._own.linkage
        turning = [own.turning_speed] * 3, [own.turning_acceleration] * 3
        return loop.Linkage(
            link.radius, link.links, np.tan(link.beta),
            np.array([-own.swing, self._clear[0], -own.spin, link.radius - own.farthest]),
            np.array([own.swing, self._clear[1], own.spin, link.radius - own.nearest]),
            np.array([*turning[0], own.stage_speed]),
            np.array([*turning[1], own.stage_acceleration]), self._R_WC.T @ -self._centre,
            self._R_WC[2].copy(), self._R_WC.T @ GRAVITY, tool.mass, tool.centre,
            self._params.tool_length)

    def _bounds(self):
        own, params = self._own, self._params
        return loop.Rules(
            PERIOD, params.touch, params.release, params.release_time, RISEN / params.rise,
            params.impedance.tissue, params.force_most, params.speed_most, params.reach,
            params.floor, params.reference.rate, 2.0 * np.pi * own.bandwidth, own.force_gain,
            own.force_rate, _INTEGRAL)

    def _home(self):
        """(R, p) in W: over the home of the parameters, its axis through the centre."""
        out = np.array(self._params.home) - self._centre
        up = out / np.linalg.norm(out)
        turn = self._params.home_turn
        along = np.array([np.cos(turn), np.sin(turn), 0.0])
        y = along - up * (up @ along)
        y /= np.linalg.norm(y)
        return np.column_stack([np.cross(y, -up), y, -up]), np.array(self._params.home)

    def _weighed(self):
        """ToolLoad from means of readings at rest in a few postures, nothing touching."""
        rotations, readings = [], []
        for share, theta_0, spin in _POSTURES:
            q = np.array([theta_0, self._clear[0] + share * np.ptp(self._clear), spin, 0.0])
            R = loop.pose(self._linkage, q)[0]
            rotations.append(R)
            readings.append(np.mean([self._sensor.read(R, self._linkage.gravity, np.zeros(6))
                                     for _ in range(_REST)], axis=0))
        return calibrate(np.array(readings), np.array(rotations), self._linkage.gravity)

    def _joints(self, R, p, now):
        """q (4,) for a pose in W; InputError names why it cannot be taken.

        now : (4,) joints whose spin is to be near, or None
        """
        R, out = self._R_WC.T @ R, self._R_WC.T @ (p - self._centre)
        up = -R[:, 2]
        aside = np.linalg.norm(out - up * (up @ out))
        if aside > _OFF:
            raise InputError(f'scissor linkage: the axis of the probe misses the centre by '
                             f'{1e3 * aside:.1f} mm; must go through it, within {1e3 * _OFF:g} mm')
        theta_0, theta_1 = joint_angles(self._own.linkage, up)
        q = np.array([theta_0, theta_1, 0.0, self._own.linkage.radius - up @ out])
        _, polar, azimuth, _, _ = loop.triad(self._linkage, q)
        q[loop.SPIN] = np.arctan2(R[:, 1] @ azimuth, R[:, 1] @ polar)
        if now is not None:
            q[loop.SPIN] = _nearest(q[loop.SPIN], now[loop.SPIN], self._own.spin)
        return q

    def _refuse_beyond_travel(self, q):
        low, high = self._linkage.low, self._linkage.high
        for i, (name, why) in enumerate((
                ('theta_0', 'of its motor'), ('theta_1', 'where no links touch'),
                ('spin', 'of its motor'))):
            if not low[i] <= q[i] <= high[i]:
                raise InputError(f'scissor linkage: {name} = {np.degrees(q[i]):.1f} deg; must be '
                                 f'{np.degrees(low[i]):.1f} to {np.degrees(high[i]):.1f} deg, the '
                                 f'range {why}')
        i, radius = loop.ADVANCE, self._own.linkage.radius
        if not low[i] <= q[i] <= high[i]:
            raise InputError(f'scissor linkage: face {1e3 * (radius - q[i]):.0f} mm from the '
                             f'centre; must be {1e3 * (radius - high[i]):.0f} to '
                             f'{1e3 * (radius - low[i]):.0f} mm, the travel of the stage')

    def state(self):
        """See ProbeHolder."""
        memory = self._memory
        R, p = self._in_world(*loop.pose(self._linkage, memory.q))
        return HolderState(R, p, *self._in_world(memory.R, memory.p), memory.q.copy(),
                           memory.dq.copy(), self._torque(), memory.wrench.copy(),
                           bool(memory.flags[loop.IN_CONTACT]), int(memory.flags[loop.TRIP]),
                           float(memory.values[loop.GOAL]))

    def _in_world(self, R, p):
        return self._R_WC @ R, self._centre + self._R_WC @ p

    def _torque(self):
        """(4,) [N m, N m, N m, N] at rest under contact, the tool's weight and the links'."""
        memory, linkage, q = self._memory, self._linkage, self._memory.q
        R, p = loop.pose(linkage, q)
        load, weight = memory.true_wrench.copy(), self._tool.mass * linkage.gravity
        lever = R @ (self._tool.centre - [0.0, 0.0, self._params.tool_length])
        load += np.concatenate([weight, np.cross(lever, weight)])
        torque = -loop.probe_jacobian(linkage, q).T @ load
        torque[:2] += self._bending.weight_torque(q[0], q[1], linkage.gravity)
        return torque

    def run(self, errand, reading, periods):
        """See ProbeHolder."""
        memory, linkage = self._memory, self._linkage
        turn = self._R_WC.T
        q = self._joints(errand.R, errand.p, memory.q)
        dq = loop.joint_rates(linkage, q, turn @ errand.v, turn @ errand.w)
        task = loop.Task(int(errand.way), q, dq, float(errand.axial), float(errand.seek),
                         float(errand.force), self._params.clearance)
        touch = self._touch(reading)
        memory.reading[:] = 0.0
        self._periods = periods
        forces = np.empty(periods)
        loop.run_tick(linkage, self._rules, task, touch, memory, self._sensor.errors(periods),
                      forces)
        return forces

    def _touch(self, reading):
        memory = self._memory
        if reading is None:
            wrench = memory.true_wrench.copy()
        else:
            turn = np.kron(np.eye(2), self._R_WC)
            self._stiffness = turn.T @ np.asarray(reading.stiffness, dtype=float) @ turn
            wrench = turn.T @ np.asarray(reading.wrench, dtype=float)
        R, _ = loop.pose(self._linkage, memory.q)
        self._compliance = self._bending.at_face(memory.q[0], memory.q[1],
                                                 memory.q[loop.ADVANCE] * R[:, 2])
        bent = np.linalg.solve(np.eye(6) + self._compliance @ self._stiffness, self._compliance)
        return loop.Touch(memory.R.copy(), memory.p.copy(), wrench, self._stiffness, bent)

    def begin_retreat(self, away):
        """See ProbeHolder."""
        memory = self._memory
        memory.values[loop.RETREAT_TO] = max(memory.q[loop.ADVANCE] - away,
                                             self._linkage.low[loop.ADVANCE])
        self.clear_trip()

    def clear_trip(self):
        """See ProbeHolder."""
        self._memory.flags[loop.TRIP] = loop.NO_TRIP

    def retreated(self):
        """See ProbeHolder."""
        memory = self._memory
        return bool(abs(memory.q[loop.ADVANCE] - memory.values[loop.RETREAT_TO]) < _NEAR)

    def obstacle(self, R, p):
        """See ProbeHolder."""
        try:
            self._refuse_beyond_travel(self._joints(R, p, self._memory.q))
        except InputError as problem:
            return str(problem)
        return ''

    def weigh(self, hurry=1.0):
        """See ProbeHolder."""
        memory = self._memory
        felt = self._tracker.step(memory.reading / self._periods, memory.R, self._linkage.gravity,
                                  self._periods, hurry)
        memory.bias[:] = self._tracker.load.bias
        return felt

    def compliance(self):
        """Return C (6, 6) [m/N, rad/(N m)] at the face as the last tick had it, axes of W."""
        turn = np.kron(np.eye(2), self._R_WC)
        return turn @ self._compliance @ turn.T

    def picture(self, width, height, skin=None):
        """See ProbeHolder."""
        if self._drawing is None:
            self._drawing = ScissorDrawing(self._own, self._R_WC, self._centre)
        return self._drawing.picture(self._memory.q, width, height, skin)

    def close(self):
        """See ProbeHolder."""
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None


def _nearest(angle, before, most):
    """The angle of those a full turn apart that is nearest to the one before and within `most`."""
    choices = [a for a in angle + 2.0 * np.pi * np.arange(-1, 2) if abs(a) <= most] or [angle]
    return min(choices, key=lambda a: abs(a - before))
