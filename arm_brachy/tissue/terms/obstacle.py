"""A wall that nobody modelled: tissue that is pushed its way comes to press against it."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.supports import chosen, positions, support_points


@dataclass(frozen=True)
class Obstacle(BodyTerm):
    """A flat rigid wall in the world, parallel to the surface at rest, near one place of it.

    Symbols: c `centre`, R `radius`, b(s) = (1 - s^2)^2 below s = 1, n the mean outward normal of
    the surface weighted with b(|X - c| / R). The wall is the plane across n whose distance from
    the tissue at rest is `gap`, at the nearest point within R; on a convex body it is reached
    there first, and contact spreads. Only points within R of c at rest find it, with stiffness
    and onset of `contact.ContactLaw` times b: stiff against the tissue up to about 0.95 R. Exactly
    nothing acts before the first contact; no friction. It does not move with the base.

    Holds for a wall that is flat over the part of the tissue that meets it. On a concave surface
    the wall touches the rim of the patch first.
    Test: tissue/terms/test_obstacle.py (bar against a wall, plane contact, complementarity)
    """

    gap: float = quantity(
        0.15, 'mm', 'clearance at rest', low=0.0, high=1e3, prior=('lognormal', 0.15, 3.0),
        typical=0.15, source='engineering judgement: less than a push moves the far side; the '
                             'wall is never met in the limit of large values',
        neutral=float('inf'))
    centre: tuple = quantity(
        [0.0, 0.0, 58.0], 'mm', 'where the tissue may meet it, on the surface at rest, world '
        'frame', shape=(3,), low=-500.0, high=500.0, source='top of a 58 mm breast phantom')
    radius: float = quantity(
        15.0, 'mm', 'radius of the surface that may meet it', low=2.0, high=200.0,
        prior=('lognormal', 15.0, 1.5), source='a bracket or a cable duct (engineering judgement)')

    spec: ClassVar[TermSpec] = TermSpec(
        name='obstacle', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='tissue meets a wall that the model does not have',
        equation="d = gap + max n . X - n . x >= 0, p >= 0, p d = 0 (regularised: p = -phi'(d) "
                 'b(|X - c| / R))',
        source='unilateral contact: Kikuchi & Oden 1988, Contact Problems in Elasticity; penalty '
               'regularisation: Wriggers 2006, Computational Contact Mechanics',
        invisible_when='no load moves the surface at the place by as much as the gap',
        leaves_open='a wall that is curved or gives way, and friction on it')

    def prepare(self, body):
        """Return `body` with the wall beside it.

        Raises MeshError if no free surface lies within `radius` of `centre`.
        """
        outer = boundary_faces(body.mesh)
        points = support_points(body, outer[~np.isin(outer, body.fixed).all(axis=1)])
        where = positions(points, body.mesh.nodes)
        away = np.linalg.norm(where - np.array(self.centre), axis=1)
        profile = np.maximum(1.0 - (away / self.radius) ** 2, 0.0) ** 2
        if not profile.any():
            off = away.min(initial=np.inf)
            raise MeshError(f'obstacle: the free surface is {1e3 * off:.1f} mm from centre at the '
                            f'nearest; must be within radius = {1e3 * self.radius:g} mm; move it '
                            'onto the surface')
        inward = (profile * points.stiffness) @ points.normal
        inward /= np.linalg.norm(inward)
        height = where @ inward
        lowest = height[profile > 0.0].min()
        wall = replace(points, normal=np.tile(inward, (len(height), 1)),
                       gap=self.gap + height - lowest, stiffness=profile * points.stiffness,
                       carried=np.zeros(len(height)))
        return replace(body, supports=body.supports.joined(chosen(wall, profile > 0.0)))
