"""Prescribed pad motions: what a move is, what it may ask for, and the legs it is made of."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class PadTarget:
    """Where one pad goes."""

    name: str
    position: float = quantity(None, 'mm', 'travel from home along the push direction', low=0.0,
                               high=1000.0)


@dataclass(frozen=True)
class Move:
    """Pads go along a straight line to their targets, arrive together, and stand.

    pads : those that are named go where it says;  others : what all others do
    cycles : how often there and back to where the move began, at the same speed and with the same
        stand at both ends; 0 = there, and no further
    """

    name: str
    speed: float = quantity(None, 'mm_s', 'of the pad with the longest way; the others are slower '
                                          'in proportion', low=0.01, high=1000.0)
    pads: tuple[PadTarget, ...] = ()
    others: Literal['stay', 'home'] = 'stay'
    hold: float = quantity(1.0, 's', 'how long the pads stand where they have arrived', low=0.0,
                           high=3600.0)
    cycles: int = 0


@dataclass(frozen=True)
class Leg:
    """One way and the stand at its end.

    move : index of the move it belongs to;  name : of the move;  last : it ends the move
    target : (p,) [m];  speed : of the pad with the longest way [m/s];  hold : [s]
    """

    move: int
    name: str
    target: np.ndarray
    speed: float
    hold: float
    last: bool

    def lasts(self, start):
        """Time [s] that the way from `start` (p,) [m] takes."""
        return float(np.abs(self.target - start).max()) / self.speed

    def at(self, start, elapsed):
        """Positions (p,) [m] `elapsed` [s] after leaving `start` (p,) [m] on a straight line."""
        way = self.lasts(start)
        if elapsed >= way:
            return self.target
        return start + (self.target - start) * (elapsed / way)

    def speeds(self, start):
        """Speed (p,) [m/s] of every pad from `start` (p,) [m]; of one that stands, the leg's."""
        distance = np.abs(self.target - start)
        longest = distance.max()
        share = distance / longest if longest > 0.0 else np.zeros_like(distance)
        return self.speed * np.where(share > 0.0, share, 1.0)


def legs_of(moves, names):
    """The legs of a list of Move, in order; the pads start at home.

    names : p pad names, the order of every (p,) array.  Returns a tuple of Leg.
    """
    legs, origin = [], np.zeros(len(names))
    for index, move in enumerate(moves):
        target = _target(move, origin, names)
        stops = [target, origin] * move.cycles or [target]
        legs += [Leg(index, move.name, stop, move.speed, move.hold, k == len(stops) - 1)
                 for k, stop in enumerate(stops)]
        origin = stops[-1]
    return tuple(legs)


def _target(move, origin, names):
    target = np.zeros(len(names)) if move.others == 'home' else origin.copy()
    for pad in move.pads:
        target[names.index(pad.name)] = pad.position
    return target


def least_hold(speed, actuators, tick):
    """Time [s] that a move at `speed` [m/s] must hold: two ticks and the time to brake.

    A command takes effect a tick after it was due, and a pad that had not arrived would round the
    corner.  actuators : ActuatorParams;  tick : period of the cell clock [s]
    """
    return 2.0 * tick + speed / actuators.max_acceleration


def check_moves(moves, scene, actuators, tick, place):
    """Refuse moves that the bank cannot make.

    scene : Scene;  actuators : ActuatorParams;  tick : period of the cell clock [s]
    place : callable, keys of the scenario file -> `file:line: key`
    A move must hold for `least_hold`. Raises ConfigError naming the first key that is wrong.
    """
    for i, move in enumerate(moves):
        if move.cycles < 0:
            raise ConfigError(f"{place('moves', i, 'cycles')} = {move.cycles}; must be at least 0")
        if move.speed > actuators.max_speed * (1 + 1e-9):  # a rounding of units is no difference
            raise ConfigError(f"{place('moves', i, 'speed_mm_s')} = {move.speed * 1e3:g}; must be "
                              f'at most the {actuators.max_speed * 1e3:g} mm/s of '
                              'actuators.max_speed_mm_s')
        least = least_hold(move.speed, actuators, tick)
        if move.hold < least * (1 - 1e-9):
            raise ConfigError(f"{place('moves', i, 'hold_s')} = {move.hold:g}; must be at least "
                              f'{least:.3g}: two ticks and the time to brake from '
                              f'{move.speed * 1e3:g} mm/s, for the pads to arrive')
        _check_pads(move.pads, scene, lambda *keys, i=i: place('moves', i, 'pads', *keys))


def _check_pads(targets, scene, place):
    strokes = {pad.name: pad.stroke for pad in scene.pads}
    for k, target in enumerate(targets):
        if target.name not in strokes:
            raise ConfigError(f"{place(k, 'name')} = {target.name!r}; must be a pad of scene "
                              f'{scene.name}: {", ".join(strokes) or "it has none"}')
        if target.name in [other.name for other in targets[:k]]:
            raise ConfigError(f"{place(k, 'name')} = {target.name!r} is given twice; names must "
                              'differ')
        stroke = strokes[target.name]
        if target.position > stroke * (1 + 1e-9):
            raise ConfigError(f"{place(k, 'position_mm')} = {target.position * 1e3:g}; must be at "
                              f'most the {stroke * 1e3:g} mm stroke of {target.name} in scene '
                              f'{scene.name}')
