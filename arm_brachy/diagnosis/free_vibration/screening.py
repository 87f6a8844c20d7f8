"""The stages of a released body before any decision: signals, model, linear screen.

    recording -> Release -> Case \
    scene     -> FreeModel       -> FreeStudy -> Problem

Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import InputError, NotConverged, RecordingError
from arm_brachy.diagnosis.free_vibration.candidates import free_hypotheses
from arm_brachy.diagnosis.free_vibration.damping import unknown, with_damping
from arm_brachy.diagnosis.free_vibration.fit import refit
from arm_brachy.diagnosis.free_vibration.look import Look
from arm_brachy.diagnosis.free_vibration.model import free_specimen
from arm_brachy.diagnosis.free_vibration.observation import SETTLED, FreePriors
from arm_brachy.diagnosis.free_vibration.problem import FreeStudy
from arm_brachy.diagnosis.free_vibration.scenes import refuse_exchanged, refuse_other_bodies
from arm_brachy.diagnosis.model.modulus import scaled
from arm_brachy.diagnosis.progress import MODEL, SCREEN, SIGNALS, untold
from arm_brachy.diagnosis.results.parts import Alternative
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.validation import OUT_OF_SCALE
from arm_brachy.diagnosis.statistics.linear_gaussian import posterior

DRIFTS = ('stiffness_drift', 'swelling_drift')
ABSURD = 'it would need a value that is impossible'
AFRESH = 'it would have to begin anew with every recording'


@dataclass
class FreeKnown:
    """What is known of released bodies so far; None where a step is not over.

    fitted, tested : look.Look each;  study : FreeStudy at the modulus that fits
    given, specimens : name of scene -> Specimen as the scene has it, and at that modulus
    answers : Answer each;  problem : judge.Problem of theirs
    """

    fitted: list
    tested: list
    study: object = None
    given: dict | None = None
    specimens: dict | None = None
    answers: tuple | None = None
    problem: object = None


def is_free(scene):
    """True for a core.scene.Scene that this diagnosis is for: no pads, and inertia counts."""
    return not scene.pads and scene.dynamics == 'implicit'


def free_screen(known, evidences, held_out=(), progress=untold, *, drifts_restart=True,
                thin=None):
    """Fill a stages.Known up to the linear screen; arguments as of `free_diagnosis_parts`.

    thin : function from the Frees to those that are tried, None = all of them
    Returns (Alternatives that were not tried, Alternatives that are impossible).
    """
    for one in (*evidences, *held_out):
        if not is_free(one.scene):
            raise InputError(f'{one.name}: its scene has pads or is quasi-static; must be a free '
                             'body with dynamics: implicit')
    known.evidences, known.held_out = tuple(evidences), tuple(held_out)
    priors, looks, every = FreePriors(), [], (*evidences, *held_out)
    for e in every:
        progress(SIGNALS, len(looks), len(every), e.name)
        looks.append(Look(prepare(e)))
    fitted, tested = looks[:len(evidences)], looks[len(evidences):]
    refuse_other_bodies([look.scene for look in looks])
    refuse_exchanged(every)
    scenes = with_damping(fitted, {look.scene.name: look.scene for look in looks})
    known.free = free = FreeKnown(fitted, tested)
    known.steps.append(SIGNALS)
    progress(MODEL, 0, 1, 'modulus')
    free.given = {name: free_specimen(scene) for name, scene in scenes.items()}
    study, free.specimens = _at_its_modulus(fitted, free.given, priors)
    free.study = study
    known.steps.append(MODEL)
    frees, dropped = _considered(free.specimens[fitted[0].scene.name],
                                 [look.scene for look in fitted],
                                 drifts_restart or len(looks) < 2, turned(fitted))
    answers = study.answers(frees if thin is None else thin(frees),
                            lambda done, of, name: progress(SCREEN, done, of, name))
    problem, absurd = possible(study, answers)
    free.answers, free.problem = answers, problem
    known.steps.append(SCREEN)
    return dropped, absurd


def _at_its_modulus(looks, given, priors):
    """(FreeStudy, name -> Specimen) at the modulus that the recordings ask for by full solutions.

    given : name -> Specimen as the scenes have it. How far a body sags goes as one over its
    modulus: answers taken at one that is 30 % off are 30 % off and more.
    """
    study = _study(looks, given, priors)
    _refuse_other_size(study)
    study.place_markers()
    try:
        ratio = refit(study, study.problem((), mesh=False)).stiffness(1.0).value
    except NotConverged:
        return study, given
    scenes = {name: scaled(one.scene, ratio) for name, one in given.items()}
    if all(scenes[name] is one.scene for name, one in given.items()):
        return study, given
    specimens = {name: free_specimen(scene) for name, scene in scenes.items()}
    study = _study(looks, specimens, priors, -np.log(ratio) / priors.modulus)
    study.place_markers()
    return study, specimens


def _refuse_other_size(study):
    """Raise RecordingError if a body goes 30 times as far as its model, or a thirtieth of it."""
    settled = np.array([row.kind == SETTLED for row in study.rows])
    for case in study.cases:
        mine = settled & np.array([row.recording == case.release.name for row in study.rows])
        seen, made = (1e3 * np.sqrt(np.mean(v[mine] ** 2)) for v in (study.values, study.start))
        if not seen / OUT_OF_SCALE <= made <= seen * OUT_OF_SCALE:
            raise RecordingError(
                f'{case.release.name}: let go its markers go {seen:.2g} mm (rms per axis), in '
                f'scene {case.scene} {made:.2g} mm; record from the hold to the rest, and give '
                'gravity, loads and modulus of the scene it was made with')


def _study(looks, specimens, priors, given=0.0):
    mine = {look.scene.name: specimens[look.scene.name] for look in looks}
    cases = [look.case(mine[look.scene.name], priors) for look in looks]
    return FreeStudy(cases, mine, priors, max(c.hand.placement for c in cases), given=given,
                     scenes=[one.scene for one in specimens.values()],
                     undamped={look.scene.name for look in looks if unknown(look.scene)})


def turned(looks):
    """True if the body hung another way in some of them: their frames are not one world's."""
    return len({tuple(look.scene.gravity) for look in looks}) > 1


def _considered(specimen, scenes, drifts, turned):
    """(frees, Alternatives dropped): without those that drift unless `drifts`.

    turned : True where the body hung in several ways: no tilt is the same in all
    """
    frees = tuple(f for f in free_hypotheses(specimen, scenes)
                  if not (turned and f.hypothesis.name == 'gravity'))
    if drifts:
        return frees, ()
    return (tuple(f for f in frees if f.hypothesis.name not in DRIFTS),
            tuple(Alternative((name,), 0.0, why=AFRESH) for name in DRIFTS))


def possible(study, answers):
    """(Problem, Alternatives dropped): without variants that would need an impossible value."""
    problem = study.problem(answers)
    kept = [a for a in answers if a.free.allows(_alone(problem, a))]
    names = {a.free.hypothesis.name for a in kept}
    lost = dict.fromkeys(a.free.hypothesis.name for a in answers
                         if a.free.hypothesis.name not in names)
    explanations = tuple(e for e, a in zip(problem.explanations, answers, strict=True)
                         if any(a is one for one in kept))
    return (replace(problem, explanations=explanations),
            tuple(Alternative((name,), 0.0, why=ABSURD) for name in lost))


def _alone(problem, answer):
    """(p,) amplitudes that the data want of a cause alone."""
    U = np.hstack([answer.columns, problem.U])
    return posterior(U, problem.r).mean[:answer.columns.shape[1]] * answer.free.prior
