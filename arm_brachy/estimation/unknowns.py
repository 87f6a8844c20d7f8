"""What a model of soft tissue may be wrong in: parameters with a Gaussian prior, and their pull.

A body driven by displacements does not feel its modulus, only how it varies; the unknowns are
therefore those that move something: a smooth field of the logarithm of the modulus, the bulk
modulus, fibres, a base that gives, pads that sit or push elsewhere, and a smooth field of body
force for what has no name. Each is standardised: one unit is one standard deviation of its prior.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity
from arm_brachy.estimation.random_fields import field_modes
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.mesh import boundary_faces, interpolate
from arm_brachy.tissue.sensitivity import moduli_derivative, stress_forces
from arm_brachy.tissue.terms.base_compliance import base_areas
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement

STEP = 1e-3             # m, by which a pad is slid to see what that does
REFERENCE_PUSH = 20e-3  # m, at which the body force has its stated size; it grows with the push
LARGEST_LOG = 2.0       # of a modulus: a factor of 7 either way, as far as the model follows


@dataclass(frozen=True)
class PriorParams:
    """Standard deviations of what the model may be wrong in, and how smooth the fields are."""

    modulus: float = quantity(0.6, '', 'sd of the logarithm of the local modulus', low=0.0,
                              source='a lump of ratio 5 is 1.6; most tissue is none')
    modulus_length: float = quantity(15.0, 'mm', 'correlation length of that field', low=1.0,
                                     source='size of the lumps of term inclusion')
    modulus_modes: int = 40
    bulk: float = quantity(0.9, '', 'sd of the logarithm of the bulk modulus', low=0.0,
                           source='prior and typical size of term compressibility')
    fibres: float = quantity(0.15, '', 'sd of fibre modulus over shear modulus, in each of '
                             'fifteen directions', low=0.0, source='typical size of anisotropy')
    base: float = quantity(0.7, 'mm_kPa', 'sd of the compliance of the base, normal and '
                           'tangential', low=0.0, source='typical size of base_compliance')
    offset: float = quantity(2.0, 'mm', 'sd of the place of a pad along the surface', low=0.0,
                             source='prior of term pad_misplacement')
    tilt: float = quantity(3.0, 'deg', 'sd of the direction of a push, about each axis', low=0.0,
                           source='prior of term pad_misplacement')
    travel: float = quantity(0.1, 'mm', 'sd of the zero of a pad travel', low=0.0,
                             source='play of an actuator')
    force: float = quantity(500.0, 'N_m3', 'sd of the body force that stands for all else, at a '
                            'push of 20 mm', low=0.0, source='fitted to plants outside the tables')
    force_length: float = quantity(20.0, 'mm', 'correlation length of that force', low=1.0,
                                   source='as modulus_length')
    force_modes: int = 30


class Unknowns:
    """The unknowns of one SoftBody: derivatives of its equations, and the body with them applied.

    body : SoftBody;  params : PriorParams;  embed_points : TetMesh -> mesh.Embedding of the
        points that are watched, the same material points in whatever mesh
    Attributes: names (k,) of the unknowns;  count k;  directions (15, 3) of fibres
        left_out : why the place of a pad is no unknown, a line for each direction of a pad whose
        patch reaches an edge of the body and cannot be slid
    """

    def __init__(self, body, params, embed_points):
        self.body, self.params = body, params
        self._embedding = embed_points(body.mesh)
        centroids = body.mesh.nodes[body.mesh.tets].mean(axis=1)
        self._modulus = params.modulus * field_modes(centroids, params.modulus_length,
                                                     params.modulus_modes)
        self.directions = hemisphere()
        self._base = _Base(body) if len(body.fixed) else None
        self._slides, self.left_out = _slides(body, embed_points)
        self._force = self._force_modes()
        self.names = self._names()

    @property
    def count(self):
        """Number k of unknowns."""
        return len(self.names)

    def _force_modes(self):
        p, n = self.params, len(self.body.mesh.nodes)
        modes = field_modes(self.body.mesh.nodes, p.force_length, p.force_modes)
        geometry = self.body.geometry
        share = (geometry.weights[:, :, None] * geometry.shape).sum(axis=1)
        volume = np.abs(np.bincount(geometry.connectivity.ravel(), share.ravel(), minlength=n))
        loads = p.force * modes * volume[:, None]
        return np.einsum('nk,ij->nikj', loads, np.eye(3)).reshape(3 * n, -1)

    def _names(self):
        pads = [pad.name for pad in self.body.pads]
        base = ['base_normal', 'base_tangential'] if self._base else []
        return tuple([*(f'modulus_{i}' for i in range(self._modulus.shape[1])), 'bulk',
                      *(f'fibres_{i}' for i in range(len(self.directions))), *base,
                      *(f'{pads[s.pad]}_{s.axis}' for s in self._slides),
                      *(f'{pad}_{what}' for pad in pads
                        for what in ('travel', 'tilt_up', 'tilt_side')),
                      *(f'force_{i}' for i in range(self._force.shape[1]))])

    def _split(self, theta):
        """theta (k, ...) by kind: modulus, bulk, fibres, base, slides, pads, force."""
        sizes = [self._modulus.shape[1], 1, len(self.directions), 2 if self._base else 0,
                 len(self._slides), 3 * len(self.body.pads), self._force.shape[1]]
        return np.split(theta, np.cumsum(sizes)[:-1])

    def derivatives(self, linearisation, q):
        """Return how equations and points change with each unknown at an equilibrium.

        linearisation : jacobian.Linearisation;  q : (p,) [m] pad travel
        Returns motion (3n, k) [m] of held nodes, rate (3n, k) [N] of the forces at fixed x, and
        shift (w, 3, k) [m] of the points watched at fixed x.
        """
        n, p = len(linearisation.x), self.params
        fields = linearisation.fields
        by_moduli = moduli_derivative(linearisation)
        m = len(fields.mu)
        alike = np.vstack([fields.mu[:, None] * self._modulus,
                           fields.kappa[:, None] * self._modulus])
        bulk = np.concatenate([np.zeros(m), p.bulk * fields.kappa])[:, None]
        rates = [by_moduli @ alike, by_moduli @ bulk, self._fibre_rates(linearisation)]
        motions = [np.zeros((3 * n, self._modulus.shape[1] + 1 + len(self.directions)))]
        if self._base:
            motions.append(p.base * self._base.motions(linearisation))
            rates.append(np.zeros((3 * n, 2)))
        slid = [s.changes(linearisation, self._embedding) for s in self._slides]
        rates.append(p.offset * _columns([s[0] for s in slid], 3 * n))
        pads = self._pad_motions(q)
        motions += [np.zeros((3 * n, len(slid))), pads, np.zeros(self._force.shape)]
        rates += [np.zeros(pads.shape), -self._growth(q) * self._force]
        shift = np.zeros((len(self._embedding.nodes), 3, self.count))
        start = self.count - self._force.shape[1] - pads.shape[1] - len(slid)
        for i, (_, moved) in enumerate(slid):
            shift[:, :, start + i] = p.offset * moved
        return np.hstack(motions), np.hstack(rates), shift

    def _growth(self, q):
        return np.abs(q).max(initial=0.0) / REFERENCE_PUSH

    def _fibre_rates(self, linearisation):
        stress = self._fibre_stress(linearisation.x, np.eye(len(self.directions)))
        return self.params.fibres * _columns(
            [stress_forces(linearisation, s) for s in stress], linearisation.x.size)

    def _fibre_stress(self, x, weights):
        """(len(weights), m, q, 3, 3) [Pa]: second Piola-Kirchhoff stress 2 k (I4 - 1) a (x) a."""
        geometry, a = self.body.geometry, self.directions
        F = np.einsum('mai,mqak->mqik', x[geometry.connectivity], geometry.gradients)
        stretch = np.einsum('mqik,dk->mqid', F, a)
        strain = (stretch**2).sum(axis=2) - 1.0
        # points that carry volume change only do not carry fibres as well
        scaled = 2.0 * self.body.mu[:, None, None] * strain * geometry.shear[:, None]
        return np.einsum('mqd,wd,di,dj->wmqij', scaled, weights, a, a, optimize=True)

    def _pad_motions(self, q):
        n, p = len(self.body.mesh.nodes), self.params
        motion = np.zeros((n, 3, len(self.body.pads), 3))
        for i, pad in enumerate(self.body.pads):
            across = placed(pad.centre, pad.direction)[:3, :2].T
            for j, axis in enumerate((p.travel * pad.direction, p.tilt * q[i] * across[0],
                                      p.tilt * q[i] * across[1])):
                motion[pad.nodes, :, i, j] = axis
        return motion.reshape(3 * n, -1)

    def applied(self, theta, q, x, base_traction=None):
        """Return the model with the unknowns at theta, for a solve that starts at x.

        theta : (k,);  q : (p,) [m];  x : (n, 3) [m] where what follows the deformation (fibres,
        slid pads) is taken
        Returns StepFields and the offsets (n, 3) [m] of held nodes.
        """
        modulus, bulk, fibres, _, _, pads, force = self._split(theta)
        fields = StepFields.of(self.body)
        stiffer = np.exp(np.clip(self._modulus @ modulus, -LARGEST_LOG, LARGEST_LOG))
        harder = np.exp(np.clip(self.params.bulk * bulk[0], -LARGEST_LOG, LARGEST_LOG))
        fields.mu *= stiffer
        fields.kappa *= stiffer * harder
        fields.stress += self._fibre_stress(x, self.params.fibres * fibres[None])[0]
        fields.nodal_force += (self._growth(q) * self._force @ force).reshape(-1, 3)
        return fields, (self._pad_motions(q) @ pads).reshape(-1, 3)


class _Base:
    """Motion of the base under the traction that it bears, per unit of compliance.

    The traction is a polynomial of second degree in position that has the moments of the
    reactions: consistent nodal forces of quadratic faces are no traction at the corners.
    """

    def __init__(self, body):
        area = base_areas(body.mesh, body.fixed)
        if not len(area.faces):
            raise MeshError('unknowns: the fixed nodes span no boundary face; the fixed region '
                            'must cover at least one')
        nodes = body.mesh.nodes
        share = np.linalg.norm(area.vectors, axis=1) / 3.0
        weight = np.bincount(area.faces.ravel(), np.repeat(share, 3), minlength=len(nodes))
        normal = np.zeros_like(nodes)
        outer = boundary_faces(body.mesh)
        outer = outer[np.isin(outer, body.fixed).all(axis=1)]
        for i in range(3):
            np.add.at(normal, area.faces[:, i], area.vectors)
            np.add.at(normal, outer[:, i], area.vectors)
        size = np.linalg.norm(normal, axis=1)
        self._on = np.flatnonzero(size > 0.0)
        self._normal = normal[self._on] / size[self._on, None]
        self._fixed, self._n = body.fixed, len(nodes)
        centre, span = nodes[self._on].mean(axis=0), np.ptp(nodes[self._on], axis=0).max()
        terms = _quadratic((nodes - centre) / span)
        gram = np.einsum('n,nj,nk->jk', weight, terms, terms)
        self._moments = np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ terms[body.fixed].T
        self._terms = terms[self._on]

    def motions(self, linearisation):
        """Return (3n, 2) [m per mm/kPa = m per 1e-6 m/Pa]: along the normal, along the base."""
        forces = linearisation.solver.assembler.forces(linearisation.x, linearisation.fields)
        give = -self._terms @ (self._moments @ forces[self._fixed])
        along = np.einsum('ni,ni->n', give, self._normal)[:, None] * self._normal
        motion = np.zeros((self._n, 3, 2))
        motion[self._on, :, 0], motion[self._on, :, 1] = along, give - along
        return motion.reshape(-1, 2)


def _quadratic(X):
    """Monomials (n, 10) up to second degree."""
    x, y, z = X.T
    return np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=1)


def _slides(body, embed_points):
    """Every _Slide that the surface has room for, and why it has not for the others."""
    slides, left_out = [], []
    for i in range(len(body.pads)):
        for axis in ('up', 'side'):
            try:
                slides.append(_Slide(body, i, axis, embed_points))
            except MeshError as error:
                left_out.append(str(error))
    return slides, tuple(left_out)


class _Slide:
    """One pad slid along the surface: another mesh, in which the points keep their material."""

    def __init__(self, body, i, axis, embed_points):
        self.pad, self.axis = i, axis
        slid = PadMisplacement(**{axis: STEP}, pads=(body.pads[i].name,)).prepare(body)
        self._shift = slid.mesh.nodes - body.mesh.nodes
        self._assembler = Assembler(slid)
        self._embedding = embed_points(slid.mesh)

    def changes(self, linearisation, embedding):
        """Return the change per metre of the forces (3n,) and of points (w, 3), nodes at rest
        keeping their displacement."""
        x, fields = linearisation.x, linearisation.fields
        there = x + self._shift
        rate = (self._assembler.forces(there, fields)
                - linearisation.solver.assembler.forces(x, fields)) / STEP
        moved = (interpolate(self._embedding, there) - interpolate(embedding, x)) / STEP
        return rate.ravel(), moved


def _columns(parts, rows):
    return np.stack([np.ravel(p) for p in parts], axis=1) if parts else np.zeros((rows, 0))


def hemisphere(count=15):
    """Return unit vectors (count, 3) spread over half a sphere, a Fibonacci lattice.

    Fifteen carry every fibre distribution at small strain: the symmetric fourth-order tensor of
    its moments has so many components.
    """
    i = np.arange(count)
    z = (i + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * i
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
