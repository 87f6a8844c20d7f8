"""Which hole, which side of the bevel, how deep, and where the pads shall put the target.

The tip of a bevel needle leaves the axis of its hole along a known arc. A plan chooses hole h,
roll r of the base and the depth u at which the base is turned by half a turn, so that the tip at
the target's depth lies where pads can bring the target:
    off = h + c(r, s, u) - p_target,   across the needle
is what is left to do. Its part on the axes that pads control becomes the target's displacement,
the rest stays as an error. c(r, s, u) is the course of the tip from the hole at depth s.

How strongly a needle bends differs from needle to needle. Off the axis of its hole the tip is at
depth s, for small slopes,
    kappa ((s - e)^2 / 2 - (s - u)^2),
so that the plan's error has that factor times the spread of kappa; e is the depth of the skin, up
to which it goes straight. It is zero, for every kappa, if the needle is turned at u = e + (s - e)
(1 - 1 / sqrt(2)), that is 0.29 of its way in the tissue. (Turning a bevel needle over on its way
is how a straight path is got in practice, Abolhassani, Patel, Ayazi 2007, Int J Med Robot 3:59.)
A plan weighs this expected error against what it leaves, and against what pads have to do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.control.needle_curvature import SPREAD
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.outcome import Outcome

ROLLS = 72          # sides of the bevel that are tried: 5 degrees apart
TURNS = 32          # depths of half a turn that are tried besides none
EFFORT = 0.04       # of the square of what pads do, a fifth of which is uncertain (own choice):
                    # they lift the target besides, and change how it gives under the probe
_DEPTH_STEPS = 30   # of a fixed point that contracts with the cosine of the tip's turn, at most
_LEVEL = 1e-6       # m by which tip and target may then differ along the axis
_PATH = 41          # points of a planned path


class NoPlan(ArmBrachyError):
    """There is no way to the target; `outcome` names why."""

    def __init__(self, outcome, message):
        """outcome : Outcome;  message : one line"""
        super().__init__(message)
        self.outcome = outcome


@dataclass(frozen=True)
class NeedlePlan:
    """How the needle goes to the target. World frame, SI.

    column, row, hole : of the template, and where it is (3,) [m];  roll : [rad] of the base
    turn : [m] depth at which the base is turned by half a turn, inf = nowhere
    depth : [m] of the needle;  tip : (3,) [m] where it then is;  goal : (3,) [m] of the target
    left : [m] distance of tip and goal across the needle, which pads cannot take away
    spread : [m] by which published needles differ there, standard deviation
    path : (k, 3) [m] of the tip on its way from the hole
    """

    column: int
    row: int
    hole: np.ndarray
    roll: float
    turn: float
    depth: float
    tip: np.ndarray
    goal: np.ndarray
    left: float
    spread: float
    path: np.ndarray


@dataclass(frozen=True)
class NeedleCourse:
    """Where a needle goes from any hole.

    axis : (3,) along the needles;  side : (3,) to which roll 0 bends them;  length : [m]
    offset : callable (roll [rad], depth [m], turn [m]) -> (3,) [m] of the tip from its hole, with
        half a turn of the base at a depth `turn`; another roll turns it about the axis
    curvature : [1/m] of that course;  skin : [m] up to which it is straight
    """

    axis: np.ndarray
    side: np.ndarray
    length: float
    offset: Callable
    curvature: float = 0.0
    skin: float = 0.0

    def depth_at(self, hole, point, turn=np.inf):
        """Return the depth [m] at which the tip is level with a point (3,) along the axis.

        Raises NoPlan for a needle that bends too much to get there.
        """
        wanted = depth = float((point - hole) @ self.axis)
        for _ in range(_DEPTH_STEPS):
            short = wanted - float(self.offset(0.0, depth, turn) @ self.axis)
            depth += short
            if abs(short) < _LEVEL:
                return depth
        raise NoPlan(Outcome.NO_PLAN, f'the needle does not get {1e3 * wanted:.0f} mm far along '
                     'its hole, since it bends too much; take one that bends less, or move the '
                     'template nearer')


def unlike(depth, turn, skin=0.0):
    """Return [m^2] by which the tip is off its axis at a depth [m], per curvature; see above."""
    return (0.5 * np.maximum(depth - skin, 0.0) ** 2
            - np.maximum(depth - np.maximum(turn, skin), 0.0) ** 2)


def plan(holes, needle, target, *, axes, reach, miss=np.inf, hole=(), start=None, unturned=None):
    """Return the NeedlePlan to a target.

    holes : (columns, rows, 3) [m];  needle : NeedleCourse
    target : (3,) [m] where it is;  axes : (3,) bool, of the pads
    reach : [m] largest displacement of the target
    hole : (column, row) to use, (column,) with any row, empty = any
    miss : [m] by which the path may pass the target
    start : (3,) from where pads have displaced the target, None = they have not
    unturned : [m] last part of the way on which the needle is not turned over; None = nowhere
    Raises NoPlan: no such hole, needle too short, target out of reach or passed by.
    """
    chosen = _chosen(holes, hole)
    turns = _turns(float((target - holes[chosen[0]]) @ needle.axis), needle.skin, unturned)
    depths = np.array([needle.depth_at(holes[chosen[0]], target, u) for u in turns])
    if min(depths) <= 0.0:
        raise NoPlan(Outcome.NO_PLAN, f'target {1e3 * -min(depths):.0f} mm behind the template, '
                     'along the needle; must be before it: turn or move the template')
    if max(depths) > needle.length:
        raise NoPlan(Outcome.NO_PLAN, f'needle {1e3 * needle.length:.0f} mm long; the target '
                     f'is {1e3 * max(depths):.0f} mm deep: take a longer one or move the template')
    rolls = np.arange(ROLLS) * 2.0 * np.pi / ROLLS
    about = Rotation.from_rotvec(np.multiply.outer(rolls, needle.axis))
    ends = np.array([about.apply(needle.offset(0.0, s, u))
                     for s, u in zip(depths, turns, strict=True)])      # (turn, roll, 3)
    places, plane = np.array([holes[c] for c in chosen]), _across(needle.axis)
    off = ((places - target) @ plane)[:, None, None] + ends @ plane     # (hole, turn, roll, 2)
    so_far = np.zeros(3) if start is None else np.where(axes, target - start, 0.0)
    spread = SPREAD * np.abs(unlike(depths, turns, needle.skin))
    by_pads = _by_pads(axes, needle.axis) @ plane
    (h, u, r), left = _best(off, spread, plane.T @ by_pads, by_pads, reach, miss, so_far)
    moved = by_pads @ off[h, u, r]
    goal = target + moved
    depth = needle.depth_at(places[h], goal, turns[u])      # pads may move it along the needle
    if depth > needle.length:
        raise NoPlan(Outcome.NO_PLAN, f'needle {1e3 * needle.length:.0f} mm long; the pads would '
                     f'take the target to {1e3 * depth:.1f} mm: take a longer one or move the '
                     'template')
    column, row = chosen[h]
    way = np.linspace(0.0, depth, _PATH)
    path = places[h] + about[r].apply([needle.offset(0.0, s, turns[u]) for s in way])
    return NeedlePlan(column, row, places[h], float(rolls[r]), float(turns[u]), float(depth),
                      path[-1], goal, left, float(spread[u]), path)


def _turns(level, skin, unturned):
    """Depths [m] of half a turn that are tried; `level` [m] is the target's along the axis."""
    if unturned is None or level - unturned <= skin:
        return np.array([np.inf])
    return np.concatenate([[np.inf], np.linspace(skin, level - unturned, TURNS + 1)[1:]])


