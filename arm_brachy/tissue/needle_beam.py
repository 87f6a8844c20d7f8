"""A needle that bends where the tissue beside it moves, and holds that tissue back.

The path is given: where the tip has cut, if nothing moved afterwards. The shaft is a slender beam
clamped in the template and straight along that path when unloaded (Euler and Bernoulli, small
slopes); tissue that was cut at arc length s lies beside the shaft at s from then on and presses on
it, per length, by k times the way between both (a Winkler foundation inside the elements, which
carry the far field themselves). At anchors a spacing l apart

    f = (1 / (k l) + B)^-1 u,    w = B f,    B_ij = a^2 (3 b - a) / (6 EI),
    a = min(s_i, s_j), b = max(s_i, s_j)

u is how far the tissue has moved across the path there, w how far the shaft has, f the force on
it. B is the flexibility of a cantilever with a force between its ends, from any table of beams.
Left out: what it takes to hold the shaft on a curved path, torsion, buckling under the force along
the needle, and up to one spacing of tissue before the tip.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.tissue import dense
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.needle_path import NeedleInTissue, along

SPACING = 5e-3      # m between anchors


@dataclass(frozen=True)
class NeedleBeam:
    """What a shaft is against bending.

    rigidity : EI [N m^2];  beside : k [N/m^2], force per length and way between shaft and tissue
    """

    rigidity: float
    beside: float

    def flexibility(self, at, loaded):
        """Return (m, k) [m/N]: deflection at arc lengths `at` (m,) by unit forces at `loaded`."""
        a, b = np.minimum(at[:, None], loaded), np.maximum(at[:, None], loaded)
        # beyond the force the shaft is straight: the same formula, with the two exchanged
        return a**2 * (3.0 * b - a) / (6.0 * self.rigidity)


@dataclass(frozen=True, eq=False)
class Anchor:
    """Tissue that the tip has cut, beside the shaft.

    s : [m] along the shaft, from the template;  nodes, weights : (a,) of the element it lies in
    across : (2, 3) unit, across the path;  off : (3,) [m] between what the weights say and where
        it was cut
    """

    s: float
    nodes: np.ndarray
    weights: np.ndarray
    across: np.ndarray
    off: np.ndarray

    def place(self, x):
        """(3,) [m] with nodes at x (n, 3)."""
        return self.weights @ x[self.nodes] - self.off

    def loads(self, count):
        """(2, n, 3) unit forces on it along `across`, on `count` nodes."""
        out = np.zeros((2, count, 3))
        np.add.at(out, (slice(None), self.nodes), self.weights[:, None] * self.across[:, None])
        return out


@dataclass(frozen=True)
class Bent:
    """A shaft at one instant: its anchors, template to tip, and the tissue's force on it there.

    force : (m, 2) [N] along each anchor's `across`
    """

    beam: NeedleBeam
    anchors: tuple = ()
    force: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    def deflection(self, at):
        """(k, 3) [m] of the shaft off its path at arc lengths `at` (k,)."""
        if not self.anchors:
            return np.zeros((len(at), 3))
        s = np.array([anchor.s for anchor in self.anchors])
        force = np.einsum('md,mdi->mi', self.force, [a.across for a in self.anchors])
        return self.beam.flexibility(np.asarray(at, dtype=float), s) @ force

    def shaft(self, needle):
        """The NeedleInTissue of a path, as it is bent."""
        at = np.linspace(0.0, needle.depth, len(needle.points))
        return NeedleInTissue(needle.points + self.deflection(at), needle.depth)

    def withdrawn(self, depth):
        """The same with its tip at a depth [m]: tissue that it has left is free."""
        stay = sum(anchor.s <= depth for anchor in self.anchors)
        return replace(self, anchors=self.anchors[:stay], force=self.force[:stay])

    def advanced(self, mesh, needle, entry, x):
        """The same with anchors up to its tip.

        mesh : TetMesh;  needle : NeedleInTissue, its path;  x : (n, 3) [m] nodes now
        entry : [m] along the shaft where it enters the tissue
        """
        known = {anchor.s for anchor in self.anchors}
        count = range(int(entry / SPACING) + 1, int(needle.depth / SPACING + 1e-9) + 1)
        at = np.array([SPACING * k for k in count if SPACING * k not in known])
        if not len(at):
            return self
        paths, ways = along(needle.points, at)
        places = paths + self.deflection(at)
        held = embed(replace(mesh, nodes=x), places, standoff=np.inf)
        new = [(Anchor(float(s), nodes, weights, _across(way), weights @ x[nodes] - place),
                np.zeros(2)) for s, place, way, nodes, weights in zip(
                    at, places, ways, held.nodes, held.weights, strict=True)]
        old = zip(self.anchors, self.force, strict=True)
        anchors, force = zip(*sorted([*old, *new], key=lambda pair: pair[0].s), strict=True)
        return replace(self, anchors=anchors, force=np.array(force))


class Sideways:
    """What a bent shaft and the tissue do to each other in one part of a step.

    before : Bent, withdrawn to where the tip is at the end;  needle : NeedleInTissue, path there
    """

    def __init__(self, before, needle):
        self.before, self.needle = before, needle
        anchors, beam = before.anchors, before.beam
        s = np.array([anchor.s for anchor in anchors])
        across = np.array([anchor.across for anchor in anchors]).reshape(-1, 2, 3)
        self._places = along(needle.points, s)[0]
        self._across = across
        B = np.einsum('jk,jdi,kei->jdke', beam.flexibility(s, s), across, across)
        size = 2 * len(s)
        self._flexibility = B.reshape(size, size) + np.eye(size) / (beam.beside * SPACING)

    def moved(self, y):
        """(2m,) [m] of the tissue off the path, nodes at y (n, 3)."""
        way = np.array([a.place(y) for a in self.before.anchors]) - self._places
        return np.einsum('mdi,mi->md', self._across, way).ravel()

    def balanced(self, moved, C, old):
        """Force (2m,) [N] of the tissue on the shaft.

        moved : (2m,) [m], under `old` (2m,) [N];  C : (2m, 2m) [m/N] flexibility of the tissue
        """
        return dense.solve(self._flexibility + C, (moved + C @ old)[:, None])[:, 0]

    def after(self, force):
        """The Bent under a force (2m,) [N]."""
        return replace(self.before, force=force.reshape(-1, 2))


def _across(way):
    """(2, 3) unit vectors across a unit vector (3,)."""
    least = np.eye(3)[np.abs(way).argmin()]
    one = least - way * (way @ least)
    one /= np.linalg.norm(one)
    return np.array([one, np.cross(way, one)])
