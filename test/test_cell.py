"""Body: what a term changes about the tissue at rest, markers, targets and pads take part in."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.cell import Body
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.tissue.terms.reference_shape import ReferenceShape

TALLER = ReferenceShape(height=0.03)


@pytest.fixture(scope='module')
def scene():
    """The breast with linear elements: what rides on it does not depend on their order."""
    given = load_scene(share_dir() / 'config' / 'scenes' / 'breast.yaml')
    return dataclasses.replace(given, element='linear')


def rest_points(scene, *terms):
    """Names and positions (k, 3) [m] of markers and targets with the pads at zero."""
    reading = Body(scene, terms).step(0.0, np.zeros(len(scene.pads)))
    return reading.names, reading.points


def test_points_sit_on_the_true_shape(scene):
    """Three per cent more height at rest for tissue and pads; the base plate stays."""
    (names, plain), (_, taller) = rest_points(scene), rest_points(scene, TALLER)
    carriers = {m.name: m.body for m in scene.markers}
    pads = {p.name: p.centre for p in scene.pads}
    for name, before, after in zip(names, plain, taller, strict=True):
        carrier = carriers.get(name, 'tissue')
        if carrier == 'base':
            expected = before
        elif carrier == 'tissue':
            expected = before * [1.0, 1.0, 1.03]
        else:  # as much as the centre of the pad
            expected = before + [0.0, 0.0, 0.03 * pads[carrier][2]]
        # the mesh's base is plane to 1e-3, and so is its normal: 3 % of that at 60 mm
        np.testing.assert_allclose(after, expected, rtol=0.0, atol=2e-6, err_msg=name)


def test_model_and_plant_of_one_shape_agree_on_targets(scene):
    model, (names, points) = TissueModel(scene, (TALLER,)), rest_points(scene, TALLER)
    for target in scene.targets:
        np.testing.assert_allclose(model.rest(target.name), points[names.index(target.name)],
                                   rtol=0.0, atol=1e-8)
