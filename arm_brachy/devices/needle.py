"""A bevel-tip needle on its way: where the tip goes, and what force the tissue answers with.

The tip follows an arc whose side the bevel chooses, since cutting pushes it away from the bevel's
face; the shaft follows the tip (Webster et al. 2006, Int J Robot Res 25:509, unicycle model):
    dp/ds = t,   dt/ds = kappa n,   n turned about t as the needle is turned at its base
from the skin on; from the template to the skin, through air, it goes straight.
Force along the needle (Okamura, Simone, O'Leary 2004, IEEE Trans Biomed Eng 51:1707):
    f = f_stiffness (before the capsule breaks) or f_cutting + f_friction (after it)
    f_stiffness = k1 d + k2 d^2,  d the dent of the capsule, which breaks at a force
    f_friction = l (c sign(v) + b v) over the length l inside, once the needle slides
Sliding and cutting are the ends of an elastic stretch. The tissue around the shaft is carried
along until the needle slides, at c, or at the static force within Karnopp's band of speeds around
zero; so a needle that comes to rest goes on holding the tissue, and one that turns back first
lets it go (elastic-plastic friction: Dupont, Hayward, Armstrong, Altpeter 2002, IEEE Trans Autom
Control 47:787). The tissue before the tip deforms until it fractures: a tip at rest stays loaded,
and its load goes as the needle goes back (deformation and fracture by turns: Mahvash et al. 2008,
IEEE Trans Biomed Eng 55:848, of scissors).
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity

_STICK = 0.5e-3      # m that the tissue is carried along until the static friction (own choice)
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])    # axes in a circle
_STRAIGHT = 1e-12    # rad, turn of an arc below which it is a line


@dataclass(frozen=True)
class NeedleParams:
    """An 18 G brachytherapy needle in a soft phantom."""

    length: float = quantity(200.0, 'mm', 'from template to tip when fully inserted', low=10.0,
                             high=500.0, source='usual brachytherapy needle')
    radius: float = quantity(400.0, 'mm', 'of the arc that the bevel tip follows', low=50.0,
                             high=1e5, source='200 to 650 mm are reported; 18 G in gelatin about '
                                              '220 mm')
    skin: float = quantity(0.0, 'mm', 'of the way from the template to the skin, which the needle '
                           'goes straight', low=0.0, high=200.0, source='that of the scene')
    dent_linear: float = quantity(20.0, 'N_m', 'stiffness of the capsule under the tip',
                                  low=0.0, high=1e4, source='soft phantom: 0.1 N at 4 mm')
    dent_square: float = quantity(2.5e3, 'N_m2', 'its growth with the dent', low=0.0, high=1e7,
                                  source='as above')
    rigidity: float = quantity(0.02, 'Nm2', 'of the shaft against bending', low=1e-6, high=1e6,
                               source='E I of a tube of 1.27 and 0.84 mm, 18 G, steel of 193 GPa')
    beside: float = quantity(14e3, 'N_m2', 'force per length and way between the shaft and the '
                             'tissue beside it', low=1.0, high=1e7,
                             source='plane strain about a shaft of 1.27 mm in tissue of 6 kPa '
                                    'that stands still 4 mm away: 4 pi G / ln(b / a)')
    puncture: float = quantity(0.5, 'N', 'force at which the capsule breaks', low=0.0, high=50.0,
                               source='skin of a plastisol phantom (own choice)')
    cutting: float = quantity(0.3, 'N', 'force of cutting, at any depth', low=0.0, high=50.0,
                              source='Okamura et al. 2004 find 0.94 N in liver; a third in a soft '
                                     'phantom (own choice)')
    coulomb: float = quantity(8.0, 'N_m', 'friction per length inside', low=0.0, high=1e3,
                              source='0.4 N at 50 mm (own choice)')
    viscous: float = quantity(60.0, 'Ns_m2', 'friction per length and speed', low=0.0, high=1e5,
                              source='0.15 N at 50 mm and 50 mm/s (own choice)')
    static: float = quantity(10.0, 'N_m', 'largest friction per length at rest', low=0.0,
                             high=1e3, source='a quarter above sliding friction (own choice)')
    band: float = quantity(0.5, 'mm_s', 'speed below which the needle counts as at rest', low=1e-3,
                           high=50.0, source='Karnopp 1985, J Dyn Sys Meas Control 107:100')


class NeedlePath:
    """Where the tip has gone: arcs, from a hole of the template on.

    p : (3,) [m] tip;  t : (3,) unit, direction of insertion;  n : (3,) unit, the side it bends to
    depth : [m] length inserted, what a tracker of the needle's base measures
    roll : [rad] by which the needle is turned about its axis since it was at the hole
    """

    def __init__(self, params, hole, axis, side):
        """hole : (3,) [m];  axis : (3,) along the hole;  side : (3,) that the bevel steers to."""
        self._radius, self._skin = params.radius, params.skin
        self.depth, self.p = 0.0, np.array(hole, dtype=float)
        self.t = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
        side = np.asarray(side, dtype=float) - self.t * (self.t @ side)
        self.n = side / np.linalg.norm(side)
        self.roll = 0.0
        self._ends = [(0.0, self.p, self.t, self.n, 0.0)]

    def turn(self, angle):
        """Turn the needle about its axis by `angle` [rad]: the bevel points elsewhere."""
        self.n = _turned(self.n, self.t, angle)
        self.roll += angle
        self._ends[-1] = (self.depth, self.p, self.t, self.n, self.roll)

    def advance(self, distance):
        """Insert by `distance` [m], or withdraw along the path already cut if negative.

        Withdrawn, the needle keeps its roll: what is cut next bends to where its bevel is then.
        """
        if distance < 0.0:
            self._withdraw(max(self.depth + distance, 0.0))
            return
        self.p, self.t, self.n = self._along(self._ends[-1], self.depth + distance)
        self.depth += distance
        self._ends.append((self.depth, self.p, self.t, self.n, self.roll))

    def _withdraw(self, depth):
        while len(self._ends) > 1 and self._ends[-1][0] > depth:
            self._ends.pop()
        start = self._ends[-1]
        self.depth, (self.p, self.t, n) = depth, self._along(start, depth)
        self.n = _turned(n, self.t, self.roll - start[-1])
        self._ends.append((depth, self.p, self.t, self.n, self.roll))

    def _along(self, start, depth):
        s0, p, t, n, _ = start
        if s0 < self._skin:
            free = min(depth, self._skin)
            s0, p = free, p + (free - s0) * t
        angle = (depth - s0) / self._radius
        if angle < _STRAIGHT:
            return p + (depth - s0) * t, t, n
        s, c = np.sin(angle), np.cos(angle)
        return (p + self._radius * (s * t + (1.0 - c) * n), c * t + s * n, c * n - s * t)

    def shaft(self, count):
        """Return (count, 3) [m] points from the template to the tip, evenly along the needle."""
        return self._places(count)[0]

    def tangents(self, count):
        """Return (count, 3) unit tangents at the points of `shaft`."""
        return self._places(count)[1]

    def _places(self, count):
        """Points and tangents, (2, count, 3)."""
        at = np.linspace(0.0, self.depth, count)
        ends = np.array([e[0] for e in self._ends])
        index = np.clip(np.searchsorted(ends, at, side='right') - 1, 0, len(ends) - 1)
        return np.array([self._along(self._ends[i], s)[:2]
                         for i, s in zip(index, at, strict=True)]).transpose(1, 0, 2)


def _turned(n, t, angle):
    """Vector n (3,) turned by `angle` [rad] about the unit vector t across it."""
    across = t[_NEXT] * n[_LAST] - t[_LAST] * n[_NEXT]      # np.cross takes ten times as long
    return np.cos(angle) * n + np.sin(angle) * across


class NeedleForce:
    """Force of the tissue along the needle, positive against insertion; one instance a needle.

    punctured : the capsule is broken;  entry : [m] depth of the needle where it broke
    tip : [N] share of the last force that acts at the tip, the rest along the shaft
    What is remembered from step to step is how far the tissue is carried by shaft and tip, not
    how long ago: relaxation of a tissue that is held is the tissue's own, see tissue.viscosity.
    A tip that is pushed in again cuts again, also where it has been before.
    """

    def __init__(self, params):
        """Outside the tissue, capsule whole."""
        self.params = params
        self.punctured, self.entry, self.tip = False, None, 0.0
        self._depth = None      # of the last step in the tissue
        self._shear = 0.0       # N/m that the tissue carried along by the shaft answers with
        self._bite = 0.0        # of the cutting force that the tissue before the tip answers with

    def step(self, depth, skin, velocity):
        """Return the force (N) on the needle.

        depth : [m] of the tip along the axis;  skin : [m] where the unloaded skin is on that axis
        velocity : [m/s] of the needle against the tissue
        """
        p, dent = self.params, depth - skin
        if dent <= 0.0:
            self.punctured, self._depth, self.tip = False, None, 0.0
            return 0.0
        if not self.punctured:
            force = p.dent_linear * dent + p.dent_square * dent**2
            if force < p.puncture:
                self.tip = force
                return force
            self.punctured, self.entry, self._depth = True, depth, depth
            self._shear, self._bite = p.coulomb * np.sign(velocity), 1.0
        way, self._depth = depth - self._depth, depth
        self._bite = float(np.clip(self._bite + way / _STICK, 0.0, 1.0))
        self.tip = p.cutting * self._bite
        return self.tip + dent * self._friction(way, velocity)

    def _friction(self, way, velocity):
        """Per length inside [N/m]."""
        p, rest = self.params, abs(velocity) <= self.params.band
        most = p.static if rest else p.coulomb
        self._shear = float(np.clip(self._shear + p.static * way / _STICK, -most, most))
        friction = self._shear + p.viscous * velocity
        return float(np.clip(friction, -most, most)) if rest else friction
