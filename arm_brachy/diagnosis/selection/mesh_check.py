"""Is the mesh at fault? Then that is said, and no physics is read into what it does."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.likelihood.discretisation import SYSTEMATIC
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.selection.problem import stacked_nuisances
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.diagnosis.statistics.linear_gaussian import TO_90, log_density, posterior

# Natural logarithm of the evidence for what a better mesh would change: linear elements 290 to
# 350, 605 quadratic ones 60 to 120, 2275 with another mesh of that size as truth -9 to 9.
AT_FAULT = 20.0
ALLOWED = 10.0      # times its standard deviation, of a mesh that is at fault
# Root mean square, in standard deviations of a single state, that a better mesh must change to be
# worth having: below a half the model is as good as the data.
MATERIAL = 0.5


@dataclass(frozen=True)
class MeshFault:
    """gain : evidence;  error : cause.Estimate [m], rms of the motion a better mesh changes

    share : rms of what it changes in all streams beside what calibration takes up (forces 6 % off
        are another modulus), in standard deviations of a single state
    """

    gain: float
    error: Estimate
    share: float

    @property
    def material(self):
        """True if another mesh is worth it."""
        return self.share >= MATERIAL

    @property
    def note(self):
        """A sentence on a mesh that is good enough."""
        return (f'A finer mesh would change positions by {1e3 * self.error.value:.3f} mm (rms); '
                f'what calibration does not take up of that and of the forces is '
                f'{100 * self.share:.0f} % of what a single state can tell, and is allowed for.')

    def cause(self):
        """The cause.Cause 'discretisation'."""
        return Cause('discretisation', {'error': self.error}, {}, float(
            1.0 / (1.0 + np.exp(-min(self.gain, 700.0)))))


def mesh_fault(matched, physics):
    """MeshFault of Matched recordings of one body, None if the mesh is good enough for them.

    physics : evidence for the best of all causes beside what any mesh may be wrong by: what
        explains more is no fault of the mesh
    If another mesh is worth it, the systematic columns of the nuisances are let go as far as they
    want.
    """
    U, names = stacked_nuisances(matched)
    r, better = np.concatenate([m.r for m in matched]), np.isin(names, SYSTEMATIC)
    gain = log_density(U, r) - log_density(U[:, ~better], r)
    if gain < max(AT_FAULT, physics):
        return None
    U = np.where(better, ALLOWED, 1.0) * U
    fit = posterior(U, r)
    part = np.where(better, fit.mean, 0.0)
    moved, other = U @ part, U[:, ~better]
    left = moved - other @ posterior(other, moved).mean
    found = MeshFault(float(gain), _error(matched, fit, part, moved),
                      float(np.sqrt(np.mean(left**2))))
    if found.material:
        for m in matched:
            m.loosen(SYSTEMATIC, ALLOWED)
    return found


def _error(matched, fit, part, moved):
    """Estimate [m] of the rms over all positions of what the systematic columns explain.

    fit : linear_gaussian.posterior;  part : (k,) of its mean that is theirs;  moved : (N,) by it
    """
    ends = np.cumsum([0, *(len(m.r) for m in matched)])
    plain = np.concatenate([m.observables.coloured(moved[a:b]) for m, a, b in
                            zip(matched, ends[:-1], ends[1:], strict=True)])
    position = np.array([row.kind != FORCE for m in matched for row in m.observables.rows])
    size = float(np.sqrt(np.mean(plain[position]**2)))
    some = np.flatnonzero(part)
    spread = np.sqrt(np.trace(fit.covariance(some)) / max(part @ part, 1e-12))
    reach = min(TO_90 * float(spread), 1.0) * size
    return Estimate(size, size - reach, size + reach)
