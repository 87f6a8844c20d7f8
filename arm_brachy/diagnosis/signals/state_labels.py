"""What was being done at each load state: regime, pad, direction, speed, amplitude, history."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.evaluation.regimes import (
    EXCHANGE,
    HELD,
    HOLD,
    LOAD,
    REST,
    RINGING,
    SETTLED,
    UNLOAD,
)


@dataclass(frozen=True)
class Labels:
    """One entry per load state, (m,) each.

    regime : REST, HOLD, LOAD, UNLOAD or EXCHANGE; HELD, RINGING or SETTLED without pads
    pad : index of the pad that moves or moved last, -1 before the first motion
    direction : +1 in, -1 out, 0 standing;  speed : [m/s] of that pad now, or of the last motion
    amplitude : [m] largest push of any pad between the rests around it
    excursion : number of the push from rest to rest, 0 before the first; kept in the rest after it
    cycle : how many earlier excursions pushed the same pads
    past_maximum : True if `pad` is further in than it was ever before this excursion
    since : [s] since the motion or stand began
    """

    regime: np.ndarray
    pad: np.ndarray
    direction: np.ndarray
    speed: np.ndarray
    amplitude: np.ndarray
    excursion: np.ndarray
    cycle: np.ndarray
    past_maximum: np.ndarray
    since: np.ndarray


def labels_of(motion, windows, q):
    """Labels of Windows cut from a Motion; q (m, p) [m] the pushes there."""
    t = np.array([w.centre for w in windows])
    phases = motion.phases()
    phase = np.array([w.phase for w in windows])
    lead, speed, sign = _leads(motion, phases)
    excursion, amplitude, before, cycle = _excursions(motion)
    piece = np.clip(np.searchsorted(motion.t, t, side='right') - 1, 0, len(motion.t) - 2)
    mine, pad = excursion[piece], lead[phase]
    now = np.array([w.moves for w in windows])
    past = np.array([p >= 0 and q[i, p] > before[mine[i], p] + motion.touch
                     for i, p in enumerate(pad)], dtype=bool)
    begins = motion.t[[phases[i][0] for i in phase]]
    goes = np.array([np.abs(motion.q[b] - motion.q[a]) > motion.tolerance for a, b in phases])
    velocity = np.where(now[:, None] & goes[phase], motion.velocity[piece], 0.0)
    return Labels(_regime(motion, velocity, q, now), pad,
                  np.where(now, sign[phase], 0).astype(int), speed[phase], amplitude[mine], mine,
                  cycle[mine], past, t - begins)


def free_labels(windows):
    """Labels of the Windows of a body without pads: held, ringing, settled."""
    m = len(windows)
    moves = np.array([w.moves for w in windows], dtype=bool)
    moved = np.cumsum(moves) > 0
    regime = np.where(moves, RINGING, np.where(moved, SETTLED, HELD))
    starts = {}
    since = np.array([w.centre - starts.setdefault(w.phase, w.start) for w in windows])
    zero, none = np.zeros(m), np.zeros(m, dtype=int)
    return Labels(regime, none - 1, none, zero, zero, none, none, np.zeros(m, dtype=bool), since)


def _leads(motion, phases):
    """Per phase: pad that goes furthest, its largest speed [m/s] and direction; of a stand those
    of the ramp before it, -1, 0 and 0 before the first.
    """
    lead = np.full(len(phases), -1)
    speed, sign = np.zeros(len(phases)), np.zeros(len(phases))
    for i, (first, stop) in enumerate(phases):
        if not motion.still[first]:
            way = motion.q[stop] - motion.q[first]
            lead[i] = int(np.argmax(np.abs(way)))
            speed[i] = np.abs(motion.velocity[first:stop, lead[i]]).max()
            sign[i] = np.sign(way[lead[i]])
        elif i > 0:
            lead[i], speed[i], sign[i] = lead[i - 1], speed[i - 1], sign[i - 1]
    return lead, speed, sign


def _excursions(motion):
    """Excursion of every piece (k,); per excursion: amplitude, former largest push (p,), cycle.

    An excursion begins with the first piece that leaves rest and lasts through the rest after it.
    """
    pushed = (motion.q > motion.touch).any(axis=1)
    leaves = pushed[1:] & ~pushed[:-1]
    number = np.cumsum(leaves)
    count = int(number[-1]) + 1
    amplitude, before = np.zeros(count), np.zeros((count, motion.q.shape[1]))
    cycle, seen, largest = np.zeros(count, dtype=int), {}, np.zeros(motion.q.shape[1])
    for e in range(count):
        rows = np.flatnonzero(number == e)
        peak = motion.q[rows + 1].max(axis=0) if len(rows) else largest * 0.0
        amplitude[e], before[e] = peak.max(initial=0.0), largest
        pads = tuple(np.flatnonzero(peak > motion.touch))
        cycle[e] = seen.get(pads, 0)
        seen[pads] = cycle[e] + 1
        largest = np.maximum(largest, peak)
    return number, amplitude, before, cycle


def _regime(motion, velocity, q, moves):
    inward = moves & (velocity > 0.0).any(axis=1)
    outward = moves & (velocity < 0.0).any(axis=1)
    pushed = (q > motion.touch).any(axis=1)
    return np.select([inward & outward, inward, outward, pushed], [EXCHANGE, LOAD, UNLOAD, HOLD],
                     REST)
