"""Recordings and a scene in, an answer out: all stages in their order.

    evidence -> recorded (no tissue model) -> matched (model, residual, nuisances)
             -> tried (every term everywhere) -> decision -> refit -> Diagnosis
"""

from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from arm_brachy.core.errors import InputError
from arm_brachy.core.random import stream
from arm_brachy.core.term import Kind
from arm_brachy.diagnosis import conclude
from arm_brachy.diagnosis.asking import asked
from arm_brachy.diagnosis.astray import astray, unled
from arm_brachy.diagnosis.blur import FINER, cut_rims, with_mesh
from arm_brachy.diagnosis.checks import refuse_twice
from arm_brachy.diagnosis.diagnosis import Diagnosis
from arm_brachy.diagnosis.figures import body_of
from arm_brachy.diagnosis.forward import ForwardModel
from arm_brachy.diagnosis.free_answer import free_answer
from arm_brachy.diagnosis.free_body import is_free
from arm_brachy.diagnosis.from_finding import (
    cause_of,
    interval_of,
    merged,
    options_of,
    place_of,
)
from arm_brachy.diagnosis.given import given, occasions_of, onsets_in
from arm_brachy.diagnosis.hypotheses import try_all
from arm_brachy.diagnosis.inertia import hint, inertia_of, with_lag
from arm_brachy.diagnosis.inertia import said as said_of_inertia
from arm_brachy.diagnosis.judgement import judged
from arm_brachy.diagnosis.limits import limits_of
from arm_brachy.diagnosis.looks import look_at
from arm_brachy.diagnosis.matched import match
from arm_brachy.diagnosis.mesh_errors import ensemble_of
from arm_brachy.diagnosis.modulus import modulus_ratio, scaled
from arm_brachy.diagnosis.nuisances import Priors
from arm_brachy.diagnosis.page import Shown
from arm_brachy.diagnosis.partial_residuals import partials
from arm_brachy.diagnosis.specimen import specimen_of
from arm_brachy.diagnosis.statements import Recording
from arm_brachy.diagnosis.traces import traces
from arm_brachy.diagnosis.wording import spoken
from arm_brachy.registry import by_name

CERTAIN = 0.999     # probability of what a finding says that has no rival
MORE = ('More is left than better meshes of this size would change: solve on a finer one before '
        'physics is asked for.')
BESIDE_NULLS = ('What the null recordings show the mesh to be wrong by is taken off the errors '
                'held out, not off those as given: a corrected scene still has it.')
STEPS = ('what the streams say by themselves', 'the model beside the recordings',
         'every term of the catalogue', 'decision and full fits')


@dataclass(frozen=True)
class Answer:
    """diagnosis : Diagnosis;  shown : page.Shown, what is drawn beside it"""

    diagnosis: Diagnosis
    shown: Shown


# Its matrices are small: a second thread of BLAS doubled the processor time of a minute with the
# breast and gained nothing.
@threadpool_limits.wrap(limits=1)
def diagnose(evidences, provenance, *, held_out=(), null=(), progress=None, accuracy=None,
             calibration=None, meshes=None):
    """Return the Answer for evidence.Evidence of one scene.

    provenance : diagnosis.Provenance without recordings
    held_out : Evidence to test on, not fitted;  null : Evidence in which nothing is
    wrong: they calibrate, and what they show is no fault
    progress : called with (step of STEPS, share done 0 to 1), or None
    accuracy : model_error.Accuracy;  calibration : finding.Calibration
    meshes : mesh_errors.EnsembleOptions; None = defaults, here as there
    Raises InputError and its kin for what cannot be compared or is there twice, NotConverged where
    the model has no state.
    Test: diagnosis/test_diagnose.py
    """
    say = progress or (lambda step, share: None)
    evidences, held_out, null = tuple(evidences), tuple(held_out), tuple(null)
    refuse_twice((*evidences, *held_out, *null))
    if is_free(evidences[0].scene):
        _refuse_null(null)
        return Answer(*free_answer(evidences, provenance, held_out,
                                   lambda share: say(STEPS[2], share)))
    _refuse_other_scenes((*evidences, *held_out, *null))
    say(STEPS[0], 0.0)
    calibration = with_lag(calibration, evidences[0].scene)
    (looked, left_out), (sound, fewer), (tested, fewest) = look_at(
        (evidences, null, held_out), calibration, lambda share: say(STEPS[0], share))
    left_out = (*left_out, *fewer, *fewest)
    say(STEPS[1], 0.0)
    specimen, ratio = _specimen((*looked, *sound), evidences[0].scene)
    ensemble = ensemble_of(ForwardModel(specimen), stream(provenance.seed, 'meshes'), meshes)
    inertia = inertia_of(specimen)

    def matches(looked, every):
        """Matched of every Recorded, with what those of `looked` are certain of."""
        out = []
        for one in every:
            out.append(match(one, specimen, ensemble, given((one,), beside=looked).terms,
                             calibration=calibration, accuracy=accuracy, several=len(every) > 1,
                             inertia=inertia))
            say(STEPS[1], len(out) / len(every))
        return out

    looked, sound, tested, matched = _led_by_pads(looked, sound, tested, matches)
    tests, matched = matched[len(looked) + len(sound):], matched[:len(looked) + len(sound)]
    found = given(looked, [f for one in sound for f in one.structure.findings], beside=looked)
    occasions = occasions_of(looked)
    tried = try_all(matched, occasions, lambda done, of, name: say(STEPS[2], done / of))
    say(STEPS[3], 0.0)
    judgement = judged(matched, tests, tried, len(null), provenance.seed, accuracy,
                       ensemble.limit)
    provenance = replace(provenance, recordings=_recordings(looked, tested, sound))
    left = ensemble.limit.left if judgement.at_limit else ensemble
    request = asked(judgement.assembly, judgement.decision, left, calibration)
    left_out = (*left_out, *said_of_inertia(matched, calibration),
                *(note for m in (*matched, *tests) for note in m.notes))
    return _answer(judgement, found, looked, provenance, ratio, left_out, request,
                   None if null else left)


