"""The answer of a diagnosis that did not run to its end: what the steps that are over have found.

No verdict is given. Findings without a tissue model that have no rival are told as causes, as a
full run tells them; candidate terms are ranked by their sensitivities alone (first order), and by
a full fit where one is over. Source of the ranking: `judge.Judge.singles`.
Test: diagnosis/test_partial.py
"""

import time
from dataclasses import replace

from threadpoolctl import threadpool_limits

from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.core.random import stream
from arm_brachy.diagnosis.free_vibration import held_out as free_trace
from arm_brachy.diagnosis.free_vibration.answer import recordings_of as free_recordings
from arm_brachy.diagnosis.free_vibration.findings import base_marker_findings
from arm_brachy.diagnosis.free_vibration.screening import free_screen, is_free
from arm_brachy.diagnosis.isolation.handover import given
from arm_brachy.diagnosis.pipeline import Answer, refuse_unfit
from arm_brachy.diagnosis.progress import ERRORS, FREE_STEPS, STEPS, untold
from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.report.answer import Diagnosis
from arm_brachy.diagnosis.report.curves import worst_curves
from arm_brachy.diagnosis.report.figures import body_of
from arm_brachy.diagnosis.report.finding_causes import with_findings
from arm_brachy.diagnosis.report.page import Shown
from arm_brachy.diagnosis.report.traces import traces
from arm_brachy.diagnosis.results.formatting import figures
from arm_brachy.diagnosis.results.parts import Screened, StreamFit, Unfinished
from arm_brachy.diagnosis.selection.judge import Judge
from arm_brachy.diagnosis.selection.problem import assemble, left_over
from arm_brachy.diagnosis.selection.screening import Tried
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.stages import Known, Quick, notes_of, recordings_of, screen
from arm_brachy.diagnosis.statistics.misfit_scan import scan
from arm_brachy.tissue.build import load_scene_mesh

MOST = 12       # candidates that are listed


@threadpool_limits.wrap(limits=1)
def partial_answer(known, provenance, why, seconds, simplified=()):
    """Return the Answer, verdict 'partial', of a stages.Known in which steps are missing.

    provenance : answer.Provenance without recordings;  why, simplified : as in
    parts.Unfinished;  seconds : since the start
    """
    steps = FREE_STEPS if is_free(known.evidences[0].scene) else STEPS
    unfinished = Unfinished(why, float(seconds), tuple(known.steps), tuple(
        step for step in steps if step not in known.steps), tuple(simplified))
    if is_free(known.evidences[0].scene):
        return _of_free(known, provenance, unfinished)
    scene = known.evidences[0].scene
    provenance = replace(provenance, recordings=recordings_of(known))
    found = given(known.looked, [f for one in known.sound for f in one.structure.findings],
                  beside=known.looked)
    causes, where, when = with_findings(replace(found, open=()), scene, (), (), (), None)
    compared = _compared(known, provenance.seed) if known.matched else {}
    drawn = compared.pop('shown', None) or Shown(body_of(scene, load_scene_mesh(scene)))
    diagnosis = Diagnosis(
        'partial', provenance, tuple(causes), (*where, *compared.pop('where', ())),
        (*when, *compared.pop('when', ())),
        findings=tuple(f for one in known.looked for f in one.structure.findings),
        notes=(*simplified, *known.left_out, *notes_of(known.looked)), unfinished=unfinished,
        **compared)
    return Answer(diagnosis, drawn)


@threadpool_limits.wrap(limits=1)
def quick_answer(evidences, provenance, *, held_out=(), null=(), progress=untold,
                 calibration=None, known=None, quick=None, jobs=1):
    """Return the Answer, verdict 'partial', of a quick look: no full fits, fewer load states.

    Arguments as of `pipeline.diagnose`;  quick : stages.Quick
    Raises what `pipeline.diagnose` raises.
    """
    start, quick = time.monotonic(), quick or Quick()
    known = Known() if known is None else known
    evidences, held_out, null = tuple(evidences), tuple(held_out), tuple(null)
    refuse_unfit(evidences, held_out, null)
    if is_free(evidences[0].scene):
        free_screen(known, evidences, held_out, progress, thin=quick.thin)
    else:
        screen(known, evidences, held_out, null, calibration, seed=provenance.seed,
               progress=progress, quick=quick, jobs=jobs)
    progress(ERRORS, 0, 1)
    return partial_answer(known, provenance, 'quick', time.monotonic() - start,
                          quick.said(evidences[0].scene))


