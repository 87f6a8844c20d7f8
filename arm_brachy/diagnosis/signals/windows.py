"""Where to look: a bounded number of short windows over stands and ramps of a recording."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.signals.stream import EM, OPTICAL

SETTLED = 0.03      # s after the end of a motion, clocks differ by as much
FIRST = 0.15        # s, length of the first part of a stand; each later one is twice as long
LONGEST = 0.6       # s of a window on a stand: what relaxes within it bends less than it settles
SHORTEST = 0.04     # s of a ramp
SWING = 0.5         # rad of a rhythm in a window on a stand: the mean is 1 % short of the middle
CRUISE = 0.3        # of the longest straight piece of a ramp: shorter ones are its acceleration
FINEST = (8, 4)     # windows per stand and per ramp, at most
LEVELS = (FINEST, (5, 3), (3, 2), (2, 1), (1, 1))
RESOLVED = 0.25     # of the largest travel, from window to window of a ramp
LEVEL = 0.1         # of the largest travel: pushes that differ by less are one load
RESTS = 0.2         # of a bounded number of windows, for stands without a push
COVERED = 0.1       # of the largest travel, by one: the answer to a push bends with the push
LOUD = 6.0          # standard deviations of noise that make a body without pads move
APART = 0.05        # s over which its motion is looked at
ENOUGH = 4          # windows between two sudden events, for what lasted from one to the other,
MANY = 12           # unless so many happened


@dataclass(frozen=True)
class Window:
    """start, stop : [s];  moves : True on a ramp;  phase : number of the stand or ramp it is of"""

    start: float
    stop: float
    moves: bool
    phase: int

    @property
    def centre(self):
        """[s]"""
        return 0.5 * (self.start + self.stop)


def windows_of(motion, limit, rhythm=0.0, events=()):
    """At most `limit` Windows over the stands and ramps of a Motion, in order of time.

    rhythm : [Hz] of what goes on in stands, 0 = none;  events : times [s] of what came suddenly:
        a touch of two seconds is seen in some windows of its own, beyond the limit if need be
    A stand is seen early and late, in parts that double in length, so that what relaxes is
    resolved and what stands is averaged; a ramp on its straight pieces, at most a quarter of the
    largest travel apart. Where there are too many, all become coarser together, then some are
    left out, of every load its share, so that a protocol that repeats is not seen in one phase.
    """
    phases, longest = motion.phases(), SWING / (2.0 * np.pi * rhythm) if rhythm else np.inf

    def cut(level):
        return [w for i, phase in enumerate(phases)
                for w in _cut(motion, phase, i, level, longest)]

    found = next((some for some in map(cut, LEVELS) if len(some) <= limit), None)
    found = _thinned(cut(LEVELS[-1]), motion, limit) if found is None else found
    if len(events) < MANY:
        ends = [*sorted(events), float(motion.t[-1])]
        for a, b in zip(ends[:-1], ends[1:], strict=True):
            found = _seen_between(found, motion, phases, a, b, longest)
    return tuple(sorted(found, key=lambda w: w.start))


def _seen_between(found, motion, phases, a, b, longest):
    """Windows `found`, those between two times made finer where they are fewer than ENOUGH."""
    if sum(a < w.start and w.stop < b for w in found) >= ENOUGH:
        return found
    finer = _between(motion, phases, a + SETTLED, b - SETTLED, longest)
    return [*(w for w in found if w.stop <= a or b <= w.start), *finer]


def _between(motion, phases, start, stop, longest):
    """Windows between two times: stands as far as they lie there, of ramps whole windows."""
    out = []
    for i, (first, last) in enumerate(phases):
        a, b = max(float(motion.t[first]), start), min(float(motion.t[last]), stop)
        if motion.still[first]:
            settled = float(motion.t[first]) + SETTLED if first > 0 else a
            out += _stand(max(a, settled), b, i, ENOUGH, min(LONGEST, longest))
        else:
            out += [w for w in _ramp(motion, first, last, i, FINEST[1])
                    if start <= w.start and w.stop <= stop]
    return out


def _thinned(windows, motion, limit):
    """At most `limit` of more Windows: those at rest a fifth, of every other load its share."""
    t = np.array([w.centre for w in windows])
    q = np.stack([np.interp(t, motion.t, column) for column in motion.q.T], axis=1)
    level = np.round(q / (LEVEL * np.ptp(motion.q, axis=0).max())).astype(int)
    loads = [(w.moves, *row) for w, row in zip(windows, level.tolist(), strict=True)]
    order = sorted(range(len(windows)), key=lambda i: (loads[i], i))
    rest = [i for i in order if not any(loads[i])]
    pushed = [i for i in order if any(loads[i])]
    few = min(len(rest), max(limit - len(pushed), int(RESTS * limit)))
    kept = sorted([*_evenly(rest, few), *_evenly(pushed, limit - few)])
    return tuple(windows[i] for i in kept)


def _evenly(items, count):
    return [items[i] for i in np.unique(
        np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int))]


def _cut(motion, phase, index, level, longest):
    first, stop = phase
    start, end = float(motion.t[first]), float(motion.t[stop])
    if not motion.still[first]:
        return _ramp(motion, first, stop, index, level[1])
    if first > 0:
        return _stand(start + SETTLED, end, index, level[0], min(LONGEST, longest))
    return [_within(start, end, longest, False, index)]     # before the first push nothing settles


def _stand(start, end, index, most, longest=LONGEST):
    if end - start < FIRST / 2.0:
        return []
    number = int(np.clip(np.floor(np.log2(1.0 + (end - start) / FIRST)), 1, most))
    if number == 1:
        return [Window(float(max(start, end - longest)), end, False, index)]
    edges = start + FIRST * (2.0 ** np.arange(number + 1) - 1.0)
    edges[-1] = end
    out = [_within(a, b, longest, False, index)
           for a, b in zip(edges[:-2], edges[1:-1], strict=True)]
    return [*out, Window(float(max(edges[-2], end - longest)), end, False, index)]


def _within(start, end, longest, moves, index):
    """The middle of [start, end], at most `longest` [s]."""
    centre, half = 0.5 * (start + end), 0.5 * min(end - start, longest)
    return Window(float(centre - half), float(centre + half), moves, index)


def _ramp(motion, first, stop, index, most):
    lasts = np.diff(motion.t[first:stop + 1])
    chosen = [i for i in range(first, stop) if lasts[i - first] >= max(
        SHORTEST, CRUISE * lasts.max())]
    if most == 1 and chosen:
        chosen = [first + int(np.argmax(lasts))]
    out = []
    for i in chosen:
        way = float(np.abs(motion.q[i + 1] - motion.q[i]).max())
        full = float(np.ptp(motion.q, axis=0).max())
        number = int(np.clip(np.ceil(way / (RESOLVED * full)), 1, most))
        edges = np.linspace(motion.t[i], motion.t[i + 1], number + 1)
        longest = max(COVERED * full / way * lasts[i - first], SHORTEST)
        out += [_within(a, b, longest, True, index)
                for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return out


def free_windows(evidence, noise, limit):
    """At most `limit` Windows of a body without pads: single samples where it moves, stands else.

    evidence : Evidence;  noise : kind -> noise.Noise
    """
    stream = evidence.get(OPTICAL) or evidence.get(EM)
    moves = _moves(stream, noise[stream.kind])
    edges = np.concatenate([[0], np.flatnonzero(np.diff(moves.astype(int))) + 1, [len(moves)]])
    stands = [(i, int(a), int(b)) for i, (a, b) in enumerate(
        zip(edges[:-1], edges[1:], strict=True)) if not moves[a] and b - a > 1]
    found = [w for i, a, b in stands
             for w in _stand(float(stream.t[a]), float(stream.t[b - 1]), i, 3)]
    rows = np.flatnonzero(moves)
    room = max(limit - len(found), 1)
    if len(rows):
        chosen = rows[np.unique(np.linspace(0, len(rows) - 1, room).round().astype(int))]
        piece = np.searchsorted(edges, chosen, side='right') - 1
        found += [Window(float(stream.t[r]), float(stream.t[r]), True, int(p))
                  for r, p in zip(chosen, piece, strict=True)]
    return tuple(sorted(found, key=lambda w: w.start)[:limit])


def _moves(stream, noise):
    """(n,) True where any channel departs from where it was shortly before or after."""
    h = max(int(round(APART / stream.period)), 1)
    out = np.zeros(len(stream.t), dtype=bool)
    steps = np.abs(stream.values[h:] - stream.values[:-h]) / noise.sd
    far = (np.nan_to_num(steps) > LOUD * np.sqrt(2.0)).any(axis=(1, 2))
    out[h:] |= far
    out[:-h] |= far
    gaps = np.flatnonzero(np.diff(np.concatenate([[1], out.astype(int), [1]])))
    for a, b in zip(gaps[::2], gaps[1::2], strict=True):   # turning points are no stands
        out[a:b] |= b - a < 4 * h
    return out
