"""External force against a bar, reciprocity and statics; and when it acts."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.external_force import ExternalForce

NO_PADS = np.zeros((0, 3))
both_elements = pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])


def block(size=(0.04, 0.04, 0.04), cells=(4, 4, 4), nu=0.45, quadratic=True):
    """Block held below, without pads or gravity."""
    mesh = box_mesh(size, cells)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'])


def touch(force, centre, radius=0.01, **when):
    """An ExternalForce, by default on from t = 0 to 2 s."""
    return ExternalForce(tuple(force), tuple(centre), radius, **when)


@both_elements
@pytest.mark.parametrize('radius', [0.002, 0.007, 0.015])
def test_the_load_is_the_force_and_acts_at_its_centre(quadratic, radius):
    """Sum of the shares and first moment on a plane face, whatever faces the patch cuts."""
    body, centre = block(quadratic=quadratic), np.array([0.018, 0.023, 0.04])
    share = touch([1.0, 0.0, 0.0], centre, radius).memory(body)
    assert share.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(share @ body.mesh.nodes, centre, rtol=0.0, atol=0.02 * radius)
    assert not share[body.mesh.nodes[:, 2] < 0.03].any()


def test_mean_stretch_of_a_bar():
    """nu = 0: the mean of u_z over any section below the patch is F z / (E A)."""
    body = block((0.02, 0.02, 0.06), (4, 4, 12), nu=0.0)
    term = touch([0.0, 0.0, 1e-5], [0.012, 0.009, 0.06], 0.008)
    u = TissueSimulator(body, (term,)).step(1.0, NO_PADS).x - body.mesh.nodes
    X = body.mesh.nodes
    for z in (0.02, 0.04):
        section = X[:, 2] == z
        weight = np.ones(len(X))
        for axis in (0, 1):  # Simpson's rule: ends, middles of edges, corners inside
            place = np.rint(X[:, axis] / 0.0025).astype(int)
            weight *= np.where(place % 2 == 1, 4.0, np.where(place % 8 == 0, 1.0, 2.0))
        mean = np.average(u[section, 2], weights=weight[section])
        assert mean == pytest.approx(1e-5 * z / (6e3 * 0.02**2), rel=3e-3)


def test_reciprocity():
    """Betti: work of one small load on what the other moves is the same both ways."""
    body = block()
    loads = [touch([0.0, 0.0, -1e-4], [0.02, 0.02, 0.04]), touch([1e-4, 0, 0], [0.0, 0.02, 0.02])]
    moved = [TissueSimulator(body, (load,)).step(1.0, NO_PADS).x - body.mesh.nodes
             for load in loads]
    work = [np.sum(np.outer(load.memory(body), load.force) * u)
            for load, u in zip(loads, reversed(moved), strict=True)]
    assert work[0] == pytest.approx(work[1], rel=1e-4)
    assert abs(work[0]) > 1e-12


@both_elements
def test_the_base_bears_it(quadratic):
    body = block(quadratic=quadratic)
    force = np.array([0.1, -0.05, -0.2])
    x = TissueSimulator(body, (touch(force, [0.02, 0.02, 0.04]),)).step(1.0, NO_PADS).x
    reaction = Assembler(body).forces(x)[body.fixed].sum(axis=0)
    np.testing.assert_allclose(reaction, -force, rtol=0.0, atol=1e-5)


def test_displacement_does_not_depend_on_the_mesh():
    """A patch smaller than a coarse face and one that spans several, far from the patch."""
    term, seen = touch([0.0, 0.0, -0.02], [0.021, 0.018, 0.04], 0.006), []
    for cells in (4, 8):
        body = block(cells=(cells,) * 3)
        u = TissueSimulator(body, (term,)).step(1.0, NO_PADS).x - body.mesh.nodes
        seen.append(u[np.linalg.norm(body.mesh.nodes - [0.0, 0.02, 0.02], axis=1).argmin()])
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.0, atol=0.02 * np.abs(seen[0]).max())


def test_it_acts_in_its_window_only():
    """Within (onset, onset + duration]; afterwards the body is where it was."""
    term = touch([0.0, 0.0, -0.1], [0.02, 0.02, 0.04], onset=1.0, duration=0.5)
    simulator = TissueSimulator(block(), (term,))
    simulator.settle()
    moved = {t: np.abs(simulator.step(t, NO_PADS).x - simulator.body.mesh.nodes).max()
             for t in (0.5, 1.0, 1.01, 1.5, 1.51, 2.0)}
    assert max(moved[0.5], moved[1.0]) < 1e-15  # rounding of 0.06 m
    assert moved[1.01] > 1e-4 and moved[1.5] == pytest.approx(moved[1.01])
    assert moved[1.51] < 1e-8 and moved[2.0] < 1e-8


@both_elements
def test_where_the_base_gives_the_force_still_finds_the_free_surface(quadratic):
    """Base compliance leaves no node fixed; the base is not free for it."""
    body = BaseCompliance().prepare(block(quadratic=quadratic))
    with pytest.raises(MeshError, match='external_force'):
        touch([1.0, 0, 0], [0.02, 0.02, 0.0], 0.005).memory(body)
    assert touch([1.0, 0, 0], [0.02, 0.02, 0.04], 0.005).memory(body).sum() == pytest.approx(1.0)


def test_a_pad_feels_it_and_a_failed_step_holds():
    plain = block(quadratic=False)
    middle = np.array([0.02, 0.02, 0.04])
    disc = np.flatnonzero(np.linalg.norm(plain.mesh.nodes - middle, axis=1) < 0.012)
    disc = disc[plain.mesh.nodes[disc, 2] == 0.04]
    pad = Pad('pad', disc, np.array([0, 0, -1.0]), middle, 0.01)
    body = dataclasses.replace(plain, pads=(pad,))
    simulator = TissueSimulator(body, (touch([0.2, 0, 0], [0.0, 0.02, 0.03], onset=0.5),))
    before = simulator.step(0.4, np.zeros((1, 3)))
    after = simulator.step(1.0, np.zeros((1, 3)))
    np.testing.assert_allclose(before.pad_force, 0.0, atol=1e-12)
    assert 0.01 < after.pad_force[0, 0] < 0.2  # dragged along, held by pad and base
    failed = simulator.step(1.1, [[0.0, 0.0, -0.1]])
    assert not failed.outcome.ok
    np.testing.assert_array_equal(failed.x, after.x)


def test_a_force_off_the_surface_is_refused():
    with pytest.raises(MeshError, match='within radius = 10 mm; move it onto the surface'):
        TissueSimulator(block(), (touch([1.0, 0, 0], [0.02, 0.02, 0.06]),))
