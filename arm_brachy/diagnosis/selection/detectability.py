"""From what size on would these recordings have shown a cause?

"Nothing is missing" says little where nothing would have shown. Of every cause that was tried,
what its response makes in standard deviations, beside all that needs no cause, says how large it
would have to be, to first order.
Test: diagnosis/theorems/test_limits.py
"""

from collections import defaultdict

import numpy as np

from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.diagnosis.results.parts import Limit
from arm_brachy.diagnosis.statistics.linear_gaussian import detectability

SHOWS = 5.0     # sd: after what a cause pays for its numbers and places, about where it is claimed
FAR = 10.0      # typical sizes: no first order reaches further
FAINT = 1e-9    # sd: nothing


def limits_of(assembly):
    """statements.Limit of every cause tried in an problem.Assembly; a tuple, as of `limits`."""
    return limits(assembly.problem, [(one, [s.spread for s in one.strengths])
                                     for one in assembly.tried.hypotheses])


def limits(problem, tried):
    """statements.Limit of every cause of a judge.Problem, the smallest first; a tuple.

    tried : (Hypothesis, (p,) standard deviations of its priors in typical sizes) of each of its
        explanations
    Of several parameters the one that shows first, at a place (or actuator, ...) that half of
    those tried do no better than. What shows from FAR typical sizes only is left out, and what
    only sizes that the parameter cannot have would show.
    """
    if not tried:
        return ()
    columns = [explanation.columns for explanation in problem.explanations]
    sizes = np.split(detectability(problem.U, np.hstack(columns)),
                     np.cumsum([part.shape[1] for part in columns])[:-1])
    of_cause = defaultdict(list)
    for (hypothesis, spread), size in zip(tried, sizes, strict=True):
        needed = SHOWS * np.asarray(spread) / np.maximum(size, FAINT)
        k = int(needed.argmin())
        of_cause[hypothesis.name].append((float(needed[k]), k, hypothesis))
    halfway = {name: sorted(some, key=lambda one: one[0])[len(some) // 2]
               for name, some in of_cause.items()}
    near = sorted((one for one in halfway.values() if one[0] <= FAR), key=lambda one: one[0])
    return tuple(limit for one in near for limit in _limit(*one))


def _limit(typical_sizes, k, hypothesis):
    """The Limit, () where the parameter may not have such a value."""
    strength = hypothesis.strengths[k]
    info = quantities(hypothesis.cls)[strength.name]
    value = strength.value(typical_sizes) / info.scale
    if not info.allows(value):
        return ()
    return (Limit(hypothesis.name, strength.label, UNITS[info.unit][1], value, typical_sizes),)
