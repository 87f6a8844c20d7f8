"""Set points of the pads over time: pushes alone, slow and fast, a long hold, pairs, idling."""
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

RATE = 1000.0


@dataclass(frozen=True)
class Push:
    """Pads (k,) move together to shares of their strokes (k,) and back, after which they rest.

    speed [m/s] of the one that goes farthest; hold, rest [s].
    """

    pads: tuple
    shares: tuple
    speed: float
    hold: float
    rest: float


@dataclass(frozen=True)
class Protocol:
    """Pushes one after another, between idle stretches [s] at begin and end."""

    pushes: tuple
    idle: float = 3.0


def draw_protocol(rng, body):
    """Protocol of one case: every pad slow and fast, one deep and long, two pairs."""
    pads = rng.permutation(len(body.pads)).tolist()
    share = rng.uniform(0.68, 0.8)
    hold = rng.uniform(0.3, 0.5)
    slow = [Push((i,), (share,), 0.002, hold, hold) for i in pads for _ in range(2)]
    fast = [Push((i,), (share,), 0.020, hold, hold) for i in pads for _ in range(2)]
    deep = Push((pads[-1],), (1.0,), 0.004, rng.uniform(6, 9), rng.uniform(4, 6))
    pairs = [Push(pair, (2 / 3, rng.uniform(0.55, 2 / 3)), 0.003, hold, hold)
             for pair in body.pairs[:-1]]
    middle = [*fast, *pairs] if rng.random() < 0.5 else [*pairs, *fast]
    return Protocol((*slow, *middle, deep))


def draw_heldout(rng, body):
    """Protocol never shown: the pair left out, another speed and amplitude."""
    pair = body.pairs[-1]
    alone = int(rng.integers(len(body.pads)))
    return Protocol((
        Push(pair, (0.6, 0.5), 0.007, 1.0, 1.0),
        Push((alone,), (0.9,), 0.007, 1.0, 1.0),
        Push(pair, (0.35, 0.66), 0.007, 1.0, 1.0),
    ), idle=1.0)


def set_points(protocol, strokes, smooth=0.03):
    """Times (t,) [s] at `RATE`, and set points (t, p) [m] of pads with `strokes` (p,) [m].

    smooth : length of the mean that rounds the corners of the ramps [s].
    """
    knots, values = [0.0, protocol.idle], [np.zeros(len(strokes))] * 2
    for push in protocol.pushes:
        goal = np.zeros(len(strokes))
        goal[list(push.pads)] = np.array(push.shares) * strokes[list(push.pads)]
        ramp = goal.max() / push.speed
        for length, value in ((ramp, goal), (push.hold, goal), (ramp, 0 * goal),
                              (push.rest, 0 * goal)):
            knots.append(knots[-1] + length)
            values.append(value)
    t = np.arange(0, knots[-1] + protocol.idle, 1 / RATE)
    u = np.column_stack([np.interp(t, knots, v) for v in np.array(values).T])
    return t, uniform_filter1d(u, int(smooth * RATE), axis=0, mode='nearest')
