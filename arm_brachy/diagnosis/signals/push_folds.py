"""Kinds of experiment in a recording: what is held out whole, never single samples."""

import numpy as np

from arm_brachy.diagnosis.signals.motion import TOUCH

STEPS = 2.0     # kinds a factor of two: pushes deeper or faster by less are of one kind


def kinds_of(states, pads):
    """Return the kind (m,) of every state of a load_states.LoadStates, a tuple of labels.

    pads : p names
    A kind is what a person would call another experiment: other pads, another speed or depth,
    each by a factor of two. Rests belong to the push before them. Of a recording with one kind of
    push its cycles are the kinds, of a single push its loading, hold and unloading.
    """
    labels = states.labels
    pushed = [frozenset(np.flatnonzero((states.q[labels.excursion == e] > TOUCH).any(axis=0)))
              for e in range(labels.excursion.max(initial=0) + 1)]
    names = [_name(labels, e, pushed[e], pads) for e in range(len(pushed))]
    first = next((name for name in names if name), '')
    every = tuple(names[e] or first for e in labels.excursion)
    if len(set(every)) > 1:
        return every
    if labels.cycle.max(initial=0) > 0:
        return tuple(f'cycle {c + 1}' for c in labels.cycle)
    return tuple(labels.regime)


def _name(labels, e, pushed, pads):
    """'pad_1 5 mm at 20 mm/s' of excursion e; '' where nothing was pushed."""
    rows = labels.excursion == e
    if not pushed:
        return ''
    depth, speed = 1e3 * labels.amplitude[rows].max(), 1e3 * labels.speed[rows].max()
    who = ' and '.join(pads[i] for i in sorted(pushed))
    return f'{who} to {_rounded(depth):g} mm at {_rounded(speed):g} mm/s'


def _rounded(value):
    """The nearest power of STEPS, so that what is alike gets one label."""
    return STEPS ** round(np.log(max(value, 1e-3)) / np.log(STEPS))
