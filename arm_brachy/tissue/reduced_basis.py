"""What a reduced model consists of and where it may be used; the pushes it is made from."""

import hashlib
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.resting import rest

ROUNDING = 1e-9  # m, by which a displacement may miss the domain


def body_hash(body):
    """Return the SHA-256 (hexadecimal) of everything in a SoftBody that its statics depend on."""
    n = len(body.mesh.nodes)
    none = np.zeros(0)
    parts = [body.mesh.nodes, body.geometry.connectivity, body.geometry.weights, body.mu,
             body.kappa, body.beyond, body.density, np.sort(body.fixed), body.springs.nodes,
             body.springs.stiffness, *vars(body.supports).values(), body.gravity,
             np.array([n, len(body.pads)]),
             none if body.nodal_force is None else body.nodal_force,
             none if body.nodal_mass is None else body.nodal_mass]
    for pad in body.pads:
        parts += [pad.nodes, pad.direction]
    digest = hashlib.sha256()
    for part in parts:
        array = np.asarray(part)
        array = array.astype(np.int64 if array.dtype.kind in 'iu' else np.float64)
        digest.update(repr(array.shape).encode() + array.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class PushDomain:
    """Where pads may go: a convex set of displacements, of which the model knows the answers.

    axes : (p, 3, 3) rows for each pad: its direction into the tissue and two tangents
    reach : (p,) [m] largest push along the direction
    together : largest sum of push / reach over the pads; 2 admits any two at full reach
    play : [m] allowed along the tangents, and outwards
    """

    axes: np.ndarray
    reach: np.ndarray
    together: float
    play: float

    @classmethod
    def of(cls, body, reach, *, together=2.0, play=0.0):
        """Return the PushDomain of a SoftBody's pads.

        reach : [m] of every pad, or (p,);  together, play : as of the class
        """
        axes = np.zeros((len(body.pads), 3, 3))
        for i, pad in enumerate(body.pads):
            least = np.eye(3)[np.abs(pad.direction).argmin()]
            across = np.cross(pad.direction, least)
            across /= np.linalg.norm(across)
            axes[i] = pad.direction, across, np.cross(pad.direction, across)
        reach = np.broadcast_to(np.asarray(reach, dtype=float), (len(body.pads),)).copy()
        if not (reach > 0.0).all() or together <= 0.0 or play < 0.0:
            raise InputError(f'push domain with reach {reach} m, together {together}, play {play} '
                             'm; reach and together must be positive, play not negative')
        return cls(axes, reach, float(together), float(play))

    def complaint(self, displacement):
        """Return what is wrong with pad displacements (p, 3) [m], '' if they lie inside."""
        local = np.einsum('pij,pj->pi', self.axes, displacement)
        push, across = local[:, 0], np.abs(local[:, 1:])
        for i in np.flatnonzero((push > self.reach + ROUNDING) | (push < -self.play - ROUNDING)):
            return (f'pad {i} pushed {1e3 * push[i]:.3f} mm; the model knows '
                    f'{-1e3 * self.play:g} to {1e3 * self.reach[i]:g} mm; push less or train it '
                    'further')
        if across.size and across.max() > self.play + ROUNDING:
            return (f'pad {across.max(axis=1).argmax()} displaced {1e3 * across.max():.3f} mm '
                    f'across its direction; the model knows {1e3 * self.play:g} mm; train it with '
                    'more play')
        total = np.sum(np.maximum(push, 0.0) / self.reach)
        if total > self.together + ROUNDING / self.reach.min():
            return (f'pads pushed {total:.3f} reaches together; the model knows '
                    f'{self.together:g}; push fewer or train it further')
        return ''


@dataclass(frozen=True)
class ReducedModel:
    """All that the online stage needs, and what ties it to its body.

    body_hash : of the SoftBody it was made from;  domain : PushDomain it was trained in
    reference : (n, 3) [m] equilibrium with the pads at rest
    basis : (n, 3, w) displacement per coordinate, w = 3p + r: 3p pad translations [m/m], then r
        modes [m/sqrt(J)], orthonormal in the tangent at the reference
    points : (s, 2) element and quadrature point of each sample
    weights : (s,) [m^3];  mu, kappa : (s,) [Pa];  stress : (s, 3, 3) [Pa]
    F0 : (s, 9) deformation gradient at the reference;  B : (9s, w) its change, row by row
    linear : (w,) [N, sqrt(J)] added to the gradient;  quadratic : (w, w) added to the tangent
    truncation : [m] largest error of a node when the training states are projected on the basis
    misfit : what the samples leave of the reduced forces, relative; 0 when nothing is left out
    """

    body_hash: str
    domain: PushDomain
    reference: np.ndarray
    basis: np.ndarray
    points: np.ndarray
    weights: np.ndarray
    mu: np.ndarray
    kappa: np.ndarray
    stress: np.ndarray
    F0: np.ndarray
    B: np.ndarray
    linear: np.ndarray
    quadratic: np.ndarray
    truncation: float
    misfit: float

    @property
    def n_pads(self):
        """Number p of pads."""
        return len(self.domain.reach)

    @property
    def n_modes(self):
        """Number r of modes."""
        return self.basis.shape[2] - 3 * self.n_pads

    def save(self, path):
        """Write the model to `path` (.npz)."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name != 'domain'}
        arrays |= {f'domain_{f.name}': getattr(self.domain, f.name) for f in fields(PushDomain)}
        np.savez_compressed(path, **arrays)

    @classmethod
    def load(cls, path, body):
        """Read the model of `body` (SoftBody) from `path`.

        Raises InputError if the file is no model, or that of another body.
        """
        names = [f.name for f in fields(cls) if f.name != 'domain']
        parts = [f.name for f in fields(PushDomain)]
        try:
            with np.load(Path(path)) as file:
                read = {name: file[name][()] for name in names}
                domain = PushDomain(*(file[f'domain_{name}'][()] for name in parts))
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise InputError(f'{path}: cannot be read as a reduced model: {error}; train it '
                             'again') from None
        model = cls(**{**read, 'body_hash': str(read['body_hash'])}, domain=domain)
        model.require(body)
        return model

    def require(self, body):
        """Raise InputError unless this is the model of `body` (SoftBody)."""
        found = body_hash(body)
        if found != self.body_hash:
            raise InputError(f'reduced model of body {self.body_hash[:12]}, asked to serve body '
                             f'{found[:12]}; mesh, material, supports, pads and loads must be the '
                             'same; train a model for this body')

    def watch(self, embedding=None):
        """Return the Watch of a mesh.Embedding's points; None = of every node."""
        if embedding is None:
            return Watch(self.reference, self.basis)
        weights, nodes = embedding.weights, embedding.nodes
        return Watch(np.einsum('ka,kai->ki', weights, self.reference[nodes]),
                     np.einsum('ka,kaiw->kiw', weights, self.basis[nodes]))


@dataclass(frozen=True)
class Watch:
    """Points whose motion is asked for: reference (k, 3) [m], basis (k, 3, w)."""

    reference: np.ndarray
    basis: np.ndarray

    def positions(self, solution):
        """Return (k, 3) [m] in a ReducedSolution; raises NotConverged if it is not OK."""
        if not solution.outcome.ok:
            raise NotConverged(f'no positions without equilibrium: {solution.message}')
        y = np.concatenate([solution.pad_displacement.ravel(), solution.q])
        return self.reference + self.basis @ y


@dataclass(frozen=True)
class Snapshots:
    """Pushes solved in full.

    domain : PushDomain they lie in;  pad_displacement : (k, p, 3) [m]
    x : (k, n, 3) [m];  pad_force : (k, p, 3) [N] of the tissue ON each pad
    reference : (n, 3) [m] the solution with the pads at rest
    """

    domain: PushDomain
    pad_displacement: np.ndarray
    x: np.ndarray
    pad_force: np.ndarray
    reference: np.ndarray


def sample_pushes(domain, count, rng):
    """Return `count` pad displacements (count, p, 3) [m] spread over a PushDomain.

    rng : numpy.random.Generator
    First the corners of the domain with whole pads (each at rest or at full reach), then
    scrambled Sobol points. Tasks use one or two pads: a quarter of the points keeps only the
    largest push, a quarter as many as may be at full reach together. A coordinate of the sequence
    chooses which, since every other point of it would fill but half the domain.
    """
    p, most = len(domain.reach), max(1, int(domain.together))
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * p, indexing='ij'), axis=-1).reshape(-1, p)
    corners = corners[(corners.sum(axis=1) > 0) & (corners.sum(axis=1) <= domain.together)]
    sobol = qmc.Sobol(3 * p + 1, rng=rng)
    found, need = [], max(0, count - len(corners))
    power = max(1, int(np.ceil(np.log2(4 * max(1, need)))))
    while sum(map(len, found)) < need:
        power += len(found) > 1  # twice the same, then doubling: powers of two in all
        u = sobol.random_base2(power)
        found.append(u[u[:, :p].sum(axis=1) <= domain.together])
    unit = np.concatenate([np.hstack([corners, np.full((len(corners), 2 * p), 0.5),
                                      np.ones((len(corners), 1))]), *found])[:count]
    for u in unit:
        keep = 1 if u[-1] < 0.25 else most if u[-1] < 0.5 else p
        u[np.argsort(-u[:p], kind='stable')[keep:]] = 0.0
    local = np.empty((len(unit), p, 3))
    local[:, :, 0] = unit[:, :p] * domain.reach
    local[:, :, 1:] = (2.0 * unit[:, p:-1].reshape(-1, p, 2) - 1.0) * domain.play
    return np.einsum('kpi,pij->kpj', local, domain.axes)


