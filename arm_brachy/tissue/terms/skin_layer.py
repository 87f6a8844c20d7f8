"""A skin: a stiffer layer of even thickness under the free surface."""

from dataclasses import dataclass
from typing import ClassVar

import igl
import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.terms.inclusion import cells

REFINEMENTS = 2  # 64 cells per cut element, each under its nearest plane


@dataclass(frozen=True)
class SkinLayer(BodyTerm):
    """Moduli times `ratio` within `thickness` of the surface, the fixed base excepted.

    Tissue under a pad has the skin too. An element that reaches deeper gets the arithmetic mean of
    the moduli (Voigt), so the layer may be thinner than an element: what a skin mostly resists is
    stretch in its own plane, and there it strains as what lies beneath it, in parallel. A load
    normal to the surface meets it in series and finds it too stiff. Force on a pad of 24 mm bonded
    to a block, layer 2 mm, ratio 2.5, nu = 0.45, elements of 4 mm against a mesh that resolves the
    layer: arithmetic +2 % pushed, +0.6 % dragged sideways; harmonic -2 % and -5 % (the layer
    itself: +17 % and +30 %). Bending of the skin alone is not resolved.
    Test: tissue/terms/test_skin_layer.py (volume, clad bar, clad sphere of Lame)
    """

    ratio: float = quantity(
        1.0, '', 'modulus of the layer over modulus beneath', low=0.1, high=200.0,
        prior=('lognormal', 2.0, 2.5), typical=2.5,
        source='2.5: a cast skin (engineering judgement); breast skin in vivo 344 +- 88 kPa, over '
               '50 x soft tissue (Sutradhar & Miller 2013, Skin Res Technol 19:e191)', neutral=1.0)
    thickness: float = quantity(
        2.0, 'mm', 'thickness of the layer', low=0.1, high=30.0,
        prior=('lognormal', 2.0, 1.5),
        source='breast skin 1.55 +- 0.25 mm, 0.83 to 2.4 mm (Sutradhar & Miller 2013)')

    spec: ClassVar[TermSpec] = TermSpec(
        name='skin_layer', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='stiffer layer under the surface',
        equation='mu_e -> mu_e (1 + (ratio - 1) phi_e), kappa_e, c_e, k_e likewise;  '
                 'phi_e = |element e within thickness of the surface| / |element e|',
        source='membrane stress resultant, modulus x thickness: Timoshenko & '
               'Woinowsky-Krieger 1959, Theory of Plates and Shells; Voigt average in elements '
               'that the layer cuts: Hill 1963, J Mech Phys Solids 11:357',
        invisible_when='the surface is neither stretched nor bent; ratio and thickness only '
                       'through (ratio - 1) x thickness where the layer is thin',
        leaves_open='a thickness that differs from place to place; skin that is stretched at '
                    'rest')

    def prepare(self, body):
        """Return `body` with a stiffer surface layer.

        Raises MeshError if the body has no free surface.
        """
        phi = layer_fraction(body.mesh, body.fixed, self.thickness)
        return body.with_stiffness(1.0 + (self.ratio - 1.0) * phi)


def layer_fraction(mesh, fixed, thickness):
    """Share of each element's volume that lies within `thickness` of the free surface.

    mesh : TetMesh;  fixed : (f,) held nodes: a face between three of them is not free
    thickness : [m]
    Returns (m,) in [0, 1], continuous in `thickness`. Raises MeshError if no face is free.
    """
    outer = boundary_faces(mesh)
    free = outer[~np.isin(outer, fixed).all(axis=1)]
    if not len(free):
        raise MeshError(f'skin_layer: all {len(outer)} boundary faces are fixed; the body must '
                        'have a free surface; fix fewer nodes')
    corners = mesh.nodes[mesh.tets]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    distance, _ = _depth(mesh, free, middle)
    near = np.flatnonzero(distance < thickness + reach)
    parts = np.einsum('cva,mai->mcvi', cells(REFINEMENTS), corners[near])
    centres = parts.mean(axis=2)
    depth, inward = _depth(mesh, free, centres.reshape(-1, 3))
    inward, depth = inward.reshape(centres.shape), depth.reshape(centres.shape[:2])
    rise = np.einsum('mcvi,mci->mcv', parts - centres[:, :, None], inward)
    phi = np.zeros(len(corners))
    phi[near] = share_below(depth[:, :, None] + rise, thickness).mean(axis=1)
    return phi


def _depth(mesh, faces, points):
    """Distance (k,) [m] of points (k, 3) off triangles (f, 3), unit vectors (k, 3) from there."""
    squared, _, nearest = igl.point_mesh_squared_distance(points, mesh.nodes, faces)
    distance = np.sqrt(squared)
    return distance, (points - nearest) / distance[:, None]


def share_below(values, level):
    """Share of a tetrahedron's volume where a linear function is below `level`.

    values : (..., 4) of the function at the corners;  level : scalar
    Returns (...) in [0, 1]: a corner cut off, a wedge in three tetrahedra, or all but a corner.
    """
    v = np.moveaxis(np.sort(values, axis=-1), -1, 0)

    def along(i, j):
        """Where `level` is met on the way from corner i to corner j, within [0, 1]."""
        gap = v[j] - v[i]
        return np.clip((level - v[i]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)

    one = along(0, 1) * along(0, 2) * along(0, 3)
    two = (along(1, 2) * along(1, 3) + along(0, 2) * along(0, 3) * (1.0 - along(1, 3))
           + along(0, 2) * along(1, 3) * (1.0 - along(1, 2)))
    three = 1.0 - (1.0 - along(0, 3)) * (1.0 - along(1, 3)) * (1.0 - along(2, 3))
    return np.select([level <= v[0], level <= v[1], level <= v[2], level < v[3]],
                     [0.0, one, two, three], 1.0)