def _compared(known, seed):
    """Fields of a Diagnosis from recordings that a model was compared with, and what is drawn."""
    sound = len(known.sound)
    assembly = known.assembly or assemble(known.matched, known.tried or Tried((), ()), sound)
    problem, rng = assembly.problem, stream(seed, 'decision')
    left = scan(problem.U, problem.r, problem.tests, rng, together=problem.together)
    fit = conclusions.errors_of(assembly, None, known.ratio, known.tests)
    where, when = () if left.chance >= Rules().alarm else (), ()
    if left.chance < Rules().alarm:
        where, when = conclusions.unexplained(assembly, left.worst, left_over(assembly, ()))
    specimen = known.matched[0].baseline.model.specimen
    return {'fit': fit, 'chance': left.chance, 'where': where, 'when': when,
            'screen': _ranked(problem, [(one, [s.spread for s in one.strengths])
                                        for one in assembly.tried.hypotheses],
                              known.fits.gains if known.fits else {}),
            'shown': Shown(body_of(specimen.scene, specimen.mesh), traces(assembly, ()), (),
                           worst_curves(assembly, None, '', known.ratio))}


def _ranked(problem, hypotheses, gains):
    """statements.Screened of the best candidates of a judge.Problem, best first.

    hypotheses : (Hypothesis, (p,) standard deviations of its priors in typical sizes) of its
        explanations, in their order;  gains : as of `full_fits.FullFits.gains`
    """
    if not problem.explanations:
        return ()
    order = {id(e): h for e, h in zip(problem.explanations, hypotheses, strict=True)}
    singles = Judge(problem, None).singles()[:MOST]
    return tuple(_screened(one, order[id(one.explanations[0])],
                           gains.get(tuple(map(id, one.explanations)))) for one in singles)


def _screened(candidate, tried, gain):
    explanation, = candidate.explanations
    return Screened(explanation.cause, explanation.variant, float(candidate.evidence),
                    float(candidate.held_out),
                    _size(candidate, *tried) if candidate.evidence > 0.0 else '',
                    None if gain is None else float(candidate.evidence + gain.evidence))


def _size(candidate, hypothesis, spread):
    """The first strength of a candidate by its linear answer, in words: 'ratio 2.1'."""
    strength = hypothesis.strengths[0]
    info = quantities(hypothesis.cls)[strength.name]
    value = strength.value(float(spread[0] * candidate.mean[0])) / info.scale
    unit = UNITS[info.unit][1]
    return f'{strength.label} {figures((value,))[0]}{"" if unit == "1" else f" {unit}"}'


def _of_free(known, provenance, unfinished):
    """The Answer for a body without pads."""
    free, scene = known.free, known.evidences[0].scene
    provenance = replace(provenance, recordings=free_recordings(known.evidences, known.held_out))
    findings, fields = (), {}
    if free is not None:
        looks = [*free.fitted, *free.tested]
        findings = base_marker_findings([look.release for look in looks],
                                        looks[0].prepared.calibration.base)
    if free is not None and free.problem is not None:
        problem = free.problem
        left = scan(problem.U, problem.r, problem.tests, stream(provenance.seed, 'decision'))
        answers = {a.free.key: (a.free.hypothesis, a.free.prior) for a in free.answers}
        fields = {'chance': left.chance, 'screen': _ranked(
            problem, [answers[e.cause, e.variant] for e in problem.explanations], {})}
    if free is not None and free.study is not None:
        fields['fit'] = tuple(_as_given(free, look) for look in free.tested or free.fitted)
    return Answer(Diagnosis('partial', provenance, findings=findings, notes=unfinished.simplified,
                            unfinished=unfinished, **fields),
                  Shown(body_of(scene, load_scene_mesh(scene))))


def _as_given(free, look):
    """StreamFit of a look.Look, by the scene as it came and at the modulus that fits."""
    def error(specimens):
        specimen = specimens[look.scene.name]
        case = look.case(free.specimens[look.scene.name], free.study.priors)
        return free_trace.left(case, free_trace.of_model(free.study.model(specimen, ()), case))

    case = look.case(free.specimens[look.scene.name], free.study.priors)
    return StreamFit(look.release.kind, error(free.given), error(free.specimens),
                     free_trace.left(case, free_trace.of_repeat(case)),
                     held_out=look.release.name if free.tested else '')
