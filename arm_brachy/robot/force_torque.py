"""The force-torque sensor between flange and probe: what it reads, and what the probe feels.

    reading = contact + weight + inertia of the tool + bias + noise,  all in the sensor's frame
Readings at rest in several orientations give mass, centre of mass and bias by linear least
squares; the bias is then followed while nothing touches the probe, since it drifts with heat.
The tool's inertia is neglected: at the 2 m/s2 of a reference it is 0.9 N of a 0.45 kg tool along
the acceleration, and nothing in a steady sweep.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantity

_MINUTE = 60.0
FEWEST = 3              # orientations; two leave a centre of mass along their common axis open
MOST_DRIFT = 1.0        # N of residual in the air that can be drift: 0.1 N a minute, for an hour
_WORST_CONDITION = 100.0  # of the least squares in units of its columns


@dataclass(frozen=True)
class ForceTorqueParams:
    """A sensor of the ATI Axia80 kind."""

    force_noise: float = quantity(0.02, 'N', 'sd of a sample, each axis', low=0.0, high=5.0,
                                  source='ATI Axia80-M20 data sheet: 0.1 N resolution at full '
                                         'rate; a fifth after its own low-pass filter')
    moment_noise: float = quantity(1.0, 'Nmm', 'sd of a sample, each axis', low=0.0, high=100.0,
                                   source='as above')
    force_bias: float = quantity(2.0, 'N', 'sd of the zero at switching on, each axis', low=0.0,
                                 high=50.0, source='own choice: what mounting a tool leaves')
    moment_bias: float = quantity(50.0, 'Nmm', 'sd of that zero', low=0.0, high=5000.0,
                                  source='as above')
    drift: float = quantity(0.1, 'N', 'sd of the random walk of the zero after a minute, forces',
                            low=0.0, high=10.0, source='own choice: warming up')


@dataclass(frozen=True)
class ToolLoad:
    """What the sensor reads of the tool and of itself.

    mass : [kg];  centre : (3,) [m] of mass, sensor frame
    bias : (6,) [N, N m] reading without any load
    residual : [N] root mean square of the force that the calibration left
    """

    mass: float
    centre: np.ndarray
    bias: np.ndarray
    residual: float = 0.0

    def contact(self, reading, R, gravity):
        """Return the wrench (6,) on the probe about the sensor's origin, sensor frame.

        reading : (6,);  R : (3, 3) of the sensor in the base frame;  gravity : (3,) [m/s2] there
        """
        left = reading - self.bias
        tool_weight(R, gravity, self.mass, self.centre, -1.0, left)
        return left


class ForceTorqueSensor:
    """Simulated sensor; `read` once a period."""

    def __init__(self, params, tool, rng, period=1e-3):
        """params : ForceTorqueParams;  tool : rigid_body.Payload;  rng : numpy Generator"""
        self._tool, self._rng = tool, rng
        sd = np.repeat([params.force_bias, params.moment_bias], 3)
        self._bias = sd * rng.normal(size=6)
        self._noise = np.repeat([params.force_noise, params.moment_noise], 3)
        self._step = params.drift * np.sqrt(period / _MINUTE)

    def errors(self, periods):
        """Return (periods, 6): zero and noise of the next readings, drawn in one block."""
        walk = np.cumsum(self._step * self._rng.normal(size=(periods, 3)), axis=0)
        noise = self._noise * self._rng.normal(size=(periods, 6))
        zero = np.tile(self._bias, (periods, 1))
        zero[:, :3] += walk
        self._bias = zero[-1].copy()
        return zero + noise

    def read(self, R, gravity, contact):
        """Return the reading (6,).

        R, gravity : as in `ToolLoad.contact`;  contact : (6,) wrench on the probe, sensor frame
        """
        reading = contact + self.errors(1)[0]
        tool_weight(R, gravity, self._tool.mass, self._tool.centre, 1.0, reading)
        return reading


@numba.njit(cache=True)
def tool_weight(R, gravity, mass, centre, sign, reading):
    """Add sign times what a tool weighs to a reading (6,), in place.

    R : (3, 3) of the sensor in the base frame;  gravity : (3,) there;  centre : (3,) of mass
    """
    f = sign * mass * (R.T @ gravity)
    reading[:3] += f
    reading[3] += centre[1] * f[2] - centre[2] * f[1]
    reading[4] += centre[2] * f[0] - centre[0] * f[2]
    reading[5] += centre[0] * f[1] - centre[1] * f[0]


@numba.njit(cache=True)
def read_wrench(holder, memory, R, errors):
    """One period of the sensor, into memory.wrench (probe, about its face) and memory.reading.

    Sensor and face share their axes and lie holder.sensor [m] apart along z.
    holder : gravity (3,), tool_mass, tool_centre (3,), sensor
    memory : true_wrench (6,) of the contact, bias and weighed of the tool as calibrated
    R : (3, 3) of the probe, frame of gravity;  errors : (6,) zero and noise
    Returns the force that presses on the face [N].
    """
    reading = errors.copy()
    tool_weight(R, holder.gravity, holder.tool_mass, holder.tool_centre, 1.0, reading)
    f, m = R.T @ memory.true_wrench[:3], R.T @ memory.true_wrench[3:]
    reading[:3] += f
    reading[3:] += m
    reading[3] -= holder.sensor * f[1]
    reading[4] += holder.sensor * f[0]
    memory.reading[:] += reading
    reading -= memory.bias
    tool_weight(R, holder.gravity, memory.weighed[0], memory.weighed[1:], -1.0, reading)
    reading[3] += holder.sensor * reading[1]
    reading[4] -= holder.sensor * reading[0]
    memory.wrench[:] = reading
    return -reading[2]


def calibrate(readings, rotations, gravity):
    """Return the ToolLoad that fits readings at rest, nothing touching, in least squares.

    readings : (n, 6);  rotations : (n, 3, 3) of the sensor in the base frame;  gravity : (3,)
    Raises InputError for fewer than FEWEST samples or orientations too much alike.
    """
    if len(readings) < FEWEST:
        raise InputError(f'tool calibration: {len(readings)} orientations; must be at least '
                         f'{FEWEST}, tilted against each other by 20 deg or more')
    down = np.einsum('nji,j->ni', rotations, gravity)
    # Unknowns: mass, mass x centre (3), bias (6).
    A, b = np.zeros((6 * len(down), 10)), np.ravel(readings)
    for k, g in enumerate(down):
        rows = A[6 * k:6 * k + 6]
        rows[:3, 0] = g
        rows[3:, 1:4] = -_cross_matrix(g)     # (m c) x g
        rows[:, 4:] = np.eye(6)
    scale = np.linalg.norm(A, axis=0)
    condition = np.linalg.cond(A / np.where(scale > 0.0, scale, 1.0))
    if not condition < _WORST_CONDITION:
        raise InputError(f'tool calibration: the orientations are too much alike (condition '
                         f'{condition:.0f}); must be below {_WORST_CONDITION:.0f}: tilt the probe '
                         'by 20 deg or more about two axes')
    x, *_ = np.linalg.lstsq(A / scale, b, rcond=None)
    x = x / scale
    left = (b - A @ x).reshape(-1, 6)[:, :3]
    return ToolLoad(float(x[0]), x[1:4] / x[0], x[4:],
                    float(np.sqrt(np.mean(np.sum(left**2, axis=1)))))


class BiasTracker:
    """Follows the bias while nothing touches the probe, by an exponential mean of the residual.

    A residual of MOST_DRIFT or more is a load and no drift; it would be taken for weight of the
    tool, and force limits would stand that much too high.
    """

    def __init__(self, load, time_constant=2.0, period=1e-3):
        """load : ToolLoad to start from;  time_constant : [s]"""
        self.load, self._rate = load, period / time_constant

    def step(self, reading, R, gravity, periods=1, hurry=1.0):
        """Take a reading in the air; the load's bias follows. Returns the force [N] left before.

        periods : that the reading is the mean of;  hurry : times as fast as the time constant says
        """
        left = self.load.contact(reading, R, gravity)
        felt = float(np.linalg.norm(left[:3]))
        if felt >= MOST_DRIFT:
            return felt
        share = -np.expm1(-periods * hurry * self._rate)
        self.load = replace(self.load, bias=self.load.bias + share * left)
        return felt


def _cross_matrix(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
