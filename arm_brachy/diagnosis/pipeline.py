"""Recordings and a scene in, an answer out: all stages in their order.

    evidence -> recorded (no tissue model) -> matched (model, residual, nuisances)
             -> tried (every term everywhere) -> decision -> refit -> Diagnosis
"""

from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.experiment_design.request import asked
from arm_brachy.diagnosis.free_vibration.answer import free_answer
from arm_brachy.diagnosis.free_vibration.screening import is_free
from arm_brachy.diagnosis.isolation.handover import given, onsets_in
from arm_brachy.diagnosis.likelihood.inertia_bound import hint
from arm_brachy.diagnosis.likelihood.inertia_bound import said as said_of_inertia
from arm_brachy.diagnosis.likelihood.nuisances import Priors
from arm_brachy.diagnosis.progress import ERRORS, FITS, untold
from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.report.answer import Diagnosis
from arm_brachy.diagnosis.report.curves import worst_curves
from arm_brachy.diagnosis.report.figures import body_of
from arm_brachy.diagnosis.report.finding_causes import said_of_faint, with_findings
from arm_brachy.diagnosis.report.finding_estimates import interval_of, place_of
from arm_brachy.diagnosis.report.mesh_notes import FINER, cut_rims, with_mesh
from arm_brachy.diagnosis.report.misfit_film import misfit_states
from arm_brachy.diagnosis.report.page import Shown
from arm_brachy.diagnosis.report.partial_residuals import partials
from arm_brachy.diagnosis.report.traces import traces
from arm_brachy.diagnosis.results.formatting import listed, spoken
from arm_brachy.diagnosis.selection.detectability import limits_of
from arm_brachy.diagnosis.selection.problem import left_over
from arm_brachy.diagnosis.selection.revision import judged
from arm_brachy.diagnosis.signals.validation import refuse_twice
from arm_brachy.diagnosis.stages import Known, notes_of, recordings_of, screen

MORE = ('More is left than better meshes of this size would change: solve on a finer one before '
        'physics is asked for.')
BESIDE_NULLS = ('What the null recordings show the mesh to be wrong by is taken off the errors '
                'held out, not off those as given: a corrected scene still has it.')


@dataclass(frozen=True)
class Answer:
    """diagnosis : Diagnosis;  shown : page.Shown, what is drawn beside it"""

    diagnosis: Diagnosis
    shown: Shown


# Its matrices are small: a second thread of BLAS doubled the processor time of a minute with the
# breast and gained nothing.
@threadpool_limits.wrap(limits=1)
def diagnose(evidences, provenance, *, held_out=(), null=(), progress=untold, accuracy=None,
             calibration=None, meshes=None, known=None, jobs=1):
    """Return the Answer for loading.Evidence of one scene.

    provenance : answer.Provenance without recordings
    held_out : Evidence to test on, not fitted;  null : Evidence in which nothing is
    wrong: they calibrate, and what they show is no fault
    progress : as in `progress`;  accuracy : discrepancy.Accuracy
    calibration : finding.Calibration;  meshes : discretisation.EnsembleOptions; None = defaults
    known : stages.Known that gets what each step has found as it ends; of it `partial` makes
        an Answer if this one is ended before its time
    jobs : processes at a time, of which the answer does not depend; those of the linear screen
        are forks (`forked`), bodies without pads have one
    Raises InputError and its kin for what cannot be compared or is there twice, NotConverged where
    the model has no state.
    Test: diagnosis/test_diagnose.py
    """
    evidences, held_out, null = tuple(evidences), tuple(held_out), tuple(null)
    refuse_unfit(evidences, held_out, null)
    known = Known() if known is None else known
    if is_free(evidences[0].scene):
        return Answer(*free_answer(evidences, provenance, held_out, progress, known))
    screen(known, evidences, held_out, null, calibration, seed=provenance.seed,
           accuracy=accuracy, meshes=meshes, progress=progress, jobs=jobs)
    return _decided(known, provenance, accuracy, progress)


def _decided(known, provenance, accuracy, progress):
    """The Answer from a stages.Known of which everything was screened."""
    looked, sound, ensemble = known.looked, known.sound, known.ensemble
    found = given(looked, [f for one in sound for f in one.structure.findings], beside=looked)
    judgement = judged(known.matched, known.tests, known.tried, len(sound), provenance.seed,
                       accuracy, ensemble.limit, progress, known)
    known.steps.append(FITS)
    progress(ERRORS, 0, 2, 'next experiment')
    provenance = replace(provenance, recordings=recordings_of(known))
    left = ensemble.limit.left if judgement.at_limit else ensemble
    request = asked(judgement.assembly, judgement.decision, left, known.calibration)
    left_out = (*known.left_out, *said_of_inertia(known.matched, known.calibration),
                *(note for m in (*known.matched, *known.tests) for note in m.notes))
    progress(ERRORS, 1, 2, 'held-out errors')
    return _answer(judgement, found, looked, provenance, known.ratio, left_out, request,
                   None if sound else left)


def refuse_unfit(evidences, held_out, null):
    """Raise InputError for loading.Evidence that is there twice, or of no one set-up."""
    refuse_twice((*evidences, *held_out, *null))
    if is_free(evidences[0].scene):
        _refuse_null(null)
    else:
        _refuse_other_scenes((*evidences, *held_out, *null))


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


