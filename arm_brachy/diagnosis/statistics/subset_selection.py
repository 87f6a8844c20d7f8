"""Which of a few causes a series asks for: every subset fitted, the simplest adequate one kept."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arm_brachy.diagnosis.statistics.gls import regress

INDISTINCT = 9.0   # in chi^2: three standard deviations


@dataclass(frozen=True)
class Choice:
    """The causes that were kept.

    estimates : cause -> (value, sd), fitted together
    gains : cause -> fall of chi^2 that it brings beside the others
    rivals : cause -> causes that would do as well in its place
    """

    estimates: dict
    gains: dict
    rivals: dict


def choose(t, y, fixed, causes, valid, colour, sd, *, positive=()):
    """Choice among the subsets of `causes` by the Bayesian information criterion.

    t : (n,) [s];  y : (n, 1);  fixed, causes : name -> column (n,), fixed ones always fitted
    valid : (n,);  colour, sd : of the noise, as gls.regress
    positive : causes that have one sign by their nature; a subset with another is none
    A rival leaves a chi^2 within 9 of the chosen cause when it takes its place.
    """
    names, penalty = tuple(causes), np.log(valid.sum())
    fits = {subset: regress(t, y, fixed | {n: causes[n] for n in subset}, valid, colour, sd)
            for size in range(len(names) + 1) for subset in combinations(names, size)}
    fits = {subset: fit for subset, fit in fits.items()
            if all(fit.of(name)[0] >= 0.0 for name in set(subset) & set(positive))}
    left = {subset: float(fit.chi2[0]) for subset, fit in fits.items()}
    best = min(fits, key=lambda subset: left[subset] + penalty * len(subset))

    def swapped(name, *others):
        wanted = (set(best) - {name}) | set(others)
        return left.get(tuple(n for n in names if n in wanted), np.inf)

    return Choice({name: fits[best].of(name) for name in best},
                  {name: swapped(name) - left[best] for name in best},
                  {name: tuple(other for other in names if other not in best
                               and swapped(name, other) < left[best] + INDISTINCT)
                   for name in best})
