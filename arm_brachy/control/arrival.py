"""When a move of a target is over: it rests at its goal, at the closest place, or time is up."""

from dataclasses import dataclass

SETTLE = 1.0     # s in the dead band where who asks does not say


@dataclass(frozen=True)
class Ending:
    """How a move ended: reached, and why, in one line."""

    reached: bool
    message: str


class Arrival:
    """Looks at each ManipulatorStep of one goal; explicit time. Test: control/test_arrival.py."""

    def __init__(self, settle=SETTLE, timeout=0.0, unreachable=''):
        """settle : [s] that the target must stay within the dead band

        timeout : [s] of the move, 0 = none
        unreachable : why the goal cannot be reached, '' if it can
        """
        self._settle, self._timeout, self._unreachable = settle, timeout, unreachable
        self._begun = self._reached_at = None

    def judge(self, step, active):
        """Return the Ending with this step, None while the move goes on.

        step : loop.ManipulatorStep;  active : the goal is still pursued
        """
        self._begun = step.t if self._begun is None else self._begun
        if not active:
            return Ending(False, step.message or 'the goal was dropped')
        if not step.reached:
            self._reached_at = None
        elif self._reached_at is None:
            self._reached_at = step.t
        if self._reached_at is not None and step.t - self._reached_at >= self._settle - 1e-6:
            return Ending(True, f'within the dead band for {self._settle:g} s')
        if self._unreachable and step.settled:
            return Ending(False, f'it rests at the closest place: {self._unreachable}')
        if self._timeout and step.t - self._begun >= self._timeout - 1e-6:
            return Ending(False, f'not reached within {self._timeout:g} s'
                          + (f': {step.message}' if step.message else ''))
        return None
