"""Everything measured at the states, as one vector whose noise is white."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL, components

KINDS = (OPTICAL, EM, FORCE)


@dataclass(frozen=True)
class Measured:
    """One stream at n states, positions in the world frame; d = 3, or 1 where it has `along`.

    kind : OPTICAL, EM or FORCE;  names : c channels;  values : (n, c, d) SI;  valid : (n, c)
    sd : (n, c, d) of the values, windows averaged;  correlation : (n, n) of noise between states
    own : (n, c, d) or 0, standard deviation of what differs from state to state besides: a sensor
        that is slow remembers its noise, a model its errors not
    along : (c, 3) as of a stream.Stream, None = all three axes are measured
    """

    kind: str
    names: tuple
    values: np.ndarray
    valid: np.ndarray
    sd: np.ndarray
    correlation: np.ndarray
    own: np.ndarray | float = 0.0
    along: np.ndarray | None = None

    @property
    def total(self):
        """(n, c, d) standard deviation of all together."""
        return np.hypot(self.sd, self.own)


@dataclass(frozen=True)
class Row:
    """What one entry of the vector is: stream, channel, axis 0 to 2 and number of the state.

    Of what is measured along one direction, the axis that this is nearest to.
    """

    kind: str
    channel: str
    axis: int
    state: int


def measured(states):
    """Return the Measured of every stream of LoadStates that a tissue model predicts."""
    out = []
    for kind in (kind for kind in KINDS if kind in states.streams):
        stream = states.streams[kind]
        valid = np.isfinite(stream.values).all(axis=2)
        sd = np.sqrt(np.where(valid[..., None], stream.variance, 1.0))
        out.append(Measured(kind, stream.names, stream.values, valid, sd,
                            states.correlation[kind], along=stream.along))
    return tuple(out)


class Observables:
    """The measured streams of one recording as one whitened vector.

    measured : Measured of each stream, in the order of KINDS;  channels : kind -> names in the
        order of the model's arrays (forward.Predicted)
    rows : N Row, only what is valid, by stream, channel, axis and state
    Channels and axes are independent; states of one channel are correlated, which `whiten` takes
    out by the Cholesky factor of each channel's covariance.
    Raises InputError for a channel that the model does not have.
    Test: diagnosis/forward/test_observables.py
    """

    def __init__(self, measured, channels):
        self.measured, self._channels = tuple(measured), channels
        self._blocks, rows = [], []
        for stream in self.measured:
            unknown = [n for n in stream.names if n not in channels[stream.kind]]
            if unknown:
                raise InputError(f'{stream.kind} has {", ".join(unknown)}; the model knows '
                                 f'{", ".join(channels[stream.kind])}; give the same scene')
            for c, name in enumerate(stream.names):
                seen = np.flatnonzero(stream.valid[:, c])
                there = channels[stream.kind].index(name)
                way = None if stream.along is None else stream.along[c]
                for axis in range(stream.sd.shape[2]) if len(seen) else ():
                    sd = stream.sd[seen, c, axis]
                    own = np.broadcast_to(stream.own, stream.sd.shape)[seen, c, axis]
                    covariance = np.diag(own**2) + (
                        np.outer(sd, sd) * stream.correlation[np.ix_(seen, seen)])
                    factor = cholesky(covariance, lower=True)
                    self._blocks.append((stream.kind, c, there, axis, way, seen, factor))
                    near = axis if way is None else int(np.argmax(np.abs(way)))
                    rows += [Row(stream.kind, name, near, int(i)) for i in seen]
        self.rows = tuple(rows)

    def at(self, states):
        """The Observables at some states (m,) only, numbered anew."""
        return Observables([replace(
            stream, values=stream.values[states], valid=stream.valid[states],
            sd=stream.sd[states], correlation=stream.correlation[np.ix_(states, states)],
            own=np.broadcast_to(stream.own, stream.sd.shape)[states])
            for stream in self.measured], self._channels)

    def less(self, shift):
        """The Observables with kind -> (n, c, 3) in the model's order taken off what was measured.

        A kind that is left out stays as it is.
        """
        def put_right(stream):
            if stream.kind not in shift:
                return stream
            there = [self._channels[stream.kind].index(name) for name in stream.names]
            return replace(stream, values=stream.values - components(
                shift[stream.kind][:, there], stream.along))
        return Observables([put_right(stream) for stream in self.measured], self._channels)

    def louder(self, factors, memory):
        """The Observables with more noise: kind -> factor of the variance.

        memory : (n, n) correlation between states of what is added
        """
        def more(stream):
            f = factors.get(stream.kind, 1.0)
            return replace(stream, sd=np.sqrt(f) * stream.sd,
                           correlation=(stream.correlation + (f - 1.0) * memory) / f)
        return Observables([more(stream) for stream in self.measured], self._channels)

    @property
    def states(self):
        """(N,) number of the state of every row."""
        return np.array([row.state for row in self.rows], dtype=int)

    def whiten(self, values):
        """Return (N, k) of arrays kind -> (n, c, 3, k) in the model's order, each over the noise.

        A kind that is left out counts as zero.
        """
        k = next(iter(values.values())).shape[3]
        out = []
        for kind, _, there, axis, way, seen, factor in self._blocks:
            part = (_shown(values[kind][seen, there], axis, way) if kind in values
                    else np.zeros((len(seen), k)))
            out.append(solve_triangular(factor, part, lower=True))
        return np.concatenate(out) if out else np.zeros((0, k))

    def whiten_feature(self, values):
        """Return (N,) of what is values (n,) at every state, alike in all channels."""
        out = [solve_triangular(factor, values[seen], lower=True)
               for *_, seen, factor in self._blocks]
        return np.concatenate(out) if out else np.zeros(0)

    def whiten_shift(self, shift):
        """Return (N,) of kind -> (n, c, 3) in the model's order, over the noise; {} = zeros."""
        if not shift:
            return np.zeros(len(self.rows))
        return self.whiten({kind: values[..., None] for kind, values in shift.items()})[:, 0]

    def times(self, values, factors):
        """Return whitened values (N,) as if each state were its factor (n,) times as large."""
        out, first = [], 0
        for *_, seen, factor in self._blocks:
            grown = factors[seen] * (factor @ values[first:first + len(seen)])
            out.append(solve_triangular(factor, grown, lower=True))
            first += len(seen)
        return np.concatenate(out) if out else np.zeros(0)

    def coloured(self, values):
        """Return (N,) SI of whitened values (N,): the inverse of what whitening did."""
        out, first = [], 0
        for *_, seen, factor in self._blocks:
            out.append(factor @ values[first:first + len(seen)])
            first += len(seen)
        return np.concatenate(out) if out else np.zeros(0)

    @property
    def sd(self):
        """(N,) standard deviation of every row, SI."""
        by_kind = {stream.kind: stream for stream in self.measured}
        out = [by_kind[kind].total[seen, c, axis]
               for kind, c, _, axis, _, seen, _ in self._blocks]
        return np.concatenate(out) if out else np.zeros(0)

    @property
    def values(self):
        """(N,) what was measured, SI."""
        by_kind = {stream.kind: stream for stream in self.measured}
        out = [by_kind[kind].values[seen, c, axis]
               for kind, c, _, axis, _, seen, _ in self._blocks]
        return np.concatenate(out) if out else np.zeros(0)

    def difference(self, predicted):
        """Return (N,) measured minus predicted, SI.

        predicted : kind -> (n, c, 3) in the model's order, e.g. `Baseline.shown`
        """
        by_kind = {stream.kind: stream for stream in self.measured}
        out = [by_kind[kind].values[seen, c, axis]
               - _shown(predicted[kind][seen, there], axis, way)
               for kind, c, there, axis, way, seen, _ in self._blocks]
        return np.concatenate(out) if out else np.zeros(0)

    def residual(self, predicted):
        """Return (N,) measured minus predicted over the noise.

        predicted : kind -> (n, c, 3) in the model's order, e.g. `Baseline.shown`
        """
        difference, out, first = self.difference(predicted), [], 0
        for *_, seen, factor in self._blocks:
            out.append(solve_triangular(factor, difference[first:first + len(seen)], lower=True))
            first += len(seen)
        return np.concatenate(out) if out else np.zeros(0)


def _shown(vectors, axis, way):
    """(m, ...) of vectors (m, 3, ...): along `way` (3,), None = along an axis."""
    return vectors[:, axis] if way is None else np.tensordot(vectors, way, (1, 0))


def channels_of(specimen):
    """Return kind -> names of a specimen.Specimen, in the order of a model's arrays."""
    return {OPTICAL: specimen.markers, EM: specimen.tools, FORCE: specimen.pads}
