"""Does a pad go as the marker on it does? Tissue and forces tell, once there is a model.

What such a marker shows of gain, yield or direction holds for the pad only while the two are one
rigid body that does not turn. On a pad that rocks, or on a post that bends, a marker goes aside
and falls short by itself; a model that takes its path for the pad's is then worse off everywhere
else.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from arm_brachy.diagnosis.isolation.handover import term_of
from arm_brachy.diagnosis.likelihood.tolerances import change_by
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.diagnosis.selection.problem import stacked_nuisances
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.signals.load_states import unseen
from arm_brachy.diagnosis.signals.stream import OPTICAL

TOLD = ('actuator_gain', 'actuator_compliance', 'pad_misplacement')     # by markers on pads
NEAR = 0.5      # of all of it, as far as which tissue and forces may show another share
UNEVEN = 0.01   # probability of the shares of all kinds of push, below which they are not one
ACROSS = 0.34   # cosine to its lever, up to which a marker's own motion is a turn about its pad


@dataclass(frozen=True)
class Astray:
    """Pads whose markers go another way than they do.

    pads : names;  share : of what the markers say by which tissue and forces show that it is not
        so: 0 = the pads go as their markers, 1 = as the scene says;  sd : of it
    lead : log likelihood by which the scene's way is ahead
    """

    pads: tuple
    share: float
    sd: float
    lead: float


def astray(matched, opened):
    """Astray of every group of pads whose markers tissue and forces gainsay; a tuple.

    matched : match.Matched with what markers are certain of in their models, of one body
    opened : per Matched the terms that they found and are not certain of: not in its model
    The motion without all that is played to all streams but the markers on those pads, beside
    nuisances and errors of the mesh. Valid where what else is missing does less than that: where
    it does more, kinds of push differ in the share that they show, and none goes astray.
    Test: diagnosis/test_astray.py, test_diagnose.py
    """
    names = matched[0].baseline.model.specimen.pads
    groups = {told_of(term, names) for m, some in zip(matched, opened, strict=True)
              for term in (*m.baseline.model.terms, *some)} - {()}
    U = stacked_nuisances(matched)[0] if groups else None
    found = (_asked(matched, opened, U, group) for group in sorted(groups))
    return tuple(one for one in found if one is not None and one.lead >= Rules().certain
                 and abs(one.share - 1.0) < NEAR)


def told_of(term, names):
    """Names of the pads whose path by their markers a term is, () if it is no such term.

    names : of all pads, in the order of the actuators
    """
    if term.spec.name not in TOLD:
        return ()
    if term.spec.name == 'pad_misplacement':
        return (term.pads or names) if term.tilt_up or term.tilt_side else ()
    return tuple(names[i] for i in term.actuators) or names


def _asked(matched, opened, U, group):
    """The Astray of a group of pads, None where nothing but their markers shows it."""
    ways = [_ways(m, some, group) for m, some in zip(matched, opened, strict=True)]
    e, r = (np.concatenate(some) for some in zip(*ways, strict=True))
    kept = np.concatenate([_others(m, group) for m in matched])
    U, e, r = U[kept], e[kept], r[kept]
    power, shown = _shown(U, e, r)
    kinds = np.concatenate([m.kinds for m in matched])[kept]
    if power <= 0.0 or _uneven(np.array([_shown(U[some], e[some], r[some]) for some in
                                         (kinds == kind for kind in np.unique(kinds))])):
        return None
    return Astray(group, float(shown / power), float(power ** -0.5), float(shown - power / 2.0))


def _shown(U, e, r):
    """(power of a change e, how much of it a residual r shows) beside nuisances U."""
    beside = np.linalg.solve(np.eye(U.shape[1]) + U.T @ U, U.T @ np.column_stack([e, r]))
    return e @ (np.column_stack([e, r]) - U @ beside)


def _uneven(kinds):
    """True if the shares that kinds of push show are not one; kinds : (k, 2) of `_shown` each."""
    power, shown = kinds[kinds[:, 0] > 0.0].T
    share = shown / power
    spread = float(np.sum(power * (share - shown.sum() / power.sum())**2))
    return bool(chi2.sf(spread, max(len(share) - 1, 1)) < UNEVEN)


def _ways(m, opened, group):
    """(change (N,) from the way of the markers to the scene's, residual (N,) by the markers)."""
    names = m.baseline.model.specimen.pads
    given, more = ([term for term in terms if told_of(term, names) == group]
                   for terms in (m.baseline.model.terms, opened))
    added = m.observables.whiten_shift(change_by(m.baseline, more))
    return -m.observables.whiten_shift(change_by(m.baseline, given)) - added, m.r - added


def _others(m, group):
    """(N,) True for rows that are no marker on a pad of the group."""
    optical = m.recorded.prepared.evidence.get(OPTICAL)
    theirs = optical.named(*group) if optical is not None else ()
    return np.array([not (row.kind == OPTICAL and row.channel in theirs)
                     for row in m.observables.rows], dtype=bool)


def unled(recorded, found):
    """The Recorded without what markers say that go astray; these are not compared any more.

    found : Astray each. Each such marker becomes a finding without a term.
    """
    names, kept, added, gone = recorded.prepared.evidence.pads, [], [], []
    for finding in recorded.structure.findings:
        led = [one for one in found if _by_markers_on(one.pads, finding, names)]
        kept += [] if led else [finding]
        gone += [one for one in led if one not in gone]
    if not gone:
        return recorded
    for one in gone:
        added += [_finding(recorded, travel, one) for travel in recorded.structure.pads
                  if travel.pad in one.pads]
    optical = recorded.prepared.evidence.get(OPTICAL)
    theirs = optical.named(*(pad for one in gone for pad in one.pads))
    return replace(recorded, structure=replace(recorded.structure, findings=(*added, *kept)),
                   states=unseen(recorded.states, OPTICAL, theirs))


def _by_markers_on(pads, finding, names):
    """True if a Finding says how some of these pads go, by the markers on them."""
    told = told_of(term_of(finding), names) if finding.term in TOLD else ()
    return bool(told) and set(told) <= set(pads)


def _finding(recorded, travel, one):
    """That the marker of a pad_tracking.PadTravel goes another way than its pad, an Astray."""
    off = np.array([travel.gain[0], *travel.tilt])
    size = float(np.linalg.norm(off))
    return Finding(OPTICAL, travel.marker, None, '', size, '1', 0.0,
                   float(np.sqrt(2.0 * one.lead)), *map(float, recorded.prepared.evidence.span),
                   f'The marker on {travel.pad} departs from the push by {100.0 * size:.0f} % of '
                   'it, but tissue and forces answer as to a pad that goes as the scene says: '
                   f'{_turn(recorded, travel, off)}neither a gain nor a direction of its push. '
                   'The marker was not compared with the model.')


def _turn(recorded, travel, off):
    """How fast a pad turns whose marker departs so, in words; '' if a turn does not do that."""
    optical = recorded.prepared.evidence.get(OPTICAL)
    pad = next(pad for pad in recorded.prepared.evidence.scene.pads if pad.name == travel.pad)
    lever = optical.rest[optical.names.index(travel.marker)] - np.array(pad.centre)
    aside = travel.frame.T @ off
    length, size = np.linalg.norm(lever), np.linalg.norm(aside)
    if length == 0.0 or abs(lever @ aside) > ACROSS * length * size:
        return ''
    rate = np.degrees(1e-3 * size / length)
    return (f'it moves as on a pad that turns by {rate:.2f} deg per mm of its travel about its '
            'centre, ')
