"""Which hole, which side of the bevel, how deep, and where the pads shall put the target.

The tip of a bevel needle leaves the axis of its hole along a known arc. A plan chooses hole h and
roll r of the base so that the tip at the target's depth lies where pads can bring the target:
    miss = h + c(r, s) - p_target,   across the needle
is what is left to do. Its part on the axes that pads control becomes the target's displacement,
the rest stays as an error. c(r, s) is the course of the tip from the hole at depth s.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.outcome import Outcome

ROLLS = 72          # sides of the bevel that are tried: 5 degrees apart
EFFORT = 0.01       # weight of a displacement by the pads against an error that stays
_DEPTH_STEPS = 3    # of a fixed point that contracts with the cosine of the tip's turn


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
    depth : [m] of the needle;  tip : (3,) [m] where it then is;  goal : (3,) [m] of the target
    left : [m] distance of tip and goal across the needle, which pads cannot take away
    """

    column: int
    row: int
    hole: np.ndarray
    roll: float
    depth: float
    tip: np.ndarray
    goal: np.ndarray
    left: float

    @property
    def text(self):
        """One line for a person."""
        return (f'hole {self.column}, {self.row}; depth {1e3 * self.depth:.1f} mm; roll '
                f'{np.degrees(self.roll):.0f} deg; {1e3 * self.left:.2f} mm left')


@dataclass(frozen=True)
class NeedleCourse:
    """Where a needle goes from any hole.

    axis : (3,) along the needles;  side : (3,) to which roll 0 bends them;  length : [m]
    offset : callable (roll [rad], depth [m]) -> (3,) [m] of the tip from its hole
    curvature : [1/m] of that course
    """

    axis: np.ndarray
    side: np.ndarray
    length: float
    offset: Callable
    curvature: float = 0.0

    def depth_at(self, hole, roll, point):
        """Return the depth [m] at which the tip is level with a point (3,) along the axis."""
        wanted = depth = float((point - hole) @ self.axis)
        for _ in range(_DEPTH_STEPS):
            depth += wanted - float(self.offset(roll, depth) @ self.axis)
        return depth


def plan(holes, needle, target, *, axes, reach, hole=(), start=None):
    """Return the NeedlePlan to a target.

    holes : (columns, rows, 3) [m];  needle : NeedleCourse
    target : (3,) [m] where it is;  axes : (3,) bool, of the pads
    reach : [m] largest displacement of the target;  hole : (column, row) to use, empty = any
    start : (3,) from where pads have displaced the target, None = they have not
    Raises NoPlan: no such hole, needle too short, target out of reach.
    """
    chosen = _chosen(holes, hole)
    rolls = np.arange(ROLLS) * 2.0 * np.pi / ROLLS
    somewhere = holes[chosen[0]]
    depths = [needle.depth_at(somewhere, r, target) for r in rolls]
    if min(depths) <= 0.0:
        raise NoPlan(Outcome.NO_PLAN, f'target {1e3 * -min(depths):.0f} mm behind the template, '
                     'along the needle; must be before it: turn or move the template')
    if max(depths) > needle.length:
        raise NoPlan(Outcome.NO_PLAN, f'needle {1e3 * needle.length:.0f} mm long; the target '
                     f'is {1e3 * max(depths):.0f} mm deep: take a longer one or move the template')
    ends = np.array([needle.offset(r, s) for r, s in zip(rolls, depths, strict=True)])
    places = np.array([holes[c] for c in chosen])
    miss = places[:, None] + ends[None] - target                # (hole, roll, 3)
    miss = miss - (miss @ needle.axis)[..., None] * needle.axis
    so_far = np.zeros(3) if start is None else target - start
    return _best(chosen, rolls, depths, places, ends, miss, target, np.asarray(axes), reach,
                 so_far)


def _chosen(holes, hole):
    columns, rows = holes.shape[:2]
    if not hole:
        return [(i, j) for i in range(columns) for j in range(rows)]
    if not (0 <= hole[0] < columns and 0 <= hole[1] < rows):
        raise NoPlan(Outcome.NO_PLAN, f'hole {hole[0]}, {hole[1]}; the template has columns 0 '
                     f'to {columns - 1} and rows 0 to {rows - 1}')
    return [tuple(hole)]


def _best(chosen, rolls, depths, places, ends, miss, target, axes, reach, so_far):
    moved = np.where(axes, miss, 0.0)
    left = np.linalg.norm(miss - moved, axis=-1)
    effort = np.linalg.norm(np.where(axes, miss + so_far, 0.0), axis=-1)
    if effort.min() > reach:
        raise NoPlan(Outcome.INFEASIBLE, f'the target would have to move {1e3 * effort.min():.1f} '
                     f'mm; allowed {1e3 * reach:g} mm: choose another hole')
    cost = np.where(effort <= reach, left**2 + EFFORT * effort**2, np.inf)
    h, r = np.unravel_index(int(cost.argmin()), cost.shape)
    column, row = (int(k) for k in chosen[h])
    return NeedlePlan(column, row, places[h], float(rolls[r]), float(depths[r]),
                      places[h] + ends[r], target + moved[h, r], float(left[h, r]))
