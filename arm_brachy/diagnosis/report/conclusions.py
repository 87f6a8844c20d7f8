"""From a decision to the parts of an answer: causes, places, times, what lost, what is left."""

from dataclasses import replace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from arm_brachy.diagnosis.estimation.cross_validation import stream_fits
from arm_brachy.diagnosis.estimation.fit import AS_FOUND, CHORD, parts_of, tested_part
from arm_brachy.diagnosis.isolation.handover import onsets_in
from arm_brachy.diagnosis.likelihood.nuisances import MODULUS
from arm_brachy.diagnosis.report.localisation import (
    CENTRES,
    marker_place,
    place_of,
    places_of_test,
)
from arm_brachy.diagnosis.report.occasions import intervals, shown_in
from arm_brachy.diagnosis.results.cause import Estimate
from arm_brachy.diagnosis.results.parts import Alternative, Nearest
from arm_brachy.diagnosis.selection.pad_rotation_tests import Turn
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.diagnosis.statistics.linear_gaussian import TO_90, detectability, posterior

VISIBLE = 3.0       # standard deviations that an effect of typical size must make to be seen
MOST = 12           # alternatives that are told
LOUD = 1e-3         # chance of noise, of all markers, below which one shows more than that
WIDTHS = (1, 5, 15)     # states
TOLD = 0.5          # of its prior: a modulus less sure than that was not measured


def probabilities(decision):
    """(p of the accepted, p of each equal), by evidence; nothing missing has evidence 0."""
    every = np.array([decision.accepted.evidence, *(c.evidence for c in decision.equals), 0.0])
    share = np.exp(every - logsumexp(every))
    return share[0], share[1:-1]


def places_of(fitted, scene):
    """statements.Place of every term of a fit.Fitted, None for one that is nowhere."""
    spreads = {} if fitted.refit is None else _spreads(fitted)
    return tuple(place_of(term, scene, spreads.get(i)) for i, term in enumerate(fitted.terms))


def options_of(decision, fits, scene, onsets):
    """(causes, places) of what was accepted and of what equals it, options numbered from 1.

    fits : full_fits.FullFits;  onsets : as of `handover.onsets_in`, of all recordings
    A cause that all options share holds in any case: it is told once, without a number, as it was
    fitted in the likeliest.
    """
    if decision.accepted is None:
        return (), ()
    first, others = probabilities(decision)
    causes, places = [], []
    for number, (one, share) in enumerate(zip((decision.accepted, *decision.equals),
                                              (first, *others), strict=True)):
        fitted = fits.of(one)
        for shared, cause, place in zip(decision.shared(one), fitted.causes(share),
                                        places_of(fitted, scene), strict=True):
            if shared and number:
                continue
            option = 0 if shared or not decision.equals else number + 1
            sure = min(float(first + np.sum(others)), 1.0) if shared else cause.probability
            causes.append(replace(_begun(cause, onsets), probability=sure, option=option))
            places += [] if place is None else [replace(place, option=option)]
    return tuple(causes), tuple(places)


def _begun(cause, onsets):
    """The Cause with the interval of its onset, where that was seen; onsets : as of `options_of`.

    A fit at single states leaves an onset as it was given.
    """
    onset = cause.parameters.get('onset')
    if onset is None or onset.value not in onsets:
        return cause
    return replace(cause, parameters={**cause.parameters,
                                      'onset': Estimate(onset.value, *onsets[onset.value])})


def _spreads(fitted):
    """Number of the hypothesis -> (3, 3) [m^2] covariance of its centre, from a fit.Fitted."""
    out, fit = {}, fitted.refit
    for chart, part in zip(fit.space.charts, fit.space.slices, strict=True):
        if chart.field in CENTRES:
            z, steps = fit.z[part], np.diag(chart.step)
            slope = np.stack([np.subtract(chart.value(z + h), chart.value(z - h)) / (2 * h.max())
                              for h in steps], axis=1)
            out[chart.number] = slope @ fitted.covariance[part, part] @ slope.T
    return out


def nearest_of(assembly, decision, fits, ratio, tests):
    """statements.Nearest of a judge.Decision that nothing explains all of; None if none.

    fits : full_fits.FullFits;  ratio : as of `parts_of`;  tests : Matched recordings held out
    """
    if decision.nearest is None:
        return None
    fitted = fits.of(decision.nearest)
    scene = assembly.matched[0].baseline.model.specimen.scene
    places = [one for one in places_of(fitted, scene) if one is not None]
    errors = () if fitted.refit is None else errors_of(assembly, fitted, ratio, tests)
    return Nearest(fitted.causes(0.0), tuple(places), errors)


def errors_of(assembly, fitted, ratio, tests):
    """statements.StreamFit on what was held out; arguments as of `nearest_of`.

    fitted : Fitted of what was found, None = nothing
    What null recordings show the mesh to be wrong by is taken off: it may be more than any cause.
    """
    parts = parts_of(assembly, fitted, ratio, numbers=AS_FOUND if tests else CHORD)
    tested = [tested_part(assembly, m, fitted, ratio) for m in tests]
    if assembly.sound:
        parts, tested = ([part.beside_mesh() for part in some] for some in (parts, tested))
    return stream_fits(parts, list(zip((m.recorded.name for m in tests), tested, strict=True)))


