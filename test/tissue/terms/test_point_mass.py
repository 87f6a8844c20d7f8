"""A weight at a point against a cantilever of Euler and Bernoulli, and against a scene's load."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError, MeshError
from arm_brachy.core.scene import Marker, Material, MeshFile, PointLoad, Region, Scene
from arm_brachy.diagnosis.free_vibration.model import FreeModel, free_specimen
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.point_mass import PointMass

E, DENSITY, GRAVITY = 2e5, 1e3, 0.02     # so little of it that all stays linear
LENGTH, SIDE = 0.1, 0.01
I = SIDE**4 / 12.0  # noqa: E741  (the letter of the textbook)
TIP = (LENGTH, 0.5 * SIDE, 0.5 * SIDE)
MASS = 5e-3         # half that of the beam


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    """A slender beam along x, clamped at x = 0, no Poisson effect."""
    path = tmp_path_factory.mktemp('beam') / 'beam.npz'
    mesh = box_mesh((LENGTH, SIDE, SIDE), (20, 2, 2))
    np.savez(path, nodes=mesh.nodes, tets=mesh.tets)
    return Scene('beam', MeshFile(str(path)),
                 Region('half_space', point=(1e-6, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
                 material=Material(E, 0.0, DENSITY), dynamics='implicit',
                 gravity=(0.0, 0.0, -GRAVITY), markers=(Marker('tip', TIP),))


def swing(scene, *terms):
    return FreeModel(free_specimen(scene), terms).swing(np.array([1.0]))


def test_a_tip_weight_bends_a_cantilever(scene):
    """By m g L^3 / 3 E I, beside its own weight."""
    down = swing(scene, PointMass(MASS, TIP)).moved[0, 0, 2] - swing(scene).moved[0, 0, 2]
    assert down == pytest.approx(-MASS * GRAVITY * LENGTH**3 / (3.0 * E * I), rel=0.02)


def test_a_tip_mass_slows_a_cantilever(scene):
    """Rayleigh: w^2 = 3 E I / ((m + 33/140 of the beam) L^3)."""
    beam = DENSITY * SIDE**2 * LENGTH
    w = np.sqrt(3.0 * E * I / ((MASS + 33.0 / 140.0 * beam) * LENGTH**3))
    found = swing(scene, PointMass(MASS, TIP)).frequency
    assert 2.0 * np.pi * found == pytest.approx(w, rel=0.02)


def test_it_is_a_load_of_the_scene(scene):
    load = PointLoad('weight', TIP, MASS)
    given, added = build_body(replace(scene, loads=(load,))), PointMass(MASS, TIP)
    np.testing.assert_array_equal(added.prepare(build_body(scene)).nodal_mass, given.nodal_mass)
    gone = PointMass(-MASS, TIP).prepare(given)
    np.testing.assert_allclose(gone.nodal_mass, 0.0, atol=1e-18)


def test_the_clamp_bears_its_weight_whatever_gravity_is(scene):
    body = build_body(replace(scene, gravity=(0.0, 0.0, 0.0)))
    simulator = TissueSimulator(body, (Gravity((0.0, 0.0, -GRAVITY)), PointMass(MASS, TIP)))
    x = simulator.settle().x
    borne = Assembler(simulator.body).forces(x)[body.fixed].sum(axis=0)
    total = MASS + DENSITY * SIDE**2 * LENGTH
    np.testing.assert_allclose(borne, [0.0, 0.0, total * GRAVITY], atol=1e-3 * MASS * GRAVITY)


def test_at_rest_without_gravity_it_is_not_there(scene):
    body = build_body(replace(scene, gravity=(0.0, 0.0, 0.0)))
    x = TissueSimulator(body, (PointMass(MASS, TIP),)).settle().x
    np.testing.assert_allclose(x, body.mesh.nodes, atol=1e-12)


def test_more_than_hangs_there_cannot_be_taken_away(scene):
    with pytest.raises(ConfigError, match='more than nothing'):
        PointMass(-MASS, TIP).prepare(build_body(scene))


def test_it_must_hang_on_the_body(scene):
    with pytest.raises(MeshError, match='point_mass'):
        PointMass(MASS, (0.5, 0.0, 0.0)).prepare(build_body(scene))
