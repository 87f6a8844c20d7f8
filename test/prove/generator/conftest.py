"""A small body, on coarse meshes, solved once for all tests."""
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator import body as bodies


@pytest.fixture(scope='session')
def body():
    """Two pads of short strokes, solved in some seconds."""
    drawn = bodies.draw_body(np.random.default_rng(2), 'test')
    pads = tuple(replace(pad, stroke=0.0024) for pad in drawn.pads[:2])
    return replace(drawn, pads=pads, pairs=((0, 1),))


@pytest.fixture(scope='session')
def cache(tmp_path_factory):
    """Folder of solutions, shared by all tests."""
    return tmp_path_factory.mktemp('solutions')


@pytest.fixture(scope='session', autouse=True)
def coarse():
    """Solve all on one coarse mesh."""
    with pytest.MonkeyPatch.context() as patch:
        for options in (*bodies.SOLVERS.values(), bodies.COARSE):
            patch.setitem(options, 'size', 1.6)
            patch.setitem(options, 'turn', 0.55)
        yield
