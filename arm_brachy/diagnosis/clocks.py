"""How late each stream is against the encoders, without a model of the tissue.

A stream is regressed on the history of the encoders (powers, products, memories); that it is
late by D shows as -D d/dt of the part so explained. Memories are fitted beside it, so that a
tissue that relaxes is not taken for a clock: what decides are the corners of the motion.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.history import history_columns
from arm_brachy.diagnosis.regression import BLOCK, whitened

REACH = 0.01       # s, over which slopes are taken
PASSES = 12
WIDEST = 3.0       # s, delay that is looked for
PACE = 0.1         # s, from one delay that is tried to the next: half a ramp of 0.1 s
THIN = 0.04        # s between the samples that are looked at meanwhile
BETTER = 30.0      # in chi^2: a delay that far away is taken only if it explains so much more
LOUD = 1.5         # times its noise, rms, that a channel must follow the pads to be asked
CLOSE = 0.05       # of the standard deviation, when to stop
FEWEST = 50        # samples of a channel


@dataclass(frozen=True)
class Lateness:
    """How late a stream's stamps are. value, sd : [s];  channels : names that were asked."""

    value: float
    sd: float
    channels: tuple


def lateness(stream, travel, touch, noise, *, memory=True):
    """Lateness of a Stream against `travel`; None if no channel follows the pads loudly enough.

    travel : (tt (m,) [s], q (m, p) [m]) of the pads, by the clock of reference
    touch : [m] less travel counts as none;  noise : noise.Noise of the stream
    memory : let the stream remember (forces, tissue); False for what is rigid
    The standard error is the largest of what the noise gives, of the block estimate over 1 s,
    which sees what the regressors do not explain, and of what the fall of chi^2 from no delay
    tells: what is far and hardly explains more was led there by something else. Delays up to
    WIDEST are tried one by one first, since from farther than half a ramp the slope leads
    elsewhere. None as well where the estimate does not settle.
    Test: diagnosis/structural/test_clocks.py
    """
    inside = (stream.t >= travel[0][0]) & (stream.t <= travel[0][-1])
    t, valid = stream.t[inside], stream.valid[inside]
    often = np.flatnonzero(valid.sum(axis=0) >= FEWEST)
    if not len(often) or len(t) < FEWEST:
        return None
    y, mask, sd = _series(t, stream.values[inside][:, often], valid[:, often], noise.sd[often])
    late = _scanned(t, y, mask, sd, travel, touch, memory, noise.colour)
    for _ in range(PASSES):
        step, error, loud = _step(t - late, t, y, mask, sd, travel, touch, noise.colour, memory)
        if not loud.any():
            return None
        late, asked = late + step, loud
        if abs(step) < CLOSE * error:
            break
    else:
        return None
    fall = np.diff([_misfit(then, t, y, mask, sd, travel, touch, noise.colour, memory)[asked].sum()
                    for then in (t - late, t)])[0]
    error = max(error, abs(late) / np.sqrt(max(fall, 1.0)))
    c = stream.values.shape[2]
    names = tuple(stream.names[often[i]] for i in np.flatnonzero(asked.reshape(-1, c).any(axis=1)))
    return Lateness(float(late), float(error), names)


def _scanned(t, y, mask, sd, travel, touch, memory, colour):
    """The delay [s] on a grid from which to start, 0 unless another explains far more.

    Noise that lasts makes slow misfits larger than white noise of its size would, by its variance
    at low frequencies.
    """
    every = max(int(THIN / np.median(np.diff(t))), 1)
    t, mask = t[::every], mask[::every]
    Y = np.where(mask, y[::every] / sd, 0.0)
    delays = PACE * np.arange(-round(WIDEST / PACE), round(WIDEST / PACE) + 1)
    left = np.array([_left(t - delay, Y, travel, touch, memory) for delay in delays])
    best, zero = int(np.argmin(left)), len(delays) // 2
    lasting = colour.share * max(2.0 * colour.time / np.median(np.diff(t)) - 1.0, 0.0)
    scale = max(left[best] / max(mask.sum(), 1), 1.0) * (1.0 + lasting)
    return float(delays[best]) if left[zero] - left[best] > BETTER * scale else 0.0


def _left(then, Y, travel, touch, memory):
    """Sum of squares of Y (n, s) that the encoders' history does not explain."""
    columns = history_columns(then, travel, touch, memory=memory)
    Q, _ = np.linalg.qr(np.stack([np.ones(len(then)), *columns.values()], axis=1))
    return float(np.sum((Y - Q @ (Q.T @ Y))**2))


def _series(t, values, valid, sd):
    """All components side by side (n, s), gaps bridged; where they were seen; their noise (s,)."""
    n, k, c = values.shape
    flat, mask = values.reshape(n, -1).copy(), np.repeat(valid, c, axis=1)
    for j in range(flat.shape[1]):
        seen = mask[:, j]
        flat[~seen, j] = np.interp(t[~seen], t[seen], flat[seen, j])
    return flat - flat.mean(axis=0), mask, sd.reshape(-1)


def _misfit(then, t, y, mask, sd, travel, touch, colour, memory):
    """(s,) sum of squares, over the noise, that each series leaves with the encoders at `then`."""
    B, _ = _basis(then, travel, touch, memory)
    everywhere = np.ones(len(t), dtype=bool)
    Q, _ = np.linalg.qr(whitened(t, B, colour, everywhere))
    Y = whitened(t, y / sd, colour, everywhere)
    return np.sum(np.where(mask, Y - Q @ (Q.T @ Y), 0.0)**2, axis=0)


def _step(then, t, y, mask, sd, travel, touch, colour, memory):
    """One Gauss-Newton step of the delay, its error, and which series follow the pads."""
    B, slope = _basis(then, travel, touch, memory)
    everywhere = np.ones(len(t), dtype=bool)
    W = whitened(t, B, colour, everywhere)
    Y = whitened(t, y / sd, colour, everywhere)
    Q, R = np.linalg.qr(W)
    beta = np.linalg.lstsq(R, Q.T @ Y, rcond=1e-8)[0]
    loud = np.sqrt(np.mean((B[:, 1:] @ beta[1:]) ** 2, axis=0)) > LOUD
    D = whitened(t, -slope @ beta, colour, everywhere)
    D = np.where(mask, D - Q @ (Q.T @ D), 0.0)[:, loud]
    left = np.where(mask, Y - W @ beta, 0.0)[:, loud]
    power = float(np.sum(D ** 2))
    if power == 0.0:
        return 0.0, np.inf, np.zeros_like(loud)
    score = np.sum(D * left, axis=1)
    first = np.concatenate([[0], np.flatnonzero(np.diff(((t - t[0]) / BLOCK).astype(int))) + 1])
    blocks = np.sqrt(np.sum(np.add.reduceat(score, first) ** 2)) / power
    return float(score.sum() / power), max(1.0 / np.sqrt(power), float(blocks)), loud


def _basis(then, travel, touch, memory):
    """Regressors (n, 1 + p), a constant first, and their slopes in time."""
    columns = history_columns(then, travel, touch, memory=memory)
    after = history_columns(then + REACH, travel, touch, memory=memory)
    before = history_columns(then - REACH, travel, touch, memory=memory)
    n = len(then)
    B = np.stack([np.ones(n), *columns.values()], axis=1)
    slope = np.stack([np.zeros(n), *((after[k] - before[k]) / (2.0 * REACH) for k in columns)],
                     axis=1)
    return B, slope
