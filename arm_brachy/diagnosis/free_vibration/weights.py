"""Weights that hang on a released body: full fits, as a response says little of one.

A weight of half the body's own bends a beam as far again and halves its frequency: no tangent at
the modulus that fits without it leads there. Each place is fitted in full, and its column is the
chord from no weight to there: what is decided by responses is decided on what the weight does.
Test: diagnosis/test_free_body.py
"""

from dataclasses import replace

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.free_vibration.fit import refit
from arm_brachy.tissue.terms.point_mass import PointMass

LEAST = 0.02    # prior standard deviations of a mass: less is none


def with_weights(study, problem, answers, count):
    """Return `answers` with those of point_mass led through their full fits.

    study : problem.FreeStudy;  problem : judge.Problem of its;  answers : Answer each
    count : progress.Count of full fits
    A place where no weight fits better than none is left out: its tangent would mislead.
    """
    heavy = [a.free.hypothesis.cls is PointMass for a in answers]
    count.expect(sum(heavy))
    led = []
    for answer, weight in zip(answers, heavy, strict=True):
        if weight:
            count.begin(answer.free.hypothesis.name)
            answer = _through(study, problem, answer)
            count.finish()
        led.append(answer)
    return tuple(a for a in led if a is not None)


def _best(study, problem, free):
    """The FreeFit that costs least, of those that are found; None if none is.

    It is looked for from no weight at the modulus that fits without, and from a weight at the
    modulus expected: all of the scene's that hangs there taken away, else one of usual size.
    """
    fits = [_fit(study, problem, free, *start) for start in (
        (0.0, 0.0), (_usual(study, free), study.given))]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)


def _usual(study, free):
    """Mass to start from, prior standard deviations."""
    strength, = free.hypothesis.strengths
    there = [load.mass for specimen in study.specimens.values() for load in specimen.scene.loads
             if tuple(load.position) == free.hypothesis.place['centre']
             and free.scene in ('', specimen.scene.name)]
    return -max(there) / (strength.typical * free.prior[0]) if there else 1.0


def _fit(study, problem, free, mass, modulus):
    try:
        return refit(study, problem, (free,), (mass,), modulus)
    except NotConverged:
        return None


def _through(study, problem, answer):
    """The Answer whose column leads from nothing to its fit, what the modulus does taken out.

    None where nothing hangs in the best fit, or none is found.
    """
    fit = _best(study, problem, answer.free)
    if fit is None or abs(fit.mean[0]) < LEAST:
        return None
    moved = study.residual() - fit.residual - problem.U[:, -1] * fit.mean[-1]
    return replace(answer, columns=moved[:, None] / fit.mean[0], fit=fit)
