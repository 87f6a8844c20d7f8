"""The truth solver against what is known in closed form."""
import numpy as np
import pytest

from arm_brachy.prove.generator import loads
from arm_brachy.prove.generator.grid import Grid
from arm_brachy.prove.generator.mesh import make_mesh
from arm_brachy.prove.generator.shape import Dome
from arm_brachy.prove.generator.solver import Model, uniform

E, NU = 10e3, 0.47
MU, KAPPA = E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))


def cauchy(F):
    """Stress of the law written down once more, by its derivative with respect to F (3, 3)."""
    def energy(F):
        J = np.linalg.det(F)
        return MU / 2 * (J**(-2 / 3) * (F * F).sum() - 3) + KAPPA / 2 * (J - 1)**2
    h = 1e-5
    P = np.array([[(energy(F + h * e) - energy(F - h * e)) / (2 * h)
                   for e in np.eye(9).reshape(3, 3, 3, 3)[i]] for i in range(3)])
    return P @ F.T / np.linalg.det(F)


@pytest.fixture(scope='module', params=['nodal', 'cell'])
def grid(request):
    dome = Dome((0.06, 0.055), 0.05, (0.004, 0.0), (0.02, 0.03, 0.0, 0.01, 0.0))
    return Grid(make_mesh(dome, (), levels=2), request.param)


def imbalance(grid, F):
    """Uniform strain F: nodal forces (n, 3) less those of its stress on the whole boundary, and
    which nodes belong to straight elements only.
    """
    model = Model(grid, (), uniform(grid, E, NU))
    J = np.linalg.det(F)
    f, g = model.residual(grid.nodes @ (F - np.eye(3)).T,
                          np.full(grid.pressures, KAPPA * (J - 1)))
    assert np.abs(g).max() < 1e-12
    nominal = J * cauchy(F) @ np.linalg.inv(F).T
    for faces in (grid.mesh.base, grid.mesh.surface):
        _, area, n = grid.face_points(faces)
        np.add.at(f, faces.ravel(),
                  -np.einsum('qa,fqi->fai', n, area @ nominal.T).reshape(-1, 3))
    curved = np.isin(grid.mesh.tets, grid.mesh.surface).any(1)
    return f, np.setdiff1d(grid.mesh.tets, grid.mesh.tets[curved])


STRAINS = {
    'shear': np.array([[1, 0.2, 0], [0, 1, 0], [0, 0, 1.0]]),
    'stretch': np.diag([1.1, 1.1, 1 / 1.2]),
    'mixed': np.array([[1.02, 0.1, 0], [0.05, 0.97, 0], [0, -0.1, 1.03]]),
}


@pytest.mark.parametrize('name', STRAINS)
def test_uniform_strain_is_in_equilibrium_with_its_stress(grid, name):
    """The patch test: exact where elements are straight, inside and on the base."""
    f, straight = imbalance(grid, STRAINS[name])
    assert len(straight) > 20
    assert np.abs(f[straight]).max() < 1e-6 * E * 0.01**2


def test_curved_elements_pass_the_patch_test_better_when_smaller():
    """Four points err on curved elements by a higher order than the forces on a face have (2)."""
    dome = Dome((0.06, 0.055), 0.05)
    worst = []
    for levels in (2, 3):
        grid = Grid(make_mesh(dome, (), levels=levels))
        worst.append(np.abs(imbalance(grid, STRAINS['mixed'])[0]).max())
    assert np.log2(worst[0] / worst[1]) > 3


def test_forces_of_the_base_carry_the_weight(grid):
    """Weight of the dome on its clamped base, and a dome that sags as the load says."""
    model = Model(grid, (), uniform(grid, E, NU),
                  loads=(loads.weight(grid, 1000.0, (0, 0, -9.81)),))
    state = model.newton(model.rest(), np.zeros(0))
    f, _ = model.residual(state.u, state.p)
    volume = grid.slopes[1].sum()
    np.testing.assert_allclose(f[grid.mesh.base_nodes].sum(0), [0, 0, 1000 * 9.81 * volume],
                               rtol=1e-5, atol=1e-5)
    assert state.u[:, 2].min() < -1e-4


def test_volume_of_the_dome_is_that_of_its_shape(grid):
    """A plain dome would have 2/3 pi a b h; the modes of the shape change it by some percent."""
    assert abs(grid.slopes[1].sum() / (2 / 3 * np.pi * 0.06 * 0.055 * 0.05) - 1) < 0.05
