"""Which recording would tell apart what those at hand cannot: max-min separation.

Of every recording that could be made (`trials`), with the streams at hand or more, the effect of
each explanation at its fitted size is held against the best that each rival makes of it, beside
the nuisances, in the new recording and those at hand together. That one is asked for whose least
separation is the largest, with as few new streams as possible. Source: Hunter & Reiner 1965,
Technometrics 7:307; Atkinson & Fedorov 1975, Biometrika 62:57 (T-optimality).
Test: diagnosis/test_next_experiment.py
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.experiment_design.advice import advice
from arm_brachy.diagnosis.experiment_design.prediction import calibrated, integrated, planned
from arm_brachy.diagnosis.experiment_design.trials import REACH, RELAXATION, trials_of
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.joint_linearisation import baselines
from arm_brachy.diagnosis.results.parts import NextExperiment
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.statistics.linear_gaussian import separation


def next_experiment(specimen, terms, options, noise, streams, *, nuisance_columns=calibrated,
                    at_hand=None, reach=REACH):
    """The parts.NextExperiment that tells options apart best; None where none is needed.

    specimen : Specimen;  terms : those that the model has for certain;
    options : prediction.Option each
    noise : kind -> noise.Noise of what is recorded; the data sheet stands in for other streams
    streams : kinds that are recorded (OPTICAL, EM, FORCE)
    nuisance_columns : Baseline -> Nuisances, as those at hand have them
    at_hand : prediction.Whitened, None = the new recording has to do it alone
    reach : of the stroke, how deep a trial pushes
    None with fewer than two options, or where those at hand are 3 sd apart already. What no trial
    tells apart is answered by `advice`. What happened once does not happen again.
    Answers are linear in the effects: the separation is an estimate. Raises NotConverged where the
    model has no state in a trial, InputError where nuisances are not those at hand.
    """
    options, known = tuple(options), None
    if at_hand is not None:
        known = at_hand.normal()
        if _apart(known, options).min(initial=np.inf) >= Rules().apart:
            return None
    if len(options) < 2:
        return None
    plans = trials_of(specimen, _concerned(options, specimen), _relaxation(options), reach)
    models = baselines(ForwardModel(specimen, terms), plans)
    designs = []
    for trial, baseline in zip(plans, models, strict=True):
        seen = planned(trial, baseline, options, noise, nuisance_columns).lasting(options)
        designs += [_Design(trial.moves, added, _apart(
            _together(known, seen.take((*streams, *added)).normal()), options))
            for added in _additions(seen.kinds, streams) if seen.found]
    return _asked(designs, options)


@dataclass(frozen=True)
class _Design:
    """A trial with streams added, and the separation [sd] of each pair of options."""

    moves: tuple
    record: tuple
    apart: np.ndarray

    @property
    def rank(self):
        """Most pairs split first, then the fewest new streams, then the largest separation."""
        split = self.apart >= Rules().apart
        return split.sum(), -len(self.record), self.apart[split].min(initial=np.inf)


def _asked(designs, options):
    """The NextExperiment by the best design; advice on pairs that it leaves, or on all."""
    pairs = list(combinations((option.name for option in options), 2))
    best = max(designs, key=lambda design: design.rank, default=None)
    split = np.zeros(len(pairs), bool) if best is None else best.apart >= Rules().apart
    left = [pair for pair, done in zip(pairs, split, strict=True) if not done]
    instruction = advice(left) if left else ''
    if not split.any():
        return NextExperiment(instruction=instruction)
    told = tuple(pair for pair, done in zip(pairs, split, strict=True) if done)
    return NextExperiment(best.moves, best.record, told, float(best.apart[split].min()),
                          instruction)


def _together(known, new):
    """`Whitened.normal` of two recordings; known : None = there is but the new one."""
    if known is None:
        return new
    if known[0] != new[0]:
        raise InputError(f'{len(new[0])} nuisances of a new recording that others share, '
                         f'{len(known[0])} of those at hand; must be the same; give the '
                         'nuisance_columns that made those')
    return new[0], known[1] + new[1]


def _additions(kinds, streams):
    """Every set of streams that the body has and that is not recorded yet, none first."""
    missing = [kind for kind in kinds if kind not in streams]
    return [added for k in range(len(missing) + 1) for added in combinations(missing, k)]


def _concerned(options, specimen):
    """Names of the pads at which an option acts."""
    places = [one.place for option in options for one in option.hypotheses]
    return ({specimen.pads[i] for place in places for i in place.get('actuators', ())}
            | {name for place in places for name in place.get('pads', ())})


def _relaxation(options):
    """The longest relaxation time [s] of the options."""
    return max((one.place['tau1'] for option in options for one in option.hypotheses
                if 'tau1' in one.place), default=RELAXATION)


def _apart(normal, options):
    """(pairs,) separation [sd] of two options, the lesser of the two ways round."""
    shared, products = normal
    k = len(shared)
    left = integrated(products[:k, :k], products[:k, k:], products[k:, k:])
    ends = np.cumsum([0, *(len(option.size) for option in options)])
    at = [np.arange(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    def one_way(i, j):
        size = options[i].size
        return separation(float(size @ left[np.ix_(at[i], at[i])] @ size),
                          left[np.ix_(at[j], at[i])] @ size, left[np.ix_(at[j], at[j])])

    return np.array([min(one_way(i, j), one_way(j, i))
                     for i, j in combinations(range(len(options)), 2)])
