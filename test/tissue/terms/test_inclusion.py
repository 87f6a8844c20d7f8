"""Inclusion against the series bar, Eshelby's sphere and the exact volume of a sphere."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.free_dofs import FreeDofs
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import volumes
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.terms.inclusion import Inclusion, cell_centroids, volume_fraction


def body_on(mesh, E, nu, fixed=(), pads=()):
    """Homogeneous SoftBody."""
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.asarray(fixed, dtype=np.int64), pads)


@pytest.mark.parametrize('cells', [2, 4, 9])
def test_volume_of_the_sphere_does_not_depend_on_the_mesh(cells):
    mesh = box_mesh((0.06, 0.06, 0.06), (cells,) * 3)
    phi = volume_fraction(mesh, np.array([0.028, 0.031, 0.033]), 0.012)
    assert phi.min() >= 0.0 and phi.max() <= 1.0
    assert phi @ volumes(mesh) == pytest.approx(4.0 / 3.0 * np.pi * 0.012**3, rel=0.02)


def test_quadrature_integrates_linear_functions_exactly():
    points = cell_centroids(2)
    assert points.min() > 0.0
    np.testing.assert_allclose(points.sum(axis=1), 1.0)
    np.testing.assert_allclose(points.mean(axis=0), 0.25)


def test_series_bar():
    """A sphere so large that it is a half space: E_eff = L / (L1/E1 + L2/E2), nu = 0."""
    length, width, ratio, strain = 0.08, 0.02, 3.0, 1e-5
    mesh = box_mesh((width, width, length), (2, 2, 8))
    end = mesh.node_sets['z1']
    pad = Pad('end', end, np.array([0.0, 0.0, 1.0]), np.array([width / 2, width / 2, length]), 1.0)
    radius = 1e4
    half = Inclusion(centre=(width / 2, width / 2, length / 2 + radius), radius=radius,
                     ratio=ratio)
    body = half.prepare(body_on(mesh, 6e3, 0.0, mesh.node_sets['z0'], (pad,)))
    pull = StaticSolver(body).solve(mesh.nodes, [[0.0, 0.0, strain * length]])
    E_eff = 2.0 / (1.0 / 6e3 + 1.0 / (ratio * 6e3))
    assert -pull.pad_force[0, 2] == pytest.approx(E_eff * strain * width**2, rel=1e-4)


def shear_energy_gain(cells, nu, inclusion, size=0.06):
    """Relative gain in energy of a cube whose whole boundary undergoes pure shear."""
    mesh = box_mesh((size,) * 3, (cells,) * 3)
    plain = body_on(mesh, 6e3, nu)
    surface = np.unique(np.concatenate([mesh.node_sets[k] for k in mesh.node_sets]))
    u = np.zeros_like(mesh.nodes)
    u[:, 0], u[:, 1] = mesh.nodes[:, 1], mesh.nodes[:, 0]
    energies = []
    for body in (plain, inclusion.prepare(plain)):
        assembler = Assembler(body)
        K, dofs = assembler.tangent(mesh.nodes), FreeDofs(assembler, surface).dofs
        total = u.ravel().copy()
        total[dofs] = 0.0
        total[dofs] = spsolve(K[dofs][:, dofs].tocsc(), -(K @ total)[dofs])
        energies.append(0.5 * total @ (K @ total))
    return energies[1] / energies[0] - 1.0


@pytest.mark.parametrize('ratio', [0.2, 3.0])
def test_energy_in_shear_approaches_eshelby(ratio):
    """Dilute sphere, sheared matrix: dW/W = V_i/V (c-1) / (1 + b (c-1)).

    b = 2 (4 - 5 nu) / (15 (1 - nu)), the shear part of Eshelby's tensor of a sphere.
    """
    nu, radius, size = 0.3, 0.012, 0.06
    b = 2.0 * (4.0 - 5.0 * nu) / (15.0 * (1.0 - nu))
    share = 4.0 / 3.0 * np.pi * radius**3 / size**3
    exact = share * (ratio - 1.0) / (1.0 + b * (ratio - 1.0))
    lump = Inclusion(centre=(size / 2,) * 3, radius=radius, ratio=ratio)
    coarse, fine = (shear_energy_gain(cells, nu, lump) for cells in (6, 12))
    assert abs(fine - exact) < 0.75 * abs(coarse - exact)
    assert fine == pytest.approx(exact, rel=0.08)


def test_outside_the_sphere_nothing_changes():
    mesh = box_mesh((0.06, 0.06, 0.06), (6, 6, 6))
    body = body_on(mesh, 6e3, 0.45)
    lump = Inclusion(centre=(0.0, 0.0, 0.0), radius=0.01, ratio=5.0)
    far = np.linalg.norm(mesh.nodes[mesh.tets], axis=2).min(axis=1) > 0.03
    np.testing.assert_array_equal(lump.prepare(body).mu[far], body.mu[far])
