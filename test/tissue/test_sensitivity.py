"""Parameter derivatives against converged finite differences, and identities they must satisfy.

Differences: both solves converged to a correction of 1e-13 m, central, once extrapolated
(Richardson), so their truncation is O(h^4); step h and tolerance stand with the test.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh, with_midside
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver
from arm_brachy.tissue.sensitivity import (
    Change,
    Gradient,
    along,
    gradient,
    log_modulus,
    moduli_derivative,
    moduli_operator,
    pad_motion,
    poisson_ratio,
    respond,
)

NU = 0.45
PUSH = np.array([[0.0, 0.0005, -0.002], [0.0015, 0.0, 0.0]])
# A change of order one moves the body by 1e-4 to 1e-3 m. At a hundredth of it the solver's 1e-13 m
# are at most 1e-7 of the derivative, and the truncation some h^4 = 1e-8.
STEP, AGREEMENT = 1e-2, 1e-6


@dataclass
class Setting:
    """An equilibrium with everything in it that carries load."""

    solver: StaticSolver
    fields: StepFields
    lin: Linearisation
    points: object

    @property
    def body(self):
        return self.solver.body


def block(element):
    """Box on a fixed floor with two pads; no loads, moduli that differ from element to element."""
    rng = np.random.default_rng(0)
    mesh = box_mesh((0.04, 0.04, 0.03), (3, 3, 2), perturbation=0.15, rng=rng)
    x, y, z = mesh.nodes.T
    mesh = quadratic_mesh(mesh) if element == 'quadratic' else mesh
    top = np.flatnonzero(np.isclose(z, 0.03) & (np.hypot(x - 0.02, y - 0.02) < 0.015))
    side = np.flatnonzero(np.isclose(x, 0.0) & (z > 0.005) & (z < 0.025) & (y > 0.01) & (y < 0.03))
    pads = (Pad('top', with_midside(mesh, top), np.array([0, 0, -1.0]),
                np.array([0.02, 0.02, 0.03]), 0.02),
            Pad('side', with_midside(mesh, side), np.array([1.0, 0, 0]),
                np.array([0.0, 0.02, 0.015]), 0.02))
    m = len(mesh.tets)
    softness = rng.uniform(0.6, 1.6, m)
    mu, kappa = moduli(6000.0, NU)
    return SoftBody(mesh, mu * softness, kappa * softness, rng.uniform(800.0, 1200.0, m),
                    mesh.node_sets['z0'], pads)


def loaded(body):
    """The block with springs on its far side, gravity, carried masses and point forces."""
    rng = np.random.default_rng(1)
    mesh, n = body.mesh, len(body.mesh.nodes)
    far = mesh.node_sets['x1']
    root = rng.normal(size=(len(far), 3, 3))
    springs = Springs(far, 2.0 * root @ np.swapaxes(root, 1, 2))
    mass, force = np.zeros(n), np.zeros((n, 3))
    mass[far[::2]] = 1e-3
    force[mesh.node_sets['y1']] = rng.normal(scale=2e-3, size=(len(mesh.node_sets['y1']), 3))
    return replace(body, springs=springs, gravity=np.array([1.0, -2.0, -9.81]), nodal_mass=mass,
                   nodal_force=force)


def symmetric(shape, scale, rng):
    S = rng.normal(scale=scale, size=shape)
    return S + np.swapaxes(S, -1, -2)


@pytest.fixture(scope='module', params=['linear', 'quadratic'])
def setting(request):
    body = loaded(block(request.param))
    step = StepFields.of(body)
    step.stress += symmetric(step.stress.shape, 40.0, np.random.default_rng(2))
    return settled(body, step)


def settled(body, step):
    solver = StaticSolver(body, options=NewtonOptions(tolerance=1e-13))
    solution = solver.solve(body.mesh.nodes, PUSH, step)
    assert solution.outcome.ok
    points = embed(body.mesh, [[0.02, 0.02, 0.015], [0.03, 0.02, 0.02], [0.012, 0.035, 0.01]])
    return Setting(solver, step, Linearisation(solver, solution.x, step), points)


def everything(setting):
    """Name -> Change that touches one field of the problem, of a size that shows."""
    rng = np.random.default_rng(3)
    body, step, n = setting.body, setting.fields, len(setting.body.mesh.nodes)
    m, springs, lin = len(body.mu), body.springs, setting.lin
    region = np.arange(m) % 3 == 0
    spots, tilt = np.zeros((n, 3)), np.zeros((n, 3))
    spots[rng.choice(n, 10, replace=False)] = rng.normal(scale=1e-2, size=(10, 3))
    tilt[body.fixed] = np.cross([0.02, -0.01, 0.03], body.mesh.nodes[body.fixed])
    return {
        'mu': Change(mu=step.mu * region),
        'kappa': Change(kappa=step.kappa * rng.uniform(0.0, 1.0, m)),
        'stress': Change(stress=symmetric(step.stress.shape, 100.0, rng)),
        'nodal force, held nodes too': Change(nodal_force=spots),
        'pad placement': pad_motion(lin, rng.normal(scale=1e-3, size=(2, 3)), np.zeros((2, 3))),
        'pad tilt': pad_motion(lin, np.zeros((2, 3)), rng.normal(scale=0.1, size=(2, 3))),
        'base registration': Change(held_at=tilt),
        'gravity': Change(gravity=np.array([3.0, 2.0, 5.0])),
        'density': Change(density=300.0 * rng.uniform(0.0, 1.0, m)),
        'carried mass': Change(nodal_mass=1e-4 * rng.uniform(0.0, 1.0, n)),
        'springs': Change(spring_stiffness=symmetric(springs.stiffness.shape, 1.0, rng)),
        'Young modulus of a part': log_modulus(step, np.flatnonzero(region)),
    }


FIELDS = ('mu', 'kappa', 'stress', 'nodal force, held nodes too', 'pad placement', 'pad tilt',
          'base registration', 'gravity', 'density', 'carried mass', 'springs',
          'Young modulus of a part')


def plus(value, change, h):
    return value if change is None else value + h * change


def solved(setting, change, h):
    """The solution with h times a Change applied, from scratch: the parameters enter linearly."""
    body, step, lin = setting.body, setting.fields, setting.lin
    other = replace(body, gravity=plus(body.gravity, change.gravity, h),
                    density=plus(body.density, change.density, h),
                    nodal_mass=plus(body.nodal_mass, change.nodal_mass, h),
                    springs=replace(body.springs, stiffness=plus(
                        body.springs.stiffness, change.spring_stiffness, h)))
    fields = StepFields(plus(step.mu, change.mu, h), plus(step.kappa, change.kappa, h),
                        step.beyond, plus(step.stress, change.stress, h),
                        plus(step.nodal_force, change.nodal_force, h))
    solver = StaticSolver(other, options=setting.solver.options)
    held_at = plus(setting.solver.held_positions(PUSH), change.held_at, h)
    solution = solver.solve_held(lin.x, held_at, fields)
    assert solution.outcome.ok
    return solution


def extrapolated(quantity, h):
    """Richardson's (4 D(h) - D(2 h)) / 3 of the central difference D of quantity(h) at 0."""
    near = (quantity(h) - quantity(-h)) / (2.0 * h)
    wide = (quantity(2.0 * h) - quantity(-2.0 * h)) / (4.0 * h)
    return (4.0 * near - wide) / 3.0


