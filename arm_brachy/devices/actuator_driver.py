"""Banks of linear actuators: the interface a hardware driver implements, and a simulated bank."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib.metadata import entry_points

import numpy as np

from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity

DRIVER_GROUP = 'arm_brachy.actuator_drivers'
_L16 = 'Actuonix L16-50-63-12 data sheet: '


@dataclass(frozen=True)
class ActuatorParams:
    """One model of actuator; all actuators of a bank are alike.

    Speed does not depend on load: the L16-63 loses half of its speed at 75 N, the tissue pushes
    back with a few newtons.
    """

    stroke: float = quantity(50.0, 'mm', 'mechanical stroke', low=1.0, high=1000.0,
                             source=_L16 + 'stroke options 50, 100, 140 mm')
    max_speed: float = quantity(20.0, 'mm_s', 'largest speed', low=0.01, high=1000.0,
                                source=_L16 + '20 mm/s without load')
    max_acceleration: float = quantity(
        200.0, 'mm_s2', 'largest acceleration', low=0.1, high=1e5,
        source='full speed in 0.1 s; not in the data sheet, engineering judgement')
    home_speed: float = quantity(5.0, 'mm_s', 'speed of homing', low=0.01, high=1000.0,
                                 source='a quarter of full speed, engineering judgement')
    encoder_resolution: float = quantity(
        0.0122, 'mm', 'one count of the position sensor (0 = continuous)', low=0.0, high=1.0,
        source='50 mm potentiometer (L16 option -P) read with 12 bit: 50 mm / 4096')
    position_repeatability: float = quantity(
        0.0, 'mm', 'standard deviation of where a move ends', low=0.0, high=5.0,
        source='none by default: the play of the screw is the term backlash')
    servo_time_constant: float = quantity(
        10.0, 'ms', 'first-order lag of the position loop', low=0.0, high=1000.0,
        source='15 Hz bandwidth of a small DC linear servo, engineering judgement')
    force_limit: float = quantity(50.0, 'N', 'push at which the bank stops pushing', low=0.1,
                                  high=1e4, source=_L16 + 'lifts 100 N; half of it, engineering '
                                                         'judgement')
    effort_noise: float = quantity(
        2.0, 'N', 'standard deviation of the force told from motor current', low=0.0, high=100.0,
        source='friction of gear and screw varies by some percent of the lift of 100 N, '
               'engineering judgement')
    effort_resolution: float = quantity(
        0.1, 'N', 'one count of the force told from motor current (0 = continuous)', low=0.0,
        high=10.0, source='lift of 100 N read with 10 bit, engineering judgement')


@dataclass(frozen=True)
class BankState:
    """What a bank says of itself at time t [s]; all arrays (n,), in the order of its names.

    q : m, from the position sensor;  velocity : m/s, its change since the last read
    effort : N, pushing back on the pad as far as motor current tells;  homed, moving : bool
    pad : m, true pad position (simulated banks; None for hardware): never for estimators
    outcome : OK, HELD (hold, stop or force limit) or REJECTED (a command since the last read)
    message : one line, empty if OK
    """

    t: float
    q: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    homed: np.ndarray
    moving: np.ndarray
    pad: np.ndarray | None
    outcome: Outcome
    message: str


class AbstractActuatorDriver(ABC):
    """What moves n linear actuators. Positions [m] are measured from the home end, >= 0.

    A driver class is called as `Driver(names, strokes, params)`: n names, strokes (n,) [m] and
    ActuatorParams; it is found by the entry point group `arm_brachy.actuator_drivers`. No method
    blocks while something moves: motion is watched through `read`. Commands that cannot be
    carried out raise CommandRefused and change nothing.
    """

    @abstractmethod
    def connect(self):
        """Open the device. Raises ArmBrachyError if it does not answer."""

    @abstractmethod
    def home(self):
        """Start retracting every actuator to its home switch, which then is zero."""

    @abstractmethod
    def move(self, q, speed=None):
        """Start moving to q (n,) [m] at most at `speed` (n,) [m/s] (None = the largest).

        Raises CommandRefused, naming actuator, value and allowed range, if any value is NaN,
        negative, beyond stroke or too fast, if not homed or while stopped; no actuator then moves.
        """

    @abstractmethod
    def hold(self):
        """Brake to rest and stay there; the next move is obeyed. Ends no emergency stop."""

    @abstractmethod
    def stop(self):
        """Emergency: stop at once and refuse every motion until `release`."""

    @abstractmethod
    def release(self):
        """End the emergency stop; nothing moves until the next command."""

    @abstractmethod
    def read(self, t, effort=None):
        """Return the BankState at t [s], not earlier than the last read.

        effort : (n,) [N] pushing back on the pads, where the drive itself cannot measure it
        """

    @abstractmethod
    def close(self):
        """Stop and let go of the device; may be called twice."""


def load_driver(name):
    """Return the driver class that an installed package offers under `name`.

    Raises ConfigError listing the available ones.
    """
    found = {point.name: point for point in entry_points(group=DRIVER_GROUP)}
    if name not in found:
        known = ', '.join(sorted(found)) or 'none installed'
        raise ConfigError(f'actuator driver {name!r} not found; available in entry point group '
                          f'{DRIVER_GROUP}: {known}')
    return found[name].load()


def check_command(names, strokes, q, speed, max_speed):
    """Return (q, speed) as arrays (n,), or raise CommandRefused naming what is out of range.

    names : n;  strokes : (n,) [m];  q : target [m];  speed : [m/s] or None;  max_speed : m/s
    Every driver calls this first, so that hardware and simulation refuse alike.
    """
    n = len(names)
    speed = np.full(n, max_speed) if speed is None else speed
    # a nanometre over the stroke is rounding in a conversion of units, not a command
    q = _within('position', 'mm', names, q, 0.0, strokes, tolerance=1e-9)
    speed = _within('speed', 'mm/s', names, speed, 0.0, np.full(n, max_speed), tolerance=1e-9)
    if (speed == 0.0).any():
        i = int(np.argmax(speed == 0.0))
        raise CommandRefused(f'{names[i]}: speed = 0 mm/s; must be > 0 (hold stops the bank)')
    return q, speed


def _within(what, unit, names, values, low, high, tolerance):
    try:
        values = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise CommandRefused(f'{what} = {values!r}; must be {len(names)} numbers') from None
    if values.shape != (len(names),):
        raise CommandRefused(f'{what} has shape {values.shape}; must be ({len(names)},), one for '
                             f'each of {", ".join(names)}')
    bad = ~((values >= low - tolerance) & (values <= high + tolerance))
    if bad.any():
        i = int(np.argmax(bad))
        raise CommandRefused(f'{names[i]}: {what} = {1e3 * values[i]:.6g} {unit}; must be '
                             f'{1e3 * low:.6g} to {1e3 * high[i]:.6g}')
    return np.clip(values, low, high)
