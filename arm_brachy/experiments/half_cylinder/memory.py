"""A body that remembers: the shape's stress relaxes, solved in time.

    S(t) = S_vol + (1 - g) S_iso + g H,    H(t) = integral exp(-(t - s) / tau) dS_iso(s)

Source: Simo 1987, CMAME 60:153, one branch. Within a step S_iso changes at an even rate, for
which the recursion is exact: H' = exp(-x) H + b (S_iso' - S_iso) with x = dt / tau and
b = (1 - exp(-x)) / x.
Test: experiments/half_cylinder/test_memory.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.experiments.half_cylinder.elements import Past

SHARE, TAU = 0.2, 4.0       # g and tau [s]


@dataclass(frozen=True)
class Memory:
    """What is kept of the past, second Piola-Kirchhoff stresses (e, q, 3, 3) [Pa].

    elastic : S_iso at the last instant;  over : H then
    """

    elastic: np.ndarray
    over: np.ndarray

    def ahead(self, step):
        """The elements.Past of the state a `step` [s] later."""
        decay, b = _kernel(step)
        return Past(1.0 - SHARE + SHARE * b, SHARE * (decay * self.over - b * self.elastic))

    def after(self, step, elastic):
        """The Memory a `step` [s] later, when S_iso is `elastic`."""
        decay, b = _kernel(step)
        return Memory(elastic, decay * self.over + b * (elastic - self.elastic))


def _kernel(step):
    x = step / TAU
    return np.exp(-x), -np.expm1(-x) / x
