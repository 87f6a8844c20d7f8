"""Stretches in which nobody knows where the pads were: between readings of the encoders.

They fell silent while pads moved, or are read so seldom that a pad changes its speed between two
readings. The path is a straight line there, and what the other streams saw is not what it would
have done.
Test: diagnosis/structural/test_blind.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.signals.clock_alignment import FAR
from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.signals.outliers import fastest
from arm_brachy.diagnosis.signals.stream import ENCODER

LONGEST = 0.2      # s without encoders over which the path is as good as straight
PERIODS = 3.0      # of the encoders, that LONGEST is at least
MOST = 0.5         # of the time; of a path that is known at single times only, nothing would stay
SLOW = 0.05        # s between readings, from which corners between them count
ROUND = 3.0        # of what a corner is, by which a path may miss the straight line there
MOST_OF_CORNERS = 0.8   # of the time; what stays are holds, whose pads are known


def without_blind(evidence):
    """The Evidence with what its other streams saw in blind spans not seen, `blind` says when.

    The same if there are none. Spans that are most of the recording are not left out, but noted.
    """
    evidence = _left_out(evidence, blind_spans(evidence), MOST, (
        'The pads may have moved unseen by their encoders: what the other streams show meanwhile '
        'was left out ({when}).',
        'The pads may have moved unseen by their encoders for {total:.1f} s, most of the '
        'recording: their path is taken for straight there.'))
    return _left_out(evidence, corner_spans(evidence), MOST_OF_CORNERS, (
        'Between some readings of the encoders pads changed their speed: what the other streams '
        'show meanwhile was left out ({total:.1f} s of all).',
        'Between most readings of the encoders pads changed their speed: their path is taken for '
        'straight there.'))


def _left_out(evidence, spans, most, notes):
    """The Evidence without what other streams show in spans, if these are not more than `most`.

    notes : what is said of it, and of spans that are more
    """
    if not spans:
        return evidence
    t = np.concatenate([one.t for one in evidence.streams.values()])
    total = float(inside(t, spans).mean() * np.ptp(t))
    when = ', '.join(f'{start:.1f} to {end:.1f} s' for start, end in spans)
    much = bool(total > most * np.ptp(t))
    evidence = replace(evidence, notes=(*evidence.notes,
                                        notes[much].format(total=total, when=when)))
    if much:
        return evidence
    streams = {kind: one if kind == ENCODER else _hidden(one, spans)
               for kind, one in evidence.streams.items()}
    base = evidence.base_force
    return replace(evidence, streams=streams, blind=tuple(sorted((*evidence.blind, *spans))),
                   base_force=None if base is None else _hidden(base, spans))


def blind_spans(evidence):
    """Tuples (t_start, t_end) [s] in which encoders were silent while a pad moved on.

    A pad that stands may be silent, as may one that is read seldom. What it moves from one reading
    to the next tells of no more than that it had begun to move. Before the first reading and after
    the last nothing is known. The other clocks may still be off by FAR.
    """
    encoder, motion = evidence.get(ENCODER), motion_of(evidence)
    if motion is None:
        return ()
    t, q = _readings(encoder)
    begun = 1.5 * encoder.period * fastest(encoder)
    moved = np.abs(np.diff(q, axis=0)).max(axis=1) > max(motion.tolerance, begun)
    others = np.concatenate([s.t for kind, s in evidence.streams.items() if kind != ENCODER])
    edges = np.concatenate([[min(others.min(), t[0])], t, [max(others.max(), t[-1])]])
    unseen = np.diff(edges) > max(LONGEST, PERIODS * encoder.period)
    return tuple((float(edges[i]) - FAR, float(edges[i + 1]) + FAR)
                 for i in np.flatnonzero(unseen & np.concatenate([[True], moved, [True]])))


def corner_spans(evidence):
    """Tuples (t_start, t_end) [s] between readings more than SLOW apart that hold a corner.

    Where a pad goes straight on from one reading to the next, it does as fast as before or after.
    At one corner in between the path departs from the straight line by the smaller of what it
    would be off if it had gone on as before, or come as it goes after.
    """
    encoder, motion = evidence.get(ENCODER), motion_of(evidence)
    if motion is None or encoder.period <= SLOW:
        return ()
    t, q = _readings(encoder)
    dt = np.diff(t)[:, None]
    changed = np.abs(np.diff(np.diff(q, axis=0) / dt, axis=0))
    off = np.minimum(changed[:-1], changed[1:]) * dt[1:-1]
    return tuple((float(t[i]) - FAR / 2.0, float(t[i + 1]) + FAR / 2.0)
                 for i in 1 + np.flatnonzero(off.max(axis=1) > ROUND * motion.tolerance))


def _readings(encoder):
    """(t (n,) [s], q (n, p) [m]) at which all pads were read."""
    seen = encoder.valid.all(axis=1)
    return encoder.t[seen], encoder.values[seen, :, 0]


def inside(t, spans):
    """(n,) True for times t (n,) [s] within spans (t_start, t_end)."""
    out = np.zeros(len(t), dtype=bool)
    for start, end in spans:
        out |= (t > start) & (t < end)
    return out


def _hidden(stream, spans):
    return stream.without(inside(stream.t, spans)[:, None])
