"""How late each stream is against the encoders, without a model of the tissue.

A stream is regressed on the history of the encoders (powers, products, memories); that it is
late by D shows as -D d/dt of the part so explained. Memories are fitted beside it, so that a
tissue that relaxes is not taken for a clock: what decides are the corners of the motion. Lost
motion of pads whose travel no marker shows is fitted beside it as well: after every reversal they
are late too, but stay off while they are held.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm_brachy.diagnosis.signals.regressors import history_columns, moving, play, slope
from arm_brachy.diagnosis.statistics.gls import whitened

# s, of which the scores are compared: what a regression on the encoders leaves may last as long as
# a push, and sums over less make too little of it (Flyvbjerg & Petersen 1989, J Chem Phys 91:461)
BLOCKS = (1.0, 2.0, 4.0, 8.0)
FEWEST_BLOCKS = 6
REACH = 0.01       # s, over which slopes are taken
PASSES = 12
WIDEST = 3.0       # s, delay that is looked for
PACE = 0.1         # s, from one delay that is tried to the next: half a ramp of 0.1 s
THIN = 0.04        # s between the samples that are looked at meanwhile
BETTER = 30.0      # in chi^2: a delay that far away is taken only if it explains so much more
LOUD = 1.5         # times its noise, rms, that a channel must follow the pads to be asked
CLEAR = 0.2        # of the power of a slope that is its own, that a channel must have to be asked
SHARE = 0.2        # of its answer, sd of what a series remembers of each push with each memory
RANGE = 3.0        # times its standard deviation, a series' answer to the deepest push
CLOSE = 0.05       # of the standard deviation, when to stop
FEWEST = 50        # samples of a channel
PLAYS = (1e-4, 3e-4, 1e-3)  # m of lost motion; any in between is nearly a mixture


@dataclass(frozen=True)
class Lateness:
    """How late a stream's stamps are. value, sd : [s];  channels : names that were asked."""

    value: float
    sd: float
    channels: tuple


def lateness(stream, travel, touch, noise, *, memory=True, lost=()):
    """Lateness of a Stream against `travel`; None if no channel follows the pads loudly enough.

    travel : (tt (m,) [s], q (m, p) [m]) of the pads, by the clock of reference
    touch : [m] less travel counts as none;  noise : noise.Noise of the stream
    memory : let the stream remember (forces, tissue); False for what is rigid
    lost : numbers of pads that may have play
    The standard error is the largest of what the noise gives, or what is left if that is louder,
    of block estimates over 1 to 8 s, which see what the regressors do not explain, of how far
    series and the ways in and out of the pads differ, which a clock has all alike, and of what the
    fall of chi^2 from no delay tells: what is far and hardly explains more was led there by
    something else; and, of encoders that are read more seldom than PACE, of what is uniform
    between two readings. Delays up to WIDEST are tried one by one first, since from farther than
    half a ramp the slope leads elsewhere. None as well where the estimate does not settle, or
    beyond WIDEST.
    Test: diagnosis/structural/test_clocks.py
    """
    inside = heard(stream, travel)
    t, valid = stream.t[inside], stream.valid[inside]
    often = np.flatnonzero(valid.sum(axis=0) >= FEWEST)
    if not len(often) or len(t) < FEWEST:
        return None
    series = series_of(t, stream.values[inside][:, often], valid[:, often], noise.sd[often])
    following = Following(t, *series, noise.colour, travel, touch, memory, lost)
    late = following.scanned()
    for _ in range(PASSES):
        step, error, loud = following.step(late)
        if not loud.any():
            return None
        late, asked = late + step, loud
        if abs(step) < CLOSE * error:
            break
    else:
        return None
    if abs(late) >= WIDEST:
        return None
    fall = np.sum(following.gained(late)[asked])
    error = max(error, abs(late) / np.sqrt(max(fall, 1.0)))
    seldom = float(np.median(np.diff(travel[0])))
    if seldom > PACE:       # nobody saw where a ramp began
        error = max(error, seldom / np.sqrt(12.0))
    c = stream.values.shape[2]
    names = tuple(stream.names[often[i]] for i in np.flatnonzero(asked.reshape(-1, c).any(axis=1)))
    return Lateness(float(late), float(error), names)


def heard(stream, travel):
    """(n,) True for samples of a Stream within the time of `travel` that hold anything at all."""
    inside = (stream.t >= travel[0][0]) & (stream.t <= travel[0][-1])
    return inside & stream.valid.any(axis=1)


