"""ADMM against Newton, its local step against a general optimiser, its time step against (3.2)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize, root

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.scene import load_scene
from arm_brachy.tissue import proximal
from arm_brachy.tissue.admm import AdmmOptions, AdmmSolver
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.material import energy, moduli
from arm_brachy.tissue.newton import StaticSolver

SIDE = 0.06  # m
SCENE = Path(__file__).resolve().parents[2] / 'config' / 'scenes' / 'breast.yaml'


def block(divisions=4, nu=0.45, **changes):
    """A cube of tissue on a plate, pushed sideways by a pad on the upper half of one wall."""
    mesh = box_mesh((SIDE,) * 3, (divisions,) * 3)
    mu, kappa = moduli(6e3, nu)
    m = len(mesh.tets)
    wall = mesh.node_sets['x0']
    under = wall[(mesh.nodes[wall, 2] > 0.5 * SIDE) & (mesh.nodes[wall, 1] > 0.2 * SIDE)]
    pad = Pad('pad', under, np.array([1.0, 0.0, 0.0]), mesh.nodes[under].mean(axis=0), 0.03)
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'], (pad,))
    return replace(body, **changes)


def push(millimetres):
    return np.array([[millimetres * 1e-3, 0.0, 0.0]])


@pytest.fixture(scope='module')
def body():
    return block()  # 384 tetrahedra


TIGHT = AdmmOptions(tolerance=1e-6, max_iterations=4000)


def test_equals_newton(body):
    assert 300 < len(body.mesh.tets) < 600
    newton = StaticSolver(body).solve(body.mesh.nodes, push(4.0))
    result = AdmmSolver(body, TIGHT).solve(body.mesh.nodes, push(4.0), reference=newton.x)
    assert newton.outcome is result.outcome is Outcome.OK
    assert np.abs(result.x - newton.x).max() < 1e-6
    largest = np.abs(newton.pad_force).max()
    assert result.pad_force == pytest.approx(newton.pad_force, abs=1e-4 * largest)
    assert result.errors[-1] < 1e-3 * result.errors[0]


def test_default_tolerance_leaves_less_than_10_um(body):
    newton = StaticSolver(body).solve(body.mesh.nodes, push(10.0))
    result = AdmmSolver(body).solve(body.mesh.nodes, push(10.0), reference=newton.x)
    assert result.outcome is Outcome.OK
    assert result.errors[-1] < 1e-5


def test_equals_newton_with_every_kind_of_load(body):
    """Gravity, dead load, a carried mass, oblique ground springs, varied moduli, added stress."""
    rng = np.random.default_rng(3)
    skew = rng.normal(size=(len(body.fixed), 3, 3))
    springs = Springs(body.fixed, 20.0 * np.eye(3) + 2.0 * skew @ np.swapaxes(skew, 1, 2))
    mass = np.zeros(len(body.mesh.nodes))
    mass[-1] = 0.005
    loaded = replace(body, fixed=np.zeros(0, dtype=int), springs=springs, nodal_mass=mass,
                     gravity=np.array([0.0, 0.0, -9.81]))
    fields = StepFields.of(loaded)
    fields.mu *= rng.uniform(0.7, 1.3, len(fields.mu))
    added = rng.normal(size=fields.stress.shape)
    fields.stress[:] = 40.0 * (added + np.swapaxes(added, 1, 2))
    fields.nodal_force[-3, 1] = 0.05
    newton = StaticSolver(loaded).solve(loaded.mesh.nodes, push(3.0), fields)
    result = AdmmSolver(loaded, TIGHT).solve(loaded.mesh.nodes, push(3.0), fields)
    assert newton.outcome is result.outcome is Outcome.OK
    assert np.abs(result.x - newton.x).max() < 2e-6


def test_equilibrium_stays_put(body):
    at_rest = AdmmSolver(body).solve(body.mesh.nodes, push(0.0))
    assert at_rest.iterations == 0 and at_rest.outcome is Outcome.OK
    newton = StaticSolver(body).solve(body.mesh.nodes, push(6.0))
    again = AdmmSolver(body).solve(newton.x, push(6.0))
    assert again.iterations == 0
    assert np.array_equal(again.x, newton.x)


def test_same_bits_twice(body):
    first, second = (AdmmSolver(body).solve(body.mesh.nodes, push(5.0)) for _ in range(2))
    assert np.array_equal(first.x, second.x)
    assert np.array_equal(first.residuals, second.residuals)


def test_residual_is_that_of_the_energy(body):
    result = AdmmSolver(body, AdmmOptions(max_iterations=30)).solve(body.mesh.nodes, push(5.0))
    assert result.outcome is Outcome.NOT_CONVERGED
    forces = Assembler(body).forces(result.x)
    held = np.union1d(body.fixed, body.pads[0].nodes)
    assert result.residuals[-1] == np.abs(np.delete(forces, held, axis=0)).max()
    assert list(result.checked) == [0, 10, 20, 30]
    assert result.pad_force[0] == pytest.approx(-forces[body.pads[0].nodes].sum(axis=0))


def test_larger_weight_ends_a_cycle():
    """A 15 mm push of the breast phantom: the plain weight cycles, doubling it converges."""
    body = build_body(load_scene(SCENE))
    displacement = np.zeros((len(body.pads), 3))
    displacement[0] = 0.015 * body.pads[0].direction
    start = body.mesh.nodes
    plain = AdmmSolver(body, AdmmOptions(largest_weight=1.0, max_iterations=600)).solve(
        start, displacement)
    adapted = AdmmSolver(body).solve(start, displacement)
    newton = StaticSolver(body).solve(start, displacement)
    assert plain.outcome is Outcome.NOT_CONVERGED
    assert plain.residuals[-10:].min() > 0.5 * plain.residuals[-30:-20].min()  # it does not fall
    assert adapted.outcome is newton.outcome is Outcome.OK
    assert adapted.weight > 1.0
    assert np.abs(adapted.x - newton.x).max() < 1e-5


def test_refuses_bad_input(body):
    with pytest.raises(InputError, match=r'pad_displacement has shape \(3,\)'):
        AdmmSolver(body).solve(body.mesh.nodes, np.zeros(3))
    with pytest.raises(InputError, match='not finite'):
        AdmmSolver(body).solve(body.mesh.nodes, push(np.nan))
    with pytest.raises(InputError, match='inverted'):
        AdmmSolver(body).solve(body.mesh.nodes * [1, 1, -1], push(1.0))
    with pytest.raises(InputError, match='dt'):
        AdmmSolver(body).step(body.mesh.nodes, 0 * body.mesh.nodes, push(1.0), 0.0)
    with pytest.raises(ConfigError, match='damping'):
        AdmmSolver(replace(body, damping=(1.0, 0.0)))
    with pytest.raises(ConfigError, match='weight = 0'):
        AdmmOptions(weight=0)
    with pytest.raises(ConfigError, match='largest_weight = 1'):
        AdmmOptions(weight=2.0, largest_weight=1.0)


def test_step_is_backward_euler():
    """(3.2)-(3.3) solved as root of x1 - x0 - dt v0 - dt^2 M^-1 f(x1), by another solver."""
    small = block(divisions=2, gravity=np.array([0.0, 0.0, -9.81]))
    rng = np.random.default_rng(1)
    assembler, dt = Assembler(small), 0.01
    held = np.union1d(small.fixed, small.pads[0].nodes)
    free = np.setdiff1d(np.arange(assembler.n), held)
    x0, v0 = small.mesh.nodes, np.zeros((assembler.n, 3))
    v0[free] = 0.1 * rng.normal(size=(len(free), 3))
    x1 = x0.copy()
    x1[small.pads[0].nodes] += push(1.0)[0]
    mass = assembler.lumped_mass()[free, None]

    def residual(q):
        x1[free] = q.reshape(-1, 3)
        moved = x1[free] - x0[free] - dt * v0[free] + dt**2 / mass * assembler.forces(x1)[free]
        return moved.ravel()

    assert root(residual, x0[free].ravel(), tol=1e-13).success
    result = AdmmSolver(small, TIGHT).step(x0, v0, push(1.0), dt)
    assert result.outcome is Outcome.OK
    assert np.abs(result.x - x1).max() < 1e-8
    assert result.v[free] == pytest.approx((x1[free] - x0[free]) / dt, abs=1e-6)


def random_gradients(rng, count, spread):
    return np.eye(3) + spread * rng.normal(size=(count, 3, 3))


def local_minimum(Y, volume, mu, kappa, w2):
    """The module's solution of (3.14) for one element whose shape gradients give F = Y."""
    work = [np.empty((3, 3)) for _ in range(3)] + [np.empty(3) for _ in range(5)]
    U, R, A, y, s, g, step, trial = work
    proximal.rotation_svd(Y, U, y, R, A)
    scale = volume / w2
    used = proximal.singular_values(y, scale * mu, scale * kappa, s, g, A, step, trial)
    return U @ np.diag(s) @ R.T, used


