"""Sizes of the network's estimator, chosen on fresh plants: none of them is in Table 4.1.

    python -m arm_brachy.experiments.fit_graph_vae [--plants 12]

prints every size that is tried with its negative log predictive density (nlpd) of the targets, the
mean error and the share of truths in the 95 % ellipsoids; the least nlpd is chosen, one size after
another in the order of SIZES.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np

from arm_brachy.core.paths import run_dir
from arm_brachy.estimation.graph_vae.params import GraphVaeParams
from arm_brachy.experiments import (
    fit_cases,
    fresh_plants,
    inside_estimators,
    inside_plants,
    inside_study,
)

# one at a time, the others at what was chosen before
SIZES = (('spread', (0.15, 0.6, 1.0)), ('local', (0.005, 0.01, 0.04)), ('spread', (0.2, 0.4, 0.8)),
         ('inflation', (1.1,)), ('localised', (False, True)))


class Fit:
    """The estimator with each set of markers, and the cases it is judged on."""

    def __init__(self, cases):
        """cases : list of fit_cases.Case; the model is solved once for each."""
        model, entry = inside_plants.model_scene(), inside_estimators.entry('graph_vae')
        names = inside_plants.tissue_markers(model)
        self._cases, self._built = cases, {
            count: entry.build(model, (), inside_plants.target_names(model), names[keep],
                               entry.params)
            for count, keep in inside_study.MARKER_SETS.items()}

    def judgements(self, tried):
        """A Judgement for each GraphVaeParams of `tried`; case by case, so as to solve once."""
        said = [[] for _ in tried]
        for case in self._cases:
            for k, params in enumerate(tried):
                one = self._built[case.count].with_params(params).step(case.last)
                if not one.outcome.ok:
                    print(f'left out: {one.message}', file=sys.stderr)
                said[k].append((one.points, one.covariance))
        return [fit_cases.judge(self._cases, each) for each in said]


def search(fit, params):
    """Return the GraphVaeParams of least nlpd, size after size; prints each that is tried."""
    for name, values in SIZES:
        tried = [replace(params, **{name: v}) for v in dict.fromkeys(
            (getattr(params, name), *values))]
        found = fit.judgements(tried)
        for one, judgement in zip(tried, found, strict=True):
            print(f'{name} {getattr(one, name)}: nlpd {density(judgement):.3f}, mean '
                  f'{1e3 * judgement.error:.3f} mm, deep {1e3 * judgement.deep:.3f} mm, covered '
                  f'{100 * judgement.covered_with(1.0):.1f} % of {judgement.trials}', flush=True)
        params = min(zip(found, tried, strict=True), key=lambda pair: density(pair[0]))[1]
    return params


def density(judgement):
    """Mean negative log predictive density with the covariances as predicted, not inflated."""
    inflation = judgement.inflation
    return judgement.nlpd + 0.5 * (float(np.mean(judgement.squared)) * (1.0 - 1.0 / inflation)
                                   - 3.0 * np.log(inflation))


def main():
    """Print what is tried and what is chosen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--plants', type=int, default=12)
    given = parser.parse_args()
    solved = fresh_plants.plants(run_dir() / inside_study.CACHE, given.plants)
    print(search(Fit(fit_cases.cases(solved)), GraphVaeParams()))


if __name__ == '__main__':
    main()
