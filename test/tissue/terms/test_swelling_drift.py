"""Swelling: free without stress, held back with the stress of closed forms, seen at no load."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy.tissue.body import Fibres, Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli, stress
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.swelling_drift import SwellingDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

L, PER_MINUTE = 0.04, 1.0 / 60.0
TERM = SwellingDrift(rate=0.015 * PER_MINUTE)
LARGE = SwellingDrift(rate=0.1 * PER_MINUTE)
NO_PADS = np.zeros((0, 3))
WALL = 1e7  # N/m of each node: gives way by some 1e-6 of L at most


def body_on(mesh, nu, fixed=(), pads=(), **extra):
    """Homogeneous SoftBody."""
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.asarray(fixed, dtype=np.int64), pads, **extra)


def cube(element='quadratic', cells=2, size=(L, L, L)):
    mesh = box_mesh(size, (cells,) * 3)
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def on_rollers(mesh, faces, nu, **extra):
    """Body with frictionless walls at these faces ('x0', 'z1', ...)."""
    walls = np.zeros((len(mesh.nodes), 3, 3))
    for face in faces:
        axis = 'xyz'.index(face[0])
        walls[mesh.node_sets[face], axis, axis] = WALL
    return body_on(mesh, nu, springs=Springs(np.arange(len(walls)), walls), **extra)


def wall_pressure(body, x, face):
    """What the walls at a face bear, over its area at rest [Pa]; positive = the tissue pushes."""
    axis, side = 'xyz'.index(face[0]), 2 * int(face[1]) - 1
    nodes = body.mesh.node_sets[face]
    return side * WALL * (x - body.mesh.nodes)[nodes, axis].sum() / L**2


def beyond(mesh, nu):
    """Stiffening and fibres aslant."""
    m, mu = len(mesh.tets), moduli(6e3, nu)[0]
    return {'stiffening': np.full(m, mu),
            'fibres': Fibres(np.full(m, 0.5 * mu), np.tile([0.6, 0.0, 0.8], (m, 1)))}


@pytest.mark.parametrize('element', ['linear', 'quadratic'])
@pytest.mark.parametrize(('rate', 'onset', 'stretches'), [
    (0.015, 0.0, (1.0 + 0.015 / 2.0, 1.015, 1.03)),
    (0.015, 30.0, (1.0, 1.0 + 0.015 / 2.0, 1.0225)),
    (-0.02, 0.0, (1.0 / 1.01, 1.0 / 1.02, 1.0 / 1.04)),
])
def test_a_free_body_swells_uniformly_and_without_stress(element, rate, onset, stretches):
    """x = s X after 30, 60 and 120 s, whatever the law; walls at three faces only guide it."""
    mesh = cube(element)
    body = on_rollers(mesh, ('x0', 'y0', 'z0'), 0.49, **beyond(mesh, 0.49))
    simulator = TissueSimulator(body, (SwellingDrift(rate * PER_MINUTE, onset),))
    for t, s in zip((30.0, 60.0, 120.0), stretches, strict=True):
        state = simulator.step(t, NO_PADS)
        assert state.outcome.ok
        np.testing.assert_allclose(state.x, s * mesh.nodes, rtol=0.0, atol=2e-9)
        assert abs(wall_pressure(body, state.x, 'z0')) < 0.1  # Pa, of a modulus of 6000


@pytest.mark.parametrize(('nu', 'term', 't', 's'), [(0.3, LARGE, 60.0, 1.1),
                                                    (0.49, TERM, 40.0, 1.01)])
def test_an_enclosed_body_presses_on_its_walls(nu, term, t, s):
    """F = I, J_e = s^-3: pressure kappa (1 - s^-3) over the area at rest, and no shear."""
    mesh = cube()
    body = on_rollers(mesh, ('x0', 'x1', 'y0', 'y1', 'z0', 'z1'), nu)
    state = TissueSimulator(body, (term,)).step(t, NO_PADS)
    exact = body.kappa[0] * (1.0 - s**-3)
    for face in ('x1', 'y0', 'z1'):
        assert wall_pressure(body, state.x, face) == pytest.approx(exact, rel=1e-3)


def test_a_clamped_bar_pushes_with_its_own_stress():
    """Between two walls, sides free, incompressible: elastic stretch 1 / s, P = s^2 mu (l - l^-2).

    To first order E (s - 1); mu / kappa is 2e-4.
    """
    body, s = on_rollers(cube(), ('x0', 'y0', 'z0', 'z1'), 0.4999), 1.1
    state = TissueSimulator(body, (LARGE,)).step(60.0, NO_PADS)
    exact = s**2 * body.mu[0] * (s**2 - 1.0 / s)
    assert wall_pressure(body, state.x, 'z1') == pytest.approx(exact, rel=1e-3)
    wide = np.linalg.norm(body.mesh.nodes - L, axis=1).argmin()
    assert state.x[wide, 0] / L == pytest.approx(s**1.5, rel=5e-4)
    slow = TissueSimulator(body, (TERM,)).step(4.0, NO_PADS)
    assert wall_pressure(body, slow.x, 'z1') == pytest.approx(6e3 * 0.001, rel=5e-3)


def test_a_body_held_all_round_grows_in_height_alone():
    """Walls at the sides, top free: P_zz(diag(1, 1, h) / s) = 0; (1 + nu) / (1 - nu) (s - 1)."""
    for nu, term, s in ((0.3, LARGE, 1.1), (0.45, TERM, 1.015)):
        body = on_rollers(cube(), ('x0', 'x1', 'y0', 'y1', 'z0'), nu)
        law = body.mu[0], body.kappa[0]
        height = brentq(lambda h, s=s, law=law: stress(np.diag([1.0, 1.0, h]) / s, *law)[2, 2],
                        0.8, 1.6)
        state = TissueSimulator(body, (term,)).step(60.0, NO_PADS)
        np.testing.assert_allclose(state.x[body.mesh.node_sets['z1'], 2] / L, height,
                                   rtol=1e-5)
        first = (1.0 + nu) / (1.0 - nu) * (s - 1.0)
        assert height - 1.0 == pytest.approx(first, rel=4.0 * (s - 1.0))


def test_markers_drift_while_no_pad_pushes():
    """On a column glued below, markers a width and more above the base part by s - 1.

    What the base holds back dies out within a width (Saint-Venant).
    """
    mesh = quadratic_mesh(box_mesh((L / 2, L / 2, 2 * L), (2, 2, 8)))
    body = body_on(mesh, 0.45, mesh.node_sets['z0'])
    riders = embed(mesh, np.array([[L / 4, 0.0, L], [L / 4, 0.0, 1.6 * L]]))
    simulator = TissueSimulator(body, (TERM,))
    before = interpolate(riders, simulator.settle().x)
    gaps = [np.diff(interpolate(riders, simulator.step(t, NO_PADS).x)[:, 2])[0]
            for t in (20.0, 60.0)]
    gap = np.diff(before[:, 2])[0]
    np.testing.assert_allclose(np.array(gaps) / gap - 1.0, [0.005, 0.015], rtol=0.01)


def test_forces_follow_the_modulus_and_positions_do_not():
    """All moduli times two (a drift of stiffness does it too): same places, twice the force.

    To rounding: 1e-14 m, and that times a stiffness of some 1e3 N/m.
    """
    mesh = cube()
    body = on_rollers(mesh, ('z0',), 0.49, **beyond(mesh, 0.49))
    lid = Pad('lid', mesh.node_sets['z1'], np.array([0.0, 0.0, -1.0]), np.array([0.5, 0.5, 1]) * L,
              0.01)
    body = dataclasses.replace(body, pads=(lid,), fixed=mesh.node_sets['z0'], springs=Springs(
        np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))))
    push = [[1e-3, 0.0, -2e-3]]
    one = TissueSimulator(body, (TERM,)).step(60.0, push)
    two = TissueSimulator(body.with_stiffness(2.0), (TERM,)).step(60.0, push)
    drifted = TissueSimulator(body, (StiffnessDrift(PER_MINUTE), TERM)).step(60.0, push)
    for other in (two, drifted):
        np.testing.assert_allclose(other.x, one.x, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(other.pad_force, 2.0 * one.pad_force, rtol=0.0, atol=1e-11)


def test_relaxing_tissue_swells_freely_and_ends_where_elastic_tissue_does():
    """What it remembers is strain of the swollen shape: none when free, the same when held."""
    visco, mesh = Viscoelasticity(g1=0.4, tau1=5.0), cube()
    free = on_rollers(mesh, ('x0', 'y0', 'z0'), 0.49, **beyond(mesh, 0.49))
    simulator = TissueSimulator(free, (visco, LARGE))
    for t in (10.0, 30.0, 60.0):
        state = simulator.step(t, NO_PADS)
    np.testing.assert_allclose(state.x, 1.1 * mesh.nodes, rtol=0.0, atol=1e-8)
    held = on_rollers(mesh, ('x0', 'y0', 'z0', 'z1'), 0.49, **beyond(mesh, 0.49))
    pressures = []
    for terms in ((visco, LARGE), (LARGE,)):
        simulator = TissueSimulator(held, terms)
        simulator.step(60.0, NO_PADS)
        pressures.append(wall_pressure(held, simulator.settle().x, 'z1'))
    assert pressures[0] == pytest.approx(pressures[1], rel=1e-6)
    assert pressures[0] > 500.0


def test_it_grows_from_substep_to_substep():
    """One long call in dynamics is many short ones."""
    body = dataclasses.replace(body_on(cube('linear', 3), 0.45, box_mesh(
        (L, L, L), (3, 3, 3)).node_sets['z0']), damping=(5.0, 1e-3))
    ends = []
    for calls in (1, 5):
        simulator = TissueSimulator(body, (SwellingDrift(0.5 * PER_MINUTE),), dynamics='implicit',
                                    options=DynamicOptions(max_step=0.01))
        for k in range(1, calls + 1):
            state = simulator.step(0.2 * k / calls, NO_PADS)
        ends.append(state)
    assert np.abs(ends[0].x - body.mesh.nodes).max() > 5e-5
    np.testing.assert_allclose(ends[0].x, ends[1].x, rtol=0.0, atol=1e-9)
