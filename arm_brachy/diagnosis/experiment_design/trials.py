"""Recordings that could be made next: a bounded list of pushes, as moves, paths and states."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arm_brachy.control.moves import Move, PadTarget, legs_of
from arm_brachy.diagnosis.signals.motion import Path

REACH = 0.6             # of the stroke, of a pad alone
TOGETHER = 0.5          # of that, of each of a pair: what they squeeze has nowhere to go
SLOW, FAST = 2e-3, 20e-3    # m/s, a decade apart: what is viscous differs, what is plastic not
RELAXATION = 3.0        # s, of a tissue of which nothing is known
HOLD_TIMES = 3.0        # relaxation times of a hold
LONGEST = 30.0          # s, of a hold
IDLE = 60.0             # s without motion, several breaths
MOST_PADS, MOST_PAIRS = 4, 3
WINDOW = 0.3            # s over which a state is averaged on a stand
RAMP = 0.1              # of the time that a way takes, on a ramp
SHORT, LONG = 1.0, 2.0  # s: a stand between two ways; one that is looked at early and late


@dataclass(frozen=True)
class Trial:
    """One recording that begins and ends with all pads at home.

    moves : control.moves.Move each;  path : Path of the encoders, from 0 s, corners and states
    t : (n,) [s] states;  width : (n,) [s] over which they are averaged
    """

    moves: tuple
    path: Path
    t: np.ndarray
    width: np.ndarray


def trials_of(specimen, first=(), relaxation=RELAXATION, reach=REACH):
    """The Trials (a tuple) worth considering on a specimen.Specimen.

    first : names of pads that matter most;  relaxation : [s] of the tissue
    reach : of the stroke, how deep
    Single pads slow and fast; pairs, the most opposed and the least first; one pad with a reversal
    at two depths; and rest.
    """
    hold = min(HOLD_TIMES * relaxation, LONGEST)
    pads = sorted(specimen.scene.pads, key=lambda pad: pad.name not in first)[:MOST_PADS]
    depth = {pad.name: reach * pad.stroke for pad in pads}
    plans = [tuple(_cycle((name,), depth, speed, hold) for speed in (SLOW, FAST))
             for name in depth]
    less = {name: TOGETHER * q for name, q in depth.items()}
    plans += [(_cycle(pair, less, FAST, hold),) for pair in _pairs(specimen, tuple(depth))]
    plans += [_reversal(next(iter(depth)), depth, hold), (Move('rest', FAST, hold=IDLE),)]
    return tuple(trial_of(moves, specimen.pads) for moves in plans)


def _cycle(names, depth, speed, hold):
    """There and back, once."""
    pads = tuple(PadTarget(name, depth[name]) for name in names)
    return Move('_'.join((*names, f'{1e3 * speed:g}_mm_s')), speed, pads, hold=hold, cycles=1)


def _reversal(name, depth, hold):
    """To a half and to the whole depth, each time back by half of that."""
    stops = [share * depth[name] for share in (0.5, 0.25, 1.0, 0.5)]
    ways = [Move(f'{name}_stop_{i + 1}', FAST, (PadTarget(name, stop),), hold=SHORT)
            for i, stop in enumerate(stops)]
    return (*ways, Move('home', FAST, others='home', hold=hold))


def _pairs(specimen, names):
    """Pairs of pads with the first of `names`, then others, most opposed directions first."""
    way = dict(zip(specimen.pads, specimen.directions, strict=True))
    pairs = sorted(combinations(names, 2), key=lambda p: (p[0] != names[0],
                                                          round(way[p[0]] @ way[p[1]], 3)))
    return pairs[:MOST_PAIRS]


def trial_of(moves, pads):
    """The Trial of moves of `pads` (p names): a second at rest, then stands and fast ways.

    Stands are looked at late, long ones also early; ways where one pad goes fast, in the middle.
    More places would cost a solve each.
    """
    t, q, states, widths = [0.0, 1.0], [np.zeros(len(pads))] * 2, [0.5], [WINDOW]
    for leg in legs_of(moves, pads):
        way, begun = leg.lasts(q[-1]), t[-1]
        if way:
            t, q = [*t, begun + way], [*q, leg.target]
            if leg.speed == FAST and leg.hold > LONG and np.sum(leg.target != q[-2]) == 1:
                states.append(begun + 0.5 * way)
                widths.append(min(RAMP * way, WINDOW))
        states += [t[-1] + WINDOW] * (leg.hold > LONG) + [t[-1] + leg.hold - WINDOW]
        widths += [WINDOW] * (len(states) - len(widths))
        t, q = [*t, t[-1] + leg.hold], [*q, leg.target]
    corners, states = Path(np.array(t), np.array(q)), np.array(states)
    times = np.union1d(corners.t, states)
    return Trial(tuple(moves), Path(times, corners.at(times)), states, np.array(widths))
