"""Do markers and tools sit in all recordings where they sit in the first? Glued anew they do not.

Recordings of one set-up share the places of markers, which is how one in which nothing is wrong
tells of a sag. A cell that was cleaned and glued anew between two of them moves every marker its
own way; no cause does, but the best of them fits some of it, with any evidence. Then every
recording has places of its own: of what was glued anew, or of all where it was more than one kind.
Test: diagnosis/test_reglued.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.likelihood.match import APART
from arm_brachy.diagnosis.results.formatting import listed
from arm_brachy.diagnosis.signals.stream import BASE, EM, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, evidence_over_none

# Share of the evidence for the best cause that its response, being linear, may leave to anything:
# a seventh of its effect.
BENT = 0.02
# Kinds of things that were seen to be glued anew from which on all were: a laboratory that was
# cleaned. What the others show at rest is then no cause's either.
SEVERAL = 2
# Share of it below which a full fit may still have what a response leaves: a third of the effect.
CURVED = 0.1


def reglued(matched, judge):
    """Names of the places that are each recording's own, {} = none, by what they are on.

    matched : Matched each;  judge : judge.Judge of them, for the cause beside which places of
        their own have to explain something
    What another shape of the body does to markers is no small effect: where its response leaves
    little to the places, they have to do better than its full fit.
    """
    groups, problem = _groups(matched[0]), judge.problem
    if len(matched) < 2 or not groups:
        return {}
    best = next(iter(judge.singles()), None)
    cause = np.hstack([e.columns for e in best.explanations]) if best else problem.U[:, :0]
    apart = {on: _own_copies(matched, names) for on, names in groups.items()}
    X = np.hstack([cause, *apart.values()])
    weighted = Beside(problem.U).weighted(np.column_stack([X, problem.r]))
    B, a = X.T @ weighted[:, :-1], X.T @ weighted[:, -1]
    owner = np.concatenate([['cause'] * cause.shape[1], *(
        [on] * columns.shape[1] for on, columns in apart.items())])
    cause_alone = _gain(B, a, owner == 'cause')
    least = judge.rules.certain + BENT * max(cause_alone, 0.0)
    needed = _needed(B, a, owner, list(groups), least)
    with_glue = _gain(B, a, np.isin(owner, ['cause', *needed]))
    if needed and with_glue - cause_alone < CURVED * with_glue:
        fitted = max(one.evidence for one in judge.weighed_singles())
        if with_glue - fitted < judge.rules.certain + BENT * max(fitted, 0.0):
            return {}
    return groups if len(needed) >= SEVERAL else {on: groups[on] for on in needed}


def _needed(B, a, owner, groups, least):
    """Those of the groups that none of the others makes up for: the idlest goes first, then anew.

    Where the tracker's frame is open, the tissue that moved as one and a pad that did are alike:
    each by itself could go.
    """
    def gain(some):
        return _gain(B, a, np.isin(owner, ['cause', *some]))

    while groups:
        without = {on: gain([one for one in groups if one != on]) for on in groups}
        idlest = max(without, key=without.get)
        if gain(groups) - without[idlest] >= least:
            break
        groups = [one for one in groups if one != idlest]
    return groups


def with_places_apart(m, names):
    """The Matched with places of these names as its own."""
    return replace(m, nuisances=named_apart(m.nuisances, names))


def named_apart(nuisances, names):
    """The Nuisances with those of these names as each recording's own."""
    return replace(nuisances, names=tuple(APART + name if name in names else name
                                          for name in nuisances.names))


def apart_in(m):
    """Names of places that are a Matched's own, as they were before."""
    return tuple(name.removeprefix(APART) for name in m.nuisances.names if name.startswith(APART))


def said(groups):
    """Sentences on what `reglued` found; none for {}."""
    if not groups:
        return ()
    moved = listed([_WORDS.get(on, f'markers on {on}') for on in groups])
    return (f'{moved[0].upper()}{moved[1:]} do not sit in all recordings where they sit in the '
            'first, as after gluing anew: what differs between recordings at rest is taken for '
            'that.',)


_WORDS = {TISSUE: 'markers on the tissue', BASE: 'markers on the base',
          EM: 'tools of the EM tracker'}


def _groups(m):
    """What markers or tools are on -> names of the nuisances of their places."""
    specimen, out = m.baseline.model.specimen, {}
    for marker, on in zip(specimen.markers, specimen.carriers, strict=True):
        out.setdefault(on, []).extend(f'{OPTICAL}_{marker}_{axis}' for axis in 'xyz')
    for tool in specimen.tools:
        out.setdefault(EM, []).extend(f'{EM}_{tool}_{axis}' for axis in 'xyz')
    left = set(m.nuisances.names)
    return {on: names for on, names in out.items() if left.issuperset(names)}


def _own_copies(matched, names):
    """(N, k) of all rows: these nuisances in every recording but the first by itself."""
    parts = [m.U[:, [m.nuisances.names.index(name) for name in names]] for m in matched]
    first = len(parts[0])
    out = np.zeros((sum(map(len, parts)), (len(parts) - 1) * len(names)))
    for i, part in enumerate(parts[1:]):
        out[first:first + len(part), i * len(names):(i + 1) * len(names)] = part
        first += len(part)
    return out


def _gain(B, a, chosen):
    """Log evidence of some columns over none; B, a : products of all, beside what may be there."""
    return evidence_over_none(B[np.ix_(chosen, chosen)], a[chosen])
