"""Made-up recordings of a body, and what the judge says of them with a few causes to choose from.

The steps are those of `diagnose`, without errors of a mesh: truth and model share it. Linear
elements on a coarse mesh where they do: what is compared is alike in both.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from arm_brachy.cell import pad_directions
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.likelihood.match import Matched
from arm_brachy.diagnosis.likelihood.nuisances import Priors, nuisances
from arm_brachy.diagnosis.likelihood.observation import Observables, channels_of, measured
from arm_brachy.diagnosis.likelihood.tolerances import joined, tolerances
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.selection.judge import Decision, Explanation, Judge
from arm_brachy.diagnosis.selection.problem import assemble
from arm_brachy.diagnosis.selection.screening import Tried
from arm_brachy.diagnosis.signals.loading import Evidence
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE, Stream
from arm_brachy.registry import by_name, parse_terms

SCENES = config_dir() / 'scenes'
PERIOD = 0.05       # s
NOISE = {OPTICAL: 1e-4, EM: 2e-4, FORCE: 0.02, ENCODER: 1e-6}
STATES = 24         # per recording: enough for a few pushes, and cheaper than the default


@dataclass(frozen=True)
class Judged:
    """decision : judge.Decision;  modulus : what `conclusions.recalibrated` says of it"""

    decision: Decision
    modulus: dict

    @property
    def verdict(self):
        return self.decision.verdict

    @property
    def names(self):
        """Causes that were accepted or equal what was, as a set."""
        one = self.decision.accepted
        return set() if one is None else {*one.causes, *(c.causes[0] for c in
                                                         self.decision.equals)}


class Lab:
    """A bench with one body on it. specimen : specimen.Specimen"""

    def __init__(self, specimen):
        self.specimen = specimen

    def run(self, path, t, *entries):
        """Predicted at t (n,) with terms, one scenario entry each."""
        found = ForwardModel(self.specimen, parse_terms(entries, 'lab')).predict(
            path, np.atleast_1d(np.asarray(t, dtype=float)), nodes=True)
        assert found.valid.all()
        return found

    def record(self, path, *entries, kinds=(OPTICAL, FORCE), markers=(TISSUE,), seed=1):
        """Evidence under white noise. kinds : besides the encoders; markers : on which bodies."""
        rng, found = np.random.default_rng(seed), self.run(path, path.t, *entries)
        streams = {}
        for kind in (*kinds, ENCODER):
            names, bodies, rest = self._channels(kind)
            values = path.q[..., None] if kind == ENCODER else found.get(kind)
            values = values + NOISE[kind] * rng.standard_normal(values.shape)
            kept = [i for i, body in enumerate(bodies) if kind != OPTICAL or body in markers]
            streams[kind] = Stream(kind, path.t, tuple(names[i] for i in kept), values[:, kept],
                                   np.ones((len(path.t), len(kept)), dtype=bool),
                                   tuple(bodies[i] for i in kept), rest[kept])
        scene = self.specimen.scene
        return Evidence('made up', scene, pad_directions(scene), streams)

    def beside(self, evidence, *, known=(), calibration=None, still=False):
        """Matched of an Evidence and the model of the body.

        known : entries of terms that the model has too;  still : only states in which no pad moves
        """
        one = look(evidence, limit=STATES)
        baseline = Baseline(ForwardModel(self.specimen, parse_terms(known, 'lab')), one.path,
                            one.states.t)
        streams = measured(one.states)
        if still:
            stands = (one.states.labels.direction == 0)[:, None]
            streams = [replace(stream, valid=stream.valid & stands) for stream in streams]
        return Matched(one, baseline, Observables(streams, channels_of(self.specimen)), joined(
            nuisances(baseline, calibration),
            tolerances(baseline, calibration, one.structure.rhythm)))

    def watch(self, path, *entries, known=(), calibration=None, still=False, **seen):
        """Matched of a recording with terms; `seen` as in `record`, the rest as in `beside`."""
        return self.beside(self.record(path, *entries, **seen), known=known,
                           calibration=calibration, still=still)

    def changed(self, matched, *entries, share=None):
        """Kind -> (n, c, 3, 1): what this body with terms shows more than the model of a Matched.

        share : (n,) of it that counts in every state, None = all
        """
        one = matched.recorded
        found = ForwardModel(self.specimen, parse_terms(entries, 'lab')).predict(one.path,
                                                                                 one.states.t)
        share = np.ones(len(one.states.t)) if share is None else share
        return {kind: (share[:, None, None] * (found.get(kind) - shown))[..., None]
                for kind, shown in matched.baseline.shown.items()}

    def _channels(self, kind):
        """(names, bodies, rest) of a stream of the scene."""
        one, k = self.specimen, len(self.specimen.markers)
        if kind == OPTICAL:
            return one.markers, one.carriers, one.rest[:k]
        if kind == EM:
            return one.tools, (TISSUE,) * len(one.tools), one.rest[k:]
        return one.pads, one.pads, np.zeros((len(one.pads), 3 if kind == FORCE else 1))


@pytest.fixture(scope='session')
def pushes():
    """Function from legs (pads (4,), depth [m], speed [m/s]), from rest and back, to a Path."""
    def path(*legs, stand=1.5, idle=3.0):
        corners, t = [(0.0, np.zeros(4))], idle
        for pads, depth, speed in legs:
            goal, way = depth * np.array(pads, dtype=float), depth / speed
            corners += [(t, np.zeros(4)), (t + way, goal), (t + way + stand, goal),
                        (t + 2.0 * way + stand, np.zeros(4))]
            t += 2.0 * (way + stand)
        clock, (when, where) = np.arange(0.0, t + 0.5 * PERIOD, PERIOD), zip(*corners, strict=True)
        return Path(clock, np.stack([np.interp(clock, when, column)
                                     for column in np.array(where).T], axis=1))
    return path


@pytest.fixture(scope='session')
def once(pushes):
    """Path of one pad, pushed once to 6 mm; it stands there from 3.6 to 5.1 s."""
    return pushes(((1, 0, 0, 0), 6e-3, 10e-3))


@pytest.fixture(scope='session')
def rich(pushes):
    """Path of one pad, another, the first again at a fifth of the speed, an opposed pair."""
    return pushes(((1, 0, 0, 0), 6e-3, 20e-3), ((0, 1, 0, 0), 6e-3, 20e-3),
                  ((1, 0, 0, 0), 6e-3, 4e-3), ((1, 0, 1, 0), 6e-3, 20e-3))


@pytest.fixture(scope='session')
def scene():
    coarse = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast' / 'breast_600.msh')
    return replace(coarse, element='linear')


@pytest.fixture(scope='session')
def lab():
    """Function from a Scene to the Lab with its body."""
    return lambda scene: Lab(specimen_of(scene))


@pytest.fixture(scope='session')
def breast(scene, lab):
    return lab(scene)


@pytest.fixture(scope='session')
def cause():
    """Function from a term's name, free parameters and place to the Hypothesis."""
    return lambda name, names=None, **place: hypothesis(by_name(name), names, **place)


@pytest.fixture(scope='session')
def others(cause):
    """Two innocent causes, which any recording may be blamed on."""
    return [cause('strain_stiffening'), cause('compressibility')]


@pytest.fixture(scope='session')
def judge():
    """Function from Matched recordings and Hypotheses to choose from to the Judged.

    strangers : (name, kind -> (n, c, 3, 1) for each recording) of causes without a term
    """
    def decide(matched, hypotheses, strangers=()):
        responses = tuple(tuple(respond(m.baseline, one) for m in matched) for one in hypotheses)
        assembly = assemble(matched, Tried(tuple(hypotheses), responses))
        extra = tuple(Explanation(name, '', np.vstack([
            m.observables.whiten(part) for m, part in zip(matched, parts, strict=True)]))
            for name, parts in strangers)
        problem = replace(assembly.problem, explanations=assembly.problem.explanations + extra)
        decision = Judge(problem, np.random.default_rng(1)).decide()
        accepted = decision.accepted.explanations if decision.accepted else ()
        scene = matched[0].baseline.model.specimen.scene
        return Judged(decision, conclusions.recalibrated(assembly, scene, accepted,
                                                      Priors().modulus))
    return decide
