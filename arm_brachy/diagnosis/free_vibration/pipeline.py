"""Diagnosis of bodies without pads: held, let go, ringing, settling. Statics and modes, no steps.

    recording -> Release -> Case \\
    scene     -> FreeModel       -> FreeStudy -> FreeFullFits, judge.Judge -> FreeParts

Of a released body everything measured in metres and seconds depends on modulus over density and
on gravity alone: E is known only as well as the density, and gravity is taken as known where the
scene has that of the Earth. A modulus is therefore recalibrated and never a finding.
Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.diagnosis.free_vibration import conclusions as said
from arm_brachy.diagnosis.free_vibration import held_out as trace
from arm_brachy.diagnosis.free_vibration.candidates import EARTH
from arm_brachy.diagnosis.free_vibration.curves import path_of
from arm_brachy.diagnosis.free_vibration.damping import said as damping_said
from arm_brachy.diagnosis.free_vibration.damping import unknown
from arm_brachy.diagnosis.free_vibration.findings import base_marker_findings
from arm_brachy.diagnosis.free_vibration.fit import refit
from arm_brachy.diagnosis.free_vibration.full_fits import FreeFullFits
from arm_brachy.diagnosis.free_vibration.screening import DRIFTS, free_screen, possible, turned
from arm_brachy.diagnosis.free_vibration.vetoes import stood_back, told_apart
from arm_brachy.diagnosis.free_vibration.weights import with_weights
from arm_brachy.diagnosis.progress import ERRORS, FITS, Count, untold
from arm_brachy.diagnosis.results.parts import Alternative, NextExperiment, Place, StreamFit
from arm_brachy.diagnosis.selection.detectability import limits
from arm_brachy.diagnosis.selection.judge import Explanation, Judge, fits_ahead
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.stages import Known
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior
from arm_brachy.diagnosis.statistics.misfit_scan import scan

NOTHING = 'fitted in full, nothing of it is left'
KNOWN = ('Of a released body only modulus over density is seen: E holds if the density of the '
         'scene does.')
DIRECTION = 'The size of gravity is taken as known, its direction is not.'
OTHER_BODY = ("The modulus that fits is {:.2g} times the scene's: a weight, a density or a length "
              'that is not that of the scene asks for one as well. A weight that hangs on the '
              'body is written in the scene under loads: name, position_mm, mass_g.')


@dataclass(frozen=True)
class FreeParts:
    """What is said of released bodies, for a answer.Diagnosis.

    decision : judge.Decision;  verdict : its verdict
    causes : cause.Cause;  where, when : parts.Place and Interval
    alternatives : parts.Alternative;  fit : parts.StreamFit per recording held out
    recalibrated : 'E' -> Estimate, with the causes;  plain : the same without any
    next_experiment : NextExperiment or None;  held_out, chance, apart : as in Diagnosis
    findings : finding.Finding of base markers;  notes : sentences
    table : (Row, measured, at the modulus asked for, recalibrated, with the causes, error) each
    limits : parts.Limit of all causes tried;  paths : curves.FreePath per recording
    """

    decision: object
    verdict: str
    causes: tuple
    where: tuple
    when: tuple
    alternatives: tuple
    fit: tuple
    recalibrated: dict
    plain: dict
    next_experiment: object
    held_out: float | None
    chance: float
    apart: float | None
    findings: tuple
    notes: tuple
    table: tuple
    limits: tuple = ()
    paths: tuple = ()


def free_diagnosis_parts(evidences, held_out=(), progress=untold, rng=None, *,
                         drifts_restart=True, known=None):
    """Return the FreeParts of recordings of one body that was let go.

    evidences : loading.Evidence to fit, held_out : to test on, not looked at before; each
        carries its scene, so that loads may differ
    progress : as in `progress`;  known : stages.Known that is kept up to date, or None
    rng : numpy.random.Generator for the structured tests
    drifts_restart : False where the recordings are of one day of one body, so that no drift can
        begin anew with each: it is then no explanation of more than one. Data do not show this
    Raises InputError, RecordingError, NotConverged.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    known = Known() if known is None else known
    dropped, absurd = free_screen(known, evidences, held_out, progress,
                                  drifts_restart=drifts_restart)
    free = known.free
    fitted, tested, study, given = free.fitted, free.tested, free.study, free.given
    specimens, answers, problem = free.specimens, free.answers, free.problem
    every = answers
    count = Count(progress, FITS, 0)
    if scan(problem.U, problem.r, problem.tests, rng).chance < Rules().alarm:
        answers, tried = with_weights(study, problem, answers, count), answers
        problem, absurd = possible(study, answers)
        absurd = (*absurd, *_vanished(tried, answers))
    full = FreeFullFits(study, problem, answers, rng, count)
    judge = Judge(problem, rng, check=full.left, gone=full.gone, weigh=full.weigh)
    count.expect(fits_ahead(judge))
    decision = judge.decide()
    known.steps.append(FITS)
    progress(ERRORS, 0, 1, 'held-out errors')
    plain = refit(study, problem)
    return replace(_parts(study, problem, decision, answers, plain, (*dropped, *absurd), fitted,
                          tested, given, specimens, full), limits=_limits(problem, every))


