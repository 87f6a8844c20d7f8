"""Sizes of the estimators' priors and covariances, fitted on plants that are in no table.

Fitted on FITTED fresh plants (`fresh_plants`), checked on CHECKED further ones. The criterion is
the mean negative log predictive density of the targets (`fit_cases.Judgement`), each covariance
first multiplied by the one factor at which its 95 % ellipsoids hold 95 % of the truths. The
inflation that is kept is that factor over fitted and checked plants together: coverage of the
checked ones is no blind test, that of Table 4.1 is. What is found is copied by hand into the
defaults of MapParams and PriorParams.
Test: experiments/test_fit_estimators.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import (
    fit_cases,
    fit_map,
    fresh_plants,
    inside_study,
)

NAME = 'fit-estimators'
FITTED, CHECKED = 24, 24       # fresh plants
COVERAGE = (93.0, 97.0)        # %


def reproduce(out_dir):
    """Fit every estimator of FITS; returns Result: a row for each size, then each Judgement."""
    solved = fresh_plants.plants(Path(out_dir).parent / inside_study.CACHE, FITTED + CHECKED)
    some, other = fit_cases.cases(solved[:FITTED]), fit_cases.cases(solved[FITTED:])
    rows, judged = [], []
    for fit in FITS.values():
        sizes, judgements = fit(some, other)
        rows += sizes
        judged += judgements
    return Result(NAME, fresh_plants.SEED, commit_of(share_dir()), machine_description(),
                  (*rows, *judged), tuple(_covered(row) for row in judged
                                          if row['plants'] == 'checked' and row['variant'] == ''))


def fit_of_map(some, other):
    """(rows of sizes, rows of judgements) of MAP; see `fit_map`."""
    linearised = fit_map.Linearised(some)
    start = fit_map.start()
    params, best = fit_map.fit(linearised, start)
    checked = fit_map.Linearised(other)
    squared = np.concatenate([best.squared, checked.judged(params).squared])
    # The twentieth part of what 24 bodies say is said by a few of them: all are asked.
    params = replace(params, inflation=float(np.quantile(squared, 0.95)) / inside_study.INSIDE_95)
    rows = [size_row('map', name, *value) for name, value in fit_map.sizes(params).items()]
    plain = replace(params, others=1.0, trust=1.0)
    return rows, [judgement_row('map', 'fitted', best, params.inflation),
                  judgement_row('map', 'checked', checked.judged(params), params.inflation),
                  judgement_row('map', 'checked', checked.judged(plain), params.inflation,
                                'one prior'),
                  judgement_row('map', 'checked', checked.judged(start), start.inflation,
                                'start of the search')]


# One that is to be fitted gives a function (cases, cases to check) -> (rows, rows).
FITS = {'map': fit_of_map}


def size_row(estimator, parameter, value, unit):
    """Row of a fitted size, in the unit at the edge."""
    return {'estimator': estimator, 'parameter': parameter, 'value': float(value), 'unit': unit}


def judgement_row(estimator, plants, found, inflation=None, variant=''):
    """Row of a Judgement.

    plants : 'fitted' or 'checked';  inflation : with which coverage is stated, None = its own
    variant : what is unlike the fitted estimator, '' = nothing
    """
    share = found.covered_with(found.inflation if inflation is None else inflation)
    low, high = inside_study.wilson(share, found.trials)
    return {'estimator': estimator, 'plants': plants, 'variant': variant, 'nlpd': found.nlpd,
            'mean_error_mm': style.MM * found.error,
            'mean_error_of_15_mm_pushes_and_more_mm': style.MM * found.deep,
            'in_95_ellipsoid_percent': 100.0 * share, 'interval_low_percent': 100.0 * low,
            'interval_high_percent': 100.0 * high, 'trials': found.trials}


def _covered(row):
    low, high = COVERAGE
    share = row['in_95_ellipsoid_percent']
    return Target(f"truths of {CHECKED} further plants in the 95 % ellipsoids of "
                  f"{row['estimator']}", share, '%', f'{low:g} to {high:g}',
                  bool(np.isfinite(share) and low <= share <= high))

