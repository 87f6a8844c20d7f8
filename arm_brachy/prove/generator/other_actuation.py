"""Other laws between an encoder and its pad; functions as in `actuation`.

Shares and times that no value names are own choices, such that the effect peaks about where the
registry's does.
"""
import numpy as np
from numba import njit
from scipy.signal import cont2discrete, lfilter

from arm_brachy.prove.generator.actuation import chosen, give_way, play
from arm_brachy.prove.generator.form import Form
from arm_brachy.prove.generator.protocol import RATE


def farthest(u):
    """Longest travel, or strongest force, of every pad in the run (p,); never zero."""
    return np.maximum(np.abs(u).max(axis=0), 1e-9)


def dead_time(t, u, ms):
    """Travel u (t, p), `ms` late."""
    return np.column_stack([np.interp(t - ms * 1e-3, t, c) for c in u.T])


def overshooting(t, u, names, v, push_back, damping=0.5):
    """Dead time, then a position loop that overshoots by a sixth and is as late on a ramp."""
    late = dead_time(t, u, v['delay_ms'])
    # On a ramp y'' / w^2 + 2 damping y' / w + y = u is late by 2 damping / w.
    w = 2 * damping / (v['time_constant_ms'] * 1e-3)
    (b,), a, _ = cont2discrete(([w**2], [1, 2 * damping * w, w**2]), 1 / RATE)
    return lfilter(b, a, late - late[0], axis=0) + late[0]


def slower_inwards(t, u, names, v, push_back, apart=0.4):
    """Dead time, then a lag longer by `apart` against the tissue, and as much shorter with it."""
    constant = np.array([1 + apart, 1 - apart]) * v['time_constant_ms'] * 1e-3
    return two_way_lag(dead_time(t, u, v['delay_ms']), *-np.expm1(-1 / (RATE * constant)))


@njit(cache=True)
def two_way_lag(u, inwards, outwards):
    """What follows u (t, p) by one share of the gap a step if u is ahead, by another if not."""
    y = u.copy()
    for i in range(1, u.shape[0]):
        for j in range(u.shape[1]):
            gap = u[i, j] - y[i - 1, j]
            y[i, j] = y[i - 1, j] + (inwards if gap > 0 else outwards) * gap
    return y


def growing(t, u, names, v, push_back):
    """Pitch that is right at home and ever more wrong on the way: a parabola, equal at the end."""
    return scaled(u, names, v, u * np.abs(u) / farthest(u))


def fading(t, u, names, v, push_back):
    """Pitch that is most wrong at home and right at the end: a parabola, equal at the end."""
    return scaled(u, names, v, u * (2 - np.abs(u) / farthest(u)))


def scaled(u, names, v, bent):
    """Travel with the gain on `bent` (t, p) instead of u."""
    return np.where(chosen(names, v['actuators']), u + v['gain'] * bent + v['offset_mm'] * 1e-3, u)


def rounded(t, u, names, v, push_back, shares=(0.0, 0.0, 0.5, 3.5)):
    """Plays side by side, of `shares` of the width: corners are rounded, as much is lost at last.

    The model of Prandtl and Ishlinskii: Visintin 1994, Differential Models of Hysteresis.
    """
    y = np.mean([play(u, share * v['width_mm'] * 1e-3) for share in shares], axis=0)
    return np.where(chosen(names, v['actuators']), y, u)


def creeping_back(t, u, names, v, push_back, time=1.0):
    """Play through which tissue pushes the pad back to where it began, in about `time` [s].

    Pushing, the pad lies on the flank that drives it. Of a fast motor that withdraws it is left
    behind as in the registry's law; of a slow one it creeps back onto that flank.
    """
    y = creeping_play(u - u[0], v['width_mm'] * 1e-3, -np.expm1(-1 / (RATE * time))) + u[0]
    return np.where(chosen(names, v['actuators']), y, u)


