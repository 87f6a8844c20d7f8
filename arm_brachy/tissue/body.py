"""What is simulated: an immutable description of one soft body and of one step's fields."""

from dataclasses import dataclass, field, fields, replace
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
    notes : what a reader left out of the file, for a person
    """

    nodes: np.ndarray
    tets: np.ndarray
    node_sets: dict = field(default_factory=dict)
    midside: np.ndarray | None = None
    notes: tuple = ()

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
class PadFootprint:
    """The face of a pad that came off its glue: the shape of the patch that it was bonded to.

    friction : Coulomb coefficient
    """

    friction: float


@dataclass(frozen=True)
class Pad:
    """A rigid disc on the surface; it translates, it does not rotate.

    nodes : (k,) node indices under the disc;  direction : (3,) unit vector into the tissue
    centre : (3,) [m] of the disc at rest;  stroke : largest displacement along direction [m]
    radius : [m] of the disc; None where the nodes are all that is known of it
    face : PadFace or PadFootprint of a pad that only touches, None = bonded to its nodes. Only
        `contact_pads.PadContact` and with it the plant take notice: every other solver bonds all
        pads, which is how models of a touching plant are made (README)
    """

    name: str
    nodes: np.ndarray
    direction: np.ndarray
    centre: np.ndarray
    stroke: float
    face: PadFace | PadFootprint | None = None
    radius: float | None = None


@dataclass(frozen=True)
class Springs:
    """Linear springs from nodes to their rest positions on the base, and with it where it goes.

    nodes : (s,) node indices, each at most once;  stiffness : (s, 3, 3) symmetric [N/m]
    """

    nodes: np.ndarray
    stiffness: np.ndarray


NO_SPRINGS = Springs(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)))


@dataclass(frozen=True)
class Supports:
    """Rigid ground that points of the surface press on, never pull, without friction.

    nodes : (s, a) nodes of the face a point lies on, corners first;  shape : (s, a) their shape
        functions at the point
    normal : (s, 3) unit vectors out of the ground, into the tissue
    gap : (s,) [m] along the normal at rest;  stiffness : (s,) [N/m] of a closed point, which comes
        in over the depth `onset` (s,) [m] as `contact_kernels.pressure_law` has it
    glue : (s,) [N/m] with which a point is besides held where it rests, in all directions
    carried : (s,) 1 where the ground is the base and goes with it, 0 where it stays
    """

    nodes: np.ndarray
    shape: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    stiffness: np.ndarray
    onset: np.ndarray
    glue: np.ndarray
    carried: np.ndarray

    def joined(self, other):
        """Return the Supports with the points of both; `other` is on the same mesh."""
        if not len(self.nodes):
            return other
        return Supports(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)])
                          for f in fields(self)))


NO_SUPPORTS = Supports(np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0)), np.zeros((0, 3)),
                       *np.zeros((5, 0)))


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
    fixed : (f,) nodes held at their rest position, or where the base has taken it
    pads : displacement-driven patches
    springs : of the base (base compliance);  supports : one-sided ones (debonding, obstacles)
    gravity : (3,) [m/s^2];  nodal_force : (n, 3) dead loads [N]
    nodal_mass : (n,) lumped masses carried besides the tissue's own [kg]; gravity acts on them too
    stiffening : (m,) [Pa] Yeoh's second constant, None = 0;  fibres : Fibres or None; both go
        beyond the Neo-Hookean law (`material`)
    damping : (alpha [1/s], beta [s]) of alpha M plus a Kelvin-Voigt stress, dynamics only; at rest
        alpha M + beta K, which is Rayleigh damping (`viscosity.viscous_stress`)
    scene_nodes : (n, 3) [m] where the material of each node lies in the scene's own mesh, None =
        in the node there. What a scene places is found by it (`build.placement_mesh`)
    in_full : quadratic elements carry volume change at all points, as plain ones of other codes
        do, which lock a little (`element`); False = at the least that they stand on
    """

    mesh: TetMesh
    mu: np.ndarray
    kappa: np.ndarray
    density: np.ndarray
    fixed: np.ndarray
    pads: tuple = ()
    springs: Springs = NO_SPRINGS
    supports: Supports = NO_SUPPORTS
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    nodal_force: np.ndarray | None = None
    nodal_mass: np.ndarray | None = None
    damping: tuple = (0.0, 0.0)
    stiffening: np.ndarray | None = None
    fibres: Fibres | None = None
    scene_nodes: np.ndarray | None = None
    in_full: bool = False

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
        return element_geometry(self.mesh, self.mu, self.kappa, in_full=self.in_full)

    @property
    def pad_names(self):
        """Names of the pads, in the order of every (p, ...) array."""
        return tuple(p.name for p in self.pads)

    def with_stiffness(self, scale):
        """Return the body with every modulus times `scale`, a scalar or (m,).

        All of the law scales alike, stiffening and fibres too, so that stress does at any strain.
        """
        stiffening = None if self.stiffening is None else scale * self.stiffening
        fibres = self.fibres and replace(self.fibres, modulus=scale * self.fibres.modulus)
        return replace(self, mu=scale * self.mu, kappa=scale * self.kappa, stiffening=stiffening,
                       fibres=fibres)

    def swollen(self, stretch):
        """Return the body with the stress-free shape that `StepFields.swelling` means.

        The density stays that of the shape before.
        """
        if stretch == 1.0:
            return self
        return replace(self, mesh=replace(self.mesh, nodes=stretch * self.mesh.nodes))


@dataclass
class StepFields:
    """What terms with memory may change for one step; the solver reads it and keeps it fixed.

    mu, kappa : (m,) [Pa] moduli in force during the step
    beyond : (m, BEYOND) as `SoftBody.beyond`, in force during the step
    stress : (m, q, 3, 3) [Pa] symmetric second Piola-Kirchhoff stress added to the elastic one at
        the element's quadrature points, each with its `ElementGeometry.point_weights`
    nodal_force : (n, 3) [N]
    swelling : stretch by which every line of the stress-free body has grown
    base : (3,) [m] displacement of the base: fixed nodes, springs, supports that it carries
    """

    mu: np.ndarray
    kappa: np.ndarray
    beyond: np.ndarray
    stress: np.ndarray
    nodal_force: np.ndarray
    swelling: float = 1.0
    base: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, body):
        """Fields of a body with no memory: its own moduli and dead loads, no added stress."""
        n = len(body.mesh.nodes)
        force = np.zeros((n, 3)) if body.nodal_force is None else body.nodal_force.copy()
        stress = np.zeros((*body.geometry.weights.shape, 3, 3))
        return cls(body.mu.copy(), body.kappa.copy(), body.beyond.copy(), stress, force)

    def scale_all_but_bulk(self, scale):
        """Multiply every modulus but the bulk modulus by `scale`, a scalar or (m,)."""
        self.mu *= scale
        self.beyond[:, :2] *= np.reshape(scale, (-1, 1))


@dataclass(frozen=True)
class Steps:
    """Known positions of a body, step after step, along which memories are carried.

    t : (m,) [s] ends of the steps;  dt : (m,) [s] their lengths, the first without end
    acting : (m,) [s] lengths as `before_step` is told, infinite where loads are to have lasted
    x : (m, n, 3) [m] at the ends;  swelling : (m,) stretch of the stress-free shape
    at : (k,) numbers of the steps asked for, increasing
    """

    t: np.ndarray
    dt: np.ndarray
    acting: np.ndarray
    x: np.ndarray
    swelling: np.ndarray
    at: np.ndarray
