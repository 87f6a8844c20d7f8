"""A small soft block with two pads, markers and targets: seconds to build."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.tissue.box import box_mesh


@pytest.fixture(scope='session')
def block(tmp_path_factory):
    """Scene of a block 60 x 80 x 60 mm on a fixed base, its markers and its targets."""
    file = tmp_path_factory.mktemp('block') / 'block.npz'
    mesh = box_mesh((0.06, 0.08, 0.06), (3, 4, 4))
    np.savez(file, nodes=mesh.nodes, tets=mesh.tets)
    pads = tuple(PadPatch(name, centre=centre, direction=direction, radius=0.0205, stroke=0.01)
                 for name, centre, direction in (
                     ('left', (0.0, 0.04, 0.03), (1.0, 0.0, 0.0)),
                     ('right', (0.06, 0.04, 0.03), (-1.0, 0.0, 0.0))))
    markers = tuple(Marker(f'm{i}{j}', (0.01 + 0.02 * i, 0.02 + 0.04 * j, 0.06))
                    for i in range(3) for j in range(2))
    targets = (Target('middle', (0.03, 0.04, 0.03)), Target('aside', (0.02, 0.045, 0.025)))
    scene = Scene('block', MeshFile(str(file)), Region('box', low=(-1.0, -1.0, -1.0),
                                                       high=(1.0, 1.0, 1e-6)),
                  material=Material(nu=0.45), pads=pads, markers=markers, targets=targets)
    return SimpleNamespace(scene=scene, markers=tuple(m.name for m in markers),
                           targets=tuple(t.name for t in targets), replace=replace)