def _chosen(holes, hole):
    columns, rows = holes.shape[:2]
    chosen = [c for c in np.ndindex(columns, rows) if c[:len(hole)] == tuple(hole)]
    if not chosen:
        raise NoPlan(Outcome.NO_PLAN, f'hole {", ".join(map(str, hole))}; the template has '
                     f'columns 0 to {columns - 1} and rows 0 to {rows - 1}')
    return chosen


def _across(axis):
    """(3, 2) unit vectors across a unit vector (3,)."""
    return np.linalg.svd(axis[None])[2][1:].T


def _by_pads(axes, axis):
    """(3, 3) from what is missed across the needle to the least that pads do against it.

    axes : (3,) bool, along which they move the target;  axis : (3,) of the needle
    """
    along_axes = np.diag(np.asarray(axes, dtype=float))
    return along_axes @ np.linalg.pinv((np.eye(3) - np.outer(axis, axis)) @ along_axes)


def _best(off, spread, across, by_pads, reach, miss, so_far):
    """((hole, turn, roll) that cost least, what is left [m]).

    off : (hole, turn, roll, 2) [m] across the needle;  so_far : (3,) [m] that the pads have done
    across : (2, 2) from `off` to what the pads do against it;  by_pads : (3, 2) to all they do
    """
    left = _length(off, np.eye(2) - across, np.zeros(2))
    effort = _length(off, by_pads, so_far)
    if effort.min() > reach:
        raise NoPlan(Outcome.INFEASIBLE, f'the target would have to move {1e3 * effort.min():.1f} '
                     f'mm; allowed {1e3 * reach:g} mm: choose another hole')
    nearest = left[effort <= reach].min()
    if nearest > miss:
        raise NoPlan(Outcome.INFEASIBLE, 'the needle would pass the target by '
                     f'{1e3 * nearest:.1f} mm, where no pad moves it; allowed {1e3 * miss:g} mm: '
                     'choose another hole or move the template')
    cost = left**2 + EFFORT * effort**2 + spread[:, None] ** 2
    good = (effort <= reach) & (left <= miss)
    best = np.unravel_index(int(np.where(good, cost, np.inf).argmin()), cost.shape)
    return best, float(left[best])


def _length(off, A, d):
    """|A o + d| for every o of off (..., 2): as polynomials, since there may be 400 000."""
    (a, b), (_, c) = A.T @ A
    u, v = 2.0 * A.T @ d
    x, y = off[..., 0], off[..., 1]
    return np.sqrt(np.maximum(x * (a * x + 2.0 * b * y + u) + y * (c * y + v) + d @ d, 0.0))
