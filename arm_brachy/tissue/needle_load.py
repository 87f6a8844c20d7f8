"""The force along a needle, in balance with how far the tissue gives way to it.

A law of the needle says f(depth, skin, velocity); the tissue under a force f along the needle
moves by c f there, so that depth against the tissue, skin and velocity depend on f. The balance
f = law(f) is found by bisection, since laws jump: where a capsule breaks, and where the needle
starts to slide (Karnopp). Where it meets a jump, the force is the one between both sides of it.
The unbroken capsule comes first: it breaks only if no force that it bears is in balance.
Forces here are along the needle; those across it are in `needle_beam`.
"""

import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np

HALVINGS = 60
MOST = 1e4      # N, more than any needle bears


class NeedleLaw(Protocol):
    """Force of tissue along a needle, as devices.needle.NeedleForce has it.

    punctured : the capsule is broken;  tip : [N] share of the last force that acts at the tip
    """

    punctured: bool
    tip: float

    def step(self, depth, skin, velocity):
        """Return the force [N], positive against insertion; may change the law's own state."""


@dataclass(frozen=True)
class NeedleState:
    """What is remembered of a needle between two instants.

    law : NeedleLaw;  depth : [m] at the last instant, None before the first
    way : [m] how far it has come against the tissue around it
    force : [N] of the tissue on it, positive against insertion;  share : of it that is at the tip
    """

    law: NeedleLaw
    depth: float | None
    way: float
    force: float
    share: float


class NeedleLoad:
    """One part of a step: a needle that goes from one depth to another in a time dt.

    before : NeedleState;  needle : NeedleInTissue at the end;  stretch : NeedleStretch or None
    x : (n, 3) [m] nodes at the start;  dt : [s]
    """

    def __init__(self, before, needle, stretch, x, dt):
        self.before, self._needle, self._stretch = before, needle, stretch
        self._x, self._dt = x, dt
        self._advance = 0.0 if before.depth is None else needle.depth - before.depth
        self._way = needle.depth if before.depth is None else before.way + self._advance

    @property
    def depth(self):
        """[m] from the template to the tip, at the end."""
        return self._needle.depth

    @property
    def outside(self):
        """True if the needle is in no tissue."""
        return self._stretch is None

    @property
    def entry(self):
        """[m] along the shaft where it enters the tissue."""
        return self._needle.depth - self._stretch.inside

    def directions(self):
        """Return loads (2, n, 3) of a unit force: at the tip (or whole skin); along the shaft."""
        s = self._stretch
        return np.array([s.tip if self.before.law.punctured else s.skin, s.shaft])

    def balanced(self, y, compliance, share):
        """Return the NeedleState with tissue that would be at y (n, 3) [m] without the needle.

        compliance : (2, n, 3) [m/N] displacement per unit force of each of `directions`
        share : of the force at the tip, as the last iteration found it
        """
        s, start = self._stretch, self._x
        one = share * compliance[0] + (1.0 - share) * compliance[1]
        give = np.array([np.sum(v * one) for v in (s.skin, s.shaft)])
        moved = np.array([np.sum(v * (y - start)) for v in (s.skin, s.shaft)])

        def asked(f):
            skin, shaft = moved + give * f
            law = copy.copy(self.before.law)
            way = self._way - shaft
            force = law.step(way, way - (s.inside - skin), (self._advance - shaft) / self._dt)
            return force, law, way

        f, law, way = _root(asked, self.before.law.punctured)
        share = float(np.clip(law.tip / f, 0.0, 1.0)) if f > 0.0 else 0.0
        return NeedleState(law, self._needle.depth, way, f, share)


def withdrawn(before, depth):
    """Return the NeedleState outside the tissue, at a depth [m] from the template, None = away.

    before : NeedleState
    """
    law = copy.copy(before.law)
    law.step(0.0, 0.0, 0.0)
    return NeedleState(law, depth, 0.0 if depth is None else depth, 0.0, 1.0)


def _root(asked, punctured):
    """(f, law, way) in balance: first with the capsule whole, then, if none is, broken."""
    if not punctured:
        low, high = _bisected(asked, -MOST, MOST, lambda f, found: found[1].punctured
                              or f < found[0])
        found = asked(high)
        if not found[1].punctured and abs(high - found[0]) <= 1e-6 * max(1.0, abs(high)):
            return (high, *found[1:])
        ceiling = low
    else:
        ceiling = MOST
    low, high = _bisected(asked, -MOST, ceiling, lambda f, found: f < found[0])
    return (0.5 * (low + high), *asked(low)[1:])


def _bisected(asked, low, high, below):
    """The last (low, high) about where `below` turns false."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if below(middle, asked(middle)):
            low = middle
        else:
            high = middle
    return low, high
