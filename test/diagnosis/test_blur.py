"""What is said of a mesh that hides something."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.blur import cut_rims, hidden
from arm_brachy.diagnosis.specimen import specimen_of
from arm_brachy.diagnosis.statements import StreamFit
from arm_brachy.tissue.meshing import mesh_surface

SCENES = share_dir() / 'config/scenes'


def test_a_mesh_of_the_surface_alone_cuts_rims_that_the_scenes_own_follows():
    scene = load_scene(SCENES / 'breast.yaml')
    assert cut_rims(specimen_of(scene)) == ()
    plain, _ = mesh_surface(SCENES / 'breast/breast.stl', edge_length=0.015)
    said, = cut_rims(specimen_of(scene, plain))
    assert all(pad.name in said for pad in scene.pads) and '--scene' in said


@pytest.mark.parametrize(('off', 'error', 'told'), [(1e-4, 1e-4, True), (1e-4, 2e-5, False),
                                                    (2e-5, 1e-4, False)])
def test_an_error_above_the_noise_that_meshes_may_make_is_told(off, error, told):
    """Two columns of `off` / sqrt 2 in all channels: a deviation of `off`; noise of 20 um."""
    columns = np.full((4, 3, 3, 2), off / np.sqrt(2.0))
    ensemble = SimpleNamespace(along=lambda baseline: SimpleNamespace(values={'optical': columns}))
    said = hidden(ensemble, (SimpleNamespace(baseline=None),),
                  (StreamFit('optical', 1.0, error, 2e-5),))
    assert len(said) == told
    assert all('0.100 mm in the optical markers (noise 0.020 mm)' in one for one in said)
