"""Which orders are obeyed: not the old, the future, the foreign, the meaningless, the outrun."""

import math
from dataclasses import dataclass

from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class GateParams:
    """What stamps may be off by."""

    lead: float = quantity(0.1, 's', 'how far in the future a stamp may lie', low=0.0, high=10.0,
                           source='clocks of machines that NTP keeps are within 10 ms; ten times '
                                  'that')


@dataclass(frozen=True)
class Refusal:
    """Why an order is not obeyed: a kind to count by, and one line."""

    kind: str
    message: str


@dataclass(frozen=True)
class Order:
    """What an order says of itself: stamp [s], frame_id, mode or state, all of its numbers."""

    stamp: float
    frame: str
    code: int
    values: tuple = ()


class OrderGate:
    """Judges orders of one kind, in the order in which they come.

    codes : mapping of the known modes (or states) to True where it makes nothing move; such an
    order is never too late, and whatever it says of time, frame and numbers is not looked at.
    """

    def __init__(self, codes, frame, max_age, params=None):
        """frame : frame_id that orders must have;  max_age : of an order [s]."""
        self._codes, self._frame, self._max_age = dict(codes), frame, max_age
        self._lead, self._last = (params or GateParams()).lead, -math.inf

    def refusal(self, t, order):
        """The Refusal of an Order at time t [s]; None if it is to be obeyed."""
        if order.code not in self._codes:
            known = ', '.join(str(int(c)) for c in self._codes)
            return Refusal('unknown mode', f'mode {order.code}; must be one of {known}')
        if self._codes[order.code]:
            return None
        refusal = self._wrong_content(order) or self._wrong_time(t, order.stamp)
        if refusal is None:
            self._last = order.stamp
        return refusal

    def _wrong_content(self, order):
        if order.frame != self._frame:
            return Refusal('foreign frame', f'frame_id = {order.frame!r}; must be '
                                            f'{self._frame!r}')
        bad = next((v for v in order.values if not math.isfinite(v)), None)
        return None if bad is None else Refusal(
            'not finite', f'holds the number {bad}; all must be finite')

    def _wrong_time(self, t, stamp):
        if t - stamp > self._max_age:
            return Refusal('old', f'stamped {t - stamp:.3g} s ago; allowed {self._max_age:g} s')
        if stamp - t > self._lead:
            return Refusal('future', f'stamped {stamp - t:.3g} s in the future; allowed '
                                     f'{self._lead:g} s')
        if stamp < self._last:
            return Refusal('out of order', f'stamped {self._last - stamp:.3g} s before the one '
                                           'obeyed last')
        return None


class Tally:
    """Counts refusals by kind; says each kind at most once a period."""

    def __init__(self, period=1.0):
        """period : [s]."""
        self._period, self._said, self.counts = period, {}, {}

    def note(self, t, kind):
        """Count one of `kind` at time t [s]; returns True if it is to be said now."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if t - self._said.get(kind, -math.inf) < self._period:
            return False
        self._said[kind] = t
        return True
