"""Recordings and a scene in, an answer out: all stages in their order.

    evidence -> recorded (no tissue model) -> matched (model, residual, nuisances)
             -> tried (every term everywhere) -> decision -> refit -> Diagnosis
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.random import stream
from arm_brachy.diagnosis import conclude
from arm_brachy.diagnosis.assembly import assemble, held_out_fits
from arm_brachy.diagnosis.decide import Judge
from arm_brachy.diagnosis.diagnosis import Diagnosis
from arm_brachy.diagnosis.figures import Trace, body_of
from arm_brachy.diagnosis.from_finding import cause_of, interval_of, place_of
from arm_brachy.diagnosis.given import given, occasions_of
from arm_brachy.diagnosis.hypotheses import try_all
from arm_brachy.diagnosis.inference import posterior
from arm_brachy.diagnosis.matched import match
from arm_brachy.diagnosis.modulus import modulus_ratio, scaled
from arm_brachy.diagnosis.nuisances import Priors
from arm_brachy.diagnosis.page import Shown
from arm_brachy.diagnosis.recorded import look
from arm_brachy.diagnosis.refit import Data, refit
from arm_brachy.diagnosis.specimen import specimen_of
from arm_brachy.diagnosis.statements import Recording
from arm_brachy.diagnosis.states import LIMIT

FEWEST = 12         # states of a recording that are worth comparing
MOST = 200          # states of all recordings together
CERTAIN = 0.999     # probability of what a finding says that has no rival
STEPS = ('what the streams say by themselves', 'the model beside the recordings',
         'every term of the catalogue', 'decision', 'fit of what was chosen')


@dataclass(frozen=True)
class Answer:
    """diagnosis : Diagnosis;  shown : page.Shown, what is drawn beside it"""

    diagnosis: Diagnosis
    shown: Shown


def diagnose(evidences, provenance, *, null=(), progress=None, accuracy=None, calibration=None):
    """Return the Answer for evidence.Evidence of one scene.

    provenance : diagnosis.Provenance without recordings;  null : Evidence in which nothing is
    wrong: they calibrate, and what they show is no fault
    progress : called with (step of STEPS, share done 0 to 1), or None
    accuracy : model_error.Accuracy;  calibration : finding.Calibration; None = defaults
    Raises InputError and its kin for what cannot be compared, NotConverged where the model has no
    state.
    Test: diagnosis/test_diagnose.py
    """
    say = progress or (lambda step, share: None)
    evidences, null = tuple(evidences), tuple(null)
    say(STEPS[0], 0.0)
    recorded, left_out = _look((*evidences, *null), calibration, say)
    looked = recorded[:len(recorded) - len(null)]
    known = [f for one in recorded[len(looked):] for f in one.structure.findings]
    found = given(looked, known)
    say(STEPS[1], 0.0)
    specimen, ratio = _specimen(looked[0], evidences[0].scene)
    terms = given(recorded).terms
    matched = []
    for i, one in enumerate(recorded):
        matched.append(match(one, specimen, terms, calibration=calibration, accuracy=accuracy))
        say(STEPS[1], (i + 1) / len(recorded))
    occasions = occasions_of(looked)
    tried = try_all(matched, occasions, lambda done, of, name: say(STEPS[2], done / of))
    assembly = assemble(matched, tried, sound=len(null))
    say(STEPS[3], 0.0)
    decision = Judge(assembly.problem, stream(provenance.seed, 'decision')).decide()
    say(STEPS[4], 0.0)
    provenance = replace(provenance, recordings=_recordings(looked, recorded[len(looked):]))
    return _answer(assembly, decision, found, looked, specimen, provenance, ratio, left_out)


def _look(evidences, calibration, say):
    """(Recorded each, notes); too many recordings share the states that can be afforded."""
    limit = min(LIMIT, max(FEWEST, MOST // len(evidences)))
    kept = evidences
    notes = []
    if len(evidences) * FEWEST > MOST:
        index = np.unique(np.linspace(0, len(evidences) - 1, MOST // FEWEST).round().astype(int))
        kept = [evidences[i] for i in index]
        notes.append(f'Of {len(evidences)} recordings {len(kept)}, evenly chosen, were compared '
                     'with the model.')
    out = []
    for i, one in enumerate(kept):
        out.append(look(one, limit=limit, calibration=calibration))
        say(STEPS[0], (i + 1) / len(kept))
    return tuple(out), tuple(notes)


def _specimen(recorded, scene):
    """(Specimen with the modulus that the forces ask for, its ratio to the scene's)."""
    specimen = specimen_of(scene)
    ratio = modulus_ratio(recorded, specimen)
    better = scaled(scene, ratio)
    if better is scene:
        return specimen, 1.0
    return specimen_of(better, specimen.mesh), ratio


def _recordings(looked, null):
    return tuple(Recording(one.name, role, *map(float, one.prepared.evidence.span))
                 for group, role in ((looked, 'fitted, kinds held out in turn'), (null, 'null'))
                 for one in group)


def _answer(assembly, decision, found, looked, specimen, provenance, ratio, left_out):
    accepted = decision.accepted
    explanations = accepted.explanations if accepted else ()
    causes, where, when, notes = [], [], [], [*left_out, *_notes(looked)]
    verdict = decision.verdict
    if accepted:
        options = _options(assembly, decision, specimen)
        single = len(options) == 1
        for number, (candidate, probability) in enumerate(options):
            option = 0 if single else number + 1
            fit, hypotheses, note = _fitted(assembly, candidate, specimen)
            notes += note
            causes += conclude.causes_of(fit, hypotheses, probability, option)
            where += conclude.places_of(fit, hypotheses, specimen.scene, option)
            when += conclude.times_of(assembly, candidate) if number == 0 else ()
    told = {c.term for c in causes}
    sure = [*found.certain, *((f, name) for f, name in found.open
                              if f.term not in told and not told & set(f.rivals))]
    causes, where, when = _with_findings(sure, specimen.scene, causes, where, when)
    verdict = _verdict(verdict, causes, found)
    if verdict == 'unexplained':
        places, times = conclude.unexplained(assembly, decision, explanations)
        where, when = [*places, *where], [*times, *when]
    alternatives = conclude.alternatives_of(assembly, decision, {c.term for c in causes})
    diagnosis = Diagnosis(
        verdict, provenance, tuple(causes), tuple(where), tuple(when), alternatives,
        held_out_fits(assembly, explanations), None,
        conclude.recalibrated(assembly, specimen.scene, explanations, Priors().modulus),
        held_out=accepted.held_out if accepted else None, chance=decision.left.chance,
        apart=_apart(decision), findings=tuple(f for one in looked
                                               for f in one.structure.findings),
        notes=tuple(notes))
    return Answer(diagnosis, Shown(body_of(specimen.scene, specimen.mesh),
                                   _traces(assembly, explanations)))


def _options(assembly, decision, specimen):
    """(decide.Candidate, probability) of what was accepted and of what equals it."""
    first, others = conclude.probabilities(decision)
    return [(decision.accepted, first), *zip(decision.equals, others, strict=True)]


def _fitted(assembly, candidate, specimen):
    """(Refit, Hypotheses, notes) of a decide.Candidate."""
    chosen = [assembly.hypothesis_of(e) for e in candidate.explanations]
    hypotheses = tuple(one for one, _ in chosen)
    amplitudes, first = [], 0
    for one in hypotheses:
        spread = np.array([s.spread for s in one.strengths])
        amplitudes.append(spread * candidate.mean[first:first + len(spread)])
        first += len(spread)
    data = [Data(specimen, m.recorded.path, m.recorded.states.t, m.observables, m.U,
                 m.baseline.model.terms) for m in assembly.matched]
    return refit(data, hypotheses, amplitudes), hypotheses, []


def _with_findings(sure, scene, causes, where, when):
    """The parts of the answer with those that findings make, one cause per term and place."""
    causes, where, when, seen = list(causes), list(where), list(when), set()
    for finding, name in sure:
        when.append(interval_of(finding, name))
        key = (finding.term, finding.channel, finding.parameter)
        if key in seen:
            continue
        seen.add(key)
        causes.append(cause_of(finding, CERTAIN))
        where.append(place_of(finding, scene))
    return causes, where, when


def _verdict(verdict, causes, found):
    """The verdict with what findings say: a finding that names no term is unexplained too."""
    if verdict == 'nothing_missing' and causes:
        return 'named'
    if verdict == 'nothing_missing' and found.nameless:
        return 'nothing_missing'
    return verdict


def _apart(decision):
    if decision.accepted is None:
        return None
    if decision.equals:
        return float(min(c.separation for c in decision.equals))
    return None


def _notes(looked):
    return [note for one in looked for note in one.prepared.evidence.notes]


def _traces(assembly, explanations):
    """figures.Trace of every stream of every recording."""
    problem, out = assembly.problem, []
    fits = [posterior(problem.U, problem.r).mean @ problem.U.T]
    if explanations:
        U = np.hstack([problem.U, *(e.columns for e in explanations)])
        fits.append(posterior(U, problem.r).mean @ U.T)
    sd = np.concatenate([m.observables.sd for m in assembly.matched])
    for m, rows in conclude.split_rows(assembly, np.arange(len(problem.r))):
        kinds = np.array([row.kind for row in m.observables.rows])
        for kind in dict.fromkeys(kinds.tolist()):
            chosen = rows[kinds == kind]
            states = m.observables.states[kinds == kind]
            lines = [_over_states(states, (problem.r - fit)[chosen] * sd[chosen],
                                  len(m.recorded.states.t)) for fit in fits]
            out.append(Trace(m.recorded.name, kind, m.recorded.states.t, lines[0],
                             float(np.sqrt(np.mean(sd[chosen]**2))),
                             lines[1] if explanations else None))
    return tuple(out)


def _over_states(states, values, n):
    count = np.maximum(np.bincount(states, minlength=n), 1)
    return np.sqrt(np.bincount(states, values**2, minlength=n) / count)

