"""A needle as a beam: closed forms of cantilever and elastic foundation, then in a block."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.outcome import Outcome
from arm_brachy.devices.needle import NeedleForce, NeedleParams
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.instruments import Instruments, Tools
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh
from arm_brachy.tissue.needle_beam import SPACING, Anchor, Bent, NeedleBeam, Sideways
from arm_brachy.tissue.needle_path import NeedleInTissue
from arm_brachy.tissue.probe_face import ProbeFace
from arm_brachy.tissue.simulator import TissueSimulator

EI = 0.02
ALONG = np.array([1.0, 0.0, 0.0])


def test_a_cantilever_sags_as_the_closed_forms_say():
    """Force at the end: F L^3 / 3 EI; even load q: q L^4 / 8 EI, slope q L^3 / 6 EI at the end."""
    beam, L = NeedleBeam(EI, 1.0), 0.1
    end = beam.flexibility(np.array([L]), np.array([L]))[0, 0]
    assert end == pytest.approx(L**3 / (3.0 * EI), rel=1e-12)
    n = 4000
    at = (np.arange(n) + 0.5) / n * L
    q = np.full(n, 1.0 * L / n)
    two = beam.flexibility(np.array([L, L - 1e-5]), at) @ q
    assert two[0] == pytest.approx(L**4 / (8.0 * EI), rel=1e-6)
    assert (two[0] - two[1]) / 1e-5 == pytest.approx(L**3 / (6.0 * EI), rel=1e-3)
    # Maxwell's reciprocity
    B = beam.flexibility(at[::500], at[::500])
    np.testing.assert_allclose(B, B.T, rtol=1e-14)


def foundation(length, spread, k):
    """(m,) deflection at anchors of a shaft whose foundation has moved by `spread` (m,)."""
    s = SPACING * np.arange(1, round(length / SPACING) + 1)
    across = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    anchors = tuple(Anchor(float(at), np.array([i]), np.ones(1), across, np.zeros(3))
                    for i, at in enumerate(s))
    path = NeedleInTissue(np.linspace(0.0, length, 3)[:, None] * ALONG, length)
    side = Sideways(Bent(NeedleBeam(EI, k), anchors, np.zeros((len(s), 2))), path)
    y = s[:, None] * ALONG + np.outer(spread(s), [0.0, 1.0, 0.0])
    rigid = np.zeros((2 * len(s), 2 * len(s)))      # the foundation goes where it goes
    force = side.balanced(side.moved(y), rigid, np.zeros(2 * len(s)))
    return s, side.after(force).deflection(s)[:, 1], force[::2]


def test_a_shaft_in_a_foundation_that_steps_aside_bends_as_hetenyi_says():
    """Ground that moves by v beyond a plane, far from either end of a long beam.

    Hetenyi 1946, Beams on elastic foundation, ch. 2: half of v in the plane, and off it by
    1/2 e^(-b x) cos(b x) of v, b^4 = k / 4 EI.
    """
    k, v, plane = 3e4, 2e-3, 0.3
    b = (k / (4.0 * EI)) ** 0.25
    s, w, _ = foundation(0.6, lambda at: np.where(at > plane + 1e-6, v, 0.0), k)
    x = s - (plane + 0.5 * SPACING)     # anchors stand for a spacing each
    wanted = np.where(x > 0.0, v, 0.0) - 0.5 * v * np.sign(x) * np.exp(-b * np.abs(x)) * np.cos(
        b * x)
    near = np.abs(x) < 0.15
    np.testing.assert_allclose(w[near], wanted[near], atol=0.01 * v)


def test_a_stiff_shaft_stays_and_a_slack_one_goes_along():
    moved = lambda at: np.full(len(at), 1e-3)                           # noqa: E731
    for rigidity, stays in ((1e6, True), (1e-9, False)):
        s = SPACING * np.arange(1, 9)
        across = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        anchors = tuple(Anchor(float(at), np.array([i]), np.ones(1), across, np.zeros(3))
                        for i, at in enumerate(s))
        path = NeedleInTissue(np.linspace(0.0, 0.04, 3)[:, None] * ALONG, 0.04)
        side = Sideways(Bent(NeedleBeam(rigidity, 1e4), anchors, np.zeros((8, 2))), path)
        y = s[:, None] * ALONG + np.outer(moved(s), [0.0, 1.0, 0.0])
        force = side.balanced(side.moved(y), np.zeros((16, 16)), np.zeros(16))
        w = side.after(force).deflection(s)[:, 1]
        if stays:
            np.testing.assert_allclose(w, 0.0, atol=1e-8)
            np.testing.assert_allclose(force[::2], 1e4 * SPACING * 1e-3, rtol=1e-4)
        else:
            np.testing.assert_allclose(w, 1e-3, rtol=0.02)
            assert np.abs(force).max() < 1e-3


PARAMS = NeedleParams()
TEMPLATE = np.array([-0.01, 0.031, 0.021])


def make_body():
    mesh = quadratic_mesh(box_mesh((0.06, 0.06, 0.04), (5, 5, 4)))
    mu, kappa = moduli(6000.0, 0.45)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'])


def needle(depth):
    return NeedleInTissue(TEMPLATE + np.linspace(0.0, depth, 41)[:, None] * ALONG, depth)


class Run:
    """A block with a needle in it, then a probe that comes down on it."""

    R = np.diag([1.0, -1.0, -1.0])

    def __init__(self, beam, params=PARAMS):
        law = NeedleForce(params)
        self.sim = TissueSimulator(make_body(), instruments=Instruments(ProbeFace(), law, beam))
        self.beside = embed(self.sim.body.mesh, [[0.03, 0.031, 0.021]])
        self.t, self.depth, self.state = 0.0, 0.0, self.sim.state
        for depth in np.arange(0.008, 0.05, 0.002):
            self.to(depth)

    def to(self, depth, indent=None):
        self.t, self.depth = self.t + 0.05, depth
        probe = None if indent is None else (self.R, np.array([0.03, 0.03, 0.04 - indent]))
        self.state = self.sim.step(self.t, np.zeros((0, 3)), Tools(probe, needle(depth)))
        assert self.state.outcome is Outcome.OK
        return self

    def press(self, indent=4e-3):
        for way in np.arange(0.0, indent + 1e-9, 1e-3):
            self.to(self.depth, way)
        return self

    @property
    def bent(self):
        return self.sim._native.bent

    @property
    def sag(self):
        """m down of the tip, of tissue beside the middle of the shaft."""
        tip = needle(self.depth).points[-1] - self.state.instruments.shaft[-1]
        there = interpolate(self.beside, self.sim.body.mesh.nodes) - interpolate(
            self.beside, self.state.x)
        return tip[2], there[0, 2]

    def unbalanced(self):
        """Sum (3,) [N] of what holds the block, what the probe and what the needle do to it."""
        assembler = self.sim._integrator.statics.assembler
        held = assembler.forces(self.state.x)[self.sim.body.fixed].sum(axis=0)
        across = np.array([a.across for a in self.bent.anchors])
        needle_on = -np.einsum('md,mdi->i', self.bent.force, across)
        felt = self.state.instruments
        return held + needle_on + ALONG * felt.needle_force - felt.probe.wrench[:3]


def test_a_needle_gets_anchors_where_it_is_in_the_tissue_and_feels_nothing_unless_it_moves():
    run = Run(NeedleBeam(EI, 14e3))
    s = np.array([a.s for a in run.bent.anchors])
    np.testing.assert_allclose(s, SPACING * np.arange(3, 10))   # the skin is 10 mm away
    assert np.abs(run.sag[0]) < 1e-4         # what the pull along it moves sideways
    assert not Run(None).bent


def test_a_probe_bends_the_needle_and_the_needle_holds_the_tissue_back():
    smooth = replace(PARAMS, cutting=0.0, coulomb=0.0, viscous=0.0, static=0.0)
    slack, usual, stiff = (Run(NeedleBeam(rigidity, 14e3), smooth).press()
                           for rigidity in (1e-7, EI, 1e3))
    none = Run(None, smooth).press()
    tip, there = np.array([run.sag for run in (slack, usual, stiff)]).T
    assert tip[0] > tip[1] > 0.2e-3 and abs(tip[2]) < 1e-6
    assert none.sag[1] > there[1] > there[2] > 0.0
    assert there[0] == pytest.approx(none.sag[1], rel=0.02)
    for run in (slack, usual, stiff):
        np.testing.assert_allclose(run.unbalanced(), 0.0, atol=2e-3)
    # across the shaft: k l (tissue - shaft) at every anchor, to the solver's tolerance of 1 um
    bent, x = usual.bent, usual.state.x
    s = np.array([a.s for a in bent.anchors])
    way = np.array([a.place(x) for a in bent.anchors]) - (TEMPLATE + s[:, None] * ALONG)
    gap = np.einsum('mdi,mi->md', [a.across for a in bent.anchors], way - bent.deflection(s))
    np.testing.assert_allclose(bent.force, 14e3 * SPACING * gap, atol=14e3 * SPACING * 3e-6)


def test_a_needle_that_leaves_lets_go_of_what_it_leaves():
    run = Run(NeedleBeam(EI, 14e3)).press()
    before = len(run.bent.anchors)
    run.to(run.depth - 0.011, 4e-3)
    assert len(run.bent.anchors) == before - 2
    for depth in np.arange(run.depth - 3e-3, 3e-3, -3e-3):
        run.to(depth, 4e-3)
    assert not run.bent.anchors
    gone = Run(None).press()
    for depth in np.arange(gone.depth - 3e-3, 3e-3, -3e-3):
        gone.to(depth, 4e-3)
    assert run.sag[1] == pytest.approx(gone.sag[1], abs=2e-5)


def test_a_bent_needle_cuts_on_where_it_points():
    """New anchors are where the tip is, not where the path would have led it: no force there."""
    run = Run(NeedleBeam(EI, 14e3)).press()
    old = len(run.bent.anchors)
    run.to(run.depth + 0.006, 4e-3)
    assert len(run.bent.anchors) == old + 1
    np.testing.assert_allclose(run.bent.force[-1], 0.0, atol=1e-12)
    sag = needle(run.depth).points[:, 2] - run.state.instruments.shaft[:, 2]
    assert sag[-1] > sag[-8] > 0.2e-3
    np.testing.assert_allclose(np.diff(sag[-5:]), np.diff(sag[-5:])[0], rtol=1e-6)  # straight


def test_the_same_needle_gives_the_same_bits():
    one, two = (Run(NeedleBeam(EI, 14e3)).press(2e-3) for _ in range(2))
    assert np.array_equal(one.state.x, two.state.x)
    assert np.array_equal(one.state.instruments.shaft, two.state.instruments.shaft)
