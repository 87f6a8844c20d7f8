"""What is simulated: an immutable description of one soft body and of one step's fields."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from arm_brachy.tissue.element import element_geometry
from arm_brachy.tissue.material import BEYOND


@dataclass(frozen=True)
class TetMesh:
    """A tetrahedral mesh in its stress-free configuration, world frame.

    nodes : (n, 3) [m];  tets : (m, 4) corner nodes, positively oriented
    node_sets : name -> (k,) node indices
    midside : (m, 6) nodes in the middle of `element.EDGES` of each tetrahedron, or None; with them
        the elements are quadratic (`element.quadratic_mesh`)
    """

    nodes: np.ndarray
    tets: np.ndarray
    node_sets: dict = field(default_factory=dict)
    midside: np.ndarray | None = None

    @property
    def connectivity(self):
        """All nodes of each element, (m, 4) or (m, 10): corners first."""
        return self.tets if self.midside is None else np.hstack([self.tets, self.midside])


@dataclass(frozen=True)
class PadFace:
    """The face of a pad that touches: flat disc of `radius` [m], edge rounded with `edge_radius`.

    friction : Coulomb coefficient
    """

    radius: float
    edge_radius: float
    friction: float


@dataclass(frozen=True)
class Pad:
    """A rigid disc on the surface; it translates, it does not rotate.

    nodes : (k,) node indices under the disc;  direction : (3,) unit vector into the tissue
    centre : (3,) [m] of the disc at rest;  stroke : largest displacement along direction [m]
    face : PadFace of a pad that only touches, None = bonded to its nodes. Only
        `contact_pads.PadContact` and with it the plant take notice: every other solver bonds all
        pads, which is how models of a touching plant are made (README)
    """

    name: str
    nodes: np.ndarray
    direction: np.ndarray
    centre: np.ndarray
    stroke: float
    face: PadFace | None = None


@dataclass(frozen=True)
class Springs:
    """Linear springs from nodes to their rest positions on the ground.

    nodes : (s,) node indices, each at most once;  stiffness : (s, 3, 3) symmetric [N/m]
    """

    nodes: np.ndarray
    stiffness: np.ndarray


NO_SPRINGS = Springs(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)))


@dataclass(frozen=True)
class Fibres:
    """Fibres that reinforce the tissue.

    modulus : (m,) [Pa] k of `material`; four times it is their Young's modulus at small strain
    direction : (m, 3) unit vectors at rest
    """

    modulus: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class SoftBody:
    """A body to solve for: mesh, material per element, supports, loads.

    mu, kappa : (m,) [Pa] shear and bulk modulus of the Neo-Hookean law (3.18, corrected)
    density : (m,) [kg/m^3]
    fixed : (f,) nodes held at their rest position
    pads : displacement-driven patches
    springs : ground springs (base compliance)
    gravity : (3,) [m/s^2];  nodal_force : (n, 3) dead loads [N]
    nodal_mass : (n,) lumped masses carried besides the tissue's own [kg]; gravity acts on them too
    stiffening : (m,) [Pa] Yeoh's second constant, None = 0;  fibres : Fibres or None; both go
        beyond the Neo-Hookean law (`material`)
    damping : (alpha [1/s], beta [s]) of alpha M plus a Kelvin-Voigt stress, dynamics only; at rest
        alpha M + beta K, which is Rayleigh damping (`viscosity.viscous_stress`)
    """

    mesh: TetMesh
    mu: np.ndarray
    kappa: np.ndarray
    density: np.ndarray
    fixed: np.ndarray
    pads: tuple = ()
    springs: Springs = NO_SPRINGS
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    nodal_force: np.ndarray | None = None
    nodal_mass: np.ndarray | None = None
    damping: tuple = (0.0, 0.0)
    stiffening: np.ndarray | None = None
    fibres: Fibres | None = None

    @cached_property
    def beyond(self):
        """(m, BEYOND) how each element's law departs from Neo-Hooke, as `material` takes it."""
        table = np.zeros((len(self.mu), BEYOND))
        if self.stiffening is not None:
            table[:, 0] = self.stiffening
        if self.fibres is not None:
            table[:, 1], table[:, 2:] = self.fibres.modulus, self.fibres.direction
        return table

    @cached_property
    def geometry(self):
        """ElementGeometry of the mesh: linear or quadratic tetrahedra, as it has midside nodes."""
        return element_geometry(self.mesh, self.mu, self.kappa)

    @property
    def pad_names(self):
        """Names of the pads, in the order of every (p, ...) array."""
        return tuple(p.name for p in self.pads)


@dataclass
class StepFields:
    """What terms with memory may change for one step; the solver reads it and keeps it fixed.

    mu, kappa : (m,) [Pa] moduli in force during the step
    stress : (m, q, 3, 3) [Pa] symmetric second Piola-Kirchhoff stress added to the elastic one at
        the element's quadrature points, each with its `ElementGeometry.point_weights`
    nodal_force : (n, 3) [N]
    swelling : stretch by which every fibre of the stress-free body has grown
    """

    mu: np.ndarray
    kappa: np.ndarray
    stress: np.ndarray
    nodal_force: np.ndarray
    swelling: float = 1.0

    @classmethod
    def of(cls, body):
        """Fields of a body with no memory: its own moduli and dead loads, no added stress."""
        n = len(body.mesh.nodes)
        force = np.zeros((n, 3)) if body.nodal_force is None else body.nodal_force.copy()
        stress = np.zeros((*body.geometry.weights.shape, 3, 3))
        return cls(body.mu.copy(), body.kappa.copy(), stress, force)
