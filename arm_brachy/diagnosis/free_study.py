"""Recordings of released bodies beside their models: residual, nuisances, answers to hypotheses.

Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ConfigError, MeshError, NotConverged
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.decide import Explanation, Problem
from arm_brachy.diagnosis.free_model import FreeModel, free_specimen
from arm_brachy.diagnosis.free_nuisances import columns_of
from arm_brachy.diagnosis.free_table import BASE, CREEP, SETTLED, predicted
from arm_brachy.tissue.assembly import InvertedElement
from arm_brachy.tissue.build import load_scene_mesh
from arm_brachy.tissue.mesh import load_mesh, quadratic_mesh
from arm_brachy.tissue.refinement import refine
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

FINE = 4000     # elements above which a mesh is not refined to learn its error
LIFT = 0.05     # logarithm of the modulus over which its effect is taken


@dataclass(frozen=True)
class Answer:
    """How all rows answer to a Free.

    columns : (n, p) per prior standard deviation
    fit : free_fit.FreeFit through which the columns lead, None = they are those of small effects
    """

    free: object
    columns: np.ndarray
    fit: object = None


class FreeStudy:
    """Cases and their models.

    cases : free_table.Case each;  specimens : name of scene -> Specimen
    terms : of the models, any stage;  priors : free_table.FreePriors
    placement : [m] of markers in the tissue, standard deviation per axis
    given : modulus that was expected, its logarithm in prior standard deviations from that of the
        specimens, which may be scaled to what the recordings ask for
    Raises NotConverged where a model has no equilibrium.
    """

    def __init__(self, cases, specimens, priors, placement, terms=(), given=0.0):
        self.cases, self.specimens, self.terms = tuple(cases), specimens, tuple(terms)
        self.priors, self._placement, self.given = priors, placement, given
        self.times = {name: np.unique(np.concatenate([
            c.release.times for c in self.cases if c.scene == name])) for name in specimens}
        self.values = np.concatenate([case.values for case in self.cases])
        self.sd = np.concatenate([case.sd for case in self.cases])
        self.rows = tuple(row for case in self.cases for row in case.rows)
        self.near, self._models, self._swings = {}, {}, {}
        for name in specimens:
            self._models[name], self._swings[name] = self._swing(name, self.terms)
            self.near[name] = self._swings[name].x
        self.start = self._vector(self._swings, self.terms)

    def vector(self, terms):
        """Return (n,) what models with `terms` besides the study's make of all rows."""
        every = (*self.terms, *terms)
        return self._vector({name: self._swing(name, every)[1] for name in self.specimens}, every)

    def residual(self, terms=()):
        """Return (n,) measured minus predicted over the errors."""
        there = self.vector(terms) if terms else self.start
        return (self.values - there) / self.sd

    def answer(self, free):
        """Return the Answer to a free_hypotheses.Free; None where it cannot act."""
        columns = []
        for k, sd in enumerate(free.prior):
            try:
                there = self.vector((free.hypothesis.alone(k, free.step),))
            except (NotConverged, MeshError, ConfigError, InvertedElement):
                return None
            columns.append((there - self.start) / free.step * sd / self.sd)
        columns = np.column_stack(columns)
        return Answer(free, columns) if np.abs(columns).max() > 1e-6 else None

    def answers(self, frees, progress=None):
        """Return the Answers to those of `frees` that can act, in their order.

        progress : called with the share done. Two branches that relax answer as each of them.
        """
        found, branches = [], {}
        for i, free in enumerate(frees):
            place = free.hypothesis.place
            if 'tau2' in place:
                one = self._both(free, branches.get(place['tau1']), branches.get(place['tau2']))
            else:
                one = self.answer(free)
            if one is not None:
                found.append(one)
                if 'tau1' in place:
                    branches[place['tau1']] = one
            if progress is not None:
                progress((i + 1) / len(frees))
        return tuple(found)

    @staticmethod
    def _both(free, one, other):
        if one is None or other is None:
            return None
        size = [answer.columns[:, :1] / (answer.free.prior[0] * s.typical)
                for answer, s in ((one, one.free.hypothesis.strengths[0]),
                                  (other, other.free.hypothesis.strengths[0]))]
        typical = [s.typical for s in free.hypothesis.strengths]
        return Answer(free, np.hstack([part * sd * unit for part, sd, unit in zip(
            size, free.prior, typical, strict=True)]))

    def modulus(self):
        """(n, 1) answer to the modulus, per prior standard deviation."""
        there = self.vector((StiffnessScale(factor=float(np.exp(LIFT))),))
        return ((there - self.start) / LIFT * self.priors.modulus / self.sd)[:, None]

    def nuisances(self, mesh=True):
        """(n, k) all that needs no cause but the modulus: frames, hands, bases, places, mesh."""
        blocks, first = [], 0
        for case in self.cases:
            own = columns_of(case, self._models[case.scene], self._swings[case.scene],
                             self.priors, self._placement)
            full = np.zeros((len(self.values), own.shape[1]))
            full[first:first + len(own)] = own
            blocks.append(full / self.sd[:, None])
            first += len(own)
        return np.hstack([*blocks, self._mesh()] if mesh else blocks)

    def problem(self, answers, mesh=True):
        """Return the decide.Problem with an Explanation for each Answer.

        mesh : False where its error, which takes a better mesh to know, does not matter
        The residual is that of the modulus expected, as far as the tangent says. Looked for is
        what is left in single rows, and in all rows together the way that any cause moves them.
        """
        U = np.hstack([self.nuisances(mesh), self.modulus()])
        r = self.residual() - U[:, -1] * self.given
        kinds = np.array([f'{row.scene} {kind_of(row)}' for row in self.rows])
        seen = np.array([row.kind != BASE for row in self.rows])
        tests = [np.eye(len(self.rows))[:, seen], *(a.columns for a in answers)]
        return Problem(r, U, kinds, np.hstack(tests),
                       tuple(Explanation(*a.free.key, a.columns) for a in answers),
                       np.full(len(self.rows), -1))

    def _mesh(self):
        """(n, s) what other meshes of each scene change; none where that costs too much."""
        out = []
        for name, specimen in self.specimens.items():
            other = _other_mesh(specimen.scene)
            if other is None:
                continue
            swings = dict(self._swings)
            swings[name] = FreeModel(free_specimen(specimen.scene, other), self.terms).swing(
                self.times[name])
            out.append((self._vector(swings, self.terms) - self.start) / self.sd)
        return np.column_stack(out) if out else np.zeros((len(self.values), 0))

    def _swing(self, name, terms):
        model = FreeModel(self.specimens[name], terms, self.near.get(name))
        return model, model.swing(self.times[name])

    def _vector(self, swings, terms):
        scale = 1.0 + sum(t.scale for t in terms if isinstance(t, OpticalScale))
        out = []
        for case in self.cases:
            swing = swings[case.scene]
            now = np.searchsorted(self.times[case.scene], case.release.times)
            part = predicted(case, _at(swing, now))
            lengths = np.array([kind_of(r) in (SETTLED, CREEP) for r in case.rows])
            out.append(np.where(lengths, scale * part, part))
        return np.concatenate(out)


def kind_of(row):
    """Kind of experiment that a free_table.Row belongs to, all creep being one."""
    if row.kind == BASE:
        return SETTLED
    return CREEP if row.kind.startswith(CREEP) else row.kind


def _at(swing, now):
    return type(swing)(swing.moved[now], swing.frequency, swing.damping, swing.shape, swing.x)


def _other_mesh(scene):
    """A TetMesh that resolves more: all elements bisected, or quadratic instead of linear."""
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    if load_scene_mesh(scene).midside is None:
        return quadratic_mesh(mesh) if len(mesh.tets) <= 4 * FINE else None
    if len(mesh.tets) > FINE:
        return None
    return quadratic_mesh(refine(mesh, np.ones(len(mesh.tets), dtype=bool))[0])