def snapshots(body, domain, count, rng):
    """Return Snapshots of a SoftBody at `count` pushes of `sample_pushes`.

    domain, rng : as there. Each solve starts from the solved push nearest to it.
    Raises NotConverged, naming the push, where the full solver finds no equilibrium.
    """
    return solve_pushes(body, domain, sample_pushes(domain, count, rng))


def solve_pushes(body, domain, pushes):
    """Return the Snapshots of a SoftBody at given pushes (k, p, 3) [m]; see `snapshots`."""
    solver = StaticSolver(body)
    start = rest(solver, body.mesh.nodes, np.zeros((len(body.pads), 3)))
    if not start.outcome.ok:
        raise NotConverged(f'no state at rest: {start.outcome.advice}')
    known, states = [np.zeros(pushes[0].size)], [start.x]
    x, force = np.empty((len(pushes), *start.x.shape)), np.empty(pushes.shape)
    waiting = np.arange(len(pushes))
    gap = np.linalg.norm(pushes.reshape(len(pushes), -1), axis=1)
    near = np.zeros(len(pushes), dtype=int)
    while len(waiting):
        k = waiting[gap[waiting].argmin()]
        found = _solved(solver, states[near[k]], pushes[k])
        x[k], force[k] = found.x, found.pad_force
        known.append(pushes[k].ravel())
        states.append(found.x)
        away = np.linalg.norm(pushes.reshape(len(pushes), -1) - known[-1], axis=1)
        near[away < gap] = len(states) - 1
        gap = np.minimum(gap, away)
        waiting = waiting[waiting != k]
    return Snapshots(domain, pushes, x, force, start.x)


def _solved(solver, x0, push):
    found = solver.solve(x0, push)
    if not found.outcome.ok:
        raise NotConverged(f'training push {(1e3 * push).round(2).tolist()} mm has no solution: '
                           f'{found.outcome.advice}; reduce the reach of the domain')
    return found
