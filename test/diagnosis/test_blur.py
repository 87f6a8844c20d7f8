"""What is said of a mesh that hides something."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.mesh_notes import cut_rims, with_mesh
from arm_brachy.diagnosis.results.parts import StreamFit
from arm_brachy.tissue.meshing import mesh_surface
from arm_brachy.tissue.rims import frame

SCENES = share_dir() / 'config/scenes'


def test_a_mesh_of_the_surface_alone_cuts_rims_that_the_scenes_own_follows():
    scene = load_scene(SCENES / 'breast.yaml')
    assert cut_rims(specimen_of(scene)) == ()
    plain, _ = mesh_surface(SCENES / 'breast/breast.stl', edge_length=0.015)
    said, = cut_rims(specimen_of(scene, plain))
    assert all(pad.name in said for pad in scene.pads) and '--scene' in said


@pytest.mark.parametrize(('off', 'cut'), [(1e-5, False), (5e-4, False), (3e-3, True), (0.1, True)])
def test_a_scene_that_was_rounded_after_its_mesh_was_made_has_no_cut_rim(off, cut):
    """Pads aside by parts of their radius: where no rim is cut all of its nodes are held."""
    scene = load_scene(SCENES / 'breast.yaml')
    aside = replace(scene, pads=tuple(
        replace(pad, centre=tuple(np.add(pad.centre, off * pad.radius * frame(pad)[2][0])))
        for pad in scene.pads))
    plain, found = specimen_of(scene), specimen_of(aside)
    assert bool(cut_rims(found)) is cut
    assert cut is not all(np.array_equal(one.nodes, other.nodes) for one, other in zip(
        plain.body.pads, found.body.pads, strict=True))


def test_what_the_mesh_may_be_wrong_by_is_told_beside_the_noise():
    """Two columns of 100 um / sqrt 2 in all channels: a deviation of 100 um."""
    columns = np.full((4, 3, 3, 2), 1e-4 / np.sqrt(2.0))
    ensemble = SimpleNamespace(along=lambda baseline: SimpleNamespace(values={'optical': columns}))
    fit, = with_mesh((StreamFit('optical', 1.0, 1e-4, 2e-5),), ensemble,
                     (SimpleNamespace(baseline=None),))
    assert fit.mesh == pytest.approx(1e-4, rel=1e-12) and fit.blurred


@pytest.mark.parametrize(('mesh', 'error', 'blurred'), [
    (1e-4, 1e-4, True), (1e-4, 2e-5, False), (2e-5, 1e-4, False), (None, 1e-4, False)])
def test_a_sentence_does_not_call_nothing_what_the_mesh_may_hide(mesh, error, blurred):
    """Noise of 20 um: an error well above it that the mesh may make is no clean bill."""
    fit = StreamFit('optical', 1.0, error, 2e-5, mesh=mesh)
    said = sentences.verdict(SimpleNamespace(verdict='nothing_missing', fit=(fit,)))
    assert ('that this mesh lets show' in said) == blurred
    assert ('mesh: up to 0.100 mm' in said) == blurred