def series_of(t, values, valid, sd):
    """All components side by side over their noise (n, s), gaps bridged; where they were seen."""
    n, k, c = values.shape
    flat, mask = values.reshape(n, -1).copy(), np.repeat(valid, c, axis=1)
    for j in range(flat.shape[1]):
        seen = mask[:, j]
        flat[~seen, j] = np.interp(t[~seen], t[seen], flat[seen, j])
    return (flat - flat.mean(axis=0)) / sd.reshape(-1), mask


@dataclass(frozen=True)
class Following:
    """Series that follow the pads, regressed on where the encoders were some delay ago.

    t : (n,) [s] stamps;  y : (n, s) over the noise;  seen : (n, s) False where bridged
    colour : of the noise;  travel, touch, memory, lost : as in `lateness`
    """

    t: np.ndarray
    y: np.ndarray
    seen: np.ndarray
    colour: object
    travel: tuple
    touch: float
    memory: bool
    lost: tuple = ()

    def scanned(self):
        """The delay [s] on a grid from which to start, 0 unless another explains far more.

        A series that jumps leads nobody (`surprise`). Noise that lasts makes slow misfits larger
        than white noise of its size would, by its variance at low frequencies.
        """
        thin = self.thin()
        delays = PACE * np.arange(-round(WIDEST / PACE), round(WIDEST / PACE) + 1)
        left = np.array([thin.surprise(delay).sum() for delay in delays])
        best, zero = int(np.argmin(left)), len(delays) // 2
        lasting = self.colour.share * max(
            2.0 * self.colour.time / np.median(np.diff(thin.t)) - 1.0, 0.0)
        return float(delays[best]) if left[zero] - left[best] > BETTER * (1.0 + lasting) else 0.0

    def thin(self):
        """The same of fewer samples, THIN [s] apart."""
        every = max(int(THIN / np.median(np.diff(self.t))), 1)
        return replace(self, t=self.t[::every], seen=self.seen[::every],
                       y=np.where(self.seen, self.y, 0.0)[::every])

    def gained(self, late):
        """(s,) by how much chi^2 of each series falls from no delay to `late` [s], in units of
        the noise there.
        """
        fit = _Explained(self, late)
        return (_Explained(self, 0.0).cost - fit.cost) / fit.excess

    def step(self, late):
        """One Gauss-Newton step of the delay, its error, and which series follow the pads.

        The slope D of what is explained has the noise of the coefficients: its power is too large
        by so much, while the score D r is as loud as all of it (errors in variables: Fuller 1987,
        Measurement Error Models, sec. 1.2). A series counts as far as its slope is its own.
        """
        fit = _Explained(self, late)
        D, size, own = fit.slopes(self._white(
            (self._columns(late - REACH) - self._columns(late + REACH)) / (2.0 * REACH)))
        loud = (fit.follows > LOUD * np.sqrt(fit.excess)) & (own > CLEAR * size)
        if not loud.any():
            return 0.0, np.inf, loud
        share = own[loud] / size[loud]
        weight = share / fit.excess[loud]
        power = float(np.sum(own[loud] * weight))
        score, weights = (D * fit.left)[:, loud] * weight, D[:, loud]**2 * share * weight
        late = float(score.sum() / power)
        error = max(1.0 / np.sqrt(power), self._apart(score - late * weights) / power,
                    *(self._scatter(score.sum(axis=1), length) / power for length in BLOCKS))
        return late, error, loud

    def _apart(self, left):
        """Root sum of squares of what scores (n, s) leave in groups that should agree: series,
        and ways in and out of every pad.

        With what a fit of their mean takes: the jackknife of groups that weigh alike.
        """
        v = np.stack([slope(self.t, self.travel[0], q, REACH) for q in self.travel[1].T], axis=1)
        lead = np.abs(v).argmax(axis=1)
        way = 2 * lead + (np.take_along_axis(v, lead[:, None], axis=1)[:, 0] > 0.0)
        groups = left.sum(axis=0), np.bincount(way, weights=left.sum(axis=1))
        groups = [group[group != 0.0] for group in groups]
        return max((np.sqrt(len(group) / (len(group) - 1.0) * np.sum(group**2))
                    for group in groups if len(group) > 1), default=0.0)

    def _scatter(self, score, length):
        """Root sum of squares of the score (n,) over blocks of `length` [s], 0 of too few."""
        block = ((self.t - self.t[0]) / length).astype(int)
        first = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1])
        sums = np.add.reduceat(score, first)
        if len(sums) < FEWEST_BLOCKS:
            return 0.0
        sums = sums - sums.mean()       # whole, they are the step that is being taken
        return float(np.sqrt(np.sum(sums**2) * len(sums) / (len(sums) - 1)))

    def surprise(self, late):
        """(s,) what is left as chi^2, where it is louder than the noise as noise of its own size.
        """
        heard = np.maximum(self.seen.sum(axis=0), 1)
        left = self.left(late) / heard
        return heard * np.where(left > 1.0, np.log(np.maximum(left, 1.0)), left - 1.0)

    def left(self, late):
        """(s,) sums of squares of y that no encoder explains, its noise taken for white."""
        Q, _ = np.linalg.qr(self._columns(late))
        return np.sum((self.y - Q @ (Q.T @ self.y))**2, axis=0)

    @cached_property
    def held(self):
        """(1 + p,) how firmly each coefficient is held near zero: one over its standard deviation,
        in those of the series; 0 = it is free.
        """
        names = history_columns(self.t[:2], self.travel, self.touch, memory=self.memory)
        memories = [name.startswith('m') / (SHARE * RANGE) for name in names]
        size = np.abs(self.travel[1]).max(initial=0.0)
        # a play is a mixture of some: what each has of it is about one part of so many
        plays = [size * len(PLAYS) / (RANGE * width) for width in PLAYS]
        plays *= len(self._gone) // len(PLAYS)
        return np.array([0.0, *memories, *plays])

    def _columns(self, late):
        """(n, 1 + p) a constant, and the history of the encoders."""
        columns = history_columns(self.t - late, self.travel, self.touch, memory=self.memory)
        plays = [np.interp(self.t - late, self.travel[0], gone) for gone in self._gone]
        return np.stack([np.ones(len(self.t)), *columns.values(), *plays], axis=1)

    @cached_property
    def _gone(self):
        """(m,) of each play that a pad may have: what is lost of it, 0 to 1.

        A pad that never comes back has shown none: it is where it touches.
        """
        q = self.travel[1]
        back = (np.maximum.accumulate(q, axis=0) - q).max(axis=0) > self.touch
        return [(q[:, i] - play(q[:, i], width)) / width
                for i in moving(q, self.touch) if back[i] and i in self.lost for width in PLAYS]

    def _white(self, columns):
        return whitened(self.t, columns, self.colour, np.ones(len(self.t), dtype=bool))

    def _unexplained(self, Q, Y):
        """What of Y (n, s) orthonormal columns Q leave where it was seen."""
        return np.where(self.seen, Y - Q @ (Q.T @ Y), 0.0)


