"""A spherical inclusion: a lump stiffer than its surroundings, or a soft pocket."""

from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec

REFINEMENTS = 3  # 8^3 = 512 quadrature points per cut element; sphere volume within 1 % (test)


@dataclass(frozen=True)
class Inclusion(BodyTerm):
    """Moduli times `ratio` inside a sphere fixed in the reference configuration.

    An element cut by the sphere gets the harmonic mean of the moduli (Reuss), so the sphere may
    be smaller than an element and its effect moves smoothly with `centre` and `radius`. The
    arithmetic mean would add to the excess stiffness of displacement elements: effect of a
    small sphere on the energy, against Eshelby, cells of 0.8 radius, ratio 3: harmonic +8 %,
    arithmetic +38 %; ratio 0.2: +14 % and -22 %. Pockets softer than 0.1 would come out too large
    on such a mesh, hence the lower limit.
    Test: tissue/terms/test_inclusion.py (series bar, Eshelby sphere)
    """

    centre: tuple = quantity(
        [0.0, 0.0, 30.0], 'mm', 'centre of the sphere at rest, world frame', shape=(3,),
        low=-500.0, high=500.0, source='mid-height of a 60 mm breast phantom')
    radius: float = quantity(
        8.0, 'mm', 'radius of the sphere', low=0.5, high=60.0, prior=('lognormal', 8.0, 1.5),
        source='T1 breast tumour, at most 20 mm across (TNM classification, 8th edition)')
    ratio: float = quantity(
        1.0, '', 'modulus inside over modulus outside', low=0.1, high=100.0,
        prior=('lognormal', 2.0, 2.5), typical=5.0,
        source='malignant tumours 3-6 x, high-grade ductal carcinoma up to 13 x fibroglandular '
               'tissue (Samani et al. 2007, Phys Med Biol 52:1565)', neutral=1.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='inclusion', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='spherical lump or soft pocket',
        equation='mu_e -> mu_e / (1 - phi_e + phi_e / ratio), kappa_e, c_e, k_e likewise;  '
                 'phi_e = |element e within the sphere| / |element e|',
        source='Eshelby 1957, Proc R Soc A 241:376 (far field ~ volume x contrast / (1 + beta '
               'contrast)); Reuss average in cut elements: Hill 1963, J Mech Phys Solids 11:357',
        invisible_when='the tissue around it is not strained; one push alone does not tell it '
                       'from a load; radius and ratio only through '
                       'volume x (ratio - 1) / (3 + 2 ratio) when it is small',
        leaves_open='the shape of the lump, and an edge that is soft; several lumps', load_cases=2)

    def prepare(self, body):
        """Return `body` with the moduli of the elements that the sphere meets scaled."""
        phi = volume_fraction(body.mesh, np.array(self.centre), self.radius)
        return body.with_stiffness(1.0 / (1.0 - phi + phi / self.ratio))


def volume_fraction(mesh, centre, radius):
    """Share of each element's volume that lies inside a sphere.

    mesh : TetMesh;  centre : (3,) [m];  radius : [m]
    Returns (m,) in [0, 1], by 512 equal-volume cells per element that the sphere may cut.
    """
    corners = mesh.nodes[mesh.tets]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    distance = np.linalg.norm(middle - centre, axis=1)
    phi = np.where(distance + reach <= radius, 1.0, 0.0)
    cut = np.flatnonzero(np.abs(distance - radius) < reach)
    points = np.einsum('qa,mai->mqi', cell_centroids(REFINEMENTS), corners[cut])
    phi[cut] = (np.linalg.norm(points - centre, axis=2) <= radius).mean(axis=1)
    return phi


def cell_centroids(refinements):
    """Barycentric centroids (8^refinements, 4) of the `cells` of a tetrahedron."""
    return cells(refinements).mean(axis=1)


def cells(refinements):
    """Barycentric corners (8^refinements, 4, 4) of a tetrahedron cut into cells of equal volume.

    Each refinement halves the edges: four corner cells and four that share the octahedron's
    diagonal. Source: Bey 1995, Computing 55:355 (red refinement).
    """
    parts = np.eye(4)[None]
    for _ in range(refinements):
        middle = {(i, j): 0.5 * (parts[:, i] + parts[:, j])
                  for i, j in product(range(4), repeat=2)}
        parts = np.concatenate([np.stack([middle[pair] for pair in child], axis=1)
                                for child in _CHILDREN])
    return parts


# corners of the eight children, each a midpoint of the parent's corners i and j (i = j: a corner)
_CHILDREN = (
    ((0, 0), (0, 1), (0, 2), (0, 3)), ((0, 1), (1, 1), (1, 2), (1, 3)),
    ((0, 2), (1, 2), (2, 2), (2, 3)), ((0, 3), (1, 3), (2, 3), (3, 3)),
    ((0, 1), (0, 2), (0, 3), (1, 3)), ((0, 1), (0, 2), (1, 2), (1, 3)),
    ((0, 2), (0, 3), (1, 3), (2, 3)), ((0, 2), (1, 2), (1, 3), (2, 3)),
)
