"""What the pads did: the encoders' path as straight pieces, and the times when they stood."""

import heapq
from dataclasses import dataclass
from math import comb

import numpy as np

from arm_brachy.diagnosis.signals.quantisation import quantum
from arm_brachy.diagnosis.signals.stream import ENCODER
from arm_brachy.evaluation.regimes import TOUCH
from arm_brachy.evaluation.residuals import MAD_TO_SD

FINENESS = 2e-3        # of the largest travel: what a straight piece may leave out
NOISE = 6.0            # standard deviations of the encoder that make no corner
UNRESOLVED = 0.5       # of a count: what readings that flicker have of noise, at most
FLICKER = 0.1          # of changes that go back at once: a motion turns less often
ORDERS = (2, 4, 6)     # of differences that tell noise from motion
MOST_PIECES = 1000
PUSHED = 0.02          # of the largest travel, but at most regimes.TOUCH


@dataclass(frozen=True)
class Motion:
    """The path of the pads as straight pieces between corners.

    t : (k + 1,) corners [s];  q : (k + 1, p) pushes there [m]
    tolerance : [m] by which the recorded path departs from the pieces at most
    touch : [m] pushed less than this counts as not pushed
    """

    t: np.ndarray
    q: np.ndarray
    tolerance: float
    touch: float

    @property
    def velocity(self):
        """(k, p) [m/s] on each piece."""
        return np.diff(self.q, axis=0) / np.diff(self.t)[:, None]

    @property
    def still(self):
        """(k,) True for pieces on which no pad moves."""
        return np.abs(np.diff(self.q, axis=0)).max(axis=1, initial=0.0) <= self.tolerance

    def stills(self):
        """Stretches in which all pads stand: tuples (t_start, t_end, pushed), in order."""
        out = []
        for i in np.flatnonzero(self.still):
            start, end = self.t[i], self.t[i + 1]
            if out and out[-1][1] == start:
                start = out.pop()[0]
            out.append((float(start), float(end), bool((self.q[i + 1] > self.touch).any())))
        return tuple(out)

    def phases(self):
        """Stands and ramps, in order: tuples (first, stop) of pieces, stop excluded.

        A ramp is a run of pieces on which the pads move on in about the same direction: corners of
        its acceleration stay inside, a reversal ends it.
        """
        still, velocity, out, first = self.still, self.velocity, [], 0
        for i in range(1, len(still) + 1):
            if i == len(still) or still[i] != still[first] or (
                    not still[i] and velocity[i] @ velocity[i - 1] <= 0.0):
                out.append((first, i))
                first = i
        return tuple(out)


def motion_of(evidence):
    """Motion of an Evidence that has encoders; None without."""
    encoder = evidence.get(ENCODER)
    if encoder is None:
        return None
    seen = encoder.valid.all(axis=1)
    t, q = encoder.t[seen], encoder.values[seen, :, 0]
    travel = float(np.ptp(q, axis=0).max())
    noise = max(noise_of(q), *map(_flicker, q.T))
    tolerance = max(FINENESS * travel, NOISE * noise)
    corners = corners_of(t, q, tolerance)
    return Motion(t[corners], q[corners], tolerance,
                  min(TOUCH, max(2.0 * tolerance, PUSHED * travel)))


def noise_of(q):
    """Standard deviation [m] of white noise of readings q (n,) or (n, p), whatever the motion.

    The least that differences of ORDERS say: a motion that is smooth, but coarsely sampled, has
    large second ones and ever smaller ones beyond; white noise has the same in all.
    """
    sizes = {n: np.median(np.abs(np.diff(q, n=n, axis=0))) for n in ORDERS if len(q) > n}
    return min((MAD_TO_SD * float(size) / np.sqrt(comb(2 * n, n)) for n, size in sizes.items()),
               default=0.0)


def _flicker(q):
    """Noise [m] of readings (n,) that it moves by a count now and then, which medians miss.

    0 where counts follow the motion alone.
    """
    way = np.sign(np.diff(q))
    way = way[way != 0.0]
    back = np.mean(way[1:] != way[:-1]) if len(way) > 1 else 0.0
    return UNRESOLVED * quantum(q) if back > FLICKER else 0.0


def corners_of(t, q, tolerance, most=MOST_PIECES):
    """Indices of the samples between which q (n, p) runs straight within `tolerance`.

    tolerance : [m], or (n,) of each sample
    The sample that departs most is made a corner until none departs by more, or `most` pieces are
    reached: top-down insertion after Douglas & Peucker 1973, Cartographica 10:112.
    """
    corners, queue = [0, len(t) - 1], []
    tolerance = np.broadcast_to(tolerance, len(t))
    _push(queue, t, q, tolerance, 0, len(t) - 1)
    while queue and len(corners) <= most:
        departure, start, worst, end = heapq.heappop(queue)
        if -departure <= 1.0:
            break
        corners.append(worst)
        _push(queue, t, q, tolerance, start, worst)
        _push(queue, t, q, tolerance, worst, end)
    return np.array(sorted(set(corners)))


def _push(queue, t, q, tolerance, start, end):
    """Queue the piece start..end by how many tolerances its worst sample is off the chord."""
    if end - start < 2:
        return
    f = ((t[start:end + 1] - t[start]) / (t[end] - t[start]))[:, None]
    off = np.abs(q[start:end + 1] - (q[start] + f * (q[end] - q[start]))).max(axis=1)
    off = off / np.maximum(tolerance[start:end + 1], 1e-300)
    worst = int(np.argmax(off))
    heapq.heappush(queue, (-float(off[worst]), start, start + worst, end))


@dataclass(frozen=True)
class Path:
    """A sampled motion of the pads along their directions, straight between samples.

    t : (m,) [s], increasing;  q : (m, p) [m]
    """

    t: np.ndarray
    q: np.ndarray

    def at(self, t):
        """Return (n, p) [m] at times t (n,), held before the first and after the last sample."""
        return np.stack([np.interp(t, self.t, column) for column in self.q.T], axis=1)
