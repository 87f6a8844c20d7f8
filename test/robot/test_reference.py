"""Rotations of the reference and their vectors; how it is led is in test_arm_loop."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.robot.reference import rotation, rotation_vector


@pytest.mark.parametrize('angle', [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-4])
def test_rotation_vectors_agree_with_scipy(angle):
    rng = np.random.default_rng(1)
    for _ in range(20):
        axis = rng.normal(size=3)
        vector = angle * axis / np.linalg.norm(axis)
        assert np.allclose(rotation(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
        assert np.allclose(rotation_vector(rotation(vector)), vector, atol=1e-8)


@pytest.mark.parametrize('axis', [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 2, -2]])
def test_half_a_turn_has_a_rotation_vector(axis):
    R = Rotation.from_rotvec(np.pi * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    found = rotation_vector(R)
    assert np.isclose(np.linalg.norm(found), np.pi)
    assert np.allclose(rotation(found), R, atol=1e-12)
