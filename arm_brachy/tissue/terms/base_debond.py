"""A sector of the glued base that has come off: it lifts, and still rests on what is below."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.mesh import boundary_faces, with_midside
from arm_brachy.tissue.supports import chosen, positions, support_points

RIM = 0.2      # of the radius: over it the glue comes back
FADE = 4       # power with which it does


@dataclass(frozen=True)
class BaseDebond(BodyTerm):
    """Unilateral support in place of the fixed nodes within a round sector of the base.

    Symbols: c `centre`, R `radius`, A area, d gap of a point of the base, which is what the point
    has risen along the base's normal n; k, s stiffness and onset of the ground, those of
    `contact.ContactLaw` (at the tissue's mean modulus it gives way by 5 um). Within R a point
    bears pressure but neither tension nor shear. Beyond, the glue comes back as k ((r - R) /
    (0.2 R))^4, up to k, and past that nodes are fixed: so nodes do not come off all at once, and
    forces and shapes change smoothly with centre and radius on any mesh. With r the distance at
    which glue and a layer of the tissue 10 mm thick are equally stiff, the glue ends at about
    1.03 R.

    Holds while the sector slides by less than it would notice (no friction, flat ground) and for
    a base whose faces are fixed node by node; fixed nodes inside the body stay fixed. With
    base_compliance the sector itself lies on rigid ground.
    Test: tissue/terms/test_base_debond.py (bar that lifts off, peeling beam, complementarity)
    """

    radius: float = quantity(
        0.0, 'mm', 'radius of the sector without glue', low=0.0, high=200.0,
        prior=('lognormal', 22.0, 1.5), typical=22.0,
        source='engineering judgement: a seventh of the base of a 60 mm breast phantom',
        neutral=0.0)
    centre: tuple = quantity(
        [0.0, 0.0, 0.0], 'mm', 'centre of the sector, on the base, world frame', shape=(3,),
        low=-500.0, high=500.0, source='middle of the base')

    spec: ClassVar[TermSpec] = TermSpec(
        name='base_debond', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='part of the glued base has come off',
        equation="d >= 0, p >= 0, p d = 0 (regularised: p = -phi'(d)), no shear, for "
                 '|X - c| < R on the base',
        source='Signorini 1933 (unilateral support); penalty regularisation: Wriggers 2006, '
               'Computational Contact Mechanics; Kikuchi & Oden 1988, Contact Problems in '
               'Elasticity',
        invisible_when='the sector is pressed down and not sheared in every load; also where the '
                       'radius is below the size of the faces of the base',
        leaves_open='the outline: a long patch, or an edge that has peeled; friction where it '
                    'rests; glue that gives way further')

    def prepare(self, body):
        """Return `body` with the sector loose.

        Raises MeshError if no boundary face lies wholly in the fixed region.
        """
        outer = boundary_faces(body.mesh)
        base = outer[np.isin(outer, body.fixed).all(axis=1)]
        if not len(base):
            raise MeshError(
                f'base_debond: none of the {len(body.fixed)} fixed nodes spans a boundary '
                'face of the mesh; the fixed region must cover at least one face')
        if not self.radius > 0.0:
            return body
        points = support_points(body, base)
        glue = self._glue(positions(points, body.mesh.nodes))
        loose = glue.reshape(len(base), -1).min(axis=1) < 1.0
        fixed = np.setdiff1d(body.fixed, self._freed(body.mesh, base, loose))
        points = replace(points, glue=glue * points.stiffness)
        points = chosen(points, np.repeat(loose, len(glue) // len(base)))
        points = chosen(points, ~np.isin(points.nodes, fixed).all(axis=1))
        if not len(points.nodes):
            return body
        return replace(body, fixed=fixed, supports=body.supports.joined(points))

    def _glue(self, where):
        """Share (s,) of the stiffness of the ground that is left of the glue at points (s, 3)."""
        away = np.linalg.norm(where - np.array(self.centre), axis=1) / self.radius
        return np.clip((away - 1.0) / RIM, 0.0, 1.0) ** FADE

    @staticmethod
    def _freed(mesh, base, loose):
        """Nodes of the base that belong to loose faces alone."""
        held, every = (with_midside(mesh, faces) for faces in (base[~loose], base))
        return np.setdiff1d(every, held)
