"""Statics and small vibrations of a released block against integration in time."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, PointLoad, Region, Scene
from arm_brachy.diagnosis.free_vibration.model import FreeModel, _ringing, free_specimen
from arm_brachy.diagnosis.free_vibration.release import QUIET, _mode
from arm_brachy.evaluation.ringing import ringing
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

SIZE, TIP = (0.06, 0.02, 0.02), (0.06, 0.01, 0.02)     # m


def block(path, gravity=-4.0):
    """A block glued at x = 0 on 60 quadratic tetrahedra, one marker at its tip."""
    mesh = box_mesh(SIZE, (5, 1, 2))
    np.savez(path / 'block.npz', nodes=mesh.nodes, tets=mesh.tets)
    return Scene('block', MeshFile(str(path / 'block.npz')),
                 Region('half_space', point=(1e-6, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
                 material=Material(60e3, 0.47, 1000.0), dynamics='implicit',
                 gravity=(0.0, 0.0, gravity), rayleigh_alpha=2.0, rayleigh_beta=5e-4,
                 markers=(Marker('tip', TIP),))


@pytest.mark.parametrize('terms', [
    pytest.param((), marks=pytest.mark.validate), (Viscoelasticity(g1=0.2, tau1=0.03),)],
                         ids=['elastic', 'relaxing'])
def test_as_integrated_in_time(tmp_path, terms):
    """Swinging by a twentieth of its length; 1.25 ms sample 9 Hz 90 times, an error of 0.04 %.

    A large swing is 0.2 % slower than a small one; damping is told from 1 s of it.
    """
    specimen = free_specimen(block(tmp_path))
    plant = TissueSimulator(specimen.body, terms, dynamics='implicit',
                            options=DynamicOptions(max_step=1.25e-3))
    plant.reset(0.0)
    rider = embed(specimen.mesh, np.array([TIP]), names=['tip'])
    t = np.arange(1, 101) * 0.01
    x = np.array([interpolate(rider, plant.step(now, np.zeros((0, 3))).x)[0] for now in t])
    seen = ringing(t[10:], x[10:])
    said = FreeModel(specimen, terms).swing(np.array([0.6, 1.0]))
    assert said.frequency == pytest.approx(seen.frequency, rel=6e-3)
    assert said.damping == pytest.approx(seen.damping, rel=0.08)
    assert TIP[2] + said.moved[-1, 0, 2] == pytest.approx(seen.offset[2], abs=0.03e-3)
    assert said.moved[-1, 0, 2] < -1e-3


def test_creep_after_the_release_is_that_of_a_relaxing_bar(tmp_path):
    """Compliance of a standard solid: J(t) = J_inf (1 - g exp(-(1 - g) t / tau)), small strain.

    Incompressible and bent: all of the deformation relaxes alike.
    """
    g, tau = 0.3, 1.0
    specimen = free_specimen(block(tmp_path, gravity=-0.5))
    t = np.array([0.5, 1.0, 2.0, 4.0])
    said = FreeModel(specimen, (Viscoelasticity(g1=g, tau1=tau),)).swing(t).moved[:, 0, 2]
    rigid = FreeModel(specimen).swing(t).moved[-1, 0, 2]
    assert said / rigid == pytest.approx(1.0 - g * np.exp(-(1.0 - g) * t / tau), abs=0.015)


def test_a_branch_faster_than_the_swing_damps_and_a_slower_one_stiffens(tmp_path):
    specimen, t = free_specimen(block(tmp_path)), np.array([5.0])
    plain = FreeModel(specimen).swing(t)
    fast = FreeModel(specimen, (Viscoelasticity(g1=0.1, tau1=0.002),)).swing(t)
    slow = FreeModel(specimen, (Viscoelasticity(g1=0.1, tau1=5.0),)).swing(t)
    assert fast.damping > 1.1 * plain.damping and slow.damping < 1.05 * plain.damping
    # 1 / (1 - g) of the modulus that relaxes, but for the little that the volume has of it
    assert (slow.frequency / plain.frequency) ** 2 == pytest.approx(1.0 / 0.9, rel=0.02)
    assert fast.frequency < 1.01 * plain.frequency


def test_damping_by_mass_of_a_weight_at_the_tip(tmp_path):
    """Of a tip mass m on a cantilever of mass M all but 33/140 M / (33/140 M + m) is the weight's
    (Rayleigh's quotient of the static shape).
    """
    scene = block(tmp_path)
    scene = Scene(**{**scene.__dict__, 'rayleigh_beta': 0.0,
                     'loads': (PointLoad('weight', (0.06, 0.01, 0.01), 0.01),)})
    said = FreeModel(free_specimen(scene)).swing(np.array([1.0]))
    own = 33.0 / 140.0 * 1000.0 * float(np.prod(SIZE))
    assert said.carried / said.damping == pytest.approx(0.01 / (0.01 + own), rel=0.03)
    bare = FreeModel(free_specimen(block(tmp_path))).swing(np.array([1.0]))
    assert bare.carried == 0.0


def test_scenes_with_pads_are_refused(tmp_path):
    scene = block(tmp_path)
    pad = PadPatch('pad', (0.03, 0.01, 0.02), (0.0, 0.0, -1.0))
    with pytest.raises(ConfigError, match='pads'):
        free_specimen(Scene(**{**scene.__dict__, 'pads': (pad,)}))


@pytest.mark.parametrize('recorded', [np.inf, 2.0])
@pytest.mark.parametrize('beat', [0.0, 0.05, 0.15, 0.4])
def test_a_mode_beside_passes_for_the_loudest_as_far_as_one_fit_takes_it(beat, recorded):
    """Two modes of 0.05 apart along y and z: the shape is what least squares read from both.

    Whether it is quiet before the recording ends or not.
    """
    w = np.array([16.0, 16.0 * (1.0 - beat)])
    ratios, sizes = np.array([0.04, 0.035]), np.array([1.0, 0.05])
    shapes = np.zeros((1, 3, 2))
    shapes[0, 2, 0], shapes[0, 1, 1] = sizes
    t = np.arange(0.0, 8.0, 0.01)
    s = np.stack([np.zeros_like(t), *(
        size * np.exp(-r * v * t) * np.cos(v * t)
        for size, r, v in zip(sizes[::-1], ratios[::-1], w[::-1], strict=True))], axis=1)
    begin = 2.0 * np.pi / w[0]
    lasts = min(-np.log(QUIET) / (w[0] * ratios[0]), recorded)
    way = np.array([[0.0, 0.0, 1.0]])
    frequency, damping, shape, size, left = _mode(t, s, begin, begin + lasts,
                                                  (w[0] / 6.0, 0.05), way)
    said = _ringing(w, np.stack([ratios, 0.0 * ratios]), shapes, way, recorded)
    assert said[0] == pytest.approx(frequency, rel=3e-3)
    assert said[1][0] == pytest.approx(damping, rel=0.01)
    assert said[2] == pytest.approx(shape, abs=3e-3)
    assert said[3] == pytest.approx(left / (size / np.sqrt(3.0)), rel=0.3, abs=1e-3)