def _refuse_null(null):
    """Raise InputError if null recordings are given of a body without pads."""
    if null:
        raise InputError(f'{null[0].name}: a null recording of scene {null[0].scene.name}, which '
                         'has no pads; must be of a body with pads: give it as one to be fitted, '
                         'with --scene-of where its scene is another')


def _refuse_other_scenes(evidences):
    """Raise InputError if recordings of a body with pads are of several scenes."""
    names = sorted({one.scene.name for one in evidences if one.scene != evidences[0].scene})
    if names:
        raise InputError(f'recordings of scenes {evidences[0].scene.name} and {", ".join(names)}; '
                         'must be of one scene: several are for bodies without pads')


def _specimen(recorded, scene):
    """(Specimen with the modulus that forces ask for, its ratio to the scene's).

    recorded : Recorded of one body; the first whose forces tell it does
    """
    specimen = specimen_of(scene)
    ratio = next((one for one in (modulus_ratio(some, specimen) for some in recorded)
                  if one != 1.0), 1.0)
    better = scaled(scene, ratio)
    if better is scene:
        return specimen, 1.0
    return specimen_of(better, specimen.mesh), ratio


def _led_by_pads(looked, sound, tested, matches):
    """The three groups of Recorded, and Matched each, without markers that go astray from pads.

    matches : (looked, all three) -> Matched each. Held out recordings do not say which go astray.
    """
    matched = matches(looked, (*looked, *sound, *tested))
    fitted = matched[:len(looked) + len(sound)]
    strays = astray(fitted, [given((m.recorded,), beside=looked).open_terms for m in fitted])
    if not strays:
        return looked, sound, tested, matched
    looked, sound, tested = (tuple(unled(one, strays) for one in some)
                             for some in (looked, sound, tested))
    return looked, sound, tested, matches(looked, (*looked, *sound, *tested))


def _recordings(looked, tested, sound):
    roles = ('fitted' if tested else 'fitted, kinds held out in turn', 'held out', 'null')
    return tuple(Recording(one.name, role, *map(float, one.prepared.evidence.span))
                 for group, role in zip((looked, tested, sound), roles, strict=True)
                 for one in group)