@pytest.mark.parametrize('spread', [0.05, 0.3, 0.8])
def test_local_step_against_general_optimiser(spread):
    rng = np.random.default_rng(7)
    mu, kappa = moduli(6e3, 0.48)
    volume, w2 = 3e-7, 3e-7 * kappa

    def objective(flat, Y):
        z = flat.reshape(3, 3)
        if not np.linalg.det(z) > 0.0:
            return np.inf
        return volume / w2 * energy(z, mu, kappa) + 0.5 * np.sum((z - Y) ** 2)

    for Y in random_gradients(rng, 20, spread):
        found, used = local_minimum(Y, volume, mu, kappa, w2)
        assert used < proximal.MAX_NEWTON
        best = minimize(objective, found.ravel() + 1e-3 * rng.normal(size=9), args=(Y,),
                        method='Nelder-Mead', options={'maxiter': 20000, 'maxfev': 20000,
                                                       'xatol': 1e-7, 'fatol': 1e-15})
        assert objective(found.ravel(), Y) <= best.fun + 1e-12
        assert np.abs(found.ravel() - best.x).max() < 1e-4


def test_rotation_svd_rebuilds_and_rotates():
    rng = np.random.default_rng(11)
    special = [np.eye(3), np.diag([2.0, 2.0, 1.0]), np.diag([1.0, 1.0, -0.5]), np.zeros((3, 3)),
               np.outer([1.0, 2.0, 3.0], [0.0, 1.0, 0.0]), 1e-3 * np.ones((3, 3))]
    for Y in [*random_gradients(rng, 200, 0.7), *special]:
        U, V, A, y = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        proximal.rotation_svd(Y, U, y, V, A)
        assert U @ np.diag(y) @ V.T == pytest.approx(Y, abs=1e-7 * max(1.0, np.abs(Y).max()))
        for rotation in (U, V):
            assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=1e-7)
            assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-7)
        exact = np.linalg.svd(Y, compute_uv=False)
        assert np.abs(y) == pytest.approx(exact, abs=1e-7 * max(1.0, exact[0]))
