"""Causes of an answer that findings without a tissue model make, beside those of a decision.

Test: diagnosis/test_from_finding.py
"""

from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.report.finding_estimates import (
    cause_of,
    interval_of,
    merged,
    options_of,
    place_of,
)
from arm_brachy.registry import by_name


def said_of_faint(found):
    """One note for each faint finding of a handover.Given."""
    return [f'{name}: {finding.statement} That may be chance (probability of a fault '
            f'{finding.probability:.2f}): no cause is told from it.'
            for finding, name in found.faint]


def _leads(decision):
    """Names of the causes that explain most where none explains all."""
    if decision is None:
        return set()
    unsure = decision.verdict == 'unexplained' and decision.ranked
    return set(decision.ranked[0].causes) if unsure else set()


def with_findings(found, scene, causes, where, when, decision):
    """The parts of the answer with those that findings make, one cause per term and place.

    found : handover.Given;  scene : core.scene.Scene;  causes, where, when : of the answer so far
    decision : judge.Decision, None = nothing was decided. Returns causes, where, when as lists.
    One that has rivals is told unless the comparison with the model named one of them, or that
    leads where nothing explains all: as a class with those that no model could have told from it,
    if nothing else is one.
    """
    causes, where, when, seen, split = list(causes), list(where), list(when), set(), None
    told = {cause.term for cause in causes}
    known = told | _leads(decision)
    sure = [*found.certain, *((f, name) for f, name in found.open if f.sure
                              and f.term not in told and not known & set(f.rivals))]
    for finding, name in sure:
        key = (finding.term, finding.channel, finding.parameter)
        if key in seen:
            when.append(interval_of(finding, name))
            continue
        seen.add(key)
        alike = _alike(finding)
        options = [(cause_of(finding, finding.probability / (1 + len(alike))), finding)]
        if alike and ((finding.term, alike) == split or _may_be_class(decision, causes)):
            split = finding.term, alike     # of several pads: all have the one or the other
            options = options_of(finding, alike, finding.probability)
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
    return (decision is not None and decision.verdict in ('named', 'nothing_missing')
            and not any(c.option for c in causes))
