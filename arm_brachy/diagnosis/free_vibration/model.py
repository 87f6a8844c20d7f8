"""A body that is let go, by its model: equilibria and small vibrations about them, no time steps.

It is released near its stress-free shape and rings about x, where it rests after a moment, as

    M u'' + C u' + (K + K_v) u = 0,  K = dg/dx at x,  C = alpha M + beta K,

K_v what memory adds. Of a small oscillation at w a Maxwell branch (g, tau) carries the share
g / (1 - g1 - g2) i w tau / (1 + i w tau) of the stiffness that relaxes (Holzapfel 2000, Nonlinear
Solid Mechanics, sec. 6.10): its real part stiffens, its imaginary part damps. The recorded motion
is large where the mode is small: a beam of 100 mm that swings by 7 mm rings 0.2 % lower (test).
Source of the rest: Clough & Penzien 1993, Dynamics of Structures, ch. 12.
Test: diagnosis/test_free_model.py (against integration in time)
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.free_vibration.release import QUIET
from arm_brachy.diagnosis.model.specimen import Specimen, attach
from arm_brachy.diagnosis.model.trajectory import Trajectory, evolve
from arm_brachy.diagnosis.signals.stream import TISSUE
from arm_brachy.registry import TERMS
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import embed
from arm_brachy.tissue.modes import modes_of
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.resting import rest
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

MODES = 6           # lowest ones, of which the release excites the first of its direction
RINGS = 0.4         # s after the release: in the middle of what rings
STEPS = (0.02, 0.1)     # s, on the way there: what relaxes fast is resolved
FAINT = 1e-3        # by which relaxing moduli are scaled to find the stiffness that relaxes


@dataclass(frozen=True)
class Swing:
    """What a released body does at the k points of its specimen, markers then tools.

    moved : (w, k, 3) [m] from the stress-free shape at the times asked for; 0 off the tissue
    frequency [Hz], damping : ratio, shape : (k, 3), along the way it settles
    carried : ratio less if damping in proportion to mass is that of the tissue's own alone
    others : rms of all other modes, from a period after the release until it is quiet, over the
        size of what rings at the beginning of that
    x : (n, 3) [m] nodes at the last of the times
    """

    moved: np.ndarray
    frequency: float
    damping: float
    shape: np.ndarray
    x: np.ndarray
    carried: float = 0.0
    others: float = 0.0


def free_specimen(scene, mesh=None):
    """Return the specimen.Specimen of a core.scene.Scene without pads.

    mesh : TetMesh instead of the scene's. Raises ConfigError if it has pads or nothing that is
    seen on the tissue, MeshError as `build_body`.
    """
    if scene.pads:
        raise ConfigError(f'scene {scene.name} has {len(scene.pads)} pads; must have none for a '
                          'body that is held and let go')
    body = build_body(scene, mesh)
    rest = np.array([p.position for p in (*scene.markers, *scene.targets)]).reshape(-1, 3)
    carriers = tuple(m.body for m in scene.markers)
    if TISSUE not in carriers and not scene.targets:
        raise ConfigError(f'scene {scene.name} has no marker on the tissue and no target; must '
                          'have one at least')
    return Specimen(scene, body.mesh, body, np.zeros((0, 3)), tuple(m.name for m in scene.markers),
                    carriers, tuple(t.name for t in scene.targets), rest)


class FreeModel:
    """A specimen.Specimen without pads, with body terms, let go near its stress-free shape.

    terms : body terms, any order;  near : (n, 3) [m] nodes from which to look for equilibrium
    body : SoftBody as the terms prepared it. Raises what a term raises that does not fit.
    """

    def __init__(self, specimen, terms=(), near=None):
        self.specimen = specimen
        self.terms = tuple(sorted((t for t in terms if t.stage is Stage.BODY),
                                  key=lambda t: TERMS.index(type(t))))
        body = specimen.body
        for term in self.terms:
            body = term.prepare(body)
        self.body, self._near = body, near
        self._attached = attach(specimen, body)
        self.remembers = any(t.memory(body) is not None for t in self.terms)

    def swing(self, times):
        """Return the Swing of all points at `times` (w,) [s] after the release, increasing.

        Raises as `swings`.
        """
        return self.swings(times, (0.0,))[0]

    def swings(self, times, held, lasts=None):
        """Return a Swing for each shape that it is let go from; as `swing` for no bend.

        held : (n, 3) [m] of the specimen's nodes from the stress-free shape, each. It rings as it
        is let go, and settles as ever;  lasts : [s] for which that is looked at, each; None =
        until it is quiet. Raises NotConverged if there is no stable equilibrium.
        """
        lasts = (np.inf,) * len(held) if lasts is None else lasts
        path = self._path(times)
        zero, inside = np.zeros((0, 3)), self._attached.inside
        now = np.searchsorted(path.t, times)
        at = np.stack([self._attached.points(path.x[i], zero, path.base[i]) for i in now])
        moved = at - self._attached.points(self.body.mesh.nodes, zero, np.zeros(3))
        matrix = self._attached.matrix(len(self.body.mesh.nodes))
        moved = np.where(inside[:, None], moved, 0.0)
        return tuple(Swing(moved, frequency, damping, shape, path.x[-1], carried, others)
                     for frequency, (damping, carried), shape, others in self._vibrations(
                         path, matrix, moved[-1], zip(held, lasts, strict=True)))

    def displaced(self, x, shift):
        """How points on the tissue that are `shift` (3,) [m] from where they should be go.

        x : (n, 3) [m] nodes. Returns (k, 3) [m], their displacement from rest; 0 off the tissue.
        """
        inside = self._attached.inside
        rest = self.specimen.rest + np.where(inside[:, None], shift, 0.0)
        there = attach(replace(self.specimen, rest=rest), self.body)
        zero = np.zeros((0, 3))
        moved = there.points(x, zero, np.zeros(3)) - there.points(
            self.body.mesh.nodes, zero, np.zeros(3))
        return np.where(inside[:, None], moved, 0.0)

    def _path(self, times):
        """Trajectory from the release through the ringing to `times`."""
        if not self.remembers:
            x = self._equilibrium()
            every = np.union1d([RINGS], times)
            return self._trajectory(every, np.broadcast_to(x, (len(every), *x.shape)))
        simulator = TissueSimulator(self.specimen.body, self.terms)
        simulator.reset(0.0)
        every = np.unique(np.concatenate([STEPS, [RINGS, 2.0 * RINGS, 4.0 * RINGS], times]))
        states = [simulator.step(t, np.zeros((0, 3))) for t in every]
        for state in states:
            if not state.outcome.ok:
                raise NotConverged(f'no equilibrium {state.t:g} s after the release '
                                   f'({state.outcome.advice})')
        start = self.body.mesh.nodes
        return self._trajectory(np.concatenate([[0.0], every]),
                                np.stack([start, *(s.x for s in states)]),
                                np.stack([np.zeros(3), *(s.base for s in states)]))

    def _trajectory(self, t, x, base=None):
        base = np.zeros((len(t), 3)) if base is None else base
        pads = np.zeros((len(t), 0, 3))
        return Trajectory(t, pads, x, pads, base, (Outcome.OK,) * len(t))

    def _equilibrium(self):
        solver, near = StaticSolver(self.body), self._near
        if near is None or near.shape != self.body.mesh.nodes.shape:
            near = self.body.mesh.nodes
        fields, = evolve(self.body, self.terms, self._trajectory(
            np.array([RINGS]), self.body.mesh.nodes[None]))
        found = rest(solver, near, np.zeros((0, 3)), fields)
        if not found.outcome.ok:
            raise NotConverged(f'no equilibrium under its own weight ({found.outcome.advice})')
        return found.x

    def _vibrations(self, path, matrix, way, held):
        """(frequency, (damping, part by what is carried), shape, others) of what each excites."""
        now = int(np.searchsorted(path.t, RINGS))
        x, fields = path.x[now], self._fields(path, now)
        solver = StaticSolver(self.body)
        found = modes_of(solver, x, fields, MODES)
        dofs, modes, w = found.dofs, found.shapes, np.sqrt(found.square)
        seen = matrix[:, solver.free.free] @ modes.reshape(len(solver.free.free), -1)
        seen = seen.reshape(len(way), 3, -1)
        weigh = found.mass[dofs][:, dofs] @ modes
        alpha, beta = self.body.damping
        ratio = 0.5 * (alpha / w + beta * w)
        stiffer, lossy = self._memory(solver, x, dofs, modes, w)
        loads = 0.5 * alpha / w * self._carried(modes, dofs)
        w, ratios = np.sqrt(found.square + stiffer), np.stack([ratio + lossy, loads])
        for one, lasts in held:
            start = (self.body.mesh.nodes + self._own(one) - x).ravel()[dofs]
            yield _ringing(w, ratios, seen * (start @ weigh), way, lasts)

    def _own(self, held):
        """`held` (n, 3) at the nodes that terms made of the specimen's."""
        mesh, nodes = self.specimen.mesh, self.body.mesh.nodes
        if np.ndim(held) == 0 or len(held) == len(nodes):
            return held
        return embed(mesh, nodes).matrix(len(mesh.nodes)) @ held

    def _carried(self, modes, dofs):
        """Share of every mode's kinetic energy that is in what hangs on the body, (j,)."""
        mass = self.body.nodal_mass
        return np.zeros(modes.shape[1]) if mass is None else np.repeat(mass, 3)[dofs] @ modes ** 2

    def _fields(self, path, now):
        """StepFields of the slow motion at an instant; of what relaxes, the long-term moduli."""
        slow = tuple(t for t in self.terms if not isinstance(t, Viscoelasticity))
        return evolve(self.body, slow, path, [now])[0]

    def _memory(self, solver, x, dofs, modes, w):
        """What relaxing branches add to w^2 and to the damping ratio of every mode, (j,) each."""
        stiffer, lossy = np.zeros(len(w)), np.zeros(len(w))
        for term in self.terms:
            if not isinstance(term, Viscoelasticity):
                continue
            relaxing = self._relaxing(solver, x, dofs, modes)
            for g, tau in ((term.g1, term.tau1), (term.g2, term.tau2)):
                turn = 1j * w * tau
                share = g / (1.0 - term.g1 - term.g2) * turn / (1.0 + turn) * relaxing
                stiffer += share.real
                lossy += 0.5 * share.imag / w ** 2
        return stiffer, lossy

    def _relaxing(self, solver, x, dofs, modes):
        """Stiffness [1/s^2] of every mode but for what the bulk modulus gives, (j,)."""
        fields = StepFields.of(self.body)
        plain = solver.assembler.tangent(x, fields)
        fields.scale_all_but_bulk(1.0 + FAINT)
        more = (solver.assembler.tangent(x, fields) - plain).tocsc()[dofs][:, dofs]
        return np.einsum('ij,ij->j', modes, more @ modes) / FAINT


