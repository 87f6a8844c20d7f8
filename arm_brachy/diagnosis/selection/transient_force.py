"""A force that acted for a while, looked for beside the model: what sets in slowly has no step.

Steps in what was recorded say when something began suddenly (`steps`). Somebody who leans on the
body in the middle of a push sets in over a quarter of a second, and what plain histories leave of
pushes hides it. Here every span of states of every recording is tried, at every place of the
surface, by its first-order response beside all nuisances; the likeliest span becomes one more
window in which to look for what passes (`candidates.Occasions`).
Test: diagnosis/test_passing.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.diagnosis.isolation.handover import Occasions
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.selection.candidates import candidates
from arm_brachy.tissue.assembly import InvertedElement
from arm_brachy.tissue.terms.external_force import ExternalForce

SHORTEST = 2        # states that a span has at least: one alone is an outlier
EVERY = 2           # of the places: beside one that is left out there is another
# nats by which it has to be likelier than the best of all other causes: a free span and place
# bend to much of what others do
AHEAD = 10.0


@dataclass(frozen=True)
class Passing:
    """number : of the recording;  start, end : [s];  evidence : [nats], the search paid for"""

    number: int
    start: float
    end: float
    evidence: float

    @property
    def occasions(self):
        """candidates.Occasions of the span, in that recording alone or in all."""
        return Occasions(onsets=(self.start,), windows=((self.start, self.end),),
                         owners={('onset', self.start): (self.number,)})


def passing(assembly, best):
    """Return the Passing of an problem.Assembly that stands out; None if none does.

    best : evidence [nats] of the likeliest of all that was tried
    """
    suspects = assembly.matched[:len(assembly.matched) - assembly.sound]
    U, r = assembly.problem.U, assembly.problem.r
    lower = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    left = r - U @ cho_solve((lower, True), U.T @ r)
    found, first, tried = [], 0, 0
    for number, m in enumerate(suspects):
        rows = slice(first, first + len(m.r))
        first = rows.stop
        for columns in _columns(m):
            taken = solve_triangular(lower, U[rows].T @ columns, lower=True)
            gram = columns.T @ columns - taken.T @ taken
            gain, spans = _gains(gram, columns.T @ left[rows])
            tried += len(gain)
            k = int(np.argmax(gain))
            found.append(Passing(number, *_times(m.recorded.states.t, *spans[k]),
                                 float(gain[k])))
    if not found:
        return None
    top = max(found, key=lambda one: one.evidence)
    evidence = top.evidence - float(np.log(tried))
    if evidence < max(best, 0.0) + AHEAD:
        return None
    return Passing(top.number, top.start, top.end, evidence)


def _columns(m):
    """(N, s, 3) flat: whitened, what a force at one place does in each of s states alone; each."""
    t = m.recorded.states.t
    if len(t) < SHORTEST:
        return
    ever = Occasions(windows=((0.0, float(t[-1]) + 1.0),))
    for one in candidates(ExternalForce, m.baseline.model.specimen, ever)[::EVERY]:
        try:
            values = respond(m.baseline, one).per_prior()
        except (InputError, InvertedElement, NotConverged):
            continue
        if all(np.isfinite(part).all() for part in values.values()):
            yield m.observables.whiten({kind: _apart(part) for kind, part in values.items()})


def _apart(values):
    """(s, c, 3, s k) of values (s, c, 3, k): those of every state alone."""
    s, c, axes, k = values.shape
    out = np.zeros((s, c, axes, s, k))
    out[np.arange(s), :, :, np.arange(s)] = values
    return out.reshape(s, c, axes, s * k)


def _gains(gram, match):
    """(log evidence (w,) of a force of unit prior in every span, spans [(first, last + 1)]).

    gram : (3 s, 3 s), match : (3 s,) of columns of single states, what is no cause taken out
    """
    s = len(match) // 3
    total = np.zeros((s + 1, s + 1, 3, 3))
    total[1:, 1:] = gram.reshape(s, 3, s, 3).transpose(0, 2, 1, 3).cumsum(0).cumsum(1)
    sums = np.vstack([np.zeros(3), match.reshape(s, 3).cumsum(0)])
    a, b = (np.array(part) for part in zip(*[
        (i, j) for i in range(s) for j in range(i + SHORTEST, s + 1)], strict=True))
    own = np.eye(3) + total[b, b] - total[a, b] - total[b, a] + total[a, a]
    along = sums[b] - sums[a]
    gain = np.einsum('wi,wi->w', along, np.linalg.solve(own, along[..., None])[..., 0])
    return 0.5 * (gain - np.linalg.slogdet(own)[1]), list(zip(a.tolist(), b.tolist(),
                                                              strict=True))


def _times(t, first, stop):
    """(start, end) [s] half way to the states beside a span."""
    before = t[first - 1] if first else t[0] - 1.0
    after = t[stop] if stop < len(t) else t[-1] + 1.0
    return max(float(0.5 * (before + t[first])), 0.0), float(0.5 * (t[stop - 1] + after))