class _Explained:
    """Series of a Following regressed on where the encoders were `late` [s] ago.

    What is remembered has a prior, it is no more than the answer itself, and so has what a play
    takes, in proportion to its width. Without it a memory that is short, times a large number,
    says nearly what a delay says, and noise is taken for both.
    left : (n, s) whitened, zero where not seen;  cost : (s,) chi^2, prior included
    excess : (s,) of chi^2 over its expectation, at least 1;  follows : (s,) rms of what follows
    """

    def __init__(self, series, late):
        B = series._columns(late)
        self._seen, self._B, Y = series.seen, series._white(B), series._white(series.y)
        prior = series.held**2
        gram, wide = self._B.T @ self._B, np.maximum(np.std(series.y, axis=0), 1e-12)
        tiny = 1e-12 * np.trace(gram) * np.eye(len(gram))
        self._inverse = [np.linalg.inv(gram + np.diag(prior / a**2) + tiny) for a in wide]
        self._spread = [inverse @ gram @ inverse for inverse in self._inverse]
        self._beta = np.stack([inverse @ (self._B.T @ y) for inverse, y in
                               zip(self._inverse, Y.T, strict=True)], axis=1)
        self.left = np.where(self._seen, Y - self._B @ self._beta, 0.0)
        squares = np.sum(self.left**2, axis=0)
        self.cost = squares + np.sum(prior[:, None] * (self._beta / wide)**2, axis=0)
        free = np.array([np.sum(inverse * gram) for inverse in self._inverse])
        self.excess = np.maximum(
            squares / np.maximum(self._seen.sum(axis=0) - free, 1.0), 1.0)
        self.follows = np.sqrt(np.mean((B[:, 1:] @ self._beta[1:])**2, axis=0))

    def slopes(self, U):
        """(D (n, s), its power (s,), how much of it is not noise (s,)) of slopes U (n, p)."""
        BU, UU = self._B.T @ U, U.T @ U
        D, own = np.empty_like(self.left), np.empty(self.left.shape[1])
        for j, (inverse, spread) in enumerate(zip(self._inverse, self._spread, strict=True)):
            D[:, j] = self._B @ (inverse @ (BU @ self._beta[:, j])) - U @ self._beta[:, j]
            own[j] = np.sum((UU - BU.T @ inverse @ BU) * spread) * self.excess[j]
        D = np.where(self._seen, D, 0.0)
        size = np.maximum(np.sum(D**2, axis=0), 1e-300)
        return D, size, size - own * self._seen.mean(axis=0)