def _vanished(before, after):
    """Alternatives of the terms that have Answers before full fits and none after."""
    names = [{a.free.hypothesis.name for a in answers} for answers in (before, after)]
    return tuple(Alternative((name,), 0.0, why=NOTHING) for name in sorted(names[0] - names[1]))


def _parts(study, problem, decision, answers, plain, dropped, fitted, tested, given, specimens,
           full):
    decision = stood_back(told_apart(decision, full), lambda one: _held_out(
        study, problem, plain, full.fit(one), fitted, tested, given, specimens))
    fits = _fits(decision, full)
    causes, where = _causes(study, problem, decision, answers, fits)
    named = fits[0] if fits else None
    gain = (problem.r - problem.U @ posterior(problem.U, problem.r).mean) ** 2
    if decision.accepted is not None:
        gain = said.explained(problem, np.hstack(
            [e.columns for e in decision.accepted.explanations]))
    term = causes[0].term if len(causes) == 1 else ''
    only = {free.scene for fit in fits if fit for free in fit.frees} or {''}
    intervals = () if decision.verdict == 'nothing_missing' else said.when(
        study, gain, term, only if '' not in only else None)
    if decision.verdict != 'nothing_missing' and not where:
        where = (Place(stream=study.cases[0].release.kind, channel=said.loudest(study, gain)[0]),)
    E = specimens[fitted[0].scene.name].scene.material.E
    best, paths = named or plain, []
    apart = [c.separation for c in decision.equals if np.isfinite(c.separation)]
    return FreeParts(
        decision, decision.verdict, causes, where, intervals,
        said.alternatives(problem, decision, answers, dropped),
        _held_out(study, problem, plain, named, fitted, tested, given, specimens, paths),
        {'E': best.stiffness(E)}, {'E': plain.stiffness(E)}, _next(decision),
        decision.accepted.held_out if decision.accepted else None, decision.left.chance,
        min(apart) if apart else None, base_marker_findings(
            [look.release for look in fitted + tested], fitted[0].prepared.calibration.base),
        _notes(fitted, best.stiffness(E).value / fitted[0].scene.material.E, study,
               said.in_one_scene(problem, answers, fits)),
        _table(study, plain, named), paths=tuple(paths))


def _limits(problem, answers):
    """Limits of all Answers, those too that the data would have less than nothing of."""
    return limits(replace(problem, explanations=tuple(
        Explanation(*a.free.key, a.columns) for a in answers)),
        [(a.free.hypothesis, a.free.prior) for a in answers])


def _fits(decision, full):
    """FreeFits of the accepted cause and of those equal to it, None where one has none."""
    options = (decision.accepted, *decision.equals) if decision.accepted else ()
    return [full.fit(one) for one in options]