def close(a, b, share):
    """Equal within a share of the largest entry."""
    np.testing.assert_allclose(a, b, rtol=0.0, atol=share * np.abs(b).max())


def test_the_equilibrium_is_one(setting):
    assert setting.lin.outstanding() < 1e-12


@pytest.mark.parametrize('name', FIELDS)
def test_forward_sensitivity_matches_differences_of_solves(setting, name):
    change = everything(setting)[name]
    response = respond(setting.lin, [change])
    both = extrapolated(lambda h: np.concatenate(
        [(s := solved(setting, change, h)).x.ravel(), s.pad_force.ravel()]), STEP)
    n = response.x.size
    close(response.x.ravel(), both[:n], AGREEMENT)
    close(response.pad_force.ravel(), both[n:], AGREEMENT)


def test_the_difference_shrinks_with_the_fourth_power_of_the_step(setting):
    """So it is the differences that are off, not the sensitivity."""
    change = everything(setting)['Young modulus of a part']
    exact = respond(setting.lin, [change]).x[:, :, 0]
    off = [np.abs(extrapolated(lambda h: solved(setting, change, h).x, h) - exact).max()
           for h in (0.08, 0.04)]
    assert 3.8 < np.log2(off[0] / off[1]) < 4.2


def test_poisson_ratio_matches_differences(setting):
    step = setting.fields
    E = 2.0 * (1.0 + NU) * step.mu
    response = respond(setting.lin, [poisson_ratio(step, NU)])

    def moved(h):
        mu, kappa = moduli(E, NU + h)
        return solved(setting, Change(mu=mu - step.mu, kappa=kappa - step.kappa), 1.0).x

    close(response.x[:, :, 0], extrapolated(moved, 2e-4), 1e-6)  # nu is 0.05 from its limit


