"""What the mesh hides: said, lest an error above the noise be read as one that was looked into.

Test: diagnosis/test_blur.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.results.formatting import listed
from arm_brachy.tissue.scene_check import cut

FINER = ('What the mesh may be wrong by is allowed for: what is smaller shows with a finer mesh, '
         'or with a recording of the same set-up in which nothing is wrong (--null).')


def cut_rims(specimen):
    """Sentences on bonded discs of a specimen.Specimen that its mesh holds by another outline."""
    across = [patch.name for patch in specimen.scene.pads
              if patch.contact == 'bonded' and not patch.set and cut(specimen.mesh, patch)]
    if not across:
        return ()
    return (f'The mesh cuts across the {"rim" if len(across) == 1 else "rims"} of '
            f'{listed(across)} and holds the tissue by another outline than the scene says: '
            'forces may be off by a tenth and more, and the modulus with them. `arm-brachy mesh '
            'SURFACE MESH --scene SCENE` makes a mesh that follows the rims of pads.',)


def with_mesh(fits, ensemble, matched):
    """Return parts.StreamFit with what the mesh may be wrong by.

    ensemble : discretisation.Ensemble;  matched : Matched recordings, without causes
    """
    errors = [ensemble.along(m.baseline).values for m in matched]
    return tuple(replace(fit, mesh=_rms([of[fit.stream] for of in errors])) for fit in fits)


def _rms(columns):
    """Root mean square [SI] per axis of what columns (n, c, 3, k) of one deviation each add to."""
    squares = np.concatenate([np.sum(values**2, axis=3).ravel() for values in columns])
    return float(np.sqrt(np.mean(squares))) if len(squares) else 0.0
