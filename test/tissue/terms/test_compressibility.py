"""Compressibility against the moduli of confined, hydrostatic and uniaxial loading."""

import numpy as np
import pytest

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.compressibility import Compressibility

FACTOR, SIZE = 0.3, 0.04
MU, KAPPA = moduli(6e3, 0.49)


def block(nu=0.49, size=(SIZE, SIZE, SIZE), cells=(4, 4, 4), disc=0.012):
    """Block held below, a pad over the middle of its top, quadratic elements."""
    mesh = quadratic_mesh(box_mesh(size, cells))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    middle, top = np.array([size[0] / 2, size[1] / 2, size[2]]), mesh.node_sets['z1']
    under = top[np.linalg.norm(mesh.nodes[top] - middle, axis=1) < disc]
    pad = Pad('pad', under, np.array([0.0, 0.0, -1.0]), middle, 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def traction(stretches):
    """Mean normal stress [Pa] on the top of a block under uniform small strain (3,)."""
    body = Compressibility(FACTOR).prepare(block())
    X = body.mesh.nodes
    forces = Assembler(body).forces(X * (1.0 + np.array(stretches)))
    return forces[body.mesh.node_sets['z1'], 2].sum() / SIZE**2


def test_confined_compression():
    """No lateral strain: sigma = (kappa + 4 mu / 3) strain."""
    expected = -(FACTOR * KAPPA + 4.0 / 3.0 * MU) * 1e-6
    assert traction([0.0, 0.0, -1e-6]) == pytest.approx(expected, rel=1e-4)


def test_hydrostatic_compression():
    """sigma = 3 kappa strain."""
    assert traction([-1e-6] * 3) == pytest.approx(-3.0 * FACTOR * KAPPA * 1e-6, rel=1e-4)


def test_shear_does_not_see_it():
    plain = block()
    x = plain.mesh.nodes.copy()
    x[:, 0] += 0.3 * x[:, 2]
    energies = [Assembler(b).energy(x) for b in (plain, Compressibility(FACTOR).prepare(plain))]
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)


@pytest.mark.parametrize('nu', [0.0, 0.3, 0.49])
def test_free_bar_narrows_by_its_new_poisson_ratio(nu):
    """nu = (3 kappa - 2 mu) / (6 kappa + 2 mu), half way up where the ends are forgotten."""
    plain = block(nu, size=(0.02, 0.02, 0.08), cells=(2, 2, 8), disc=1.0)
    body = Compressibility(FACTOR).prepare(plain)
    x, X = TissueSimulator(body).step(1.0, [[0.0, 0.0, 1e-6]]).x, plain.mesh.nodes
    height = X[:, 2] == 0.04
    side = [x[height & (X[:, 0] == edge), 0].mean() for edge in (0.0, 0.02)]
    along = [x[X[:, 2] == z, 2].mean() for z in (0.03, 0.05)]
    lateral, axial = (side[1] - side[0]) / 0.02 - 1.0, (along[1] - along[0]) / 0.02 - 1.0
    mu, bulk = plain.mu[0], FACTOR * plain.kappa[0]
    expected = (3.0 * bulk - 2.0 * mu) / (6.0 * bulk + 2.0 * mu)
    assert -lateral / axial == pytest.approx(expected, rel=3e-3)
