"""The stiffness of tissue, supports and skin is the derivative of their forces."""
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator import loads
from arm_brachy.prove.generator.grid import Grid
from arm_brachy.prove.generator.layer import make_layer
from arm_brachy.prove.generator.mesh import make_mesh
from arm_brachy.prove.generator.shape import Dome
from arm_brachy.prove.generator.solver import Model, uniform
from arm_brachy.prove.generator.sparse import times


@pytest.fixture(scope='module', params=['nodal', 'cell'])
def model(request):
    dome = Dome((0.06, 0.055), 0.05, (0.004, 0.0), (0.02, 0.03, 0.0, 0.01, 0.0))
    grid = Grid(make_mesh(dome, (), levels=2), request.param)
    return Model(grid, (), uniform(grid, 10e3, 0.47))


def rich(tissue):
    """Tissue with every term of the law, and swollen."""
    one = np.ones_like(tissue.mu)
    return replace(tissue, stiffening=3e3 * one, cubic=4e3 * one, fibre_modulus=2e3 * one,
                   fibre=np.multiply.outer(one, [0.6, 0.0, 0.8]), swelling=1.02 * one)


@pytest.mark.parametrize('load', ['none', 'springs', 'loose', 'skin', 'wall'])
def test_stiffness_is_the_derivative_of_the_forces(model, load):
    grid = model.grid
    made = {'none': lambda: (), 'springs': lambda: (loads.springs(grid, 1e6, 4e5),),
            'loose': lambda: (loads.loose_base(grid, lambda x, area: (x**2).sum(-1) < 9e-4, 1e7),),
            'skin': lambda: (make_layer(grid, 2e-3, 4e3),),
            'wall': lambda: (loads.wall(grid, (0, 0, 0.05), 0.02, np.array([0, 0, 1.0]), -2e-3,
                                        1e6, bend=20.0),)}[load]()
    full = replace(model, tissue=rich(model.tissue), loads=made)
    rng = np.random.default_rng(3)
    u = 2e-4 * rng.normal(size=grid.nodes.shape)
    p = 100 * rng.normal(size=grid.pressures)
    x = np.r_[1e-4 * rng.normal(size=u.size), 50 * rng.normal(size=len(p))]

    def residual(h):
        f, g = full.residual(u + h * x[:u.size].reshape(-1, 3), p + h * x[u.size:])
        return np.r_[f.ravel(), g]

    h = 1e-4
    derivative = (residual(h) - residual(-h)) / (2 * h)
    product = times(grid.pattern.matrix(full.matrix(u, p)), x)
    for part in (slice(0, u.size), slice(u.size, None)):
        scale = np.abs(product[part]).max()
        np.testing.assert_allclose(product[part], derivative[part], rtol=0, atol=2e-5 * scale)


def test_layer_has_the_volume_of_its_thickness_times_the_surface(model):
    grid = model.grid
    _, area, _ = grid.face_points(grid.mesh.surface)
    surface = np.linalg.norm(area, axis=2).sum()
    thickness = 1e-3
    layer = make_layer(grid, thickness, 1.0)
    # A shell of a dome of radius 55 mm is smaller by about its thickness over that.
    assert abs(layer.volume.sum() / (thickness * surface) - 1) < 0.04
