"""Which samples of a target are believed: those near where model, pads and history put it.

A sample is gated where it lies further from the prediction than both a floor and a multiple of
the standard deviation of that distance, which grows with the travel of the target since the last
sample believed. A jump of the tracker, a swapped sensor or a forged pose is gated; creep, noise
and a wrong model are not. Samples that contradict each other again and again are two sources, of
which none can be told to be true: then nothing is pushed. One source that jumped and stays is
believed again after a while, in which nothing was pushed either.
"""

from collections import deque
from dataclasses import dataclass

from arm_brachy.core.quantity import quantity, whole


@dataclass(frozen=True)
class PoseGateParams:
    """How far from the prediction a sample may lie."""

    floor: float = quantity(
        4.0, 'mm', 'distance from the prediction that is always believed', low=0.0, high=1000.0,
        source='ten times the noise of a tracker in a distorted field; above what a first push '
               'with a wrong model is off by')
    sigmas: float = quantity(
        8.0, '', 'and the same in standard deviations of the prediction', low=1.0, high=1e6,
        source='own choice: no sample of the shipped scenarios comes near it')
    window: float = quantity(
        1.0, 's', 'in which gated samples are added up', low=0.05, high=60.0,
        source='as long as positions are averaged for a goal')
    reacquire: float = quantity(
        2.0, 's', 'in which nothing else was believed, until a sample that stays is', low=0.1,
        high=1e6, source='twice the window: the supervisor has named a stranger within it')
    contradictions: int = whole(3, 'gated samples in the window from which on the pads hold',
                                low=1)


class PoseGate:
    """Gates samples of one target; counts what it gated."""

    def __init__(self, params):
        """params : PoseGateParams."""
        self.params, self.gated = params, 0
        self._recent, self._since = deque(), None

    def refusal(self, t, distance, sd):
        """Why a sample at t [s] is not believed, in a few words; '' if it is.

        distance : [m] from the prediction;  sd : [m] of that distance on one axis
        """
        allowed = max(self.params.floor, self.params.sigmas * sd)
        if distance <= allowed:
            self._since = None
            return ''
        self.gated += 1
        self._recent.append(t)
        self._since = t if self._since is None else self._since
        return (f'{1e3 * distance:.1f} mm from where the target must be, allowed '
                f'{1e3 * allowed:.1f} mm')

    def contradicted(self, t):
        """True while so many samples are gated that none should be followed, at t [s]."""
        while self._recent and self._recent[0] < t - self.params.window:
            self._recent.popleft()
        return len(self._recent) >= self.params.contradictions

    def has_moved(self, t):
        """True once nothing but gated samples has come for `reacquire`, at t [s]."""
        return self._since is not None and t - self._since >= self.params.reacquire

    @property
    def suspicious(self):
        """True if samples were gated lately; see `contradicted`."""
        return len(self._recent) > 0

    def reset(self):
        """Forget what was gated, not how often."""
        self._recent.clear()
        self._since = None