def _answer(judgement, found, looked, provenance, ratio, left_out, request, blur):
    """blur : discretisation.Ensemble of what the mesh may be wrong by, None where nulls tell."""
    assembly, decision = judgement.assembly, judgement.decision
    accepted, specimen = decision.accepted, assembly.matched[0].baseline.model.specimen
    explanations = accepted.explanations if accepted else ()
    fitted = [judgement.fits.of(one) for one in (accepted, *decision.equals) if one is not None]
    best = fitted[0] if fitted else None
    errors = conclusions.errors_of(assembly, best, ratio, judgement.tests)
    errors = errors if blur is None else with_mesh(errors, blur, assembly.matched)
    causes, where, when = _named(judgement, found, specimen.scene)
    verdict = _verdict(decision.verdict, causes, judgement.fault, found.nameless)
    where, when, words = _unnamed(judgement, found, specimen.scene, verdict, where, when)
    notes = [*([] if blur is not None else [BESIDE_NULLS]), *left_out, *cut_rims(specimen),
             *judgement.notes, *notes_of(looked), *said_of_faint(found),
             *(note for one in fitted for note in one.notes), *words,
             *_advised(judgement, verdict, causes, errors)]
    diagnosis = Diagnosis(
        verdict, provenance, causes, where, when,
        conclusions.alternatives_of(assembly, decision, {c.term for c in causes}),
        errors, request,
        conclusions.recalibrated(assembly, specimen.scene, explanations, Priors().modulus,
                                 best.scale if best else None),
        evidence=accepted.evidence if accepted else None,
        held_out=accepted.held_out if accepted else None, chance=decision.left.chance,
        apart=min((float(c.separation) for c in decision.equals), default=None),
        nearest=None if verdict != 'unexplained' else conclusions.nearest_of(
            assembly, decision, judgement.fits, ratio, judgement.tests),
        findings=tuple(f for one in looked for f in one.structure.findings), notes=tuple(notes),
        limits=limits_of(assembly))
    return Answer(diagnosis, Shown(body_of(specimen.scene, specimen.mesh),
                                   traces(assembly, explanations),
                                   partials(assembly, explanations),
                                   worst_curves(assembly, *_drawn(judgement, best, found), ratio),
                                   misfit_states(assembly, explanations)))


def _named(judgement, found, scene):
    """(causes, places, times) of what is named: by the model, by findings, and a mesh at fault."""
    assembly, decision, fault = judgement.assembly, judgement.decision, judgement.fault
    onsets = {middle: ends for m in assembly.matched
              for middle, ends in onsets_in(m.recorded).items()}
    causes, where = conclusions.options_of(decision, judgement.fits, scene, onsets)
    when = [] if decision.accepted is None else conclusions.times_of(assembly, decision.accepted)
    causes, where, when = with_findings(found, scene, causes, where, when, decision)
    return (*causes, *([] if fault is None else [fault.cause()])), where, when


def _unnamed(judgement, found, scene, verdict, where, when):
    """(places, times, notes): where and when, those of what nobody names too, and what to say."""
    assembly, decision, fault = judgement.assembly, judgement.decision, judgement.fault
    notes, shape = [], decision.shape if fault is None else decision.unproven
    if shape is not None:
        where = [*where, *(replace(one, term='') for one in conclusions.places_of(
            judgement.fits.of(shape), scene) if one is not None)]
        when = [*when, *(replace(one, term='') for one in conclusions.times_of(assembly, shape))]
        notes += [] if decision.unproven is None else [_would_do(shape)]
    elif decision.verdict == 'unexplained' and fault is None:
        places, times = conclusions.unexplained(assembly, decision.before.worst,
                                                left_over(assembly, ()))
        where, when = [*places, *where], [*times, *when]
        notes += conclusions.said_of(assembly.tests[decision.before.worst])
    if verdict == 'unexplained':
        where = [*where, *(place_of(finding, scene) for finding, _ in found.nameless)]
        when = [*when, *(interval_of(finding, name) for finding, name in found.nameless)]
    return tuple(where), tuple(when), notes


def _advised(judgement, verdict, causes, errors):
    """Notes on what to do about a verdict."""
    notes = []
    if verdict == 'unexplained' or any(cause.term == 'clock_offset' for cause in causes):
        notes += hint(judgement.assembly.matched)
    if judgement.fault is not None and judgement.decision.verdict == 'unexplained':
        notes.append(MORE)
    if verdict == 'nothing_missing' and any(one.blurred for one in errors):
        notes.append(FINER)
    return notes


def _drawn(judgement, best, found):
    """(Fitted of what is drawn beside the measured curves, None = nothing; its name in words).

    best : Fitted of what was accepted, or None;  found : handover.Given
    Where nothing is claimed, what comes nearest.
    """
    known = [term.spec.name for term in found.terms]
    if best is None and judgement.decision.nearest is not None:
        nearest = judgement.fits.of(judgement.decision.nearest)
        if nearest.refit is not None:
            names = [*known, *(one.name for one in nearest.hypotheses)]
            return nearest, f'{listed(map(spoken, names))} (nearest, not claimed)'
    names = [*known, *(one.name for one in (best.hypotheses if best else ()))]
    return best, listed(map(spoken, dict.fromkeys(names))) if names else ''


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
