"""ADMM against Newton, its merit against cycles, its time step against (3.2)."""

from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from scipy.optimize import root

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.scene import load_scene
from arm_brachy.tissue.admm import AdmmOptions, AdmmSolver
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
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


@pytest.mark.parametrize('options', [TIGHT, replace(TIGHT, scheme='published')])
def test_equals_newton(body, options):
    assert 300 < len(body.mesh.tets) < 600
    newton = StaticSolver(body).solve(body.mesh.nodes, push(4.0))
    result = AdmmSolver(body, options).solve(body.mesh.nodes, push(4.0), reference=newton.x)
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
    fields.stress[:] = 40.0 * (added + np.swapaxes(added, -1, -2))
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
    result = AdmmSolver(body, AdmmOptions(tolerance=1e-12, max_iterations=30)).solve(
        body.mesh.nodes, push(5.0))
    assert result.outcome is Outcome.NOT_CONVERGED
    forces = Assembler(body).forces(result.x)
    held = np.union1d(body.fixed, body.pads[0].nodes)
    assert result.residuals[-1] == np.abs(np.delete(forces, held, axis=0)).max()
    assert result.checked[0] == 0 and result.checked[-1] <= 30
    assert (np.diff(result.checked) <= 12).all()
    assert result.pad_force[0] == pytest.approx(-forces[body.pads[0].nodes].sum(axis=0))


def breast(pushes_mm, nu):
    """The breast phantom of linear tetrahedra, displacements of its pads, Newton's answer."""
    scene = replace(load_scene(SCENE), element='linear')
    body = build_body(scene)
    mu, kappa = moduli(6e3, nu)
    body = replace(body, mu=np.full_like(body.mu, mu), kappa=np.full_like(body.mu, kappa))
    directions = np.array([p.direction for p in body.pads])
    displacement = 1e-3 * np.array(pushes_mm)[:, None] * directions
    newton = StaticSolver(body).solve(body.mesh.nodes, displacement)
    assert newton.outcome is Outcome.OK
    return body, displacement, newton.x


CASES = [((10, 0, 0, 0), 0.49), ((15, 0, 0, 0), 0.45), ((15, 0, 15, 0), 0.49),
         ((15, 0, 15, 0), 0.45), ((15, 15, 0, 0), 0.49), ((15, 15, 0, 0), 0.45),
         ((15, 15, 15, 15), 0.45),
         ((20, 0, 20, 0), 0.49), ((20, 0, 20, 0), 0.45), ((10, 0, 0, 0), 0.499)]


@pytest.mark.parametrize(('pushes', 'nu'), CASES)
def test_converges_to_newton(pushes, nu):
    body, displacement, answer = breast(pushes, nu)
    result = AdmmSolver(body).solve(body.mesh.nodes, displacement, reference=answer)
    assert result.outcome is Outcome.OK
    assert result.errors[-1] < 1e-5
    assert result.accepted[np.argmax(result.errors < 1e-4)] <= 100


@pytest.mark.parametrize(('pushes', 'nu'), [((15, 0, 0, 0), 0.45), ((15, 0, 15, 0), 0.45)])
def test_published_iteration_cycles(pushes, nu):
    """Two iterations on it is back where it was, far from the solution; one on it is not."""
    body, displacement, answer = breast(pushes, nu)
    options = (AdmmOptions(scheme='published', max_iterations=240 + k) for k in range(3))
    first, second, third = (AdmmSolver(body, k).solve(body.mesh.nodes, displacement)
                            for k in options)
    assert third.outcome is Outcome.NOT_CONVERGED
    there = np.abs(second.x - first.x).max()
    assert there > 1e-4
    assert np.abs(third.x - first.x).max() < 1e-3 * there
    assert np.linalg.norm(third.x - answer, axis=1).max() > 5e-4


@pytest.mark.parametrize('depth', [0, 6])
@pytest.mark.parametrize(('pushes', 'nu'), [((15, 0, 15, 0), 0.49), ((15, 0, 15, 0), 0.45),
                                            ((15, 15, 0, 0), 0.49), ((15, 15, 0, 0), 0.45)])
def test_merit_falls_with_every_accepted_step(pushes, nu, depth):
    """So no iterate can come back, on cases on which the published iteration cycles."""
    body, displacement, _ = breast(pushes, nu)
    result = AdmmSolver(body, AdmmOptions(depth=depth, max_iterations=120)).solve(
        body.mesh.nodes, displacement)
    merit, weights = result.merits.T
    change = np.diff(merit)[np.diff(weights) == 0]
    assert len(change) > 20
    assert (change < 1e-12 * np.abs(merit).max()).all()
    assert result.reweighings < 15
    if (pushes, nu) == ((15, 0, 15, 0), 0.49):
        assert result.weight > 2.0  # it had to grow, and did so a handful of times


def test_extrapolation_saves_iterations(body):
    plain, fast = (AdmmSolver(body, AdmmOptions(depth=depth)).solve(body.mesh.nodes, push(8.0))
                   for depth in (0, 6))
    assert plain.outcome is fast.outcome is Outcome.OK
    assert fast.iterations < 0.7 * plain.iterations


def test_gives_up_where_weights_may_not_grow():
    body, displacement, _ = breast((20, 0, 20, 0), 0.49)
    result = AdmmSolver(body, AdmmOptions(weight=0.3, largest_weight=0.3)).solve(
        body.mesh.nodes, displacement)
    assert result.outcome is Outcome.NOT_CONVERGED
    assert result.weight > 0.3


def test_same_bits_for_any_number_of_threads(body):
    results = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        results.append(AdmmSolver(body).solve(body.mesh.nodes, push(6.0)))
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert np.array_equal(results[0].x, results[1].x)
    assert np.array_equal(results[0].merits, results[1].merits)


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
    with pytest.raises(ConfigError, match='weight = -1'):
        AdmmOptions(weight=-1)
    with pytest.raises(ConfigError, match="scheme = 'fast'"):
        AdmmOptions(scheme='fast')
    with pytest.raises(ConfigError, match='10 nodes'):
        AdmmSolver(replace(body, mesh=quadratic_mesh(body.mesh)))


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
