"""A picture of the scissor linkage over the body: its URDF in PyBullet's software renderer."""

import tempfile
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient
from scipy.spatial.transform import Rotation

from arm_brachy.robot.scissor_urdf import joint_positions, scissor_urdf
from arm_brachy.robot.simulation import camera_image, show_surface

_SKIN = (0.9, 0.72, 0.62, 1.0)
# The camera: from how far, from where.
_CAMERA, _YAW, _PITCH = 0.83, np.radians(100.0), np.radians(-28.0)
_LOOK = np.array([0.05, -0.05, 0.1])      # m from the centre, W


class ScissorDrawing:
    """The linkage in a physics server of its own, world frame W."""

    def __init__(self, own, R_WC, centre):
        """own : ScissorHolderParams;  R_WC (3, 3), centre (3,) : where the linkage stands"""
        self._linkage, self._centre = own.linkage, np.array(centre)
        self._bullet = BulletClient(connection_mode=pybullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'scissor.urdf'
            file.write_text(scissor_urdf(own, R_WC.T @ [0.0, 0.0, -1.0]), encoding='utf-8')
            self._body = self._bullet.loadURDF(
                str(file), basePosition=list(self._centre),
                baseOrientation=Rotation.from_matrix(R_WC).as_quat().tolist(), useFixedBase=True,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        self._joints = {self._bullet.getJointInfo(self._body, i)[1].decode(): i
                        for i in range(self._bullet.getNumJoints(self._body))}
        self._links = {self._bullet.getJointInfo(self._body, i)[12].decode(): i
                       for i in range(self._bullet.getNumJoints(self._body))}

    def place(self, q):
        """Put all joints where the linkage closes; q : (4,) as in `scissor_loop`"""
        for name, value in joint_positions(self._linkage, q).items():
            self._bullet.resetJointState(self._body, self._joints[name], value)

    def frame(self, link):
        """Return (R (3, 3), p (3,)) in W of a link of the URDF, as PyBullet has it."""
        p, turn = self._bullet.getLinkState(self._body, self._links[link],
                                            computeForwardKinematics=True)[4:6]
        return np.array(self._bullet.getMatrixFromQuaternion(turn)).reshape(3, 3), np.array(p)

    def picture(self, q, width, height, skin=None):
        """Return (height, width, 3) uint8; skin : (x (n, 3), triangles (k, 3)) in W, or None"""
        self.place(q)
        shown = None if skin is None else show_surface(self._bullet, *skin, _SKIN)
        out = camera_image(self._bullet, width, height, target=self._centre + _LOOK,
                           distance=_CAMERA, yaw=_YAW, pitch=_PITCH)
        if shown is not None:
            self._bullet.removeBody(shown)
        return out

    def close(self):
        """End the physics server."""
        self._bullet.disconnect()
