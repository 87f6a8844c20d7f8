"""Are recordings of what finer elements come to? Then the model is taken to that limit.

Tissue has no elements, and a good simulation has small ones. Where a recording is so, what halving
the elements changes tells by how much the model is off, and little is left that its mesh may hide.
A recording from another coarse mesh is off by something else, and must not be met with claims:
the recordings themselves decide.
Test: diagnosis/forward/test_mesh_limit.py
"""

import numpy as np

from arm_brachy.diagnosis.selection.problem import stacked_nuisances
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density

BORNE_OUT = np.log(20.0)    # natural logarithm of odds, over the mesh as it is


def at_limit(matched, limit):
    """Matched recordings at a discretisation.Limit of their body; None if they contradict it.

    They must be likelier with it than with what may be wrong with the mesh as it is, and likelier
    than with as little as the limit leaves about the mesh as it is.
    """
    if limit is None:
        return None
    finer = [m.at_limit(limit) for m in matched]
    before, after = (stacked_nuisances(some)[0] for some in (matched, finer))
    plain, moved = (np.concatenate([m.r for m in some]) for some in (matched, finer))
    likelier = log_density(after, moved) - max(log_density(before, plain),
                                               log_density(after, plain))
    return finer if likelier > BORNE_OUT else None


def said(matched):
    """A sentence on what the limit adds to Matched recordings at it."""
    moved = max(np.linalg.norm(values, axis=2).max(initial=0.0) for m in matched
                for kind, values in m.finer.items() if kind != FORCE)
    added, whole = (max(np.linalg.norm(one[FORCE], axis=2).max(initial=0.0) for one in some)
                    for some in ([m.finer for m in matched], [m.baseline.shown for m in matched]))
    forces = f' and forces by {100 * added / whole:.1f} %' if whole else ''
    return (f'Finer elements would move points by {1e3 * moved:.3f} mm at most{forces}; the '
            'recordings bear that out, and are compared with it added to the model.')
