"""One measured stream as the diagnosis sees it: own clock, names, values, what was seen."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core import scene

ENCODER, FORCE, OPTICAL, EM = 'encoder', 'force', 'optical', 'em'
UNITS = {ENCODER: 'm', FORCE: 'N', OPTICAL: 'm', EM: 'm'}
TISSUE, BASE = scene.TISSUE, scene.BASE
REMAINS = 0.5     # of white noise, that straight pieces leave where pads move (test_steadied)


@dataclass(frozen=True)
class Stream:
    """k channels of c components, sampled together on one clock.

    kind : ENCODER (c = 1), FORCE, OPTICAL or EM (c = 3; forces along one direction: c = 1)
    t : (n,) [s], increasing;  names : k channels; where a sensor has several
        the first is along the push
    values : (n, k, c) SI, world or tracker frame, NaN where not seen;  valid : (n, k)
    bodies : what each channel sits on: TISSUE, BASE or the name of a pad
    rest : (k, c) the scene's positions at rest [m]; zero for encoders and forces
    taken : (k,) [m] noise that was taken out of encoders (`encoder_smoothing`), None = of none
    along : (k, 3) unit vectors of the world frame, along which the one component is measured;
        None = components are those of the frame
    """

    kind: str
    t: np.ndarray
    names: tuple
    values: np.ndarray
    valid: np.ndarray
    bodies: tuple
    rest: np.ndarray
    taken: np.ndarray | None = None
    along: np.ndarray | None = None

    @property
    def period(self):
        """Median step between samples [s]; 0 with fewer than two samples."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0

    def on(self, *bodies):
        """Indices (int array) of the channels that sit on one of `bodies`."""
        return np.array([i for i, body in enumerate(self.bodies) if body in bodies], dtype=int)

    def named(self, *bodies):
        """Names of the channels that sit on one of `bodies`."""
        return tuple(self.names[i] for i in self.on(*bodies))

    def channels(self, index):
        """The stream with only the channels in `index`."""
        index = np.asarray(index, dtype=int)
        return replace(self, names=tuple(self.names[i] for i in index),
                       values=self.values[:, index], valid=self.valid[:, index],
                       bodies=tuple(self.bodies[i] for i in index), rest=self.rest[index],
                       taken=None if self.taken is None else self.taken[index],
                       along=None if self.along is None else self.along[index])

    @property
    def vectors(self):
        """Values (n, k, 3) in the frame; zero across where one component was measured."""
        return self.values if self.along is None else self.values * self.along

    def path_error(self, duration):
        """(k,) [m] standard deviation of steadied encoders in their mean over `duration` [s].

        Zeros where nothing was taken out. At most REMAINS of the noise: what lines leave of it
        while pads set out and stop.
        """
        if self.taken is None:
            return np.zeros(len(self.names))
        return self.taken * min(REMAINS, np.sqrt(self.period / max(duration, self.period)))

    def between(self, t_start, t_end):
        """The samples with t_start <= t <= t_end [s]."""
        keep = slice(np.searchsorted(self.t, t_start),
                     np.searchsorted(self.t, t_end, side='right'))
        return replace(self, t=self.t[keep], values=self.values[keep], valid=self.valid[keep])

    def seen(self):
        """The stream without samples in which no channel was seen."""
        rows = self.valid.any(axis=1)
        return self if rows.all() else replace(self, t=self.t[rows], values=self.values[rows],
                                               valid=self.valid[rows])

    def without(self, hidden):
        """The stream with what is True in `hidden` (n, k) not seen; its samples stay."""
        valid = self.valid & ~hidden
        return replace(self, values=np.where(valid[..., None], self.values, np.nan), valid=valid)

    def at(self, t):
        """Values (m, k, c) at times t (m,), linear between samples, held outside them.

        For streams without gaps (encoders); a gap is bridged by a straight line.
        """
        out = np.empty((len(t), *self.values.shape[1:]))
        for k in range(out.shape[1]):
            seen = self.valid[:, k]
            for c in range(out.shape[2]):
                out[:, k, c] = np.interp(t, self.t[seen], self.values[seen, k, c])
        return out


def components(vectors, along):
    """What sensors show of vectors (..., k, 3): (..., k, 1) along `along` (k, 3), None = all."""
    return vectors if along is None else np.sum(vectors * along, axis=-1, keepdims=True)


def thinned(stream, period):
    """Average a stream over bins of `period` [s], without aliasing or skew in time.

    Every bin is the mean over its samples, stamped with their mean time. A sample that is missing
    inside a bin is first put on the straight line between its neighbours, so that a mean over a
    motion does not belong to another time; a channel counts as seen in a bin if at least half of
    its samples were. The mean over a bin suppresses what oscillates faster than 1 / period.
    """
    filled = _bridged(stream, period)
    index = np.floor((stream.t - stream.t[0]) / period).astype(int)
    first = np.concatenate([[0], np.flatnonzero(np.diff(index)) + 1])
    count = np.diff(np.append(first, len(index)))
    seen = np.add.reduceat(stream.valid.astype(float), first, axis=0) / count[:, None]
    values = np.add.reduceat(filled, first, axis=0) / count[:, None, None]
    valid = (seen >= 0.5) & np.isfinite(values).all(axis=2)
    t = np.add.reduceat(stream.t - stream.t[0], first) / count + stream.t[0]
    return replace(stream, t=t, values=np.where(valid[..., None], values, np.nan), valid=valid)


def _bridged(stream, longest):
    """Values with gaps up to `longest` [s] bridged by straight lines; longer ones stay NaN."""
    filled = stream.values.copy()
    for k in range(filled.shape[1]):
        seen = np.flatnonzero(stream.valid[:, k])
        lost = np.flatnonzero(~stream.valid[:, k])
        if not len(seen) or not len(lost):
            continue
        after = np.searchsorted(seen, lost)
        inner = (after > 0) & (after < len(seen))
        lost, after = lost[inner], after[inner]
        short = stream.t[seen[after]] - stream.t[seen[after - 1]] <= 2.0 * longest
        for c in range(filled.shape[2]):
            filled[lost[short], k, c] = np.interp(
                stream.t[lost[short]], stream.t[seen], stream.values[seen, k, c])
    return filled
