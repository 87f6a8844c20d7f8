"""When a cause shows: stretches of the recordings and what was being done in them."""

import numpy as np

from arm_brachy.diagnosis.results.parts import Interval
from arm_brachy.evaluation.regimes import HOLD, LOAD, REST, UNLOAD

SHARE = 0.3      # of the largest effect: less is not shown as an interval
BESIDES = 0.6    # correlation with a regime below which an effect shows in none in particular
NEAR = 3.0       # s: stretches closer than that are one
MANY = 3         # stretches; what shows in more shows from the first to the last


def shown_in(matched, rows):
    """(n,) size of an effect at every state: root mean square of its whitened rows (N,)."""
    states, n = matched.observables.states, len(matched.recorded.states.t)
    power = np.bincount(states, np.square(rows), minlength=n)
    return np.sqrt(power / np.maximum(np.bincount(states, minlength=n), 1))


def intervals(matched, size, *, term='', onset=None):
    """statements.Interval each in which an effect of `size` (n,) shows; a tuple, largest first.

    onset : (low, high) [s] of a sudden beginning, None = not known: what shows in the first state
        after it shows from then on;  term : of the cause, '' = not known
    """
    states = matched.recorded.states
    if not size.max(initial=0.0) > 0.0:
        return ()
    regime, strong = regime_of(states, size), np.flatnonzero(size >= SHARE * size.max())
    cuts = np.flatnonzero(np.diff(states.t[strong]) > NEAR) + 1
    runs = np.split(strong, cuts)
    if len(runs) > MANY:
        runs = [strong]
    runs.sort(key=lambda run: -size[run].max())
    half = 0.5 * states.width
    out = []
    for run in runs:
        begun = onset if onset and run[0] == np.searchsorted(states.t, onset[0]) else None
        start = begun[0] if begun else states.t[run[0]] - half[run[0]]
        out.append(Interval(matched.recorded.name, float(start),
                            float(states.t[run[-1]] + half[run[-1]]), regime, begun, term))
    return tuple(out)


def regime_of(states, size):
    """In which regime an effect of `size` (n,) shows more than in others; '' = in none."""
    features = _features(states)
    scores = {name: _correlation(values, size) for name, values in features.items()}
    best = max(scores, key=scores.get)
    return best if scores[best] >= BESIDES else ''


def _features(states):
    labels, depth = states.labels, states.q.max(axis=1, initial=0.0)
    speed = np.where(labels.direction != 0, labels.speed, 0.0)
    return {'amplitude': depth, 'rate': speed, 'rest': labels.regime == REST,
            'hold': depth * (labels.regime == HOLD), 'load': depth * (labels.regime == LOAD),
            'unload': depth * (labels.regime == UNLOAD),
            'past_maximum': depth * labels.past_maximum}


def _correlation(a, b):
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if not (np.ptp(a) and np.ptp(b)):
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
