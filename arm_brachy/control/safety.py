"""What the cell allows: run, hold, or stop. Actuators move only while the answer is RUN."""

from enum import IntEnum

import numpy as np


class Permission(IntEnum):
    """Values of arm_brachy_msgs/SafetyState.state."""

    RUN = 0
    HOLD = 1
    STOP = 2


class Safety:
    """Latches the first cause; only `reset` goes back to RUN, and only if the cause is gone.

    force_limit : largest force on one pad [N]
    """

    def __init__(self, force_limit):
        self._force_limit = force_limit
        self._silent, self._force = (), {}
        self.permission, self.reason = Permission.RUN, ''

    def force(self, pad, force):
        """Note the force (3,) [N] on a pad; too much is an emergency stop, NaN a hold."""
        size = float(np.linalg.norm(force))
        self._force[pad] = size
        if not np.isfinite(size):
            self.hold(f'{pad}: force reads {size}; must be finite')
        elif size > self._force_limit:
            self.stop(f'{pad}: force {size:.2f} N; allowed {self._force_limit:g} N')

    def silent(self, nodes):
        """Note which nodes have gone silent (names, possibly none); any is a hold."""
        self._silent = tuple(nodes)
        if self._silent:
            self.hold(f'no sign of life from {", ".join(self._silent)}')

    def hold(self, reason):
        """Hold the actuators; an emergency stop in force stays in force."""
        self._raise_to(Permission.HOLD, reason)

    def stop(self, reason):
        """Emergency stop."""
        self._raise_to(Permission.STOP, reason)

    def _raise_to(self, permission, reason):
        if permission > self.permission:
            self.permission, self.reason = permission, reason

    def reset(self):
        """Go back to RUN unless a cause is still there; returns (done, one line)."""
        high = [p for p, f in self._force.items() if not f <= self._force_limit]
        if high or self._silent:
            return False, f'still in force: {", ".join([*high, *self._silent])}'
        self.permission, self.reason = Permission.RUN, ''
        return True, 'running'
