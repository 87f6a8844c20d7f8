"""Stretches in which nobody knows where the pads were: encoders fell silent while they moved.

The path is a straight line there, and what the other streams saw is not what it would have done.
Test: diagnosis/structural/test_blind.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.motion import motion_of
from arm_brachy.diagnosis.rough_clock import FAR
from arm_brachy.diagnosis.spikes import fastest
from arm_brachy.diagnosis.stream import ENCODER

LONGEST = 0.2      # s without encoders over which the path is as good as straight
PERIODS = 3.0      # of the encoders, that LONGEST is at least
MOST = 0.5         # of the time; of a path that is known at single times only, nothing would stay


def without_blind(evidence):
    """The Evidence with what its other streams saw in `blind_spans` not seen, `blind` says when.

    The same if there are none, or if they are most of the recording, which is noted.
    """
    spans = blind_spans(evidence)
    if not spans:
        return evidence
    t = np.concatenate([one.t for one in evidence.streams.values()])
    total = sum(end - start for start, end in spans)
    if total > MOST * np.ptp(t):
        return replace(evidence, notes=(
            *evidence.notes, f'The pads may have moved unseen by their encoders for {total:.1f} '
            's, most of the recording: their path is taken for straight there.'))
    streams = {kind: one if kind == ENCODER else _hidden(one, spans)
               for kind, one in evidence.streams.items()}
    base = evidence.base_force
    when = ', '.join(f'{start:.1f} to {end:.1f} s' for start, end in spans)
    return replace(evidence, streams=streams, blind=spans,
                   base_force=None if base is None else _hidden(base, spans), notes=(
                       *evidence.notes, 'The pads may have moved unseen by their encoders: what '
                       f'the other streams show meanwhile was left out ({when}).'))


def blind_spans(evidence):
    """Tuples (t_start, t_end) [s] in which encoders were silent while a pad moved on.

    A pad that stands may be silent, as may one that is read seldom. What it moves from one reading
    to the next tells of no more than that it had begun to move. Before the first reading and after
    the last nothing is known. The other clocks may still be off by FAR.
    """
    encoder, motion = evidence.get(ENCODER), motion_of(evidence)
    if motion is None:
        return ()
    seen = encoder.valid.all(axis=1)
    t, q = encoder.t[seen], encoder.values[seen, :, 0]
    begun = 1.5 * encoder.period * fastest(encoder)
    moved = np.abs(np.diff(q, axis=0)).max(axis=1) > max(motion.tolerance, begun)
    others = np.concatenate([s.t for kind, s in evidence.streams.items() if kind != ENCODER])
    edges = np.concatenate([[min(others.min(), t[0])], t, [max(others.max(), t[-1])]])
    unseen = np.diff(edges) > max(LONGEST, PERIODS * encoder.period)
    return tuple((float(edges[i]) - FAR, float(edges[i + 1]) + FAR)
                 for i in np.flatnonzero(unseen & np.concatenate([[True], moved, [True]])))


def inside(t, spans):
    """(n,) True for times t (n,) [s] within spans (t_start, t_end)."""
    out = np.zeros(len(t), dtype=bool)
    for start, end in spans:
        out |= (t > start) & (t < end)
    return out


def _hidden(stream, spans):
    return stream.without(inside(stream.t, spans)[:, None])