@njit(cache=True)
def creeping_play(u, width, share):
    """Play (t, p) of u (t, p) in which a share of the way to zero is gone in every step."""
    y = u.copy()
    for i in range(1, u.shape[0]):
        for j in range(u.shape[1]):
            y[i, j] = min(max((1 - share) * y[i - 1, j], u[i, j] - width), u[i, j])
    return y


def worn_at_home(t, u, names, v, push_back, more=0.4):
    """Play wider by `more` at home, where a screw wears, and as much narrower at the far end."""
    width = v['width_mm'] * 1e-3 * (1 + more - 2 * more * np.clip(u / farthest(u), 0, 1))
    return np.where(chosen(names, v['actuators']), pushed_between(u - width, u), u)


@njit(cache=True)
def pushed_between(low, high):
    """What stays where it is unless `low` or `high` (t, p) push it; starts at `high`."""
    y = high.copy()
    for i in range(1, high.shape[0]):
        for j in range(high.shape[1]):
            y[i, j] = min(max(y[i - 1, j], low[i, j]), high[i, j])
    return y


def in_two_goes(t, u, names, v, push_back, pause=3.0):
    """Half is lost at the onset, half `pause` [s] later."""
    return short(u, names, v, two_goes(t, v['onset_s'], pause))


def slipping(t, u, names, v, push_back, lasts=1.5):
    """Steps are lost one after another from the onset on, over `lasts` [s]."""
    return short(u, names, v, np.clip((t - v['onset_s']) / lasts, 0, 1))


def two_goes(t, onset, pause):
    """Share (t,) of what happens half at the onset and half `pause` [s] later."""
    return 0.5 * (t >= onset) + 0.5 * (t >= onset + pause)


def short(u, names, v, share):
    """Travel short by a share (t,) of the shortfall."""
    lost = share[:, None] * v['shortfall_mm'] * 1e-3
    return u - np.where(chosen(names, v['actuators']), lost, 0.0)


def stiffening(t, u, names, v, push_back, bend=1.0):
    """Spring that stiffens, fourfold up to the run's strongest force, where it gives as much."""
    c = compliances(names, v)
    top = farthest(push_back(u))
    return give_way(u, push_back,
                    lambda f: c * f * (1 + bend) / (1 + bend * np.abs(f) / top))


def rubbing(t, u, names, v, push_back, rubs=0.5, width=0.25):
    """Spring whose leaves rub: a share `rubs` of what it gives lags the force by a play.

    width : half the play over the strongest force;  once around, the pad does not come home
    """
    c = compliances(names, v)
    half = width * farthest(push_back(u))

    def yielding(force):
        return c * ((1 - rubs) * force + rubs * centred_play(force, half))
    return give_way(u, push_back, yielding)


def compliances(names, v):
    """Compliance of every actuator (p,) [m/N]."""
    return np.where(chosen(names, v['actuators']), v['compliance_mm_N'] * 1e-3, 0.0)


def centred_play(force, half):
    """Play (t, p) of half the width (p,), fresh from the unloaded state."""
    unloaded = np.zeros((1, force.shape[1]))
    low, high = (np.vstack([unloaded, force + side * half]) for side in (-1, 1))
    return pushed_between(low, high)[1:]


OTHER_ACTUATION = {
    'actuator_lag': {'overshooting': Form(overshooting),
                     'slower_inwards': Form(slower_inwards)},
    'actuator_gain': {'growing': Form(growing), 'fading': Form(fading)},
    # A play that begins inside its gap is the registry's, which has a `start`.
    'backlash': {'rounded': Form(rounded),
                 'creeping_back': Form(creeping_back),
                 'worn_at_home': Form(worn_at_home)},
    # They begin at the onset, but a step that resembles them most is later.
    'lost_steps': {'in_two_goes': Form(in_two_goes, same=('shortfall_mm',)),
                   'slipping': Form(slipping, same=('shortfall_mm',))},
    'actuator_compliance': {'stiffening': Form(stiffening), 'rubbing': Form(rubbing)},
}
