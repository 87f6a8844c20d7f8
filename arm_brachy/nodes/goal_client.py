"""Brings a target to a point with the session key: what `arm-brachy goal` starts."""

import signal
import time
from pathlib import Path

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.signals import uninstall_signal_handlers

from arm_brachy.core.errors import ArmBrachyError, ConfigError, InputError, Interrupted
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import Session
from arm_brachy.nodes import convert, parameters
from arm_brachy.nodes.keyed_goal import SERVICE, action_of
from arm_brachy.nodes.keyed_trigger import ticket_request
from arm_brachy.nodes.names import targets_of
from arm_brachy.nodes.spin import act_once
from arm_brachy_msgs.action import MoveTarget

NODE = SERVICE.partition('/')[0]
ACTION = f'{NODE}/move_target'
MM = 1e-3
REACH_MM = 1e4         # of what can be asked for
LONGEST_S = 1e6
PATIENCE_S = 10.0      # for the cell to be found and to answer
GONE_S = 2.0           # without an action server: the cell has ended
SPOKEN_S = 1.0         # between two lines


class GoalClient(Node):
    """Announces a goal by its ticket, sets it by the action, follows it to its result.

    calls set_parameters of mpc_manipulator, with a ticket
    act   mpc_manipulator/move_target
    par   session_key, target, axes (all required), x_mm, y_mm, z_mm, relative, settle_s, timeout_s
    """

    def __init__(self, **kwargs):
        super().__init__('goal_client', **kwargs)
        self._key = Path(self._required('session_key', 'file with the key of the session'))
        self._session = Session.load(self._key)
        self._goal = self._asked()
        self._action = ActionClient(self, MoveTarget, ACTION)
        self._tickets = self.create_client(SetParameters, f'{NODE}/set_parameters')
        self._begun = self._spoken = None      # stamp of the first feedback; time of the last line
        self._interrupted = False
        uninstall_signal_handlers()            # rclpy's own would leave nobody to cancel
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _required(self, name, description):
        value = parameters.text(self, name, '', description)
        if not value:
            raise ConfigError(f'{self.get_name()}: parameter {name} is missing ({description}); '
                              'arm-brachy goal gives it')
        return value

    def _asked(self):
        """The goal that the parameters describe. Raises ConfigError."""
        axes = self._required('axes', 'of x, y, z, those that are controlled')
        if not set(axes) <= set('xyz'):
            raise ConfigError(f'{self.get_name()}: axes = {axes!r}; must be of x, y and z')
        goal = MoveTarget.Goal(target=self._required('target', 'name in the scene'),
                               axes=[a in axes for a in 'xyz'])
        goal.goal = convert.point([MM * parameters.number(
            self, f'{a}_mm', 0.0, f'goal along {a}', -REACH_MM, REACH_MM) for a in 'xyz'])
        goal.relative = parameters.flag(self, 'relative', True, 'a displacement, no position')
        for name, text in (('settle_s', 'within the dead band'), ('timeout_s', 'then given up')):
            setattr(goal, name, parameters.number(self, name, 0.0, text, 0.0, LONGEST_S))
        return goal

    def pursue(self):
        """Do it. Raises ArmBrachyError unless the target is reached, Interrupted on a signal."""
        self._find()
        self._goal.header.stamp = self.get_clock().now().to_msg()
        self._announce()
        handle = self._answer(self._action.send_goal_async(self._goal, self._on_feedback))
        future = handle.get_result_async()
        self._until(lambda: future.done() or self._interrupted or self._gone())
        if self._interrupted and not future.done():
            self._cancel(handle, future)
        if not future.done():
            raise ArmBrachyError(f'{self._goal.target}: the cell has ended before the target '
                                 'reached its goal')
        self._conclude(future.result().result)

    def _find(self):
        """Wait for the cell; it may still be on its way up."""
        there = (self._action.server_is_ready, self._tickets.service_is_ready)
        self._until(lambda: self._interrupted or all(ready() for ready in there), PATIENCE_S)
        if self._interrupted:
            raise Interrupted('ended before a goal was set')
        if not all(ready() for ready in there):
            raise ArmBrachyError(f'{self._full(ACTION)}: no such action within '
                                 f'{PATIENCE_S:.0f} s: the cell is ending, was killed (then its '
                                 f'key {self._key} is left behind), or makes prescribed moves '
                                 'and takes no goals')

    def _announce(self):
        full = self._full(SERVICE)
        result, = self._answer(self._tickets.call_async(ticket_request(
            self._session, full, action_of(full, self._goal)))).results
        if not result.successful:
            raise ArmBrachyError(result.reason)

    def _cancel(self, handle, future):
        handle.cancel_goal_async()
        if not self._until(future.done, PATIENCE_S):
            abort = self._full(f'{NODE}/abort')
            raise Interrupted(f'{self._goal.target}: the cancellation was not answered within '
                              f'{PATIENCE_S:.0f} s; the goal may still be pursued; to drop it: '
                              f'ros2 service call {abort} std_srvs/srv/Trigger')
        if not future.result().result.reached:
            raise Interrupted(f'{self._goal.target}: {future.result().result.message}')

    def _conclude(self, result):
        target = self._goal.target
        if self._begun is None and result.outcome == Outcome.REJECTED.name:
            known = targets_of(self)
            raise (ArmBrachyError if target in known else InputError)(result.message)
        if not result.reached:
            raise ArmBrachyError(f'{target} is not at its goal: {result.message}'
                                 + ('' if self._begun is None else f'; {self._error(result)}'))
        print(f'{target}: reached: {self._error(result)}, {result.message}', flush=True)

    def _on_feedback(self, message):
        """A line a second, in the cell's own time."""
        told, now = message.feedback, time.monotonic()
        t = convert.nanoseconds(told)
        if self._begun is None:
            self._begun = t
            print(f'{self._goal.target}: goal accepted, {self._error(told)}', flush=True)
        elif now - self._spoken < SPOKEN_S:
            return
        else:
            ok = told.outcome == Outcome.OK.name
            print(f'{(t - self._begun) * 1e-9:6.1f} s  {self._error(told)}'
                  + (', within the dead band' if told.reached else '')
                  + ('' if ok else f'  {told.outcome}: {told.message}'), flush=True)
        self._spoken = now

    def _error(self, told):
        """Error along the controlled axes, as text."""
        error = zip('xyz', convert.xyz(told.error) / MM, self._goal.axes, strict=True)
        return 'error ' + ', '.join(f'{a} {value:.2f}' for a, value, on in error if on) + ' mm'

    def _gone(self):
        """True once the cell has ended: its key is removed, or nobody serves the action."""
        if not self._key.exists():
            return True
        return (not self._action.server_is_ready()
                and not self._until(self._action.server_is_ready, GONE_S))

    def _answer(self, future):
        if not self._until(future.done, PATIENCE_S):
            raise ArmBrachyError(f'{self._full(NODE)}: no answer within {PATIENCE_S:.0f} s')
        return future.result()

    def _full(self, name):
        return self.resolve_service_name(name)

    def _until(self, condition, seconds=float('inf')):
        """Spin until `condition`; returns whether it came true."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.1)
        return condition()

    def _on_signal(self, number, frame):
        self._interrupted = True


def main(args=None):
    """Run it; exit status 0 if the target was reached, else one line that says why not."""
    act_once(GoalClient, GoalClient.pursue, args)
