"""What the supervisor allows, as a node that commands motion has heard it, and its gates."""

from arm_brachy import graph
from arm_brachy.control.gate import OrderGate
from arm_brachy.control.safety import Permission
from arm_brachy.nodes import convert
from arm_brachy_msgs.msg import ActuatorCommand, SafetyState

MODES = {ActuatorCommand.MODE_MOVE: False, ActuatorCommand.MODE_HOLD: True,
         ActuatorCommand.MODE_STOP: True}
STATES = {SafetyState.RUN: False, SafetyState.HOLD: True, SafetyState.STOP: True}
TICKS = 3   # the age in lockstep of an order is one tick, at wall pace up to two


def command_gate(setup):
    """Gate of the ActuatorCommands of a node."""
    return _gate(setup, MODES)


def safety_gate(setup):
    """Gate of the SafetyStates that a node hears."""
    return _gate(setup, STATES)


def _gate(setup, codes):
    patience = max(setup.cell.scenario.limits.silence, TICKS * setup.tick_ns * 1e-9)
    return OrderGate(codes, setup.frame, patience)


class PermissionWatch:
    """Passes the supervisor's word on; at wall pace its silence is a hold.

    In lockstep the clock waits for the supervisor, so it is never silent.
    """

    def __init__(self, setup, permit):
        """setup : parameters.NodeSetup;  permit : callable (Permission, reason)."""
        self._permit, self._gate = permit, safety_gate(setup)
        self._patience = None if setup.lockstep else setup.cell.scenario.limits.silence
        self._heard_ns = None
        if graph.SUPERVISOR.name in setup.peers:
            permit(Permission.HOLD, 'no word from the supervisor yet')
        else:
            permit(Permission.RUN, '')

    def hear(self, t_ns, messages, health):
        """Take the SafetyState messages of a tick; none for too long withdraws the permission."""
        for msg in messages:
            refusal = self._gate.refusal(t_ns * 1e-9, convert.allowance(msg))
            if refusal is not None:
                health.turn_away(t_ns, refusal.kind, f'{graph.SAFETY.name}: {refusal.message}')
                continue
            self._heard_ns = convert.nanoseconds(msg)
            self._permit(Permission(msg.state), msg.reason)
        if self._patience is None or self._heard_ns is None:
            return
        silence = (t_ns - self._heard_ns) * 1e-9
        if silence > self._patience:
            self._permit(Permission.HOLD, f'no word from the supervisor for {silence:.1f} s')
