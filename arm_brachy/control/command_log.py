"""Which part of the commanded travel is still to come."""

import numpy as np


class CommandLog:
    """The last commands, long enough to tell travel under way from travel that will not come.

    A command older than the actuator's delay has either been carried out or never will be (servo
    offset, lost steps). Only younger ones are credited as pending; crediting the rest would leave
    a lasting error that no feedback sees.
    """

    def __init__(self, delay):
        """delay : [s] within which an actuator carries out one period's push."""
        self._delay = delay
        self._entries = []

    def append(self, t, command):
        """Note the command (p,) [m] given at t [s]; entries that no longer matter are dropped."""
        self._entries.append((t, np.array(command, dtype=float)))
        while len(self._entries) > 1 and self._entries[1][0] <= t - self._delay:
            self._entries.pop(0)

    def pending(self, t, q):
        """Travel (p,) [m] commanded within the delay and not yet seen at q (p,) [m] at t [s]."""
        if not self._entries:
            return np.zeros_like(q)
        before = [c for s, c in self._entries if s <= t - self._delay]
        old, new = (before or [self._entries[0][1]])[-1], self._entries[-1][1]
        recent = new - old
        return np.clip(new - q, np.minimum(recent, 0.0), np.maximum(recent, 0.0))
