"""Force sensors that were zeroed with the weight of the body on them.

A scene with gravity presses its pads at rest; a laboratory may zero its cells before the body is
there, or after. Readings near zero at rest then say nothing of the weight.
Test: diagnosis/forward/test_tared.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import FORCE, components

NEAR = 0.25     # of what the weight presses with, that is read of it by cells zeroed under it
LARGE = 3.0     # tolerances of a zero, for a weight to be told from it


def tared(measured, rest, least, specimen, calibration):
    """What the weight presses with (p, 3) [N] if cells were zeroed under it; None if not.

    measured : observation.Measured each;  rest : (p, 3) [N] of the model with the pads at home
    least : number of the state that this is;  specimen : specimen.Specimen
    Nothing where its scene has no gravity: what else presses at rest is a cause, or an error.
    """
    force = next((one for one in measured if one.kind == FORCE), None)
    if force is None or not any(specimen.scene.gravity):
        return None
    there = [specimen.pads.index(name) for name in force.names]
    weight = components(rest[there], force.along)[force.valid[least]]
    read = force.values[least][force.valid[least]]
    zero = (calibration or Calibration()).force_zero
    large = weight.size and np.abs(weight).max() > LARGE * zero
    return rest if large and np.linalg.norm(read) < NEAR * np.linalg.norm(weight) else None


def loosened(calibration, weight):
    """The finding.Calibration of cells that know no zero to better than a weight (p, 3) [N]."""
    return replace(calibration or Calibration(), force_zero=float(np.abs(weight).max()))


def note(name, weight):
    """What is told of a recording whose cells were zeroed under a weight (p, 3) [N]."""
    return (f'{name}: at rest its force sensors read next to nothing of the '
            f'{np.linalg.norm(weight, axis=1).max():.2g} N with which the weight of the scene '
            'presses: they are taken to have been zeroed under it.')
