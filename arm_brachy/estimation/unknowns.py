"""What a model of soft tissue may be wrong in: parameters with a Gaussian prior, and their pull.

A body driven by displacements does not feel its modulus, only how it varies; the unknowns are
therefore those that move something: a smooth field of the logarithm of the modulus, the bulk
modulus, fibres, a base that gives, pads that sit or push elsewhere or fall short at their rims, a
smooth field of body force for what has no name, and loads on the skin that follow no push. Each is
standardised: one unit is one standard deviation of its prior.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import quantity, whole
from arm_brachy.estimation.local_loads import AROUND, face_motion, local_loads, node_volumes
from arm_brachy.estimation.random_fields import field_modes
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.mesh import boundary_faces, interpolate
from arm_brachy.tissue.sensitivity import log_modulus_derivative
from arm_brachy.tissue.terms.base_compliance import base_areas
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement

STEP = 1e-3             # m, by which a pad is slid to see what that does
REFERENCE_PUSH = 20e-3  # m, at which the body force has its stated size; it grows with the push
LARGEST_LOG = 2.0       # of a modulus: a factor of 7 either way, as far as the model follows

_FITTED = 'fitted to plants outside the tables, arm-brachy reproduce fit-estimators'
_KEPT = 'fitted to plants outside the tables, README.md, section 4'


@dataclass(frozen=True)
class PriorParams:
    """Standard deviations of what the model may be wrong in, and how smooth the fields are."""

    modulus: float = quantity(0.12, '', 'sd of the logarithm of the local modulus', low=0.0,
                              source=_FITTED)
    modulus_length: float = quantity(15.0, 'mm', 'correlation length of that field', low=1.0,
                                     source='size of the lumps of term inclusion')
    modulus_modes: int = whole(40, 'of that field', low=1, high=1000)
    bulk: float = quantity(1.4, '', 'sd of the logarithm of the bulk modulus', low=0.0,
                           source=_FITTED)
    fibres: float = quantity(0.11, '', 'sd of fibre modulus over shear modulus, in each of '
                             'fifteen directions', low=0.0, source=_FITTED)
    base: float = quantity(0.56, 'mm_kPa', 'sd of the compliance of the base, normal and '
                           'tangential', low=0.0, source=_FITTED)
    offset: float = quantity(0.8, 'mm', 'sd of the place of a pad along the surface', low=0.0,
                             source=_FITTED)
    tilt: float = quantity(1.2, 'deg', 'sd of the direction of a push, about each axis', low=0.0,
                           source=_KEPT)
    travel: float = quantity(0.05, 'mm', 'sd of the zero of a pad travel', low=0.0,
                             source=_KEPT)
    force: float = quantity(250.0, 'N_m3', 'sd of the body force that stands for all else, at a '
                            'push of 20 mm', low=0.0, source=_KEPT)
    force_length: float = quantity(20.0, 'mm', 'correlation length of that force', low=1.0,
                                   source='as modulus_length')
    force_modes: int = whole(30, 'of that force', low=1, high=1000)
    faces: float = quantity(0.15, '', 'sd of the share of its travel by which a pad falls short '
                            'at its rim, in each of five terms around it', low=0.0,
                            source=_FITTED)
    give: float = quantity(0.2, '', 'sd of how much more or less the tissue gives under a known '
                           'load than the model, as a share', low=0.0, high=10.0,
                           source='plants under a probe, README.md, section 4')
    load: float = quantity(1.0, 'N', 'sd of an unknown load at each of load_places of the skin, '
                           'in x, y and z', low=0.0, source='an ultrasound probe presses with '
                           '3 N')
    load_places: int = whole(40, 'of the skin at which it may press', low=0, high=1000)


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
        self._volume = node_volumes(body)
        self._force = self._force_modes()
        self._load = params.load * local_loads(body, self._volume, params.load_places)
        slots = body.geometry.connectivity.ravel()
        self._sum = csr_array((np.ones(len(slots)), (slots, np.arange(len(slots)))),
                              shape=(len(body.mesh.nodes), len(slots)))
        self._sizes = {'modulus': self._modulus.shape[1], 'bulk': 1,
                       'fibres': len(self.directions), 'base': 2 if self._base else 0,
                       'slides': len(self._slides), 'pads': 3 * len(body.pads),
                       'force': self._force.shape[1], 'faces': AROUND * len(body.pads),
                       'give': 1, 'load': self._load.shape[1]}
        self.names = self._names()

    @property
    def count(self):
        """Number k of unknowns."""
        return len(self.names)

    def _force_modes(self):
        p, nodes = self.params, self.body.mesh.nodes
        modes = field_modes(nodes, p.force_length, p.force_modes)
        loads = p.force * modes * self._volume[:, None]
        return np.einsum('nk,ij->nikj', loads, np.eye(3)).reshape(nodes.size, -1)

    def _names(self):
        pads = [pad.name for pad in self.body.pads]
        base = ['base_normal', 'base_tangential'] if self._base else []
        return tuple([*(f'modulus_{i}' for i in range(self._modulus.shape[1])), 'bulk',
                      *(f'fibres_{i}' for i in range(len(self.directions))), *base,
                      *(f'{pads[s.pad]}_{s.axis}' for s in self._slides),
                      *(f'{pad}_{what}' for pad in pads
                        for what in ('travel', 'tilt_up', 'tilt_side')),
                      *(f'force_{i}' for i in range(self._force.shape[1])),
                      *(f'{pad}_face_{i}' for pad in pads for i in range(AROUND)),
                      'give', *(f'load_{i}' for i in range(self._load.shape[1]))])

    def derivatives(self, linearisation, q, known=None):
        """Return the Derivatives with respect to each unknown at an equilibrium.

        linearisation : jacobian.Linearisation;  q : (p,) [m] pad travel
        known : (n, 3) [N] of the known loads, None = there are none
        """
        p, fields, size = self.params, linearisation.fields, linearisation.x.size
        by_modulus = log_modulus_derivative(linearisation.solver.assembler, linearisation.x,
                                            fields)
        bulk = log_modulus_derivative(linearisation.solver.assembler, linearisation.x,
                                      replace(fields, mu=np.zeros_like(fields.mu)))
        here = (linearisation.solver.assembler.forces(linearisation.x, fields),
                interpolate(self._embedding, linearisation.x))
        slid = [s.changes(linearisation, *here) for s in self._slides]
        rates = {
            'modulus': by_modulus @ self._modulus, 'bulk': p.bulk * bulk.sum(axis=1)[:, None],
            'fibres': p.fibres * self._fibre_rates(linearisation.x),
            'slides': p.offset * _columns([s[0] for s in slid], size),
            'force': -self._growth(q) * self._force, 'load': -self._load}
        if known is not None:
            rates['give'] = -p.give * known.reshape(-1, 1)
        motions = {'pads': self._pad_motions(q), 'faces': self._face_motions(q)}
        if self._base:
            motions['base'] = p.base * self._base.motions(linearisation)
        shift = np.zeros((len(self._embedding.nodes), 3, self.count))
        shift[:, :, self.part('slides')] = p.offset * np.moveaxis(
            np.array([s[1] for s in slid]).reshape(-1, *shift.shape[:2]), 0, 2)
        return Derivatives(self._side_by_side(motions, size), self._side_by_side(rates, size),
                           shift)

    def _side_by_side(self, parts, rows):
        """(rows, k), zero where a kind of unknown has no part."""
        out = np.zeros((rows, self.count))
        for name, columns in parts.items():
            out[:, self.part(name)] = columns
        return out

    def part(self, name):
        """Return the slice of the unknowns of one kind, modulus, bulk, fibres, base,
        slides, pads, force, faces, give or load."""
        names = list(self._sizes)
        start = sum(self._sizes[n] for n in names[:names.index(name)])
        return slice(start, start + self._sizes[name])

    def _growth(self, q):
        return np.abs(q).max(initial=0.0) / REFERENCE_PUSH

    def _fibre_rates(self, x):
        """(3n, 15) [N] forces of fibres of modulus mu in each direction: w S F a (a . grad N)."""
        geometry = self.body.geometry
        along, strength = self._fibre_strain(x)
        slopes = np.einsum('mqak,dk->mqad', geometry.gradients, self.directions)
        pull = np.einsum('mq,mqd,mqid,mqad->maid', geometry.point_weights, strength, along,
                         slopes, optimize=True)
        total = self._sum @ pull.reshape(-1, 3 * len(self.directions))
        return total.reshape(x.size, -1)

    def _fibre_strain(self, x):
        """F a (m, q, 3, 15) and the stress 2 mu (I4 - 1) (m, q, 15) [Pa] along each direction.

        Points that carry volume change only do not carry fibres as well.
        """
        geometry = self.body.geometry
        along = np.einsum('mai,mqak,dk->mqid', x[geometry.connectivity], geometry.gradients,
                          self.directions, optimize=True)
        strength = 2.0 * ((along**2).sum(axis=2) - 1.0) * self.body.mu[:, None, None]
        return along, strength * geometry.shear[:, None]

    def _pad_motions(self, q):
        n, p = len(self.body.mesh.nodes), self.params
        motion = np.zeros((n, 3, len(self.body.pads), 3))
        for i, pad in enumerate(self.body.pads):
            across = placed(pad.centre, pad.direction)[:3, :2].T
            for j, axis in enumerate((p.travel * pad.direction, p.tilt * q[i] * across[0],
                                      p.tilt * q[i] * across[1])):
                motion[pad.nodes, :, i, j] = axis
        return motion.reshape(3 * n, -1)

    def _face_motions(self, q):
        nodes, pads = self.body.mesh.nodes, self.body.pads
        motion = np.zeros((len(nodes), 3, len(pads), AROUND))
        for i, pad in enumerate(pads):
            motion[pad.nodes, :, i] = self.params.faces * q[i] * face_motion(nodes, pad)
        return motion.reshape(nodes.size, -1)

    def applied(self, theta, q, x, last=None, known=None):
        """Return the model with the unknowns at theta, for a solve that starts at x.

        theta : (k,);  q : (p,) [m];  x : (n, 3) [m] where fibres have their stress from
        last : Derivatives from which base and slid pads have what they do; None leaves them out
        known : (n, 3) [N] of the known loads, None = there are none
        Returns StepFields, offsets (n, 3) [m] of held nodes and shifts (w, 3) [m] of the points.
        """
        fields = StepFields.of(self.body)
        modulus = self._modulus @ theta[self.part('modulus')]
        bulk = modulus + self.params.bulk * theta[self.part('bulk')]
        fields.mu *= np.exp(np.clip(modulus, -LARGEST_LOG, LARGEST_LOG))
        fields.kappa *= np.exp(np.clip(bulk, -LARGEST_LOG, LARGEST_LOG))
        fibres = self.params.fibres * theta[self.part('fibres')]
        fields.stress += np.einsum('mqd,d,di,dj->mqij', self._fibre_strain(x)[1], fibres,
                                   self.directions, self.directions, optimize=True)
        force = (self._growth(q) * self._force @ theta[self.part('force')]
                 + self._load @ theta[self.part('load')])
        offset = (self._pad_motions(q) @ theta[self.part('pads')]
                  + self._face_motions(q) @ theta[self.part('faces')])
        shift = np.zeros((len(self._embedding.nodes), 3))
        if last is not None:
            base, slides = self.part('base'), self.part('slides')
            offset += last.motion[:, base] @ theta[base]
            force -= last.rate[:, slides] @ theta[slides]
            shift = last.shift[:, :, slides] @ theta[slides]
        fields.nodal_force += force.reshape(-1, 3)
        if known is not None:
            fields.nodal_force += (1.0 + self.params.give * theta[self.part('give')]) * known
        return fields, offset.reshape(-1, 3), shift


@dataclass(frozen=True)
class Derivatives:
    """How equations and points change with k unknowns, at an equilibrium.

    motion : (3n, k) [m] of held nodes;  rate : (3n, k) [N] of the forces at fixed x
    shift : (w, 3, k) [m] of the points watched at fixed x
    """

    motion: np.ndarray
    rate: np.ndarray
    shift: np.ndarray


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

    def changes(self, linearisation, forces, points):
        """Return the change per metre of the forces (3n,) and of points (w, 3), nodes at rest
        keeping their displacement.

        forces (n, 3), points (w, 3) : of the pad where it is
        """
        there = linearisation.x + self._shift
        rate = (self._assembler.forces(there, linearisation.fields) - forces) / STEP
        moved = (interpolate(self._embedding, there) - points) / STEP
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
