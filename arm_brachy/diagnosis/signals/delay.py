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

from arm_brachy.diagnosis.signals.regressors import history_columns, moving, play
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
    The standard error is the largest of what the noise gives, of block estimates over 1 to 8 s,
    which see what the regressors do not explain, and of what the fall of chi^2 from no delay
    tells: what is far and hardly explains more was led there by something else. Delays up to
    WIDEST are tried one by one first, since from farther than half a ramp the slope leads
    elsewhere. None as well where the estimate does not settle, or beyond WIDEST.
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
    fall = np.sum(following.misfit(0.0)[asked] - following.misfit(late)[asked])
    error = max(error, abs(late) / np.sqrt(max(fall, 1.0)))
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

    def misfit(self, late):
        """(s,) chi^2 that each series leaves."""
        Q, _ = np.linalg.qr(self._white(self._columns(late)))
        return np.sum(self._unexplained(Q, self._white(self.y))**2, axis=0)

    def step(self, late):
        """One Gauss-Newton step of the delay, its error, and which series follow the pads."""
        B = self._columns(late)
        slope = (self._columns(late - REACH) - self._columns(late + REACH)) / (2.0 * REACH)
        Q, R = np.linalg.qr(self._white(B))
        Y = self._white(self.y)
        beta = np.linalg.lstsq(R, Q.T @ Y, rcond=1e-8)[0]
        loud = np.sqrt(np.mean((B[:, 1:] @ beta[1:])**2, axis=0)) > LOUD
        D = self._unexplained(Q, self._white(-slope @ beta))[:, loud]
        left = np.where(self.seen, Y - Q @ (R @ beta), 0.0)[:, loud]
        power = float(np.sum(D**2))
        if power == 0.0:
            return 0.0, np.inf, np.zeros_like(loud)
        score = np.sum(D * left, axis=1)
        blocks = max(self._scatter(score, length) for length in BLOCKS) / power
        return float(score.sum() / power), max(1.0 / np.sqrt(power), blocks), loud

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
