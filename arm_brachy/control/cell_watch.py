"""What a supervisor notices beside forces: motion that nobody allowed, and two nodes as one."""

import math
from collections import deque
from dataclasses import dataclass

from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class WatchParams:
    """When a pad counts as moving, and when two nodes as alive under one name."""

    grace: float = quantity(0.5, 's', 'from the end of a permission until pads must stand',
                            low=0.0, high=10.0,
                            source='two ticks until the drive hears of it, 0.1 s of braking from '
                                   'full speed, the rest for a loaded machine')
    travel: float = quantity(0.3, 'mm', 'way of an encoder from then on that is motion', low=0.0,
                             high=10.0, source='25 counts of the default encoder')
    window: float = quantity(1.0, 's', 'in which answers of one node that do not count on are '
                             'added up', low=0.1, high=60.0, source='time to notice, own choice')
    echoes: int = 3   # so many in the window are two nodes; one that was started again makes one


class MotionWatch:
    """Compares encoders with the permission: from the end of the grace on they must stand."""

    def __init__(self, params=None):
        """params : WatchParams."""
        self._params = params or WatchParams()
        self._since, self._stood = None, {}

    def breach(self, t, allowed, positions):
        """What moves although it may not, in one line; '' if nothing does.

        allowed : may things move;  positions : mapping name -> encoder position [m] at t [s]
        """
        if allowed:
            self._since, self._stood = None, {}
            return ''
        self._since = t if self._since is None else self._since
        if t - self._since < self._params.grace:
            return ''
        for name, q in positions.items():
            travel = abs(q - self._stood.setdefault(name, q))
            if not travel <= self._params.travel:
                return (f'{name} moved {1e3 * travel:.2f} mm without permission; allowed '
                        f'{1e3 * self._params.travel:g} mm')
        return ''


class PulseWatch:
    """Tells two live nodes of one name from one that was started again.

    Each node numbers its answers. Of one node the numbers count on; where a node was started
    again they fall once; where two are alive they fall again and again.
    """

    def __init__(self, params=None):
        """params : WatchParams."""
        self._params = params or WatchParams()
        self._last, self._falls = {}, {}

    def heard(self, t, name, number):
        """Take answer `number` of node `name` at time t [s]."""
        if number <= self._last.get(name, -math.inf):
            self._falls.setdefault(name, deque(maxlen=self._params.echoes)).append(t)
        self._last[name] = number

    def doubles(self, t):
        """Names of the nodes of which two are alive at time t [s]."""
        return tuple(sorted(
            name for name, falls in self._falls.items()
            if len(falls) == self._params.echoes and t - falls[0] <= self._params.window))