def _ringing(w, ratio, shapes, way, lasts=np.inf):
    """(frequency, ratios, shape, others): of the loudest mode and of what others pass for.

    ratio : (r, j), shapes : (k, 3, j) of j modes at w (j,) [1/s]
    lasts : [s] from a period after the release on; free_release goes no further than it is quiet
    """
    loud = np.sum(shapes ** 2, axis=(0, 1))
    top = int(np.argmax(loud))
    decay = np.maximum(w * ratio[0], 1e-6)
    lasts = min(lasts, -np.log(QUIET) / decay[top])
    passing = _passing(w, decay, top, lasts)
    weight = loud * np.abs(passing) ** 2
    others = _others(w, decay, loud, passing, top, lasts)
    weight /= weight.sum()
    shape = shapes @ passing.real
    shape = shape if np.sum(shape * way) >= 0.0 else -shape
    frequency = float(np.sqrt(weight @ w ** 2) / (2.0 * np.pi))
    return frequency, (ratio @ weight).tolist(), shape / np.linalg.norm(shape), others


def _passing(w, decay, top, lasts):
    """(j,) complex part of every mode that passes for the loudest where one mode is fitted.

    w, decay : (j,) [1/s];  lasts : [s]. What least squares make of exp((i w_j - d_j) t) by
    exp((i w - d) t) from t = 2 pi / w on, where free_release begins: the mean of the product over
    that of the square, turned by what the phases are apart by then. All of a mode of the same
    frequency, little of one that beats. Holds while others are fainter than the loudest.
    """
    begin, slower = 2.0 * np.pi / w[top], 1j * (w - w[top]) - (decay - decay[top])
    own = 2.0 * decay[top]
    shared = own - slower
    return (np.exp(slower * begin) * (1.0 - np.exp(-shared * lasts)) / shared
            * own / -np.expm1(-own * lasts))


def _others(w, decay, loud, passing, top, lasts):
    """As Swing.others: modes at w (j,) [1/s] that decay (j,) [1/s], their squares `loud` (j,).

    passing : (j,) as of `_passing`, which is no part of it. free_release reads the ringing in that
    stretch, in which those that are faster die away.
    """
    begin, fade = 2.0 * np.pi / w[top], 2.0 * decay
    mean = 0.5 * np.exp(-fade * begin) * -np.expm1(-fade * lasts) / (fade * lasts)
    left = loud * np.maximum(mean - mean[top] * np.abs(passing) ** 2, 0.0)
    size = np.exp(-fade[top] * begin) * (loud @ np.abs(passing) ** 2)
    return float(np.sqrt(left.sum() / size))
