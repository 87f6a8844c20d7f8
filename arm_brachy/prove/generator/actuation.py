"""Effects between an encoder and its pad: each takes motor travel to pad travel, on a fine clock.

Every function: t (t,) [s] at `RATE`, u (t, p) motor travel [m], names of the pads, parameters as
the catalogue names them, and push_back, which gives the force (t, p) [N] against the pads at
travel y (t, p).  Returns y (t, p) [m].
"""
import numpy as np
from numba import njit
from scipy.signal import lfilter

from arm_brachy.prove.generator.protocol import RATE
from arm_brachy.prove.generator.solver import NotSolved


def chosen(names, wanted):
    """Which of `names` are wanted (p,) bool; none named means all."""
    return np.array([not wanted or name in wanted for name in names])


def lag(t, u, names, v, push_back):
    """Dead time, then a first-order lag."""
    late = np.column_stack([np.interp(t - v['delay_ms'] * 1e-3, t, c) for c in u.T])
    rho = np.exp(-1 / (RATE * v['time_constant_ms'] * 1e-3)) if v['time_constant_ms'] else 0.0
    return lfilter([1 - rho], [1, -rho], late - late[0], axis=0) + late[0]


def gain(t, u, names, v, push_back):
    """Scale and zero error of the transmission."""
    y = (1 + v['gain']) * u + v['offset_mm'] * 1e-3
    return np.where(chosen(names, v['actuators']), y, u)


def backlash(t, u, names, v, push_back):
    """Play: the pad stays where it is until the motor has crossed the gap."""
    return np.where(chosen(names, v['actuators']), play(u, v['width_mm'] * 1e-3), u)


@njit(cache=True)
def play(u, width):
    """Play operator (t, p) of u (t, p): never ahead of u, never more than `width` behind."""
    y = u.copy()
    for i in range(1, u.shape[0]):
        for j in range(u.shape[1]):
            y[i, j] = min(max(y[i - 1, j], u[i, j] - width), u[i, j])
    return y


def lost_steps(t, u, names, v, push_back):
    """From the onset on the pad stands short."""
    late = (t >= v['onset_s'])[:, None] & chosen(names, v['actuators'])
    return u - np.where(late, v['shortfall_mm'] * 1e-3, 0)


def compliance(t, u, names, v, push_back):
    """Spring in series: y = u - c F(y)."""
    c = np.where(chosen(names, v['actuators']), v['compliance_mm_N'] * 1e-3, 0.0)
    return give_way(u, push_back, lambda force: c * force)


def give_way(u, push_back, yielding, steps=12):
    """Travel y = u - yielding(F(y)), by secants through every instant at once.

    yielding : takes the force (t, p) [N] to what is lost (t, p) [m].  Raises NotSolved.
    """
    miss = yielding(push_back(u))
    y, before = u - miss, u
    for _ in range(steps):
        error = y + yielding(push_back(y)) - u
        if np.abs(error).max() < 1e-8:
            return y
        slope = np.where(np.abs(y - before) > 1e-12, (error - miss) / (y - before + 1e-30), 1.0)
        before, miss = y, error
        y = y - error / np.where(np.abs(slope) > 0.2, slope, 1.0)
    raise NotSolved(f'actuator_compliance: {np.abs(error).max()} m off after {steps} secants')


ACTUATION = {
    'actuator_lag': lag,
    'actuator_gain': gain,
    'backlash': backlash,
    'lost_steps': lost_steps,
    'actuator_compliance': compliance,
}
