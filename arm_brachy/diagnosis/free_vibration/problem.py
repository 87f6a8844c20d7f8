"""Recordings of released bodies beside their models: residual, nuisances, answers to hypotheses.

Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import ConfigError, MeshError, NotConverged
from arm_brachy.devices.terms.optical_scale import OpticalScale
from arm_brachy.diagnosis.free_vibration.initial_shape import hold_shapes
from arm_brachy.diagnosis.free_vibration.model import FreeModel, free_specimen
from arm_brachy.diagnosis.free_vibration.nuisances import STEP, columns_of, places_of
from arm_brachy.diagnosis.free_vibration.observation import BASE, CREEP, HELD, SETTLED, predicted
from arm_brachy.diagnosis.free_vibration.scenes import acting, along, hung
from arm_brachy.diagnosis.selection.judge import Explanation, Problem
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density, posterior
from arm_brachy.tissue.assembly import InvertedElement
from arm_brachy.tissue.build import load_scene_mesh
from arm_brachy.tissue.mesh import embed, load_mesh, quadratic_mesh
from arm_brachy.tissue.refinement import refine
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

FINE = 4000     # elements above which a mesh is not refined to learn its error
LOOSER = (1.0, 1.5, 2.0, 3.0, 4.5)  # times the error of places that where markers are seen tells
LIKELY = 2.0    # standard deviations
LIFT = 0.05     # logarithm of the modulus over which its effect is taken


@dataclass(frozen=True)
class Answer:
    """How all rows answer to a Free.

    columns : (n, p) per prior standard deviation
    fit : fit.FreeFit through which the columns lead, None = they are those of small effects
    """

    free: object
    columns: np.ndarray
    fit: object = None


@dataclass(frozen=True)
class Aside:
    """Loads that hang aside.

    shifts : name of scene -> (loads, 3) [m];  does : (n,) what that does to the rows
    """

    shifts: dict
    does: np.ndarray

    def times(self, share):
        """The Aside of a share of it."""
        return Aside({name: share * shift for name, shift in self.shifts.items()},
                     share * self.does)


def _joined(asides):
    """The Aside of all of them at once: several loads of a scene may hang on one hook."""
    shifts = {}
    for one in asides:
        for name, shift in one.shifts.items():
            shifts[name] = shifts.get(name, 0.0) + shift
    return Aside(shifts, sum(one.does for one in asides))


class FreeStudy:
    """Cases and their models.

    cases : observation.Case each;  specimens : name of scene -> Specimen
    terms : of the models, any stage;  priors : observation.FreePriors
    placement : [m] of markers in the tissue, standard deviation per axis
    scenes : core.scene.Scene of the body, also those of no case;  undamped : names of those
        whose damping is not known
    given : modulus that was expected, its logarithm in prior standard deviations from that of the
        specimens, which may be scaled to what the recordings ask for
    Raises NotConverged where a model has no equilibrium.
    """

    def __init__(self, cases, specimens, priors, placement, terms=(), given=0.0, scenes=(),
                 undamped=()):
        self.cases, self.specimens, self.terms = tuple(cases), specimens, tuple(terms)
        self.priors, self.placement, self.given = priors, placement, given
        self._scenes, self._undamped = tuple(scenes), undamped
        self.times = {name: np.unique(np.concatenate([
            c.release.times for c in self.cases if c.scene == name])) for name in specimens}
        self.values = np.concatenate([case.values for case in self.cases])
        self.sd = np.concatenate([case.sd for case in self.cases])
        self.rows = tuple(row for case in self.cases for row in case.rows)
        self.near, self._models, self._swings = {}, {}, {}
        for name in specimens:
            self._models[name] = self.model(specimens[name], self.terms)
            self._swings |= self._let_go(name, self._models[name])
            self.near[name] = next(self._swings[c.release.name].x for c in self._of(name))
        self.start = self._vector(self._swings, self.terms)
        self._aside = self._hangs()
        self._holds = {name: hold_shapes(one, priors.hold) for name, one in specimens.items()}

    def vector(self, terms):
        """Return (n,) what models with `terms` besides the study's make of all rows."""
        every = (*self.terms, *terms)
        swings = {}
        for name, specimen in self.specimens.items():
            swings |= self._let_go(name, self.model(specimen, every, self.near[name]))
        return self._vector(swings, every)

    def residual(self, terms=()):
        """Return (n,) measured minus predicted over the errors."""
        there = self.vector(terms) if terms else self.start
        return (self.values - there) / self.sd

    def answer(self, free):
        """Return the Answer to a candidates.Free; None where it cannot act."""
        columns = []
        for k, sd in enumerate(free.prior):
            try:
                there = self.vector((free.alone(k, free.step),))
            except (NotConverged, MeshError, ConfigError, InvertedElement):
                return None
            columns.append((there - self.start) / free.step * sd / self.sd)
        columns = np.column_stack(columns)
        return Answer(free, columns) if np.abs(columns).max() > 1e-6 else None

    def answers(self, frees, progress=None):
        """Return the Answers to those of `frees` that can act, in their order.

        progress : called with frees done, of all, and the name of the next, or None. Two
            branches that relax answer as each of them.
        """
        found, branches = [], {}
        for i, free in enumerate(frees):
            if progress is not None:
                progress(i, len(frees), free.hypothesis.name)
            place = free.hypothesis.place
            if 'tau2' in place:
                one = self._both(free, branches.get(place['tau1']), branches.get(place['tau2']))
            else:
                one = self.answer(free)
            if one is not None:
                found.append(one)
                if 'tau1' in place:
                    branches[place['tau1']] = one
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
        """(n, k) all that needs no cause but the modulus: frames, hands, bases, places, mesh, and
        where loads hang, which comes last.

        A marker is at one place in all recordings of a scene; for another it may have been glued
        anew.
        """
        blocks, places, first = [], {}, 0
        for case in self.cases:
            swing, specimen = self._swings[case.release.name], self.specimens[case.scene]
            rows = slice(first, first + len(case.rows))
            own = columns_of(case, specimen, swing, self.priors, self._held_more(case),
                             case.scene in self._undamped)
            blocks.append(self._within(rows, own))
            for name, part in places_of(case, self._models[case.scene], swing,
                                        self.placement).items():
                key = case.scene, name
                places[key] = places.get(key, 0.0) + self._within(rows, part)
            first = rows.stop
        every = [*blocks, *places.values(), *([self._mesh()] if mesh else [])]
        return np.hstack([*every, *(one.does[:, None] / self.sd[:, None]
                                    for one in self._aside)])

    def _within(self, rows, columns):
        """(n, j) over the errors: columns of some rows alone."""
        full = np.zeros((len(self.values), columns.shape[1]))
        full[rows] = columns
        return full / self.sd[:, None]

    def place_markers(self):
        """Take markers to be as far off their places as is likeliest for all rows, no cause tried.

        How a marker goes and rings tells as well as where it is seen. A cause can hardly be taken
        for places: what moves a marker by a millimetre would have to be off by ten.
        """
        likely = []
        usual = self.placement
        for self.placement in usual * np.array(LOOSER):
            problem = self.problem((), mesh=False)
            likely.append(log_density(problem.U, problem.r))
        self.placement = usual * LOOSER[int(np.argmax(likely))]

    def problem(self, answers, mesh=True):
        """Return the judge.Problem with an Explanation for each Answer.

        mesh : False where its error, which takes a better mesh to know, does not matter
        The residual is that of the modulus expected, as far as the tangent says. Looked for is
        what is left in single rows, and in all rows together the way that any cause moves them.
        """
        U = np.hstack([self.nuisances(mesh), self.modulus()])
        r = self.residual() - U[:, -1] * self.given
        kinds = np.array([f'{row.scene} {kind_of(row)}' for row in self.rows])
        seen = np.array([row.kind not in (BASE, HELD) for row in self.rows])
        tests = [np.eye(len(self.rows))[:, seen], *(a.columns for a in answers)]
        return Problem(r, U, kinds, np.hstack(tests),
                       tuple(Explanation(*a.free.key, a.columns) for a in answers),
                       np.full(len(self.rows), -1))

    def _held_more(self, case):
        """(Hold, Swing) each: how it rings when a hand bends it by STEP of that Hold more."""
        holds = self._holds[case.scene]
        return tuple(zip(holds, self._models[case.scene].swings(self.times[case.scene], [
            case.hand.bent.nodes + STEP * hold.nodes for hold in holds],
            [_rings(case)] * len(holds)), strict=True))

    def _hangs(self):
        """Asides: how far from where the scene has it a load hangs, along every axis.

        Loads of one place in several scenes hang on one hook, wherever that is, and each a little
        aside from it. All to the side where that does more.
        """
        out = []
        for hook in self._hooks():
            for axis in np.eye(3):
                ways = [[self._aside_by(name, i, side * self.priors.hang * axis)
                         for name, i in hook] for side in (1.0, -1.0)]
                one = max(ways, key=lambda way: np.linalg.norm(sum(each.does for each in way)))
                out.append(_joined(one))
                own = one if len(hook) > 1 else ()
                out += [each.times(self.priors.rehang / self.priors.hang) for each in own]
        return tuple(out)

    def _hooks(self):
        """[(name of a scene, number of its load)] of every place where loads hang."""
        hooks = {}
        for name, specimen in self.specimens.items():
            for i, load in enumerate(specimen.scene.loads):
                hooks.setdefault(tuple(load.position), []).append((name, i))
        return tuple(hooks.values())

    def _aside_by(self, name, i, way):
        """Aside of the i-th load of a scene, `way` (3,) [m] from where that has it."""
        scene = self.specimens[name].scene
        shift = np.zeros((len(scene.loads), 3))
        shift[i] = way
        return Aside({name: shift}, self._hung(name, hung(scene, shift)) - self.start)

    def as_hung(self, specimen, problem, fit):
        """(Specimen, terms) of a fit.FreeFit to the problem, loads where it has them hang.

        No farther than is likely: what a response says of more leads beside the body.
        """
        name, terms = specimen.scene.name, fit.terms
        U = problem.U[:, :-1]
        share = posterior(U, fit.residual).mean[U.shape[1] - len(self._aside):]
        shift = sum((z * one.shifts[name] for z, one in zip(
            np.clip(share, -LIKELY, LIKELY), self._aside, strict=True) if name in one.shifts),
            np.zeros((len(specimen.scene.loads), 3)))
        if not np.any(shift):
            return specimen, terms
        moved = hung(specimen.scene, shift)
        return free_specimen(moved), along(acting(terms, name, self._scenes), specimen.scene,
                                           moved)

    def only_in(self, term):
        """Names of the scenes in which alone a term acts; () = in all."""
        names = [one.name for one in self._scenes]
        mine = tuple(name for name in names if acting((term,), name, self._scenes))
        return mine if len(mine) < len(names) else ()

    def _hung(self, name, scene):
        """(n,) as `vector`, the loads of one scene where a Scene has them."""
        model = self.model(free_specimen(scene), self.terms, self.near[name])
        return self._vector({**self._swings, **self._let_go(name, model)}, self.terms)

    def _mesh(self):
        """(n, s) what other meshes of each scene change; none where that costs too much."""
        out = []
        for name, specimen in self.specimens.items():
            other = _other_mesh(specimen.scene)
            if other is None:
                continue
            model = self.model(free_specimen(specimen.scene, other), self.terms)
            over = embed(specimen.mesh, model.body.mesh.nodes).matrix(len(specimen.mesh.nodes))
            swings = {**self._swings, **self._let_go(name, model, lambda held, A=over: A @ held)}
            out.append((self._vector(swings, self.terms) - self.start) / self.sd)
        return np.column_stack(out) if out else np.zeros((len(self.values), 0))

    def _of(self, name):
        return [case for case in self.cases if case.scene == name]

    def _let_go(self, name, model, taken=np.asarray):
        """Recording -> Swing of those of a scene, by a FreeModel that has `taken` their hold."""
        cases = self._of(name)
        held = [taken(case.hand.bent.nodes) for case in cases]
        return dict(zip([case.release.name for case in cases], model.swings(
            self.times[name], held, [_rings(case) for case in cases]), strict=True))

    def model(self, specimen, terms, near=None):
        """The FreeModel of a Specimen with those of `terms` that act in its scene."""
        return FreeModel(specimen, acting(terms, specimen.scene.name, self._scenes), near)

    def _vector(self, swings, terms):
        scale = 1.0 + sum(t.scale for t in terms if isinstance(t, OpticalScale))
        out = []
        for case in self.cases:
            swing = swings[case.release.name]
            now = np.searchsorted(self.times[case.scene], case.release.times)
            part = predicted(case, _at(swing, now))
            lengths = np.array([kind_of(r) in (SETTLED, CREEP) for r in case.rows])
            out.append(np.where(lengths, scale * part, part))
        return np.concatenate(out)


def kind_of(row):
    """Kind of experiment that a observation.Row belongs to, all creep being one."""
    if row.kind in (BASE, HELD):
        return SETTLED
    return CREEP if row.kind.startswith(CREEP) else row.kind


def _rings(case):
    """[s] for which a Case is read as ringing; without end if it does not ring."""
    ring = case.release.ring
    return np.inf if ring is None else ring.span[1] - ring.span[0]


def _at(swing, now):
    return replace(swing, moved=swing.moved[now])


def _other_mesh(scene):
    """A TetMesh that resolves more: all elements bisected, or quadratic instead of linear."""
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    if load_scene_mesh(scene).midside is None:
        return quadratic_mesh(mesh) if len(mesh.tets) <= 4 * FINE else None
    if len(mesh.tets) > FINE:
        return None
    return quadratic_mesh(refine(mesh, np.ones(len(mesh.tets), dtype=bool))[0])
