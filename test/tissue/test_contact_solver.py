"""Steps of contact: what they refuse, report and repeat; probes, turns, bonded pads besides."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact import ContactLaw, ContactPair
from arm_brachy.tissue.contact_poses import between, moved, placed
from arm_brachy.tissue.contact_shapes import CurvedProbe, Disc, RoundedBox, Sphere
from arm_brachy.tissue.contact_solver import ContactOptions, ContactSolver
from arm_brachy.tissue.contact_surface import surface_quadrature
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, quadratic_mesh

DOWN, TOP = np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.02])


def make_body(quadratic=False, **extra):
    mesh = box_mesh((0.04, 0.04, 0.02), (5, 5, 3))
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    mu, kappa = moduli(6000.0, 0.45)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'], **extra)


def push(solver, start, *ways):
    state = solver.initial(start)
    for way in ways:
        state = solver.step(state, moved(start, np.atleast_2d(way)))
        assert state.outcome is Outcome.OK
    return state


@pytest.mark.parametrize('quadratic', [False, True])
@pytest.mark.parametrize('points', [3, 6])
def test_surface_quadrature_integrates_area_and_position(quadratic, points):
    mesh = make_body(quadratic).mesh
    surface = surface_quadrature(mesh, boundary_faces(mesh), points)
    at = np.einsum('qa,fai->fqi', surface.shape, mesh.nodes[surface.faces])
    assert surface.weights.sum() == pytest.approx(2 * 0.04**2 + 4 * 0.04 * 0.02)
    np.testing.assert_allclose(np.einsum('fq,fqi->i', surface.weights, at) / surface.weights.sum(),
                               [0.02, 0.02, 0.01], rtol=1e-12)
    with pytest.raises(ConfigError, match='points'):
        surface_quadrature(mesh, boundary_faces(mesh), 5)


def test_a_step_repeats_its_bits():
    def run():
        solver = ContactSolver(make_body(), [ContactPair('pad', Disc(0.01, 0.002), 0.4)])
        return push(solver, placed(TOP, DOWN)[None], [0, 0, -1e-3], [2e-4, 0, -1.5e-3])
    one, two = run(), run()
    assert np.array_equal(one.x, two.x)
    assert np.array_equal(one.force, two.force)


@pytest.mark.parametrize('quadratic', [False, True])
def test_faces_left_out_because_they_are_clear_change_nothing(quadratic):
    body = make_body(quadratic)
    solver = ContactSolver(body, [ContactPair('ball', Sphere(0.015))])
    start = placed([0.02, 0.02, 0.035], DOWN)[None]
    state = push(solver, start, [0, 0, -2e-3])
    every = solver.assembler
    few = every.forces(state.x)
    every._near = [np.arange(len(s.faces)) for s in every.surfaces]
    every._near_at = state.x
    np.testing.assert_array_equal(every.forces(state.x), few)


@pytest.mark.parametrize('shape', [RoundedBox(0.03, 0.012, 0.003),
                                   CurvedProbe(0.03, 0.014, 0.003)], ids=['linear', 'curved'])
def test_a_probe_turned_about_its_axis_feels_a_moment_against_the_turn(shape):
    solver = ContactSolver(make_body(), [ContactPair('probe', shape, 0.6)])
    start = placed(TOP, DOWN)[None]
    state = push(solver, start, [0, 0, -2e-3])
    turned = state.X_WB.copy()
    c, s = np.cos(0.05), np.sin(0.05)
    turned[0, :3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ turned[0, :3, :3]
    after = solver.step(state, turned)
    assert after.outcome is Outcome.OK
    assert after.moment[0, 2] - state.moment[0, 2] < -1e-5
    assert after.dissipation[0] >= 0.0


def test_frictionless_states_do_not_depend_on_the_path():
    solver = ContactSolver(make_body(), [ContactPair('ball', Sphere(0.015))])
    start = placed([0.02, 0.02, 0.035], DOWN)[None]
    direct = push(solver, start, [0, 0, -3e-3])
    detour = push(solver, start, [0, 0, -1e-3], [1e-3, 0, -4e-3], [0, 0, -3e-3])
    np.testing.assert_allclose(detour.x, direct.x, atol=1e-8)
    np.testing.assert_allclose(detour.force, direct.force, atol=1e-7)


def test_an_impossible_push_ends_with_advice_and_holds_the_last_state():
    solver = ContactSolver(make_body(), [ContactPair('pad', Disc(0.01, 0.002), 0.3)],
                           options=ContactOptions(max_bisections=3))
    start = placed(TOP, DOWN)[None]
    good = push(solver, start, [0, 0, -1e-3])
    failed = solver.step(good, moved(start, [[0, 0, -0.05]]))
    assert not failed.outcome.ok
    assert np.array_equal(failed.x, good.x)
    assert np.array_equal(failed.X_WB, good.X_WB)
    assert np.array_equal(failed.force, good.force)
    again = solver.step(failed, moved(start, [[0, 0, -1.2e-3]]))
    assert again.outcome is Outcome.OK  # and the solver is as good as new
    same = solver.step(good, moved(start, [[0, 0, -1.2e-3]]))
    assert np.array_equal(again.x, same.x)


def test_sensitivity_is_the_derivative_of_the_state():
    """Without friction, by central differences of solved states."""
    solver = ContactSolver(make_body(), [ContactPair('ball', Sphere(0.015))])
    start = placed([0.02, 0.02, 0.035], DOWN)[None]
    state = push(solver, start, [0, 0, -3e-3])
    found, h = solver.sensitivity(state)[:, :, 0, :], 1e-6
    for axis in (0, 2):
        shift = h * np.eye(3)[axis]
        ahead, back = (solver.step(state, moved(state.X_WB, [s * shift])).x for s in (1, -1))
        np.testing.assert_allclose(found[:, :, axis], (ahead - back) / (2 * h), atol=5e-3)


def test_a_probe_touches_while_a_pad_is_bonded():
    mesh = make_body().mesh
    side = np.flatnonzero((mesh.nodes[:, 0] == 0.0) & (np.abs(mesh.nodes[:, 2] - 0.01) < 0.005)
                          & (np.abs(mesh.nodes[:, 1] - 0.02) < 0.009))
    pad = Pad('side', side, np.array([1.0, 0, 0]), np.array([0.0, 0.02, 0.01]), 0.01)
    solver = ContactSolver(make_body(pads=(pad,)), [ContactPair('probe', Sphere(0.01), 0.2)])
    start = placed([0.02, 0.02, 0.03], DOWN)[None]
    held_at = solver.statics.held_positions([[1e-3, 0.0, 0.0]])
    state = solver.step(solver.initial(start), moved(start, [[0, 0, -1e-3]]), held_at)
    assert state.outcome is Outcome.OK
    u = (state.x - mesh.nodes)[side]
    np.testing.assert_allclose(u, np.broadcast_to([1e-3, 0.0, 0.0], u.shape), atol=1e-15)
    assert state.pad_force[0, 0] < 0.0 < state.force[0, 2]


def test_touching_moves_a_body_along_its_axis_to_first_touch():
    solver = ContactSolver(make_body(), [ContactPair('ball', Sphere(0.01))])
    found = solver.touching(placed([0.02, 0.02, 0.05], DOWN)[None])
    surface = solver.assembler.surfaces[0]
    x = solver.body.mesh.nodes
    at = np.einsum('qa,fai->fqi', surface.shape, x[surface.faces]).reshape(-1, 3)
    gap = np.linalg.norm(at - found[0, :3, 3], axis=1).min() - 0.01
    assert gap == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InputError, match='touches nothing'):
        solver.touching(placed([0.2, 0.2, 0.05], DOWN)[None])


def test_poses_between_turn_about_one_axis():
    start, goal = placed(TOP, DOWN)[None], placed(TOP + 1e-2, [1.0, 0, 0])[None]
    half = between(start, goal, 0.5)
    np.testing.assert_allclose(between(half, goal, 1.0), goal)
    np.testing.assert_allclose(half[0, :3, 3], TOP + 5e-3)
    first = half[0, :3, :3] @ start[0, :3, :3].T
    np.testing.assert_allclose(first @ first, goal[0, :3, :3] @ start[0, :3, :3].T, atol=1e-12)


def test_refuses_bad_arguments():
    solver = ContactSolver(make_body(), [ContactPair('ball', Sphere(0.01))])
    with pytest.raises(InputError, match='X_WB'):
        solver.initial(np.eye(4))
    with pytest.raises(InputError, match='ball is not rigid'):
        solver.initial(np.diag([2.0, 1.0, 1.0, 1.0])[None])
    with pytest.raises(ConfigError, match='friction'):
        ContactPair('ball', Sphere(0.01), -0.1)
    with pytest.raises(ConfigError, match='depth'):
        ContactLaw(depth=0.0)
    body = make_body()
    with pytest.raises(InputError, match='none of its'):
        ContactSolver(body, [dataclasses.replace(
            solver.pairs[0], faces=boundary_faces(body.mesh)[:0])])
