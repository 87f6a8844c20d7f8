"""The arm that plays the Panda: PyBullet integrates it, torques and contact forces move it."""

import tempfile
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.friction import joint_friction
from arm_brachy.robot.urdf import panda_urdf

TIP_LINK = panda.JOINTS      # PyBullet's number of the fixed link that carries the end effector


class ArmSimulation:
    """One Panda in a physics server of its own, base frame = world of the server.

    Joints have the published friction and nothing else that damps. Not for joints at rest on
    friction alone: the published model has none at zero velocity.
    """

    def __init__(self, arm, q, *, period=1e-3, friction=True):
        """Start at rest.

        arm : rigid_body.Arm, its gravity acts;  q : (7,) [rad];  period : [s] of one step
        friction : False leaves an ideal arm, for checks
        """
        self._arm, self._friction = arm, friction
        self._bullet = BulletClient(connection_mode=pybullet.DIRECT)
        self._bullet.setGravity(*arm.gravity)
        self._bullet.setTimeStep(period)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'panda.urdf'
            file.write_text(panda_urdf(arm, panda.JOINT_NAMES), encoding='utf-8')
            # Without the flag PyBullet computes inertias of its own from collision shapes.
            self._body = self._bullet.loadURDF(str(file), useFixedBase=True,
                                               flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        self._joints = list(range(panda.JOINTS))
        self._free(q)
        # Looked up once: the client makes a new function object at each access.
        self._read = self._bullet.getJointStates
        self._drive = self._bullet.setJointMotorControlArray
        self._advance = self._bullet.stepSimulation

    def _free(self, q):
        """No damping, no velocity motors, which PyBullet has by default; joints at q."""
        for link in range(-1, self._bullet.getNumJoints(self._body)):
            self._bullet.changeDynamics(self._body, link, linearDamping=0.0, angularDamping=0.0,
                                        jointDamping=0.0)
        for joint, angle in zip(self._joints, q, strict=True):
            self._bullet.resetJointState(self._body, joint, angle)
        self._bullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.VELOCITY_CONTROL, forces=[0.0] * panda.JOINTS)

    def read_into(self, q, dq):
        """Write joint angles and velocities into q, dq (7,): `state` without new arrays."""
        joints = self._read(self._body, self._joints)
        q[:] = [j[0] for j in joints]
        dq[:] = [j[1] for j in joints]

    def advance(self, forces):
        """Advance by one period with what moves each joint (7,) [N m], friction included."""
        # A list is taken over faster than an array.
        self._drive(self._body, self._joints, pybullet.TORQUE_CONTROL, forces=forces.tolist())
        self._advance()

    def state(self):
        """Return (q (7,) [rad], dq (7,) [rad/s])."""
        joints = np.array([j[:2] for j in self._read(self._body, self._joints)])
        return joints[:, 0].copy(), joints[:, 1].copy()

    def step(self, torque, wrench=None):
        """Advance by one period.

        torque : (7,) [N m] of the motors
        wrench : (6,) [N, N m] on the end effector at its tip, base frame; None = 0
        """
        q, dq = self.state()
        applied = np.array(torque, dtype=float)
        if self._friction:
            applied -= joint_friction(dq)
        if wrench is not None:
            applied += self._arm.jacobian(q).T @ wrench
        self.advance(applied)

    def mass_matrix(self, q):
        """M (7, 7) [kg m2] as PyBullet has it."""
        return np.array(self._bullet.calculateMassMatrix(self._body, list(q)))

    def torque(self, q, dq, ddq):
        """Joint torques (7,) [N m] for ddq without friction, as PyBullet has them."""
        return np.array(self._bullet.calculateInverseDynamics(
            self._body, list(q), list(dq), list(ddq)))

    def tip(self):
        """Return (R (3, 3), p (3,) [m]) of the end effector as PyBullet has it."""
        _, _, _, _, p, orientation = self._bullet.getLinkState(
            self._body, TIP_LINK, computeForwardKinematics=True)[:6]
        R = np.array(self._bullet.getMatrixFromQuaternion(orientation)).reshape(3, 3)
        return R, np.array(p)

    def show(self, x, triangles, colour):
        """Draw a surface from now on; it has no weight and touches nothing.

        x : (n, 3) [m], base frame;  triangles : (k, 3), outward;  colour : (4,) red to opacity
        """
        return show_surface(self._bullet, x, triangles, colour)

    def hide(self, shown):
        """Draw what `show` returned no longer."""
        self._bullet.removeBody(shown)

    def picture(self, width, height, *, target, distance, yaw, pitch):
        """Return (height, width, 3) uint8, the arm as PyBullet's software renderer draws it.

        target : (3,) [m] looked at;  distance : [m];  yaw, pitch : [rad] of the camera
        """
        return camera_image(self._bullet, width, height, target=target, distance=distance,
                            yaw=yaw, pitch=pitch)

    def close(self):
        """End the physics server."""
        self._bullet.disconnect()


def show_surface(bullet, x, triangles, colour):
    """Draw a surface in a physics server; see `ArmSimulation.show`."""
    shape = bullet.createVisualShape(
        pybullet.GEOM_MESH, vertices=np.asarray(x).tolist(),
        indices=np.ravel(triangles).tolist(), rgbaColor=list(colour))
    return bullet.createMultiBody(baseMass=0.0, baseVisualShapeIndex=shape)


def camera_image(bullet, width, height, *, target, distance, yaw, pitch):
    """Return (height, width, 3) uint8 of a physics server; see `ArmSimulation.picture`."""
    view = bullet.computeViewMatrixFromYawPitchRoll(
        list(target), distance, np.degrees(yaw), np.degrees(pitch), 0.0, 2)
    lens = bullet.computeProjectionMatrixFOV(40.0, width / height, 0.05, 10.0)
    _, _, pixels, _, _ = bullet.getCameraImage(
        width, height, view, lens, renderer=pybullet.ER_TINY_RENDERER)
    return np.reshape(pixels, (height, width, 4))[:, :, :3].astype(np.uint8)