def _answer(judgement, found, looked, provenance, ratio, left_out, request, blur):
    """blur : mesh_errors.Ensemble of what the mesh may be wrong by, None where nulls tell."""
    assembly, decision, fault = judgement.assembly, judgement.decision, judgement.fault
    tests = judgement.tests
    accepted, specimen = decision.accepted, assembly.matched[0].baseline.model.specimen
    scene = specimen.scene
    explanations = accepted.explanations if accepted else ()
    onsets = {middle: ends for m in assembly.matched
              for middle, ends in onsets_in(m.recorded).items()}
    causes, where = conclude.options_of(decision, judgement.fits, scene, onsets)
    when = [] if accepted is None else conclude.times_of(assembly, accepted)
    fitted = [judgement.fits.of(one) for one in (accepted, *decision.equals) if one is not None]
    best = fitted[0] if fitted else None
    errors = conclude.errors_of(assembly, best, ratio, tests)
    errors = errors if blur is None else with_mesh(errors, blur, assembly.matched)
    notes = [*([] if blur is not None else [BESIDE_NULLS]), *left_out, *cut_rims(specimen),
             *judgement.notes, *_notes(looked), *(note for one in fitted for note in one.notes)]
    causes, where, when = with_findings(found, scene, causes, where, when, decision)
    left = conclude.left_over(assembly, explanations)
    causes += [] if fault is None else [fault.cause()]
    shape = decision.shape if fault is None else decision.unproven
    if shape is not None:
        where += [replace(one, term='') for one in conclude.places_of(
            judgement.fits.of(shape), scene) if one is not None]
        when += [replace(one, term='') for one in conclude.times_of(assembly, shape)]
        notes += [] if decision.unproven is None else [_would_do(shape)]
    elif decision.verdict == 'unexplained' and fault is None:
        places, times = conclude.unexplained(assembly, decision.before.worst, left)
        where, when = [*places, *where], [*times, *when]
        notes += conclude.said_of(assembly.tests[decision.before.worst])
    verdict = _verdict(decision.verdict, causes, fault, found.nameless)
    if verdict == 'unexplained' or any(cause.term == 'clock_offset' for cause in causes):
        notes += hint(assembly.matched)
    if verdict == 'unexplained':
        where += [place_of(finding, scene) for finding, _ in found.nameless]
        when += [interval_of(finding, name) for finding, name in found.nameless]
    if fault is not None and decision.verdict == 'unexplained':
        notes.append(MORE)
    if verdict == 'nothing_missing' and any(one.blurred for one in errors):
        notes.append(FINER)
    diagnosis = Diagnosis(
        verdict,
        provenance, tuple(causes), tuple(where), tuple(when),
        conclude.alternatives_of(assembly, decision, {c.term for c in causes}),
        errors, request,
        conclude.recalibrated(assembly, scene, explanations, Priors().modulus,
                              best.scale if best else None),
        evidence=accepted.evidence if accepted else None,
        held_out=accepted.held_out if accepted else None, chance=decision.left.chance,
        apart=min((float(c.separation) for c in decision.equals), default=None),
        nearest=None if verdict != 'unexplained' else conclude.nearest_of(
            assembly, decision, judgement.fits, ratio, tests),
        findings=tuple(f for one in looked for f in one.structure.findings), notes=tuple(notes),
        limits=limits_of(assembly))
    return Answer(diagnosis, Shown(body_of(scene, specimen.mesh),
                                   traces(assembly, explanations),
                                   partials(assembly, explanations)))


def _verdict(verdict, causes, fault, nameless):
    """That of the decision, but for what needs no decision: findings, and a mesh at fault."""
    if verdict == 'unexplained' and fault is not None:
        return 'named'
    if any(cause.option for cause in causes):
        return 'equivalent'
    if verdict != 'nothing_missing':
        return verdict
    if causes:
        return 'named'
    return 'unexplained' if nameless else verdict


def _would_do(candidate):
    return (f'An effect like {" with ".join(map(spoken, candidate.causes))} would explain it; but '
            'these recordings push in one way only, and a load that comes with the push would '
            'explain it as well.')


def _leads(decision):
    """Names of the causes that explain most where none explains all."""
    unsure = decision.verdict == 'unexplained' and decision.ranked
    return set(decision.ranked[0].causes) if unsure else set()


def with_findings(found, scene, causes, where, when, decision):
    """The parts of the answer with those that findings make, one cause per term and place.

    found : given.Given;  scene : core.scene.Scene;  causes, where, when : of the answer so far
    decision : decide.Decision. Returns causes, where and when as lists.
    One that has rivals is told unless the comparison with the model named one of them, or that
    leads where nothing explains all: as a class with those that no model could have told from it,
    if nothing else is one.
    """
    causes, where, when, seen, split = list(causes), list(where), list(when), set(), None
    told = {cause.term for cause in causes}
    known = told | _leads(decision)
    sure = [*found.certain, *((f, name) for f, name in found.open
                              if f.term not in told and not known & set(f.rivals))]
    for finding, name in sure:
        key = (finding.term, finding.channel, finding.parameter)
        if key in seen:
            when.append(interval_of(finding, name))
            continue
        seen.add(key)
        alike = _alike(finding)
        options = [(cause_of(finding, CERTAIN / (1 + len(alike))), finding)]
        if alike and ((finding.term, alike) == split or _may_be_class(decision, causes)):
            split = finding.term, alike     # of several pads: all have the one or the other
            options = options_of(finding, alike, CERTAIN)
        for cause, said in options:
            if cause in causes:
                continue
            twins = [both for both in enumerate(merged(cause, one) for one in causes) if both[1]]
            if twins:
                causes[twins[0][0]] = twins[0][1]
                continue
            causes.append(cause)
            where.append(place_of(said, scene, cause.option))
            when.append(interval_of(said, name))
    return causes, where, when


def _alike(finding):
    """Rivals of a finding but for tissue and boundary: these move markers, and were not found."""
    return tuple(name for name in finding.rivals
                 if by_name(name).spec.kind not in (Kind.TISSUE, Kind.BOUNDARY))


def _may_be_class(decision, causes):
    """True if an answer can have options: none yet, and it explains what there is."""
    return decision.verdict in ('named', 'nothing_missing') and not any(c.option for c in causes)


def _notes(looked):
    return [note for one in looked for note in (
        *one.prepared.evidence.notes,
        *(note for noise in one.prepared.noise.values() for note in noise.notes))]
