"""What a decision about released bodies says of causes, places and times.

Test: diagnosis/test_free_body.py
"""

import numpy as np
from scipy.special import logsumexp

from arm_brachy.diagnosis.free_vibration.observation import CREEP, SETTLED
from arm_brachy.diagnosis.free_vibration.problem import kind_of
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.parts import Alternative, Interval, Place
from arm_brachy.diagnosis.statistics.linear_gaussian import detectability, log_density, posterior

SEEN = 3.0          # standard deviations: a cause that could not move the data by that is not seen
FAR = -1e12         # less than any gain: rows of other recordings
TAIL = 0.05         # beyond either end of a 90 % interval


def weights(problem, answers, term):
    """[(Answer, probability)] of the variants of a term, after the data, likeliest first."""
    variants = [a for a in answers if a.free.hypothesis.name == term]
    gain = np.array([log_density(np.hstack([problem.U, a.columns]), problem.r) for a in variants])
    share = np.exp(gain - logsumexp(gain))
    return [(variants[i], float(share[i])) for i in np.argsort(-share)]


def cause_of(fit, i, alike, probability, option, scenes):
    """The Cause of the i-th free of a FreeFit.

    alike : [(Answer, probability)] of its variants: what was scanned gets its interval from them
    scenes : names of those in which alone it acts; () = all
    """
    free = fit.frees[i]
    parameters, place = fit.parameters(i), {}
    for name, value in free.hypothesis.place.items():
        if name.startswith('tau') or name == 'energy':
            parameters[name] = _scanned(name, value, free, alike)
        elif np.ndim(value) or isinstance(value, float):
            parameters[name] = Estimate.unsure(value)
        else:
            place[name] = value
    return Cause(free.hypothesis.name, parameters, place, probability, option, scenes)


def _scanned(name, value, free, alike):
    """Estimate of a parameter that was tried on a grid; it reaches half way to the next."""
    at = {}
    for answer, share in alike:
        place = answer.free.hypothesis.place
        if set(place) == set(free.hypothesis.place):
            at[place[name]] = at.get(place[name], 0.0) + share
    grid = np.array(sorted(at))
    below = np.cumsum([at[v] for v in grid]) / sum(at.values())
    low, high = (int(np.searchsorted(below, edge)) for edge in (TAIL, 1.0 - TAIL))
    high = min(high, len(grid) - 1)
    step = np.sqrt(grid[1] / grid[0]) if len(grid) > 1 else 1.0
    return Estimate(float(value), float(min(grid[low] / step, value)),
                    float(max(grid[high] * step, value)))


def place_of(cause, alike):
    """Place of a Cause: of one with a centre the middle and radius of its 90 % region."""
    if 'centre' in cause.parameters:
        points = np.array([a.free.hypothesis.place['centre'] for a, _ in alike])
        share = np.array([p for _, p in alike])
        middle = np.asarray(cause.parameters['centre'].value)
        away = np.linalg.norm(points - middle, axis=1)
        order = np.argsort(away)
        inside = np.searchsorted(np.cumsum(share[order]), 1.0 - 2.0 * TAIL)
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        spacing = np.median(np.partition(apart, 1, axis=1)[:, 1]) if len(points) > 1 else 0.0
        radius = max(float(away[order][min(inside, len(order) - 1)]), 0.5 * float(spacing))
        return Place(boundary=_surface(cause.term), position=tuple(map(float, middle)),
                     radius=radius, term=cause.term, option=cause.option)
    if cause.term in ('base_compliance',):
        return Place(boundary='base', term=cause.term, option=cause.option)
    return None


def in_one_scene(problem, answers, fits):
    """Sentences about causes of some FreeFits (None where there is none) in one scene alone.

    The same in another scene the other way, or in all, may be as likely where no modulus is known.
    """
    out = []
    alone = {free.key: free for fit in fits if fit for free in fit.frees if free.scene}
    for free in alone.values():
        share = {}
        for answer, p in weights(problem, answers, free.hypothesis.name):
            share[answer.free.scene] = share.get(answer.free.scene, 0.0) + p
        term, p = free.hypothesis.name.replace('_', ' '), share[free.scene]
        there = (f'in scene {free.scene} alone' if p > 1.0 - TAIL else f'likeliest in scene '
                 f'{free.scene} alone ({100.0 * p:.0f} %), else in another or in all')
        out.append(f'{term.capitalize()}: {there}.')
    return out


def _surface(term):
    return {'base_debond': 'base', 'external_force': 'surface',
            'point_mass': 'surface'}.get(term, '')


def explained(problem, columns):
    """(n,) by how much the square of each row falls once a cause is allowed for."""
    left = []
    for U in (problem.U, np.hstack([problem.U, columns])):
        left.append((problem.r - U @ posterior(U, problem.r).mean) ** 2)
    return left[0] - left[1]


def loudest(study, gain):
    """(stream, channel, Interval fields (recording, start, end)) where `gain` (n,) is largest."""
    kinds = sorted({(r.recording, kind_of(r)) for r in study.rows})
    total = {k: sum(g for r, g in zip(study.rows, gain, strict=True)
                    if (r.recording, kind_of(r)) == k) for k in kinds}
    channels = {}
    for row, g in zip(study.rows, gain, strict=True):
        if row.channel:
            channels[row.channel] = channels.get(row.channel, 0.0) + g
    recording, kind = max(total, key=total.get)
    return max(channels, key=channels.get), span(study, recording, kind)


def span(study, recording, kind):
    """(recording, start, end) [s] of the stretch that rows of a kind are of."""
    release = next(c.release for c in study.cases if c.release.name == recording)
    end = release.t + float(release.since[-1])
    if kind in (SETTLED, CREEP) or release.ring is None:
        return recording, release.t + float(release.times[0]), end
    return recording, release.t + float(release.ring.span[0]), release.t + release.ring.span[1]


def when(study, gain, term='', scenes=None):
    """Intervals, of every recording of `scenes` (None = all) the stretch that shows it most."""
    out = []
    for case in (c for c in study.cases if scenes is None or c.scene in scenes):
        mine = np.array([r.recording == case.release.name for r in study.rows])
        _, (name, start, end) = loudest(study, np.where(mine, gain, FAR))
        out.append(Interval(name, float(start), float(end), term=term))
    return tuple(out)


def alternatives(problem, decision, answers, dropped):
    """Alternatives that lost, best first; `dropped` : Alternative each, left out beforehand."""
    taken = set()
    for one in (decision.accepted, *decision.equals):
        taken |= set(one.causes) if one is not None else set()
    out = []
    for one in decision.ranked:
        if set(one.causes) & taken:
            continue
        columns = np.hstack([e.columns for e in one.explanations])
        most = detectability(problem.U, columns).max()
        out.append(Alternative(one.causes, one.held_out, visible=bool(most >= SEEN)))
    return (*out, *dropped)
