"""A simulated bank of linear actuators behind the driver interface."""

import numpy as np

from arm_brachy.core.errors import CommandRefused, ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.term import Stage
from arm_brachy.devices.actuator_driver import (
    DRIVER_GROUP,
    AbstractActuatorDriver,
    ActuatorParams,
    BankState,
    check_command,
    load_driver,
)
from arm_brachy.devices.motion_profile import Motion, Profile, lag_behind, stopping_point

__all__ = ['DRIVER_GROUP', 'AbstractActuatorDriver', 'ActuatorParams', 'BankState',
           'SimulatedBank', 'check_command', 'load_driver']

# Where a term can act on a bank, in the order of `SimulatedBank._through`.
_STAGES = (Stage.SETPOINT, Stage.TRANSMISSION, Stage.ENCODER)
# Slower than this [m/s] an actuator counts as at rest: 10 um/s, an encoder count in a second.
_REST_SPEED = 1e-5
# The home switch closes this close to zero [m].
_SWITCH = 1e-6


class SimulatedBank(AbstractActuatorDriver):
    """Trapezoidal profile, servo lag, set-point terms = motor; then transmission terms = pad.

    names : n;  strokes : (n,) [m], at most params.stroke;  params : ActuatorParams
    terms : actuation terms at Stage.SETPOINT, TRANSMISSION or ENCODER (between motor and reading),
        applied in the order given
    rng : numpy Generator; needed if params.position_repeatability or effort_noise > 0. What motor
        current adds is drawn from a child of it, so that reading more often moves no pad
    homed : start at zero with the sensor zeroed, as after homing
    start : (n,) [m] where the actuators stand at t0 (default zero);  t0 : s

    Time passes in `read` only: a command given after read(t) holds from t on. Profile and servo
    are solved in closed form, so how time is cut into reads does not matter to them; terms see the
    path as chords between reads, off by at most max_acceleration dt^2 / 8.
    Raises ConfigError on a stroke, start or term out of place.
    Test: devices/test_actuator.py
    """

    def __init__(self, names, strokes, params, terms=(), rng=None, *, homed=False, start=None,
                 t0=0.0):
        self.names = tuple(names)
        self.params = params
        self.strokes = np.array(strokes, dtype=float)
        n = len(self.names)
        self._motor = np.zeros(n) if start is None else np.array(start, dtype=float)
        self._check(terms, rng)
        self._rng = rng
        self._current_rng = None if rng is None else rng.spawn(1)[0]
        self._t = t0
        self._servo = self._motor.copy()
        self._profiles = [self._rest(x) for x in self._motor]
        self._stages = [[term for term in terms if term.stage is stage] for stage in _STAGES]
        self._memories = [[term.memory(self._motor) for term in stage] for stage in self._stages]
        self._pad = self._motor.copy()
        self._sensed = self._motor.copy()
        self._velocity = np.zeros(n)
        self._homed = np.full(n, homed)
        self._homing = np.zeros(n, dtype=bool)
        self._zero = np.zeros(n) if homed else self._motor.copy()
        self._commanded = np.full(n, np.nan)
        self._settling_error = np.zeros(n)
        self._connected = self._stopped = self._held = False
        self._blocked = np.zeros(n, dtype=bool)
        self._refusal = ''

    def connect(self):
        """Switch on; until then every other call but `close` is refused."""
        self._connected = True

    def home(self):
        """Start retracting to zero at params.home_speed; watch BankState.homed."""
        self._permit('home')
        self._homed[:] = False
        self._homing[:] = True
        self._go(np.zeros(len(self.names)), np.full(len(self.names), self.params.home_speed))

    def move(self, q, speed=None):
        """See AbstractActuatorDriver.move; a refusal is also in the next BankState."""
        try:
            self._permit('move')
            q, speed = check_command(self.names, self.strokes, q, speed, self.params.max_speed)
            if not self._homed.all():
                name = self.names[int(np.argmin(self._homed))]
                raise CommandRefused(f'{name}: not homed; call home and wait until it is')
        except CommandRefused as error:
            self._refusal = str(error)
            raise
        self._go(self._where_it_will_end(q), speed)

    def hold(self):
        """Brake to rest under the acceleration limit and stay; a homing under way is given up.

        During an emergency stop nothing moves anyway: the stop stays in force.
        """
        self._permit_connected('hold')
        a = self.params.max_acceleration
        stops = [stopping_point(profile.motion, a) for profile in self._profiles]
        self._homing[:] = False
        self._go(np.array(stops), np.full(len(stops), self.params.max_speed))
        self._held = True

    def stop(self):
        """Cut the drives: they stand still at once (the screw does not run back)."""
        self._profiles = [self._rest(x) for x in self._servo]
        self._homing[:] = False
        self._stopped = True

    def release(self):
        """End the emergency stop; the bank stands where it stopped."""
        self._stopped = False

    def read(self, t, effort=None):
        """Advance to t [s] under `effort` (n,) [N] and return the BankState.

        A push above params.force_limit ends at once any motion that pushes on (the drive runs into
        its current limit): outcome HELD until the next command.
        Raises CommandRefused if t lies before the last read.
        """
        self._permit_connected('read')
        if t < self._t:
            raise CommandRefused(f'actuators: read at t = {t} s after t = {self._t} s; time must '
                                 'not run backwards')
        effort = np.zeros(len(self.names)) if effort is None else np.array(effort, dtype=float)
        if t > self._t:
            self._yield_to(effort)
            self._advance(t, effort)
        return self._state(self._told_by_current(effort))

    def close(self):
        """Stop and switch off."""
        self.stop()
        self._connected = False

    def _check(self, terms, rng):
        n = len(self.names)
        limit = self.params.stroke
        if self.strokes.shape != (n,) or self._motor.shape != (n,):
            raise ConfigError(f'actuators: {n} names, strokes {self.strokes.shape}, start '
                              f'{self._motor.shape}; must be one of each per actuator')
        for name, stroke, start in zip(self.names, self.strokes, self._motor, strict=True):
            if not 0.0 < stroke <= limit:
                raise ConfigError(f'{name}: stroke_mm = {1e3 * stroke:g}; must be > 0 and at most '
                                  f'the {1e3 * limit:g} mm of the actuator')
            if not 0.0 <= start <= stroke:
                raise ConfigError(f'{name}: start_mm = {1e3 * start:g}; must be 0 to '
                                  f'{1e3 * stroke:g}')
        for term in terms:
            if term.stage not in _STAGES:
                raise ConfigError(f'actuators: term {term.spec.name} acts at '
                                  f'{term.stage.value}; must act at '
                                  + ', '.join(stage.value for stage in _STAGES))
        for name, spread in (('position_repeatability_mm', self.params.position_repeatability),
                             ('effort_noise_N', self.params.effort_noise)):
            if spread > 0.0 and rng is None:
                raise ConfigError(f'actuators: {name} > 0 needs a random stream')

    def _permit_connected(self, what):
        if not self._connected:
            raise CommandRefused(f'actuators: {what} while not connected; call connect first')

    def _permit(self, what):
        self._permit_connected(what)
        if self._stopped:
            raise CommandRefused(f'actuators: {what} during an emergency stop; call release first')

    def _rest(self, x):
        return Profile(Motion(float(x), 0.0), float(x), self.params.max_speed,
                       self.params.max_acceleration)

    def _go(self, targets, speeds):
        self._profiles = [
            Profile(profile.motion, float(target), float(speed), self.params.max_acceleration)
            for profile, target, speed in zip(self._profiles, targets, speeds, strict=True)]
        self._blocked[:] = False
        self._held = False

    def _where_it_will_end(self, q):
        """Add the settling error, drawn anew for every actuator that is sent elsewhere."""
        spread = self.params.position_repeatability
        if spread > 0.0:
            fresh = spread * self._rng.standard_normal(len(q))
            self._settling_error = np.where(q == self._commanded, self._settling_error, fresh)
        self._commanded = q
        return np.clip(q + self._settling_error, 0.0, self.strokes)

    def _yield_to(self, effort):
        for i in np.flatnonzero(effort > self.params.force_limit):
            profile = self._profiles[i]
            if profile.target > self._servo[i] + _SWITCH:
                self._profiles[i] = self._rest(self._servo[i])
                self._blocked[i] = True

    def _advance(self, t, effort):
        dt = t - self._t
        pieces = [profile.advance(dt) for profile in self._profiles]
        self._servo = np.array([lag_behind(y, piece, self.params.servo_time_constant)
                                for y, piece in zip(self._servo, pieces, strict=True)])
        before = self._encoder()
        self._motor = self._through(0, self._servo, effort, t, dt)
        self._pad = self._through(1, self._motor, effort, t, dt)
        self._sensed = self._through(2, self._motor, effort, t, dt)
        self._velocity = (self._encoder() - before) / dt   # before homing moves the zero
        self._t = t
        self._close_switches()

    def _through(self, stage, u, effort, t, dt):
        """Pass u (n,) through the terms of one stage."""
        u = u.copy()
        for j, term in enumerate(self._stages[stage]):
            u, self._memories[stage][j] = term.step(self._memories[stage][j], u, effort, t, dt)
        return u

    def _close_switches(self):
        home = self._homing & (np.abs(self._motor) <= _SWITCH)
        self._homed |= home
        self._homing &= ~home
        self._zero[home] = 0.0

    def _state(self, effort):
        done = np.array([profile.done for profile in self._profiles], dtype=bool)
        outcome, message = self._outcome()
        return BankState(
            t=self._t, q=self._encoder(), velocity=self._velocity.copy(), effort=effort,
            homed=self._homed.copy(), moving=~done | (np.abs(self._velocity) > _REST_SPEED),
            pad=self._pad.copy(), outcome=outcome, message=message)

    def _encoder(self):
        return _whole_counts(self._sensed - self._zero, self.params.encoder_resolution)

    def _told_by_current(self, effort):
        """What the motors' current says of the push (n,) [N]."""
        if self.params.effort_noise > 0.0:
            noise = self._current_rng.standard_normal(len(effort))
            effort = effort + self.params.effort_noise * noise
        return _whole_counts(effort, self.params.effort_resolution)

    def _outcome(self):
        if self._refusal:
            message, self._refusal = self._refusal, ''
            return Outcome.REJECTED, message
        if self._stopped:
            return Outcome.HELD, 'emergency stop; call release, then move'
        if self._blocked.any():
            names = ', '.join(self.names[i] for i in np.flatnonzero(self._blocked))
            return Outcome.HELD, (f'{names}: push above force_limit_N = '
                                  f'{self.params.force_limit:g}; retract or push less far')
        if self._held:
            return Outcome.HELD, 'held on request; the next move is obeyed'
        return Outcome.OK, ''


def _whole_counts(x, count):
    """x rounded to multiples of `count`; unchanged where that is 0."""
    return count * np.round(x / count) if count > 0.0 else x