def test_many_right_hand_sides_are_the_single_ones(setting):
    changes = list(everything(setting).values())
    together = respond(setting.lin, changes)
    for k, change in enumerate(changes):
        alone = respond(setting.lin, [change])
        close(together.x[:, :, k], alone.x[:, :, 0], 1e-12)
        close(together.pad_force[:, :, k], alone.pad_force[:, :, 0], 1e-12)
    assert respond(setting.lin, []).x.shape == (*setting.lin.x.shape, 0)


def test_points_move_as_interpolated(setting):
    change = everything(setting)['mu']
    response = respond(setting.lin, [change])
    np.testing.assert_allclose(response.points(setting.points)[:, :, 0],
                               interpolate(setting.points, response.x[:, :, 0]), rtol=1e-12)


def pairing(found, change):
    """Contraction of a Gradient with a Change over the fields they share."""
    pairs = [(getattr(found, f.name), getattr(change, f.name)) for f in fields(Gradient)]
    return sum(np.sum(g * c) for g, c in pairs if c is not None)


def cotangents(setting, rng):
    return rng.normal(size=setting.lin.x.shape), rng.normal(size=(2, 3))


@pytest.mark.parametrize('name', FIELDS)
def test_adjoint_is_the_transpose_of_forward(setting, name):
    change = everything(setting)[name]
    x_bar, force_bar = cotangents(setting, np.random.default_rng(4))
    response = respond(setting.lin, [change])
    terms = np.concatenate([(x_bar * response.x[:, :, 0]).ravel(),
                            (force_bar * response.pad_force[:, :, 0]).ravel()])
    scale = np.abs(terms).max()
    by_hand = along(setting.lin, [change], x_bar, force_bar)
    np.testing.assert_allclose(by_hand, [terms.sum()], rtol=0.0, atol=1e-10 * scale)
    if name != 'stress':  # of which Gradient has no field
        found = pairing(gradient(setting.lin, x_bar, force_bar), change)
        np.testing.assert_allclose(found, terms.sum(), rtol=0.0, atol=1e-10 * scale)


