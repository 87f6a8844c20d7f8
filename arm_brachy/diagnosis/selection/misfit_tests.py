"""What to look for in a residual: all that a missed effect may follow, in each channel and in all.

A channel alone is held against features of what was being done there and then (depth of every
pad and its square, direction, speed, time, ...). All together they are held against what the
past may have done to the tissue or to a pad (`pooled_misfit_tests`), and a pad that turns.
Test: diagnosis/theorems/test_pasts.py
"""

import numpy as np

from arm_brachy.diagnosis.selection.pad_rotation_tests import Turn, pad_turn_tests
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past, pooled_tests
from arm_brachy.diagnosis.signals.motion import TOUCH


def structured_tests(matched, parts=None):
    """Columns (N, m) of all tests of Matched recordings, whitened, and what each is.

    parts : (Observables, numbers of the states they hold) for each, None = all that is there
    Labels are ((kind, channel, axis), feature), a pooled_misfit_tests.Past or a
    pad_rotation_tests.Turn. Their number and order do not depend on `parts`; what
    these cannot show is a column of zeros.
    """
    parts = parts or [(m.observables, np.arange(len(m.recorded.states.t))) for m in matched]
    alone, channels = _by_channel(matched, parts)
    together, past = pooled_tests(matched, parts)
    turned, turns = pad_turn_tests(matched, parts)
    return np.hstack([alone, together, turned]), (*channels, *past, *turns)


def in_directions(labels):
    """Lists of indices of tests, by their labels, that are one effect in several directions."""
    groups = {}
    for i, one in enumerate(labels):
        if isinstance(one, Turn):
            groups.setdefault((one.pad, one.power), []).append(i)
        elif not isinstance(one, Past):
            (kind, channel, _), feature = one
            groups.setdefault((kind, channel, feature), []).append(i)
        elif one.moved:
            groups.setdefault((one.history, one.pad, one.moved), []).append(i)
    return tuple(groups.values())


def _by_channel(matched, parts):
    """Columns (N, m) of every feature in every channel, and ((kind, channel, axis), feature)."""
    features = [features_of(m) for m in matched]
    channels = list(dict.fromkeys((row.kind, row.channel, row.axis)
                                  for m in matched for row in m.observables.rows))
    names = list(dict.fromkeys(name for some in features for name in some))
    of_row = np.array([channels.index((row.kind, row.channel, row.axis))
                       for observables, _ in parts for row in observables.rows], dtype=int)
    columns = np.zeros((len(of_row), len(channels) * len(names)))
    for j, name in enumerate(names):
        whole = np.concatenate([
            observables.whiten_feature(some[name][kept]) if name in some
            else np.zeros(len(observables.rows))
            for (observables, kept), some in zip(parts, features, strict=True)])
        columns[np.arange(len(of_row)), of_row * len(names) + j] = whole
    return columns, tuple((channel, name) for channel in channels for name in names)


def features_of(m):
    """Name -> (n,) what a missed effect may follow at the states of a Matched, within -1 to 1."""
    states, labels = m.recorded.states, m.recorded.states.labels
    depth = states.q / max(np.abs(states.q).max(), 1e-9)
    deepest = depth.max(axis=1)
    span = states.t - states.t[0]
    speed = np.where(labels.direction != 0, labels.speed, 0.0)
    out = {'constant': np.ones(len(span)), 'time': span / max(span[-1], 1e-9),
           'direction': labels.direction * deepest, 'past_maximum': labels.past_maximum * deepest,
           'rate': deepest * speed / max(speed.max(initial=0.0), 1e-9),
           'hold': np.where(labels.direction == 0, deepest, 0.0) * np.exp(-labels.since),
           'rest': np.where(deepest < 0.02, np.exp(-labels.since), 0.0)}
    for i, column in enumerate(depth.T):
        if np.ptp(states.q[:, i]) > TOUCH:
            out[f'depth {i}'] = column
            out[f'depth^2 {i}'] = column**2
    return out
