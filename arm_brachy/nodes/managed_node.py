"""Managed nodes (ROS 2 lifecycle) that start by themselves, unless somebody else shall do it.

Their publishers are ordinary ones: a node that may not act still publishes what it knows.
Three things that rclpy does are put right here. It drops the exception of a failed transition. It
raises in the executor, which ends the node, if a transition is asked for that the state does not
have. It leaves a node that was destroyed in the graph, with all that its state machine made.
"""

import traceback
from abc import ABC, abstractmethod

import rclpy
from lifecycle_msgs.srv import ChangeState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes import parameters
from arm_brachy.nodes.ticker import call_every

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'
CONNECTED = (INACTIVE, ACTIVE)
# State -> the transition towards active, what a person does, every transition that there is.
NEXT = {UNCONFIGURED: 'configure', INACTIVE: 'activate'}
TO_DO = {UNCONFIGURED: 'configure and activate it', INACTIVE: 'activate it',
         FINALIZED: 'start it again'}
POSSIBLE = {UNCONFIGURED: 'configure, shutdown', INACTIVE: 'activate, cleanup, shutdown',
            ACTIVE: 'deactivate, shutdown', FINALIZED: 'none'}
END_S = 0.2     # from a shutdown to the end of the process, for the answer to go out


class AbstractManagedNode(LifecycleNode, ABC):
    """Base of the nodes that can move something, or allow it.

    A node of this kind calls `begin` last in its __init__, and says what it does in `connect`,
    `hold` and `disconnect`.

    srv  ~/change_state, ~/get_state and the others of every managed node, open to all
    out  ~/transition_event
    par  autostart
    """

    def __init__(self, name, **kwargs):
        super().__init__(name, **kwargs)
        self.state, self._trouble = UNCONFIGURED, None
        self.autostart = parameters.flag(
            self, 'autostart', True,
            'configure and activate at the start; false: wait for ~/change_state')
        service = next(s for s in self.services if s.srv_type is ChangeState)
        self._change, service.callback = service.callback, self._on_change

    def connect(self):
        """Do what `configure` asks for. An ArmBrachyError fails it; the node is as before."""

    @abstractmethod
    def hold(self):
        """Make everything rest: before `deactivate` ends, and at a shutdown of what is connected.

        An exception here is an error of the transition: the node disconnects.
        """

    def disconnect(self):
        """Let go of what `connect` took: on `cleanup`, at a shutdown and after an error."""

    def begin(self):
        """Configure and activate; without `autostart` say in one line what is waited for.

        Raises what kept the node from being connected.
        """
        if not self.autostart:
            self._tell()
            return
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self._trouble

    @property
    def active(self):
        """True while the node may act."""
        return self.state == ACTIVE

    @property
    def connected(self):
        """True from `configure` to `cleanup`."""
        return self.state in CONNECTED

    def why_not_active(self):
        """The state and what to do about it in one line; '' if active."""
        if self.active:
            return ''
        command = f' ({self._command()})' if self.state in NEXT else ''
        return f'{self.get_name()} is {self.state}: {TO_DO[self.state]}{command}'

    def asleep(self):
        """What somebody must do before anything is connected, for a Ticker; '' if connected."""
        if self.connected:
            return ''
        return self._command() if self.state in NEXT else 'the end of this finalized node'

    def let_go(self):
        """Hold and disconnect if anything is connected: the node ends."""
        connected, self.state = self.connected, FINALIZED
        if not connected:
            return
        try:
            self.hold()
        finally:
            self.disconnect()

    def destroy_node(self):
        """Destroy the state machine, too, without which the node would stay in the graph."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def on_configure(self, state):
        """Connect; an ArmBrachyError is a failed transition (rclpy calls this)."""
        try:
            with _Kept(self):
                self.connect()
        except ArmBrachyError:
            return TransitionCallbackReturn.FAILURE
        self.state = INACTIVE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        """Act from now on (rclpy calls this)."""
        self.state = ACTIVE
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state):
        """Act no more, then hold (rclpy calls this)."""
        self.state = INACTIVE
        with _Kept(self):
            self.hold()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state):
        """Disconnect (rclpy calls this)."""
        self.state = UNCONFIGURED
        with _Kept(self):
            self.disconnect()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state):
        """Hold, disconnect, and end the process once the answer is out (rclpy calls this)."""
        call_every(self, END_S, self._end)
        with _Kept(self):
            self.let_go()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state):
        """Disconnect and be unconfigured; where that fails, too, end (rclpy calls this)."""
        self.state = FINALIZED
        end = call_every(self, END_S, self._end)
        with _Kept(self):
            self.disconnect()
        end.cancel()
        self.state = UNCONFIGURED
        return TransitionCallbackReturn.SUCCESS

    def _end(self):
        raise SystemExit(0 if self._trouble is None else 1)

    def _on_change(self, request, response):
        """Service ~/change_state."""
        self._trouble = None
        try:
            response = self._change(request, response)
        except RCLError:    # the state does not have this transition
            if not rclpy.ok():
                raise
            response.success = False
        if response.success:
            self._tell()
        else:
            self.get_logger().error(
                self._failure(request.transition.label or request.transition.id))
        return response

    def _failure(self, transition):
        """Why a transition did not succeed: one line, of a bug the traceback."""
        if self._trouble is None:
            return (f'{self.get_name()} is {self.state}: got transition {transition}; must be '
                    f'among {POSSIBLE[self.state]}')
        expected = isinstance(self._trouble, ArmBrachyError)
        why = str(self._trouble) if expected else ''.join(
            traceback.format_exception(self._trouble))
        return f'{self.get_name()} is {self.state}: {transition} failed: {why}'

    def _tell(self):
        todo = f'; {self._command()}' if self.state in NEXT else ''
        self.get_logger().info(f'{self.get_name()}: {self.state}{todo}')

    def _command(self):
        return f'ros2 lifecycle set {self.get_fully_qualified_name()} {NEXT[self.state]}'


class _Kept:
    """Keeps the first exception of a transition for whoever says why it did not succeed."""

    def __init__(self, node):
        self._node = node

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        self._node._trouble = self._node._trouble or error
