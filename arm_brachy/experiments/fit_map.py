"""Sizes of MAP's prior: the model is linearised once for every push, the rest is closed form."""

import sys
from dataclasses import fields, replace

import numpy as np

from arm_brachy.estimation.map_update import Point, hypotheses, in_all, target_state, update
from arm_brachy.estimation.mixture import Mixture
from arm_brachy.estimation.unknowns import PriorParams
from arm_brachy.experiments import fit_cases, inside_estimators, inside_plants, inside_study

FACTORS = (1.5,)               # of a size, up and down, one for each round of the search
OTHERS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
TRUST = (1.0, 0.5, 0.25)
PRIORS = ('modulus', 'bulk', 'fibres', 'base', 'offset', 'tilt', 'travel', 'force', 'faces')
LOCALS = ('marker_local', 'target_local')
# In this order. The other sizes stay at START, where an earlier fit on 24 plants left them: four
# plants of a kind do not tell the size of that kind (README of estimation, section 4).
SEARCHED = ('faces', 'others')
# Where the search begins, whatever the defaults are; at the edges' units.
START = {'modulus': 0.12, 'bulk': 1.4, 'fibres': 0.11, 'base': 0.56, 'offset': 0.8, 'tilt': 1.2,
         'travel': 0.05, 'force': 250.0, 'faces': 0.1, 'marker_local': 0.55,
         'target_local': 0.45, 'others': 0.25, 'trust': 1.0, 'inflation': 1.0}


def start():
    """MapParams at START."""
    params = inside_estimators.entry('map').params
    for name, value in START.items():
        params = _changed(params, name, value * _infos(params)[name].scale)
    return params


class Linearised:
    """Every Case with the model linearised at its travel, all priors of one estimator's size."""

    def __init__(self, some):
        """some : list of Case."""
        model = inside_plants.model_scene()
        entry, names = inside_estimators.entry('map'), inside_plants.tissue_markers(model)
        self.params, self.cases = start(), some
        built = entry.build(model, (), inside_plants.target_names(model), names, self.params)
        self.unknowns, self._points, before = built.unknowns, [], None
        for i, case in enumerate(some):
            if (case.fresh.number, case.push) != before:
                built.reset()   # from rest, whatever was solved before
            before = case.fresh.number, case.push
            self._points.append(_of_markers(built.linearised(case.last.q), case.count))
            if i % 16 == 15:
                print(f'map: {i + 1} of {len(some)} linearised', file=sys.stderr)

    def predictions(self, params):
        """(points, covariances) of each Case with other MapParams, inflation 1."""
        ratio, plain = self._ratio(params.prior), replace(params, inflation=1.0)
        keep = self.unknowns.part('load').start     # nothing but pads loads a fresh plant
        scale = hypotheses(self.unknowns, params.others)
        scale = scale[~scale[:, keep:].any(axis=1), :keep]
        found = []
        for case, at in zip(self.cases, self._points, strict=True):
            at = replace(at, response=(at.response * ratio)[:, :keep], theta=at.theta[:keep],
                         loads=0)
            state, _ = update(at, case.last, Mixture.prior(in_all(scale, at.markers)), plain)
            points, spread = target_state(at, state, plain)
            found.append((points, fit_cases.blocks(spread)))
        return found

    def _ratio(self, prior):
        """(k,) sds of `prior` over those that the responses were computed with."""
        was, unknowns = self.params.prior, self.unknowns
        ratio = np.ones(unknowns.count)
        for part, name in (('modulus', 'modulus'), ('bulk', 'bulk'), ('fibres', 'fibres'),
                           ('base', 'base'), ('slides', 'offset'), ('force', 'force'),
                           ('faces', 'faces')):
            ratio[unknowns.part(part)] = getattr(prior, name) / getattr(was, name)
        ratio[unknowns.part('pads')] = np.tile(
            [getattr(prior, n) / getattr(was, n) for n in ('travel', 'tilt', 'tilt')],
            unknowns.part('pads').stop // 3 - unknowns.part('pads').start // 3)
        return ratio

    def judged(self, params):
        """fit_cases.Judgement of MapParams."""
        return fit_cases.judge(self.cases, self.predictions(params))


def _of_markers(at, count):
    """The Point of all markers with those of one of MARKER_SETS only."""
    chosen = np.arange(at.markers)[inside_study.MARKER_SETS[count]]
    keep = np.concatenate([chosen, np.arange(at.markers, len(at.points))])
    rows = (3 * keep[:, None] + np.arange(3)).ravel()
    return Point(at.theta, at.q, at.points[keep], at.response[rows], at.strain[keep],
                 len(chosen), loads=at.loads)


def fit(linearised, start, report=sys.stderr):
    """MapParams of least nlpd, by coordinate search from `start`; returns (params, Judgement).

    Every size of SEARCHED is tried at FACTORS up and down, `others` and `trust` at their lists.
    """
    best, params = linearised.judged(start), start
    for factor in FACTORS:
        for name in SEARCHED:
            params, best = _line(linearised, params, best, name, factor)
            print(f'map: {name} {_value(params, name):.4g}, nlpd {best.nlpd:.4f}, error '
                  f'{1e3 * best.error:.3f} mm', file=report)
    return replace(params, inflation=best.inflation), best


def _line(linearised, params, best, name, factor):
    """Walk one coordinate as long as that helps; a list of values is walked through whole."""
    values = {'others': OTHERS, 'trust': TRUST}.get(name)
    if values:
        for value in values:
            params, best, _ = _tried(linearised, params, best, name, value)
        return params, best
    for step in (factor, 1.0 / factor):
        better = True
        while better:
            params, best, better = _tried(linearised, params, best, name,
                                          step * _value(params, name))
    return params, best


def _tried(linearised, params, best, name, value):
    other = _changed(params, name, value)
    found = linearised.judged(other)
    return (other, found, True) if found.nlpd < best.nlpd - 1e-4 else (params, best, False)


def _value(params, name):
    return getattr(params.prior if name in PRIORS else params, name)


def _changed(params, name, value):
    if name in PRIORS:
        return replace(params, prior=replace(params.prior, **{name: value}))
    return replace(params, **{name: value})


def sizes(params):
    """name -> (value in the unit at the edge, unit) of all that is fitted."""
    infos = _infos(params)
    return {name: (_value(params, name) / infos[name].scale, infos[name].unit) for name in START}


def _infos(params):
    """name -> Quantity; those of PRIORS are PriorParams' (an offset is of a pad, not a marker)."""
    own = {f.name: f.metadata.get('quantity') for f in fields(params)}
    return own | {f.name: f.metadata['quantity'] for f in fields(PriorParams) if f.name in PRIORS}
