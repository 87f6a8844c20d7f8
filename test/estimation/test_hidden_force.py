"""A body under hidden force: nearer with the cloud than without it; refusals; same bits."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.estimation.hidden_force import HiddenForce, HiddenForceParams
from arm_brachy.tissue.body import SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.newton import StaticSolver

PARAMS = HiddenForceParams(centres=24, width=0.012, noise=1e-4)


@pytest.fixture(scope='module')
def body():
    mesh = box_mesh((0.06, 0.05, 0.04), (5, 4, 4))
    mu, kappa = moduli(4500.0, 0.45)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.zeros(m), mesh.node_sets['z0'])


def visible(body):
    faces = boundary_faces(body.mesh)
    return faces[np.isin(faces, body.mesh.node_sets['z1']).all(axis=1)]


def pushed(body, force, law='neo_hookean'):
    """Equilibrium with a force [N] shared by the nodes about the middle of the top."""
    top, rest = body.mesh.node_sets['z1'], body.mesh.nodes
    near = top[np.argsort(np.linalg.norm(rest[top, :2] - [0.03, 0.025], axis=1))[:4]]
    fields = StepFields.of(body)
    fields.nodal_force[near] = np.asarray(force) / 4.0
    solver = StaticSolver(body)
    if law == 'linear':
        rate = -fields.nodal_force.reshape(-1, 1)
        moved = Linearisation(solver, rest).respond(np.zeros_like(rate), rate)
        return rest + moved.reshape(-1, 3)
    found = solver.solve(rest, np.zeros((0, 3)), fields)
    assert found.outcome.ok
    return found.x


def cloud(body, x, rng, count=150):
    faces = visible(body)
    share = rng.dirichlet(np.ones(3), size=count)
    return np.einsum('ca,cai->ci', share, x[faces[rng.integers(len(faces), size=count)]])


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
def test_inner_nodes_come_near_and_the_force_has_its_direction(body, law):
    force = np.array([0.0, 0.0, -0.3])
    x = pushed(body, force, law)
    tracker = HiddenForce(body, visible(body), replace(PARAMS, law=law))
    frame = tracker.step(cloud(body, x, np.random.default_rng(1)))
    inner = np.setdiff1d(np.arange(len(x)), boundary_faces(body.mesh))
    moved = np.linalg.norm(x - body.mesh.nodes, axis=1)[inner].mean()
    left = np.linalg.norm(x - frame.x, axis=1)[inner].mean()
    assert left < 0.3 * moved
    assert frame.force @ force > 0.9 * np.linalg.norm(frame.force) * np.linalg.norm(force)


def test_at_rest_it_stays_at_rest(body):
    tracker = HiddenForce(body, visible(body), PARAMS)
    frame = tracker.step(cloud(body, body.mesh.nodes, np.random.default_rng(2)))
    np.testing.assert_allclose(frame.x, body.mesh.nodes, atol=1e-9)


def test_same_clouds_same_bits(body):
    x = pushed(body, [0.0, 0.05, -0.1])
    clouds = [cloud(body, x, np.random.default_rng(k)) for k in range(2)]
    tracker, said = HiddenForce(body, visible(body), PARAMS), []
    for _ in range(2):
        tracker.reset()
        said.append([tracker.step(c).x.tobytes() for c in clouds])
    assert said[0] == said[1]


@pytest.mark.parametrize('bad', [np.zeros((0, 3)), np.zeros((4, 2)), np.full((3, 3), np.nan)])
def test_a_cloud_that_is_none_is_refused(body, bad):
    with pytest.raises(InputError, match='cloud'):
        HiddenForce(body, visible(body), PARAMS).step(bad)
