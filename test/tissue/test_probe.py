"""A probe on tissue: Hertz, the other contact solver, balances, cone, derivative, lift-off."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.term import Stage
from arm_brachy.registry import parse_terms, split
from arm_brachy.tissue import instrumented, probe_contact
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact import ContactLaw, ContactPair
from arm_brachy.tissue.contact_poses import moved
from arm_brachy.tissue.contact_shapes import Sphere
from arm_brachy.tissue.contact_solver import ContactSolver
from arm_brachy.tissue.instruments import Instruments, Tools
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import NewtonOptions
from arm_brachy.tissue.probe_face import ProbeFace
from arm_brachy.tissue.simulator import TissueSimulator

E, NU, TOP = 6000.0, 0.45, 0.03
DOWN = np.diag([1.0, -1.0, -1.0])
MIDDLE = np.array([0.03, 0.03, TOP])
TIGHT = NewtonOptions(tolerance=1e-10)


@dataclass(frozen=True)
class Ball:
    """What `Instruments` needs to know of a face, for a sphere."""

    radius: float = 0.02
    friction: float = 0.0
    width: float = 0.04
    thickness: float = 0.04
    strips: int = 4

    @property
    def shape(self):
        return Sphere(self.radius)


def make_body(cells=(6, 6, 3), pad=False, **extra):
    mesh = quadratic_mesh(box_mesh((0.06, 0.06, TOP), cells))
    mu, kappa = moduli(E, NU)
    m = len(mesh.tets)
    pads = ()
    if pad:
        side = np.flatnonzero((mesh.nodes[:, 0] == 0.0) & (np.abs(mesh.nodes[:, 1] - 0.03) < 0.011)
                              & (np.abs(mesh.nodes[:, 2] - 0.015) < 0.006))
        pads = (Pad('side', side, np.array([1.0, 0, 0]), np.array([0.0, 0.03, 0.015]), 0.01),)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'], pads=pads, **extra)


@pytest.fixture
def tight(monkeypatch):
    monkeypatch.setattr(instrumented, 'LOOSEST', 0.0)


def make(face, body=None, terms=(), layer=probe_contact.GEL):
    body = make_body() if body is None else body
    return TissueSimulator(body, terms, options=TIGHT, instruments=Instruments(face, layer=layer))


def walk(sim, *places, t=0.0, pad=0.0, R=DOWN):
    """Step to each place (3,) of the probe, 50 ms apart; returns the TissueStates."""
    states = []
    for place in places:
        t += 0.05
        pads = np.tile([pad, 0.0, 0.0], (len(sim.body.pads), 1))
        states.append(sim.step(t, pads, Tools(probe=(R, MIDDLE + np.asarray(place)))))
        assert states[-1].outcome is Outcome.OK
    return states


def down(depth, count=4):
    return [[0.0, 0.0, -depth * k / count] for k in range(1, count + 1)]


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_agrees_with_the_solver_that_factorises_the_contact(tight, monkeypatch, friction):
    """Another algorithm, the same potential; `verification/test_contact` holds it to Hertz."""
    monkeypatch.setattr(probe_contact, 'FINEST', 1.0)   # no finer quadrature, as there
    ball, body = Ball(friction=friction), make_body()
    other = ContactSolver(body, [ContactPair('ball', Sphere(ball.radius), friction)],
                          law=probe_contact.GEL, newton=TIGHT)
    X = np.eye(4)
    # A Sphere's origin is its centre; here as there.
    X[:3, :3], X[:3, 3] = DOWN, MIDDLE + [0.0, 0.0, ball.radius + 1e-4]
    there = other.initial(X[None])
    sim = make(ball, body)
    ways = [*down(3e-3), [1e-3, 0.0, -3e-3], [2e-3, 0.0, -3e-3]]
    walk(sim, [0.0, 0.0, ball.radius + 1e-4])
    for k, way in enumerate(ways):
        there = other.step(there, moved(X[None], [np.array(way)]))
        here = walk(sim, np.array(way) + [0.0, 0.0, ball.radius + 1e-4], t=0.05 * (k + 1))[0]
    np.testing.assert_allclose(here.x, there.x, atol=2e-8)
    np.testing.assert_allclose(here.instruments.probe.wrench[:3], there.force[0], atol=1e-5)
    np.testing.assert_allclose(here.instruments.probe.wrench[3:], there.moment[0], atol=1e-6)


def test_a_ball_follows_hertz_within_the_limits_of_a_block():
    """F = 4/3 E' R^1/2 d^3/2 on a half-space; the block's bottom, 12 radii of contact down, is
    held, which stiffens by some 1.3 a / h = 11 %."""
    mesh = box_mesh((1.0, 1.0, 1.0), (8, 8, 5))
    nodes = mesh.nodes.copy()
    s = 2.0 * nodes[:, :2] - 1.0
    nodes[:, :2] = 0.03 + 0.03 * np.sign(s) * np.abs(s)**1.8
    nodes[:, 2] = TOP * (1.0 - (1.0 - nodes[:, 2])**1.8)
    mesh = quadratic_mesh(box_replaced(mesh, nodes))
    mu, kappa = moduli(E, NU)
    m = len(mesh.tets)
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'])
    R, d = 8e-3, 8e-4
    sim = make(Ball(radius=R), body, layer=ContactLaw(depth=5e-6, onset=5e-6))
    forces = [s.instruments.probe.wrench[2] for s in walk(
        sim, *[[0.0, 0.0, R + 1e-4], *([0.0, 0.0, R - k * d / 4] for k in (1, 2, 3, 4))])]
    hertz = 4.0 / 3.0 * E / (1.0 - NU**2) * np.sqrt(R) * d**1.5
    assert 0.9 < forces[4] / hertz < 1.15
    assert np.log2(forces[4] / forces[2]) == pytest.approx(1.5, abs=0.12)


def box_replaced(mesh, nodes):
    return type(mesh)(nodes, mesh.tets, mesh.node_sets)


@pytest.mark.parametrize('friction', [0.0, 0.2])
def test_stiffness_is_the_derivative_of_the_wrench(tight, friction):
    """Central differences of whole steps from one state, all six motions of the probe."""
    sim = make(ProbeFace(width=0.03, thickness=0.01, edge_radius=0.004, friction=friction))
    walk(sim, [0.0, 0.0, 1e-4], *down(3e-3))
    start, h = sim._native, 2e-7

    def wrench(motion):
        turn = Rotation.from_rotvec(motion[3:]).as_matrix()
        place = MIDDLE + [1e-3, 5e-4, -3e-3] + motion[:3]
        fields = sim._fields(sim._memories, 0.3, 0.05)
        native, state = sim._integrator.step(start, np.zeros((0, 3)), 0.05, fields,
                                             Tools(probe=(turn @ DOWN, place)))
        assert state.outcome is Outcome.OK
        return state.instruments.probe

    sim._integrator._factorise(start.state.x, sim._fields(sim._memories, 0.3, 0.05))
    found = wrench(np.zeros(6)).stiffness
    scale = np.array([1.0, 1.0, 1.0, 5e-3, 5e-3, 5e-3])
    for axis in range(6):
        step = h / scale[axis] * np.eye(6)[axis]
        difference = (wrench(step).wrench - wrench(-step).wrench) / (2.0 * np.abs(step).max())
        np.testing.assert_allclose(-difference / scale / scale[axis],
                                   found[:, axis] / scale / scale[axis], atol=12.0)
    if friction == 0.0:     # a potential: Maxwell and Betti
        np.testing.assert_allclose(found[:3, :3], found[:3, :3].T, atol=2.0)


def test_all_forces_on_the_tissue_add_up_to_nothing(tight):
    gravity = np.array([0.0, 0.0, -9.81])
    sim = make(ProbeFace(width=0.03, friction=0.2), make_body(pad=True, gravity=gravity))
    sim.settle()
    state = walk(sim, [0.0, 0.0, 1e-4], *down(3e-3), [1e-3, 0.0, -3e-3], pad=1e-3)[-1]
    body = sim.body
    assembler = sim._integrator.statics.assembler
    held = assembler.forces(state.x)[body.fixed].sum(axis=0)
    weight = gravity * assembler.element_mass().sum()
    total = held + weight - state.pad_force.sum(axis=0) - state.instruments.probe.wrench[:3]
    np.testing.assert_allclose(total, 0.0, atol=2e-6)
    assert state.instruments.probe.wrench[2] > 0.1


def test_lift_off_leaves_exactly_nothing_and_it_touches_again():
    sim = make(ProbeFace(width=0.03))
    states = walk(sim, [0.0, 0.0, 1e-4], *down(3e-3), [0.0, 0.0, 2e-3], [0.0, 0.0, 2e-3],
                  [0.0, 0.0, -3e-3])
    pressed, clear, again = states[4], states[6], states[7]
    probe = clear.instruments.probe
    assert pressed.instruments.probe.wrench[2] > 0.1
    assert not probe.wrench.any()
    assert not probe.stiffness.any()
    assert probe.area == 0.0
    assert not probe.pressure.any()
    np.testing.assert_allclose(clear.x, sim.body.mesh.nodes, atol=1e-7)
    np.testing.assert_allclose(again.instruments.probe.wrench[2],
                               pressed.instruments.probe.wrench[2], rtol=2e-2)


def test_sliding_meets_coulomb_and_stays_within_the_cone():
    """On a flat block: traction reaches mu times the normal force, and turns with the motion."""
    mu = 0.2
    sim = make(ProbeFace(width=0.03, friction=mu))
    states = walk(sim, [0.0, 0.0, 1e-4], *down(2e-3),
                  *[[4e-4 * k, 0.0, -2e-3] for k in range(1, 13)],
                  *[[48e-4 - 4e-4 * k, 0.0, -2e-3] for k in range(1, 13)])
    ratio = np.array([s.instruments.probe.wrench[0] / s.instruments.probe.wrench[2]
                      for s in states[1:]])
    # The edges rise and fall with the skin, so that normal forces have a part along x as well.
    assert np.abs(ratio).max() < 1.35 * mu
    assert ratio[15] < -0.7 * mu       # the tissue drags a probe that moves along +x back
    assert ratio[-1] > 0.7 * mu


def test_a_dome_narrower_than_the_probe_bears_in_the_middle_only():
    mesh = box_mesh((0.06, 0.06, TOP), (6, 6, 3))
    nodes = mesh.nodes.copy()
    nodes[:, 2] *= 1.0 - 8.0 * (nodes[:, 0] - 0.03)**2 / 0.03   # falls by 7 mm over 30 mm
    mesh = quadratic_mesh(box_replaced(mesh, nodes))
    mu, kappa = moduli(E, NU)
    m = len(mesh.tets)
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'])
    face = ProbeFace(strips=7)
    pressure = walk(make(face, body), [0.0, 0.0, 1e-4], *down(1e-3))[-1].instruments.probe.pressure
    assert pressure[0] == pressure[-1] == 0.0
    assert pressure[3] > 0.0
    probe_force = pressure.sum() * face.width * face.thickness / face.strips
    sim = make(ProbeFace(strips=1), body)
    one = walk(sim, [0.0, 0.0, 1e-4], *down(1e-3))[-1].instruments.probe
    assert one.pressure[0] * face.width * face.thickness == pytest.approx(probe_force, rel=1e-9)


def test_tissue_with_memory_relaxes_under_the_probe():
    terms = split(parse_terms([{'name': 'viscoelasticity', 'g1': 0.4, 'tau1_s': 0.5}], 'test'))
    sim = make(ProbeFace(width=0.03), terms=tuple(terms[Stage.BODY]))
    states = walk(sim, [0.0, 0.0, 1e-4], *down(3e-3), *[[0.0, 0.0, -3e-3]] * 20)
    force = np.array([s.instruments.probe.wrench[2] for s in states])
    assert (np.diff(force[5:]) < 0.0).all()
    assert 0.6 < force[-1] / force[4] < 0.9


def test_the_same_steps_give_the_same_bits():
    def run():
        return walk(make(ProbeFace(width=0.03)), [0.0, 0.0, 1e-4], *down(2e-3),
                    [1e-3, 0.0, -2e-3])[-1]
    one, two = run(), run()
    assert np.array_equal(one.x, two.x)
    assert np.array_equal(one.instruments.probe.wrench, two.instruments.probe.wrench)


def test_an_impossible_push_holds_the_last_state():
    sim = make(ProbeFace(width=0.03))
    good = walk(sim, [0.0, 0.0, 1e-4], *down(2e-3))[-1]
    failed = sim.step(0.5, np.zeros((0, 3)), Tools(probe=(DOWN, MIDDLE - [0.0, 0.0, 0.028])))
    assert not failed.outcome.ok
    assert np.array_equal(failed.x, good.x)
    again = sim.step(0.55, np.zeros((0, 3)), Tools(probe=(DOWN, MIDDLE - [0.0, 0.0, 0.002])))
    assert again.outcome is Outcome.OK


def test_instruments_need_bonded_pads_and_statics():
    with pytest.raises(ConfigError, match='quasi_static'):
        TissueSimulator(make_body(), dynamics='implicit', instruments=Instruments(ProbeFace()))
