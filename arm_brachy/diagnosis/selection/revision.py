"""From everything tried to a decision: the mesh and the noise are asked first whether it was them.

Test: diagnosis/test_diagnose.py, diagnosis/test_loudness.py, diagnosis/test_mesh_fault.py
"""

from dataclasses import dataclass
from operator import methodcaller

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.likelihood.discretisation import SYSTEMATIC
from arm_brachy.diagnosis.progress import FITS, Count, untold
from arm_brachy.diagnosis.selection.full_fits import FullFits
from arm_brachy.diagnosis.selection.judge import Decision, Judge, fits_ahead
from arm_brachy.diagnosis.selection.marker_placement import reglued, with_places_apart
from arm_brachy.diagnosis.selection.marker_placement import said as said_of_places
from arm_brachy.diagnosis.selection.mesh_check import ALLOWED, MeshFault, mesh_fault
from arm_brachy.diagnosis.selection.mesh_convergence import at_limit
from arm_brachy.diagnosis.selection.mesh_convergence import said as said_of_limit
from arm_brachy.diagnosis.selection.noise_scale import louder, said
from arm_brachy.diagnosis.selection.problem import Assembly, assemble
from arm_brachy.diagnosis.selection.screening import try_all
from arm_brachy.diagnosis.selection.transient_force import passing
from arm_brachy.tissue.terms.external_force import ExternalForce


@dataclass(frozen=True)
class Judgement:
    """assembly, fits, decision : what was decided, on what;  tests : Matched, held out
    at_limit : True if the model was taken to the limit of finer elements
    fault : MeshFault, None where the mesh is good enough;  notes : sentences
    """

    assembly: Assembly
    fits: FullFits
    decision: Decision
    tests: tuple
    fault: MeshFault | None
    notes: tuple
    at_limit: bool = False


def judged(matched, tests, tried, sound, seed, accuracy=None, limit=None, progress=untold,
           known=None):
    """The Judgement of Matched recordings and what was tried (`screening.try_all`) on them.

    tests : Matched, held out: what is found of mesh and noise holds for them as well
    limit : discretisation.Limit of their body, None = not known
    sound : number of null recordings, last of `matched`;  accuracy : discrepancy.Accuracy
    progress : as in `progress`, of the step FITS;  known : stages.Known that is kept up to date
    What nothing explains, or one cause leaves, is judged anew with noise as loud as it may be.
    """
    ends, count = {}, Count(progress, FITS, 0)
    progress(FITS, 0, 0, 'products of sensitivities')

    def judge(matched, quiet=None):
        assembly = assemble(matched, tried, sound)
        fits = FullFits(assembly, stream(seed, 'adequacy'), accuracy, ends, quiet, count)
        if known is not None and quiet is None:
            known.assembly, known.fits = assembly, fits
        return assembly, fits, Judge(assembly.problem, stream(seed, 'decision'), check=fits.check,
                                     gone=fits.gone, weigh=fits.gain, beyond=fits.beyond)

    assembly, fits, one = judge(matched)
    moved = {}
    while more := reglued(matched, one):
        moved |= more
        matched, tests = ([with_places_apart(m, sum(more.values(), [])) for m in some]
                          for some in (matched, tests))
        assembly, fits, one = judge(matched)
    fault, notes = mesh_fault(matched, one.singles()[0].evidence), said_of_places(moved)
    if fault is not None and not fault.material:
        fault, notes = None, (*notes, fault.note)
    finer = at_limit(matched, limit) if fault is None else None
    if fault is not None:
        for test in tests:
            test.loosen(SYSTEMATIC, ALLOWED)
    if finer is not None:
        matched, tests = finer, [test.at_limit(limit) for test in tests]
        notes = (*notes, said_of_limit(finer))
    if fault is not None or finer is not None:
        assembly, fits, one = judge(matched)
    spans = None if fault is not None else _spans(assembly, one)
    if spans is not None:
        tried = tried.more(try_all(matched, spans, terms=(ExternalForce,)))
        assembly, fits, one = judge(matched)
    count.expect(fits_ahead(one))

    def once_more(factors, quiet=fits):
        found = judge(_louder(matched, factors), quiet)
        count.expect(fits_ahead(found[-1]))
        return found

    again = _once(once_more)
    factors, (assembly, fits, one) = _noise_beside((assembly, fits, one), again)
    decision = one.decide()
    if not factors and decision.verdict == 'unexplained' and decision.unproven is None:
        factors = louder(assembly, [e for c in decision.ranked[:1] for e in c.explanations])
        if factors:
            assembly, fits, one = again(factors)
            decision = one.decide()
    if factors:
        tests, notes = _louder(tests, factors), (*notes, *said(factors))
    return Judgement(assembly, fits, decision, tuple(tests), fault, notes, finer is not None)


def _spans(assembly, judge):
    """candidates.Occasions of a force that passes and stands out from all else; None = none."""
    found = passing(assembly, judge.singles()[0].evidence)
    return None if found is None else found.occasions


def _louder(matched, factors):
    return [one.louder(factors) for one in matched]


def _once(judge):
    """factors -> what is judged with noise as loud, made once: full fits there take minutes."""
    known = {}

    def again(factors):
        key = tuple(sorted(factors.items()))
        if key not in known:
            known[key] = judge(factors)
        return known[key]

    return again


def _noise_beside(quiet, again):
    """(`louder` factors of the noise beside which nothing is left, what is judged with it so).

    quiet : (Assembly, FullFits, Judge), returned with {} where noise as loud makes no difference
    again : factors -> the same with noise as loud
    Nothing is left by one cause, or by none where none stands out: first by one that is far ahead
    of all others, then by the best once all that promise most are fitted in full. What is left
    without them would be put down to a second cause, or to nothing that is known.
    """
    for best in (methodcaller('outstanding'), methodcaller('alone')):
        found = best(quiet[-1])
        if found is None:
            continue
        if found[1].chance >= quiet[-1].rules.alarm:
            break
        factors = louder(quiet[0], found[0])
        loud = again(factors) if factors else None
        then = loud and best(loud[-1])
        if then and then[1].chance >= loud[-1].rules.alarm:
            return factors, loud
    return {}, quiet
