"""The tissue's true stress-free shape differs from the mesh that the scene names."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.element import EDGES, signed_volumes
from arm_brachy.tissue.mesh import boundary_faces

GRAZING = 0.2   # cosine to its surface's normal, 78 degrees, below which a push is a shear


@dataclass(frozen=True)
class ReferenceShape(BodyTerm):
    """Taller, wider, and with a bump or a dent, in the scene's coordinates.

    Symbols: h `height`, l `width`, n the unit normal of the base into the body, p the centroid of
    the fixed nodes, z = n . (X - p); bump of height H `bump_height`, radius R `bump_radius` and
    centre c `bump_centre`, b(s) = (1 - s^2)^2 below s = 1, m the mean outward normal of the free
    surface under it. Near the base the bump fades over one radius, so that it leaves the base
    alone; a plane base stays plane.

    Nodes keep their numbers and material points move along: markers and targets attached in the
    scene's mesh sit at the same material point of the true shape, as marks made on the tissue do,
    and not where the scene says. A pad is glued to the patch of its nodes, wherever that is now;
    its actuator stays where it is mounted, so that the pad, and markers on it, come to the true
    surface by a longer or a shorter way along its push and no other way, to first order in how
    far the surface goes. Edges are straight in the true shape too. Holds for smooth, small
    changes; elements are stretched, not remeshed.
    Test: tissue/terms/test_reference_shape.py (bars, volume of the bump, plane base, markers)
    """

    height: float = quantity(
        0.0, '', 'relative change of height above the base', low=-0.5, high=1.0,
        prior=('normal', 0.0, 0.03), typical=0.03,
        source='engineering judgement: 2 mm of 60 mm, as between mould and cast', neutral=0.0)
    width: float = quantity(
        0.0, '', 'relative change of width along the base', low=-0.5, high=1.0,
        prior=('normal', 0.0, 0.03), source='as height', neutral=0.0)
    bump_height: float = quantity(
        0.0, 'mm', 'height of the bump, negative for a dent', low=-30.0, high=30.0,
        prior=('normal', 0.0, 2.0),
        source='engineering judgement: a fold or a bad cast, or an error of the scan', neutral=0.0)
    bump_centre: tuple = quantity(
        [0.0, 0.0, 60.0], 'mm', 'centre of the bump, on the surface, world frame', shape=(3,),
        low=-500.0, high=500.0, source='top of a 60 mm breast phantom')
    bump_radius: float = quantity(
        15.0, 'mm', 'radius within which the bump lies', low=2.0, high=200.0,
        prior=('lognormal', 15.0, 1.5), source='about a pad (engineering judgement)')

    spec: ClassVar[TermSpec] = TermSpec(
        name='reference_shape', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='stress-free shape differs from the mesh',
        equation='X -> X + h z n + l (X - p - z n) + H b(|X - c| / R) (1 - max(1 - z / R, 0)^2) m',
        source='smooth modes of the shape; b: biweight kernel (Silverman 1986, Density '
               'Estimation, ch. 3)',
        invisible_when='a uniform error of size with an optical scale error, and shape with sag '
                       'in one orientation; a bump away from all markers and pads',
        leaves_open='further modes of the shape: a barrel, a plateau instead of a rounded bump, '
                    'several bumps')

    def prepare(self, body):
        """Return `body` with its true shape.

        Raises MeshError if the fixed nodes or those of a pad span no boundary face, if no free
        surface lies under the bump, or if an element is turned inside out.
        """
        move = self._motion(body)
        corners = np.unique(body.mesh.tets)
        nodes = body.mesh.nodes.copy()
        nodes[corners] = move(nodes[corners])
        if body.mesh.midside is not None:
            ends = nodes[body.mesh.tets[:, EDGES]]
            nodes[body.mesh.midside] = 0.5 * (ends[:, :, 0] + ends[:, :, 1])
        self._refuse_inverted(nodes, body.mesh.tets)
        pads = tuple(_brought_up(pad, body.mesh, move) for pad in body.pads)
        return replace(body, mesh=replace(body.mesh, nodes=nodes), pads=pads)

    def _motion(self, body):
        """The map X (k, 3) [m] -> where those points are in the true shape."""
        base, free = _surface(body)
        n = -base.sum(axis=0) / np.linalg.norm(base.sum(axis=0))
        p = body.mesh.nodes[body.fixed].mean(axis=0)
        m = self._bump_direction(*free) if self.bump_height else np.zeros(3)

        def move(X):
            z = (X - p) @ n
            up = z[:, None] * n
            fade = 1.0 - np.maximum(1.0 - z / self.bump_radius, 0.0) ** 2
            bump = (self.bump_height * fade * self._profile(X))[:, None] * m
            return X + self.height * up + self.width * (X - p - up) + bump

        return move

    def _profile(self, X):
        s = np.linalg.norm(X - np.array(self.bump_centre), axis=1) / self.bump_radius
        return np.maximum(1.0 - s**2, 0.0) ** 2

    def _bump_direction(self, middles, areas):
        mean = self._profile(middles) @ areas
        length = np.linalg.norm(mean)
        if not length > 0.0:
            gap = np.linalg.norm(middles - np.array(self.bump_centre), axis=1).min()
            raise MeshError(f'reference_shape: the middle of the nearest free face is '
                            f'{1e3 * gap:.1f} mm from bump_centre; must be within bump_radius = '
                            f'{1e3 * self.bump_radius:g} mm; move the bump onto the surface or '
                            'make it wider')
        return mean / length

    def _refuse_inverted(self, nodes, tets):
        bad = np.flatnonzero(signed_volumes(nodes, tets) <= 0.0)
        if len(bad):
            raise MeshError(f'reference_shape: {len(bad)} of {len(tets)} elements turned inside '
                            f'out, first {bad[0]}; a bump of {1e3 * self.bump_height:g} mm is too '
                            f'steep for a radius of {1e3 * self.bump_radius:g} mm; make it lower '
                            'or wider')


def _brought_up(pad, mesh, move):
    """The pad where its push meets the surface that `move` has moved, a plane under it.

    What slides along the surface brings no pad anywhere, and nothing one that shears it.
    """
    outer = boundary_faces(mesh)
    under = outer[np.isin(outer, pad.nodes).all(axis=1)]
    if not len(under):
        raise MeshError(f'reference_shape: the {len(pad.nodes)} nodes of pad {pad.name} span no '
                        'boundary face of the mesh; must span one; make the pad larger or the '
                        'mesh finer')
    a, b, c = (mesh.nodes[under[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a).sum(axis=0)
    along = pad.direction @ normal
    if abs(along) < GRAZING * np.linalg.norm(normal):
        return pad
    way = (move(pad.centre[None])[0] - pad.centre) @ normal / along
    return replace(pad, centre=pad.centre + way * pad.direction)


def _surface(body):
    """Area vectors [m^2] of the base's faces; centroids and area vectors of the free ones."""
    outer = boundary_faces(body.mesh)
    a, b, c = (body.mesh.nodes[outer[:, i]] for i in range(3))
    areas, held = 0.5 * np.cross(b - a, c - a), np.isin(outer, body.fixed).all(axis=1)
    if not held.any():
        raise MeshError(f'reference_shape: none of the {len(body.fixed)} fixed nodes spans a '
                        'boundary face of the mesh; the fixed region must cover at least one face')
    return areas[held], (((a + b + c) / 3.0)[~held], areas[~held])
