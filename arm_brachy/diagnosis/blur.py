"""What the mesh hides: said, lest an error above the noise be read as one that was looked into.

Test: diagnosis/test_blur.py
"""

import numpy as np

from arm_brachy.diagnosis.statements import edge_unit
from arm_brachy.diagnosis.wording import figures, listed
from arm_brachy.diagnosis.words import STREAMS
from arm_brachy.tissue.outlines import crossing

SEEN = 2.0      # times the noise: an error held out, and what meshes differ by, worth a word


def cut_rims(specimen):
    """Sentences on bonded discs of a specimen.Specimen that its mesh holds by another outline."""
    cut = [patch.name for patch in specimen.scene.pads
           if patch.contact == 'bonded' and not patch.set and len(crossing(specimen.mesh, patch))]
    if not cut:
        return ()
    return (f'The mesh cuts across the {"rim" if len(cut) == 1 else "rims"} of {listed(cut)} and '
            'holds the tissue by another outline than the scene says: forces may be off by a '
            'tenth and more, and the modulus with them. `arm-brachy mesh SURFACE MESH --scene '
            'SCENE` makes a mesh that follows the rims of pads.',)


def hidden(ensemble, matched, fits):
    """Sentences on what meshes as good as the model's differ by, where that is above the noise.

    ensemble : mesh_errors.Ensemble;  matched : Matched recordings without causes
    fits : statements.StreamFit on what was held out of them
    """
    errors = [ensemble.along(m.baseline).values for m in matched]
    told = []
    for fit in fits:
        size = _rms([of[fit.stream] for of in errors])
        if min(fit.reached, size) > SEEN * fit.noise_floor:
            unit, scale = edge_unit(fit.stream)
            blur, floor = figures((size / scale, fit.noise_floor / scale))
            told.append(f'{blur} {unit} in the {STREAMS[fit.stream][0]} (noise {floor} {unit})')
    if not told:
        return ()
    return (f'Meshes as good as this one may be off by {listed(told)}. That is allowed for: what '
            'is smaller shows with a finer mesh, or with a recording of the same set-up in which '
            'nothing is wrong (--null).',)


def _rms(columns):
    """Root mean square [SI] per axis of what columns (n, c, 3, k) of one deviation each add to."""
    squares = np.concatenate([np.sum(values**2, axis=3).ravel() for values in columns])
    return float(np.sqrt(np.mean(squares))) if len(squares) else 0.0
