"""A made-up block for the tests that need no solution."""

import numpy as np
import pytest

from arm_brachy.experiments.gel_block.bodies import RAYS, Ray
from arm_brachy.experiments.gel_block.layout import MARKERS, TARGETS

SHARE = np.array((0.0, 1 / 3, 2 / 3, 1.0))


@pytest.fixture(scope='session')
def rays():
    """Name -> Ray: points follow both pads in part, forces are springs of 500 N/m."""
    out = {}
    for name, full in RAYS.items():
        q = np.outer(SHARE, full)
        u = np.zeros((4, len(MARKERS) + len(TARGETS), 3))
        u[:, :, 0], u[:, :, 1] = -0.3 * q[:, :1], -0.2 * q[:, 1:]
        force = np.zeros((4, 2, 3))
        force[:, 0, 0], force[:, 1, 1] = 500.0 * q[:, 0], 500.0 * q[:, 1]
        out[name] = Ray(np.array(full), SHARE, u, force)
    return out