def test_gradient_of_a_misfit_matches_differences_in_single_elements(setting):
    """J = |points - aim|^2 / 2 + weight |pad force - aim|^2 / 2, as a fit to data has it."""
    lin, weights = setting.lin, setting.points.matrix(len(setting.lin.x))
    point_aim = interpolate(setting.points, lin.x) + 1e-3
    force_aim, per_newton = np.ones((2, 3)), 1e-4

    def misfit(s):
        return (0.5 * np.sum((interpolate(setting.points, s.x) - point_aim) ** 2)
                + 0.5 * per_newton * np.sum((s.pad_force - force_aim) ** 2))

    here = solved(setting, Change(), 0.0)
    found = gradient(lin, weights.T @ (interpolate(setting.points, here.x) - point_aim),
                     per_newton * (here.pad_force - force_aim))
    m = len(setting.fields.mu)
    largest = {name: np.abs(getattr(found, name) * getattr(setting.fields, name)).argsort()[-2:]
               for name in ('mu', 'kappa')}
    for name, elements in largest.items():
        for e in (*elements, m // 2):
            change = Change(**{name: getattr(setting.fields, name) * (np.arange(m) == e)})
            numeric = extrapolated(lambda h, c=change: misfit(solved(setting, c, h)), 0.02)
            np.testing.assert_allclose(pairing(found, change), numeric, rtol=1e-5)


def test_the_derivative_by_moduli_adds_up_to_the_elastic_force(setting):
    lin, step = setting.lin, setting.fields
    body = replace(setting.body, springs=block('linear').springs, gravity=np.zeros(3),
                   nodal_mass=None, nodal_force=None)
    bare = StaticSolver(body).assembler.forces(lin.x, replace(
        step, stress=np.zeros_like(step.stress), nodal_force=np.zeros_like(step.nodal_force)))
    total = moduli_derivative(lin) @ np.concatenate([step.mu, step.kappa])
    close(total, bare.ravel(), 1e-11)


def test_moduli_operator_is_linear_algebra(setting):
    """Its transpose is one, and its columns are the single responses."""
    A = moduli_operator(setting.lin, setting.points)
    rng = np.random.default_rng(6)
    v, w = rng.normal(size=A.shape[1]), rng.normal(size=A.shape[0])
    np.testing.assert_allclose(w @ (A @ v), (A.T @ w) @ v, rtol=1e-9)
    step, m = setting.fields, len(setting.fields.mu)
    response = respond(setting.lin, [log_modulus(step)])
    product = A @ np.concatenate([step.mu, step.kappa])
    np.testing.assert_allclose(product, np.concatenate(
        [response.points(setting.points).ravel(), response.pad_force.ravel()]), rtol=1e-12)
    assert A.shape == (3 * 3 + 3 * 2, 2 * m)


def test_scaling_all_that_carries_load_scales_forces_only(setting):
    """Euler's theorem: forces are homogeneous of degree 1 in moduli, stress, springs, loads."""
    body, step = setting.body, setting.fields
    all_of_it = Change(mu=step.mu, kappa=step.kappa, stress=step.stress, gravity=body.gravity,
                       nodal_force=step.nodal_force, spring_stiffness=body.springs.stiffness)
    response = respond(setting.lin, [all_of_it])
    force = solved(setting, Change(), 0.0).pad_force
    close(response.pad_force[:, :, 0], force, 1e-9)
    assert np.abs(response.x).max() < 1e-12


def test_four_times_the_moduli_leave_every_bit_of_the_positions():
    """No loads: x does not depend on the modulus. By 4, whose root is 2, nothing is rounded."""
    body = block('quadratic')
    stiff = replace(body, mu=4.0 * body.mu, kappa=4.0 * body.kappa)
    soft, hard = (StaticSolver(b).solve(b.mesh.nodes, PUSH) for b in (body, stiff))
    np.testing.assert_array_equal(soft.x, hard.x)
    np.testing.assert_array_equal(4.0 * soft.pad_force, hard.pad_force)
    here = settled(body, StepFields.of(body))
    response = respond(here.lin, [log_modulus(here.fields)])
    force = solved_plain(here).pad_force
    close(response.pad_force[:, :, 0], force, 1e-10)
    assert np.abs(response.x).max() < 1e-12


def solved_plain(setting):
    return setting.solver.solve(setting.lin.x, PUSH, setting.fields)


def unit_forces(setting, node):
    """Three Changes: a unit force on a node along each axis."""
    for axis in range(3):
        force = np.zeros_like(setting.lin.x)
        force[node, axis] = 1.0
        yield Change(nodal_force=force)


def test_reciprocity_of_point_forces(setting):
    """Maxwell-Betti: what a force at b moves a is what one at a moves b, in a deformed state."""
    a, b = setting.solver.free.free[[3, -7]]
    by_a = respond(setting.lin, list(unit_forces(setting, a)))
    by_b = respond(setting.lin, list(unit_forces(setting, b)))
    assert np.abs(by_b.x[a]).max() > 1e-2 * np.abs(by_b.x[b]).max()  # or nothing is tested
    close(by_b.x[a], by_a.x[b].T, 1e-11)


def test_reciprocity_of_pads_and_points(setting):
    """A pad feels a nodal force through the matrix by which its motion moves the node."""
    node = setting.solver.free.free[5]
    felt = respond(setting.lin, list(unit_forces(setting, node))).pad_force
    moved = setting.lin.state_sensitivity()[node]
    close(felt, np.moveaxis(moved, 0, -1), 1e-11)


def rigid(setting, velocity, spin):
    return Change(held_at=velocity + np.cross(spin, setting.lin.x))


@pytest.mark.parametrize('element', ['linear', 'quadratic'])
def test_rigid_motion_of_all_that_is_held_turns_the_body_and_its_forces(element):
    """Objectivity, without loads that do not turn: dx = v + w x x, d force = w x force."""
    body = block(element)
    here = settled(body, StepFields.of(body))
    velocity, spin = np.array([0.3, -0.2, 0.5]), np.array([0.4, 1.0, -0.7])
    change = rigid(here, velocity, spin)
    response = respond(here.lin, [change])
    close(response.x[:, :, 0], change.held_at, 1e-10)
    close(response.pad_force[:, :, 0], np.cross(spin, solved_plain(here).pad_force), 1e-9)


def test_answers_do_not_depend_on_the_kept_factor(setting):
    """Bits: the same from a Linearisation moved here as from one made here."""
    change = everything(setting)['mu']
    lin = Linearisation(setting.solver, setting.body.mesh.nodes)
    lin.move_to(setting.lin.x, setting.fields)
    np.testing.assert_array_equal(respond(lin, [change]).x, respond(setting.lin, [change]).x)


@pytest.mark.parametrize('field', [f.name for f in fields(Change)])
def test_an_array_of_the_wrong_shape_is_refused_by_name(setting, field):
    with pytest.raises(InputError, match=f'{field} has shape'):
        respond(setting.lin, [Change(**{field: np.zeros((2, 2))})])


def test_a_gradient_of_the_wrong_shape_is_refused(setting):
    with pytest.raises(InputError, match='x_bar has shape'):
        gradient(setting.lin, np.zeros(3))
