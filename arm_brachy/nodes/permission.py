"""What the supervisor allows, as a node that commands motion has heard it."""

from arm_brachy import graph
from arm_brachy.control.safety import Permission
from arm_brachy.nodes import convert


class PermissionWatch:
    """Passes the supervisor's word on; at wall pace its silence is a hold.

    In lockstep the clock waits for the supervisor, so it is never silent.
    """

    def __init__(self, setup, permit):
        """setup : parameters.NodeSetup;  permit : callable (Permission, reason)."""
        self._permit = permit
        self._patience = None if setup.lockstep else setup.cell.scenario.limits.silence
        self._heard_ns = None
        if graph.SUPERVISOR.name in setup.peers:
            permit(Permission.HOLD, 'no word from the supervisor yet')
        else:
            permit(Permission.RUN, '')

    def hear(self, t_ns, messages):
        """Take the SafetyState messages of a tick; none for too long withdraws the permission."""
        for msg in messages:
            self._heard_ns = convert.nanoseconds(msg)
            self._permit(Permission(msg.state), msg.reason)
        if self._patience is None or self._heard_ns is None:
            return
        silence = (t_ns - self._heard_ns) * 1e-9
        if silence > self._patience:
            self._permit(Permission.HOLD, f'no word from the supervisor for {silence:.1f} s')
