"""A running cell beside its model: which channel departs from its prediction, and since when.

Test: diagnosis/test_monitor.py
"""

from collections import deque

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.monitoring import Channels, Limits

WAITING = 1000      # samples kept of a stream until the model has caught up, and of the model


class Monitor:
    """Compares streams with predictions as both come in.

    watched : stream -> monitoring.Watched, a stream being its kind or 'kind/channel...', as
        topics are called;  limits : Limits or None
    The cell must be sound while it is zeroed, moving or not. What a model has wrong from the start
    is seen as soon as the pads move further than `share` forgives.
    """

    def __init__(self, watched, limits=None):
        self._limits = limits or Limits()
        each = self._limits.per_hour / max(len(watched), 1)
        self._channels = {kind: Channels(kind.split('/')[0], stream, self._limits, each)
                          for kind, stream in watched.items()}
        self._waiting = {kind: deque(maxlen=WAITING) for kind in watched}
        self._predicted = deque(maxlen=WAITING)

    @property
    def active(self):
        """The Alarms that have not ended."""
        return tuple(alarm for one in self._channels.values() for alarm in one.active.values())

    def predict(self, t, values):
        """Take in what the model says at t [s]; returns the Alarms newly raised, a tuple.

        values : stream -> (c, 3) SI.  Raises InputError if t does not increase.
        """
        if self._predicted and t <= self._predicted[-1][0]:
            raise InputError(f'prediction at {t:g} s after one at {self._predicted[-1][0]:g} s; '
                             'must increase; start a new Monitor with a new run')
        self._predicted.append((t, values))
        return tuple(alarm for kind in self._channels for alarm in self._catch_up(kind))

    def measure(self, kind, t, values):
        """Take in a sample (c, 3) of a stream at t [s], NaN where not seen.

        Returns the Alarms newly raised, a tuple. A sample waits for a prediction past it.
        """
        self._waiting[kind].append((t, np.asarray(values, dtype=float)))
        return self._catch_up(kind)

    def _catch_up(self, kind):
        raised, waiting = [], self._waiting[kind]
        while waiting and self._predicted and waiting[0][0] <= self._predicted[-1][0]:
            t, values = waiting.popleft()
            expected = self._at(kind, t)
            if expected is not None:
                raised += self._channels[kind].take(t, values, expected)
        return tuple(raised)

    def _at(self, kind, t):
        """The prediction (c, 3) at t, straight between two; None before the first."""
        after = None
        for when, values in reversed(self._predicted):
            if when <= t:
                if after is None or when == t:
                    return values[kind]
                share = (t - when) / (after[0] - when)
                return (1.0 - share) * values[kind] + share * after[1][kind]
            after = when, values
        return None