def _causes(study, problem, decision, answers, fits):
    """(causes, places) of what was accepted and of its equals, an option each if there are any.

    A cause that all options share holds in any case and is told once, as it was first fitted.
    """
    if decision.verdict not in ('named', 'equivalent'):
        return (), ()
    options = [decision.accepted, *decision.equals]
    gain = np.array([c.evidence for c in options])
    share = np.exp(gain - gain.max())
    share /= share.sum()
    causes, places, told = [], [], False
    for number, (one, fit, p) in enumerate(zip(options, fits, share, strict=True), start=1):
        if fit is None:
            continue
        for i, (free, shared) in enumerate(zip(fit.frees, decision.shared(one), strict=True)):
            if shared and told:
                continue
            alike = said.weights(problem, answers, free.hypothesis.name)
            cause = said.cause_of(fit, i, alike, 1.0 if shared else float(p),
                                  number if decision.equals and not shared else 0,
                                 study.only_in(fit.terms[i]))
            causes.append(cause)
            places.append(said.place_of(cause, alike))
        told = True
    return tuple(causes), tuple(p for p in places if p is not None)


def _held_out(study, problem, plain, named, fitted, tested, given, specimens, paths=None):
    """StreamFit of every recording held out, or of those fitted where there is none.

    paths : list that gets the FreePath of each, None = nobody draws them
    """
    cases = {look.release.name: look.case(specimens[look.scene.name], study.priors)
             for look in (*fitted, *tested)}
    out = []
    for look in tested or fitted:
        case = cases[look.release.name]

        def described(fit, look=look, case=case):
            specimen = specimens[look.scene.name]
            hung = (given[look.scene.name], ()) if fit is None else study.as_hung(
                specimen, problem, fit)
            return trace.of_model(study.model(*hung), case)

        made = [described(fit) for fit in (None, plain, *([] if named is None else [named]))]
        errors = [trace.left(case, one) for one in made]
        repeats = [one for one in fitted if one.scene.name == look.scene.name
                   and one.release.names == look.release.names]
        floor = min(trace.left(case, trace.of_repeat(cases[one.release.name]))
                    for one in (repeats or [look]))
        out.append(StreamFit(look.release.kind, *errors[:2], floor, *errors[2:],
                             held_out=look.release.name if tested else ''))
        if paths is not None:
            paths.append(path_of(case, made[1:], floor))
    return tuple(out)


def _next(decision):
    """What would split a class."""
    if decision.verdict != 'equivalent':
        return None
    names = [' + '.join(c.causes) for c in (decision.accepted, *decision.equals)]
    again = {n for c in decision.equals for n in c.causes} | set(decision.accepted.causes)
    what = ('Hold the body and let it go again: what relaxes begins anew, what drifts does not.'
            if again & set(DRIFTS) else 'Let the body go with a known weight hung on it, and '
            'turned by 90 degrees: each explanation depends on the load in its own way.')
    return NextExperiment(instruction=what, splits=tuple((names[0], n) for n in names[1:]))


def _notes(fitted, ratio, study, alone):
    """ratio : modulus that fits over the scene's;  alone : sentences of what is in one scene"""
    gravity = np.linalg.norm(fitted[0].scene.gravity)
    out = [KNOWN, *([DIRECTION] if EARTH[0] <= gravity <= EARTH[1] and not turned(fitted)
                    else ())]
    out += [damping_said(one.scene) for name, one in study.specimens.items()
            if name in {look.scene.name for look in fitted if unknown(look.scene)}
            and not unknown(one.scene)]
    out += alone
    if abs(np.log(ratio)) > study.priors.modulus:
        out.append(OTHER_BODY.format(ratio))
    if any(look.scene.loads for look in fitted):
        out.append('Where the weight hangs is taken from the scene; 1 mm further out on a beam of '
                   '100 mm sags by 1.5 % more, which reads as a softer body.')
    out += [f'{look.release.name}: {", ".join(look.release.lost)} not seen at rest, while it '
            'rings or at the end; left out.' for look in fitted if look.release.lost]
    loose = study.placement
    if loose > 1.5 * fitted[0].prepared.calibration.placement:
        out.append(f'Markers at rest are {1e3 * loose:.1f} mm per axis from where the scene has '
                   'them; that is allowed for.')
    return tuple(out)


def _table(study, plain, named):
    """Rows of what was measured beside what every model makes of it, SI."""
    made = [study.start, study.values - plain.residual * study.sd]
    made.append(np.full(len(study.values), np.nan) if named is None
                else study.values - named.residual * study.sd)
    return tuple(zip(study.rows, study.values.tolist(), *(m.tolist() for m in made),
                     study.sd.tolist(), strict=True))