def times_of(assembly, candidate):
    """statements.Interval in which each cause of a judge.Candidate shows."""
    out, first = [], 0
    for one in candidate.explanations:
        began = assembly.hypothesis_of(one)[0].place.get('onset')
        width = one.columns.shape[1]
        effect = one.columns @ candidate.mean[first:first + width]
        first += width
        for m, rows in split_rows(assembly, effect):
            out += intervals(m, shown_in(m, rows), term=one.cause,
                             onset=onsets_in(m.recorded).get(began))
    return tuple(out)


def split_rows(assembly, values):
    """(Matched, its part) of values (N,) over all recordings."""
    ends = np.cumsum([0, *(len(m.r) for m in assembly.matched)])
    return [(m, values[a:b]) for m, a, b in
            zip(assembly.matched, ends[:-1], ends[1:], strict=True)]




def unexplained(assembly, worst, left):
    """(places, intervals) of what is left (N,); worst : number of the test that stands out.

    What all channels show together is where its test says, single markers say nothing; and when
    what is left does as the test has it.
    Else also where the markers are that show more than noise, and when that is in its channel.
    """
    label = assembly.tests[worst]
    if isinstance(label, Past | Turn):
        agreed = assembly.problem.tests[:, worst] * left
        return places_of_test(label), _times(assembly, np.sqrt(np.maximum(
            np.sign(agreed.sum()) * agreed, 0.0)))
    around = marker_place(assembly.matched[0].baseline.model.specimen.scene,
                          _beyond_noise(assembly, left))
    (kind, channel, _), _ = label
    there = [_steadier(m.observables.rows, rows, (kind, channel))
             for m, rows in split_rows(assembly, left)]
    return (*places_of_test(label), *([] if around is None else [around])), _times(
        assembly, np.concatenate(there))


def _steadier(rows, values, channel):
    """Sums (N,) of a channel's values over as many states as make them stand out most.

    rows : (N,) observation.Row;  channel : kind and name;  zero in all others
    Each sum is over the root of its number, as noise grows: a faint drift is in no single state.
    """
    series = {}
    for i, row in enumerate(rows):
        if (row.kind, row.channel) == channel:
            series.setdefault(row.axis, []).append(i)
    ways = []
    for width in WIDTHS:
        way = np.zeros(len(values))
        for mine in series.values():
            if len(mine) >= width:
                count = np.convolve(np.ones(len(mine)), np.ones(width), mode='same')
                way[mine] = np.convolve(values[mine], np.ones(width), mode='same') / np.sqrt(count)
        ways.append(way)
    return max(ways, key=lambda way: np.abs(way).max())


def _beyond_noise(assembly, left):
    """Marker -> by how much the squares of what is left (N,) are more than noise makes them."""
    squares = {}
    for m, rows in split_rows(assembly, left):
        for row, value in zip(m.observables.rows, rows, strict=True):
            if row.kind == OPTICAL:
                squares.setdefault(row.channel, []).append(value**2)
    return {name: sum(some) - len(some) for name, some in squares.items()
            if chi2.sf(sum(some), len(some)) < LOUD / len(squares)}


def _times(assembly, values):
    """statements.Interval in which values (N,) are large, in every recording that may lack it."""
    suspects = split_rows(assembly, values)[:len(assembly.matched) - assembly.sound]
    return tuple(one for m, rows in suspects for one in intervals(m, shown_in(m, rows)))


def said_of(label):
    """Sentences on a structured test that stands out, by its label, beside its place; a tuple."""
    return (label.said,) if isinstance(label, Past | Turn) else ()


def alternatives_of(assembly, decision, named=()):
    """statements.Alternative that lost, best first; those that could not be seen come last.

    named : terms that were not lost
    """
    lost = [one for one in decision.ranked if not set(one.causes) & set(named)]
    parts = [np.hstack([e.columns for e in one.explanations]) for one in lost]
    sizes = np.split(detectability(assembly.problem.U, np.hstack(parts)),
                     np.cumsum([part.shape[1] for part in parts])[:-1]) if lost else ()
    out = [Alternative(one.causes, one.held_out, bool(size.max() >= VISIBLE))
           for one, size in zip(lost, sizes, strict=True)]
    out.sort(key=lambda a: (not a.visible, -a.held_out))
    untried = [Alternative((term,), 0.0, False, f'not tried: {why}')
               for term, why in assembly.tried.left_out.items()
               if term not in named and 'recalibrated' not in why]
    return (*out[:MOST], *untried)


def recalibrated(assembly, scene, explanations, spread, scale=None):
    """{'E': Estimate [Pa]} of a core.scene.Scene's modulus; {} where nothing recorded tells it.

    spread : prior standard deviation of its logarithm, to which its nuisance is scaled
    scale : Estimate of it over that of the scene by a full fit, None = by the linear answer
    """
    problem = assembly.problem
    U = np.hstack([problem.U, *(e.columns for e in explanations)])
    column = assembly.names.index(MODULUS)
    fit = posterior(U, problem.r)
    sd = float(np.sqrt(fit.covariance([column])[0, 0]))
    if sd > TOLD:
        return {}
    if scale is not None:
        return {'E': Estimate(*(float(scene.material.E * v) for v in
                                (scale.value, scale.low, scale.high)))}
    value, reach = 1.0 + spread * fit.mean[column], TO_90 * spread * sd
    E = scene.material.E
    return {'E': Estimate(*(float(E * v) for v in (value, value - reach, value + reach)))}
