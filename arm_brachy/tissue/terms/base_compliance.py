"""A base that gives: the glue, foam or chest wall under the tissue is not rigid."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.body import Springs
from arm_brachy.tissue.mesh import boundary_faces, face_middles


@dataclass(frozen=True)
class BaseCompliance(BodyTerm):
    """A Winkler foundation in place of the fixed nodes.

    Boundary faces whose three nodes are all fixed become the base surface; each hands a third of
    its area to its nodes, which hang on independent springs to where they rest. Fixed nodes
    beneath that surface are set free with it. Holds while the base moves by less than its own
    thickness and stays bonded; lift-off is another term.
    Test: tissue/terms/test_base_compliance.py
    """

    normal: float = quantity(
        1.0, 'kPa_mm', 'foundation modulus along the base normal', low=1e-3, high=1e4,
        prior=('lognormal', 1.0, 5.0), typical=1.0,
        source='engineering judgement: foam of E = 10 kPa, 10 mm thick, E / thickness; rigid in '
               'the limit of large values', neutral=float('inf'))
    tangential: float = quantity(
        1.0, 'kPa_mm', 'foundation modulus along the base', low=1e-3, high=1e4,
        prior=('lognormal', 1.0, 5.0), typical=1.0,
        source='engineering judgement: a glued layer, between G / thickness (a third of normal) '
               'and normal', neutral=float('inf'))

    spec: ClassVar[TermSpec] = TermSpec(
        name='base_compliance', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='the base under the tissue gives',
        equation='K_a = sum over base faces f at node a of A_f / 3 '
                 '[normal n n^T + tangential (I - n n^T)]',
        source='Winkler 1867, Die Lehre von der Elasticitaet und Festigkeit; Hetenyi 1946, Beams '
               'on Elastic Foundation',
        invisible_when='no marker lies within about one pad diameter of the base and no base '
                       'marker exists; also where normal, tangential >> E / height',
        leaves_open='a foundation that differs from place to place, as of a plate that bends; '
                    'one that is not linear')

    def prepare(self, body):
        """Return `body` on springs instead of fixed nodes.

        Raises MeshError if no boundary face lies wholly in the fixed region.
        """
        nodes, stiffness = self._springs(body)
        kept = ~np.isin(body.springs.nodes, nodes)  # a spring at a fixed node did nothing
        springs = Springs(np.concatenate([body.springs.nodes[kept], nodes]),
                          np.concatenate([body.springs.stiffness[kept], stiffness]))
        return replace(body, fixed=np.zeros(0, dtype=np.int64), springs=springs)

    def _springs(self, body):
        area = base_areas(body.mesh, body.fixed)
        if not len(area.faces):
            raise MeshError(
                f'base_compliance: none of the {len(body.fixed)} fixed nodes spans a boundary '
                'face of the mesh; the fixed region must cover at least one face')
        unit = area.vectors / np.linalg.norm(area.vectors, axis=1, keepdims=True)
        size = np.linalg.norm(area.vectors, axis=1)[:, None, None] / 3.0
        along = np.einsum('fi,fj->fij', unit, unit)
        share = size * (self.normal * along + self.tangential * (np.eye(3) - along))
        nodes, slot = np.unique(area.faces, return_inverse=True)
        stiffness = np.zeros((len(nodes), 3, 3))
        np.add.at(stiffness, slot.reshape(-1), np.repeat(share, 3, axis=0))
        return nodes, stiffness


@dataclass(frozen=True)
class FaceAreas:
    """Boundary triangles.

    faces : (f, 3) nodes that share each equally: its corners, or with quadratic elements the
        middles of its edges, a rule exact for springs times quadratic displacements' integral
    vectors : (f, 3) outward area vectors [m^2]
    """

    faces: np.ndarray
    vectors: np.ndarray


def base_areas(mesh, fixed):
    """Boundary faces of a TetMesh whose three nodes are all in `fixed` (k,), as FaceAreas."""
    outer = boundary_faces(mesh)
    base = outer[np.isin(outer, fixed).all(axis=1)]
    a, b, c = (mesh.nodes[base[:, i]] for i in range(3))
    carriers = base if mesh.midside is None else face_middles(mesh, base)
    return FaceAreas(carriers, 0.5 * np.cross(b - a, c - a))
