"""What recordings in which nothing is wrong say of a set-up, handed on to full fits of others.

With z the nuisances that all recordings share, z ~ N(0, I) before any, nulls leave z ~ N(m, S S').
Whatever is fitted to another recording then stands beside U S instead of U, and its residual is
less U m: the same density as of all recordings together, without running the nulls' model again.
Test: diagnosis/forward/test_beside_nulls.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky

from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.nuisances import MODULUS
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior


@dataclass(frozen=True)
class SetUp:
    """Nuisances that recordings share, in prior standard deviations: mean + spread z, z ~ N(0, I).

    names : k, errors of the mesh last, one name for many;  mean : (k,)
    spread : (k, k) lower triangular, so that what is known of the mesh alone stays apart
    """

    names: tuple
    mean: np.ndarray
    spread: np.ndarray

    def put_right(self, m):
        """The Matched of another recording with it known."""
        names, values = np.array(m.nuisances.names), dict(m.nuisances.values)
        which = _mesh_last(np.flatnonzero(np.isin(names, self.names)), names)
        of_mesh = np.isin(self.names, NAMES)
        shift = {kind: v[..., which] for kind, v in values.items()}
        for kind, part in shift.items():
            values[kind] = v = values[kind].copy()
            v[..., which] = part @ self.spread
        return replace(
            m, nuisances=replace(m.nuisances, values=values),
            observables=m.observables.less(_times(shift, np.where(of_mesh, 0.0, self.mean))),
            finer=_sum(m.finer, _times(shift, np.where(of_mesh, self.mean, 0.0))))


def set_up_of(nulls, U, names):
    """The SetUp by Matched recordings in which nothing is wrong.

    U (N, k), names : as of `problem.stacked_nuisances`, shared ones last
    The modulus is not handed on: tissue dries, warms and is cast anew.
    """
    own = sum(np.count_nonzero(m.own) for m in nulls)
    shared = _mesh_last([i for i in range(own, len(names)) if names[i] != MODULUS], names)
    known = posterior(U, np.concatenate([m.r for m in nulls]))
    return SetUp(tuple(names[i] for i in shared), known.mean[shared],
                 cholesky(known.covariance(shared), lower=True))


def _mesh_last(columns, names):
    """Numbers of columns in order, those that the names say are errors of the mesh last."""
    return sorted(columns, key=lambda i: names[i] in NAMES)


def _times(shift, mean):
    return {kind: values @ mean for kind, values in shift.items()}


def _sum(one, other):
    return {kind: one[kind] + values if kind in one else values for kind, values in other.items()}
