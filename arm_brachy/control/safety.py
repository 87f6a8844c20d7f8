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

    The wait for the first signs of life is no cause: it ends by itself, in RUN if none has come.
    """

    def __init__(self, force_limit, awaited=(), others=None):
        """force_limit : on one pad [N];  awaited : names of what must be heard before RUN.

        others : name -> force limit [N] of what is no pad
        """
        self._force_limit, self._others = force_limit, dict(others or {})
        self._silent, self._doubled, self._strangers = (), (), ()
        self._awaited = set(awaited)
        self._force, self._ages = {}, {}
        self._latched, self._cause = Permission.RUN, ''

    @property
    def permission(self):
        """What is allowed now."""
        return max(self._latched, Permission.HOLD if self._awaited else Permission.RUN)

    @property
    def reason(self):
        """Why not everything is allowed, in one line; '' in RUN."""
        waiting = f'waiting for {", ".join(sorted(self._awaited))}' if self._awaited else ''
        return self._cause or waiting

    def heard(self, name):
        """Note a sign of life."""
        self._awaited.discard(name)

    def force(self, pad, force):
        """Note the force (3,) [N] on a pad or another; too much is a stop, NaN a hold."""
        size = float(np.linalg.norm(force))
        self._force[pad] = size
        if not np.isfinite(size):
            self.hold(f'{pad}: force reads {size}; must be finite')
        elif size > self._limit(pad):
            self.stop(f'{pad}: force {size:.2f} N; allowed {self._limit(pad):g} N')

    def _limit(self, name):
        return self._others.get(name, self._force_limit)

    def old(self, name, age, limit):
        """Note the age [s] of what was last heard of something; too old is a hold."""
        self._ages[name] = age > limit
        if age > limit:
            self.hold(f'{name}: last heard {age:.2f} s ago; allowed {limit:g} s')

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

    def breach(self, reason):
        """Emergency stop because motion was seen that is not allowed; it says so in any case."""
        self._latched, self._cause = Permission.STOP, reason

    def doubled(self, nodes):
        """Note of which nodes two are alive (names, possibly none); any is a hold."""
        self._doubled = tuple(nodes)
        if self._doubled:
            self.hold(f'two nodes are alive as {", ".join(self._doubled)}; end one of the two, or '
                      'start a second cell in a namespace or domain of its own')

    def foreign(self, strangers):
        """Note who publishes what sensors and drives say (`node on topic`); any is a hold."""
        self._strangers = tuple(strangers)
        if self._strangers:
            self.hold(f'a stranger publishes what only the cell may: {", ".join(self._strangers)}')

    def _raise_to(self, permission, reason):
        if permission > self._latched:
            self._latched, self._cause = permission, reason

    def reset(self):
        """Go back to RUN unless a cause is still there; returns (done, one line)."""
        high = [p for p, f in self._force.items() if not f <= self._limit(p)]
        high += [name for name, too_old in self._ages.items() if too_old]
        if causes := [*high, *self._silent, *self._doubled, *self._strangers,
                               *sorted(self._awaited)]:
            return False, f'still in force: {", ".join(causes)}'
        self._latched, self._cause = Permission.RUN, ''
        return True, 'running'
