"""Servo lag: the motor follows its set point late, by a time constant, a dead time or both."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import ActuationTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class LagMemory:
    """State of the lag.

    output : (n,) [m] at the last time
    times : (k,) [s] and inputs : (k, n) [m], what the dead time still has to play back;
        times is empty before the first step
    """

    output: np.ndarray
    times: np.ndarray
    inputs: np.ndarray


@dataclass(frozen=True)
class ActuatorLag(ActuationTerm):
    """First-order lag after a dead time, solved exactly for input that is linear between steps.

    Symbols: u set point, y motor position, tau `time_constant`, D `delay` [s]. The set point comes
    from a speed-limited profile, so linear between steps is off by at most
    max_acceleration dt^2 / 8. Unity gain: no error at rest.
    Test: devices/terms/test_actuator_lag.py
    """

    time_constant: float = quantity(
        20.0, 'ms', 'time constant of the first-order response', low=0.0, high=5000.0,
        prior=('lognormal', 20.0, 3.0), typical=20.0,
        source='position loop of 8 Hz bandwidth, usual for a geared DC linear servo '
               '(engineering judgement; identify with a ramp)', neutral=0.0)
    delay: float = quantity(
        0.0, 'ms', 'dead time before the motor answers', low=0.0, high=5000.0,
        prior=('uniform', 0.0, 100.0), typical=20.0,
        source='one period of the usual 50 Hz RC-servo command (Actuonix L16-R) is 20 ms',
        neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='actuator_lag', kind=Kind.ACTUATION, stage=Stage.SETPOINT,
        summary='the motor follows its set point late',
        equation="tau y'(t) + y(t) = u(t - D)",
        source='definition: first-order lag with dead time',
        invisible_when='encoders are recorded: they show the motor late and drive the model; only '
                       'rest positions are recorded; with one constant speed and no hold it '
                       'equals an offset; without the encoder it equals a clock offset',
        leaves_open='a loop of second order that overshoots; another time constant in either '
                    'direction; a limit of speed')

    def memory(self, q0):
        """Return the state of a bank that has rested at q0 (n,) [m] for ever."""
        q0 = np.array(q0, dtype=float)
        return LagMemory(q0, np.zeros(0), q0[None].copy())

    def step(self, memory, u, effort, t, dt):
        """Return (motor positions (n,) [m] at t, new memory), given the set point u (n,) at t."""
        times = memory.times if len(memory.times) else np.array([t - dt])
        times = np.append(times, t)
        inputs = np.vstack([memory.inputs, u])
        y = self._response(memory.output, times, inputs, t, dt)
        keep = max(np.searchsorted(times, t - self.delay, side='right') - 1, 0)
        return y, LagMemory(y.copy(), times[keep:], inputs[keep:])

    def _response(self, y, times, inputs, t, dt):
        """Carry the lag across (t - dt, t], kink by kink of the delayed input."""
        start, end = t - dt - self.delay, t - self.delay
        inner = times[(times > start) & (times < end)]
        knots = np.concatenate([[start], inner, [end]])
        delayed = [_at(s, times, inputs) for s in knots]
        for i in range(len(knots) - 1):
            y = first_order(y, delayed[i], delayed[i + 1], knots[i + 1] - knots[i],
                            self.time_constant)
        return y


def first_order(y, u0, u1, duration, time_constant):
    """Response of tau y' + y = u at the end of a span over which u runs linearly.

    y : (n,) output at the start;  u0, u1 : (n,) input at start and end;  duration : s, >= 0
    Exact. time_constant = 0 returns u1.
    """
    if time_constant == 0.0 or duration == 0.0:
        return np.array(u1 if duration > 0.0 else y, dtype=float)
    x = duration / time_constant
    return u1 + (y - u0) * np.exp(-x) + (u1 - u0) / x * np.expm1(-x)


def _at(s, times, inputs):
    """Input at time s, linear between records, constant outside them."""
    if s <= times[0]:
        return inputs[0]
    i = int(np.searchsorted(times, s, side='right')) - 1
    if i >= len(times) - 1:
        return inputs[-1]
    fraction = (s - times[i]) / (times[i + 1] - times[i])
    return inputs[i] + fraction * (inputs[i + 1] - inputs[i])
