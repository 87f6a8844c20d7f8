"""A needle pushed through a block: force balance, dent, puncture, targets that come along."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.needle import NeedleForce, NeedleParams
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.instruments import Instruments, Tools
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, embed, interpolate, quadratic_mesh
from arm_brachy.tissue.needle_path import NeedleInTissue, stretch
from arm_brachy.tissue.simulator import TissueSimulator

PARAMS = NeedleParams()
TEMPLATE, ALONG = np.array([-0.01, 0.031, 0.021]), np.array([1.0, 0.0, 0.0])


def make_body():
    mesh = quadratic_mesh(box_mesh((0.06, 0.06, 0.04), (5, 4, 3)))
    mu, kappa = moduli(6000.0, 0.45)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'])


def needle(depth):
    return NeedleInTissue(TEMPLATE + np.linspace(0.0, depth, 21)[:, None] * ALONG, depth)


class Run:
    """A block and a needle driven tick by tick."""

    def __init__(self, params=PARAMS):
        self.sim = TissueSimulator(make_body(), instruments=Instruments(None, NeedleForce(params)))
        self.target = embed(self.sim.body.mesh, [[0.03, 0.031, 0.026]])
        self.rest = interpolate(self.target, self.sim.body.mesh.nodes)[0]
        self.t = 0.0

    def to(self, depth):
        self.t += 0.05
        state = self.sim.step(self.t, np.zeros((0, 3)), Tools(needle=needle(depth)))
        assert state.outcome is Outcome.OK
        return state.instruments.needle_force, interpolate(self.target, state.x)[0] - self.rest

    def held(self):
        """Force of the fixed nodes on the tissue."""
        assembler = self.sim._integrator.statics.assembler
        return assembler.forces(self.sim.state.x)[self.sim.body.fixed].sum(axis=0)


def test_a_unit_force_on_the_nodes_is_a_unit_force():
    body = make_body()
    found = stretch(body.mesh, boundary_faces(body.mesh), needle(0.045), body.mesh.nodes)
    assert found.inside == pytest.approx(0.035)
    for load in (found.skin, found.tip, found.shaft):
        np.testing.assert_allclose(load.sum(axis=0), ALONG, atol=1e-12)
    moment = np.cross(body.mesh.nodes, found.shaft).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross([0.0175, 0.031, 0.021], ALONG), atol=1e-9)
    assert stretch(body.mesh, boundary_faces(body.mesh), needle(0.009), body.mesh.nodes) is None


def test_what_the_needle_feels_is_what_holds_the_tissue():
    run = Run()
    for depth in np.arange(0.008, 0.04, 0.001):
        force, _ = run.to(depth)
    assert force > 0.3
    np.testing.assert_allclose(run.held(), [-force, 0.0, 0.0], atol=1e-4)


def test_the_skin_dents_by_the_law_before_it_breaks():
    run = Run()
    for depth in np.arange(0.0095, 0.0145, 0.0005):
        force, _ = run.to(depth)
        faces = boundary_faces(run.sim.body.mesh)
        found = stretch(run.sim.body.mesh, faces, needle(depth), run.sim.state.x)
        dent = 0.0 if found is None else found.inside
        law = PARAMS.dent_linear * dent + PARAMS.dent_square * dent**2
        assert force == pytest.approx(law, abs=2e-4)
    assert 0.0 < force < PARAMS.puncture


def test_targets_come_along_and_go_back_with_the_needle():
    run = Run()
    path = [run.to(depth) for depth in np.arange(0.008, 0.05, 0.001)]
    rest = [run.to(0.049) for _ in range(5)]
    back = [run.to(depth) for depth in np.arange(0.048, 0.008, -0.001)]
    out = run.to(0.005)
    forward, backward = np.array([u[0] for _, u in path]), np.array([u[0] for _, u in back])
    assert forward[-1] > 2e-4                  # along the insertion
    assert path[-1][0] > 0.0 > back[3][0]      # friction is reversed
    assert backward.min() < 0.0
    held, full = rest[-1][0], path[-1][0]
    assert 0.9 * full < held < full            # at rest nothing but the viscous part goes
    assert rest[-1][1][0] > 0.9 * forward[-1]  # and the target stays displaced
    assert out[0] == 0.0
    assert np.abs(out[1]).max() < 1e-7


def test_sliding_friction_and_cutting_are_those_of_the_law():
    """Steady insertion: relative speed is the needle's, but for what the tissue still moves."""
    run = Run()
    for depth in np.arange(0.008, 0.05, 0.0005):
        force, _ = run.to(depth)
    inside, speed = depth - 0.01, 0.01
    law = PARAMS.cutting + inside * (PARAMS.coulomb + PARAMS.viscous * speed)
    assert force == pytest.approx(law, rel=0.1)


def test_the_same_insertion_gives_the_same_bits():
    def go():
        run = Run()
        return [run.to(depth) for depth in np.arange(0.008, 0.03, 0.002)][-1]
    one, two = go(), go()
    assert one[0] == two[0]
    assert np.array_equal(one[1], two[1])


def test_refuses_a_needle_without_points():
    with pytest.raises(InputError, match='needle'):
        NeedleInTissue(np.zeros((1, 3)), 0.0)
