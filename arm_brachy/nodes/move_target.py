"""The action ~/move_target: a goal with feedback, an end, preemption and cancellation."""

import math

from rclpy.action import ActionServer, CancelResponse

from arm_brachy.control.arrival import SETTLE, Arrival, Ending
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert
from arm_brachy_msgs.action import MoveTarget


class MoveTargetServer:
    """One move at a time: a new goal, by action or by service, ends the one under way.

    Call `step` with every control step and `end` when anybody else decides about the goal.
    A goal that is refused is accepted as an action and ends at once as aborted: only a result can
    say why. A move counts as executed when it ends: rclpy's executor would poll a coroutine that
    waits for the end without pause.
    """

    def __init__(self, node, pursue, abort):
        """pursue(request) -> pursuit.Answer, raises CommandRefused;  abort() drops the goal."""
        self._pursue, self._abort = pursue, abort
        self._handle = self._answer = self._arrival = self._last = None
        self._ends = {}     # id of a goal -> how its state is set, and its result
        self._server = ActionServer(
            node, MoveTarget, '~/move_target', execute_callback=self._conclude,
            handle_accepted_callback=self._begin, cancel_callback=self._may_cancel)

    def end(self, message):
        """End the move under way, if there is one, as not reached."""
        self._finish(Ending(False, message))

    def step(self, t_ns, frame, step, active):
        """Tell how far it is; end the move where it is over."""
        if self._handle is None:
            return
        self._last = step
        if self._handle.is_cancel_requested:
            self._abort()
            self.end('cancelled; the pads stay')
            return
        self._handle.publish_feedback(MoveTarget.Feedback(
            header=convert.header(t_ns, frame), estimate=convert.point(step.estimate),
            error=convert.vector(step.error), reached=bool(step.reached),
            outcome=step.outcome.name, message=step.message))
        ending = self._arrival.judge(step, active)
        if ending is not None:
            self._finish(ending)

    def _begin(self, handle):
        try:
            settle, timeout = _times(handle.request)
            answer = self._pursue(handle.request)
        except CommandRefused as refusal:
            self._execute(handle, handle.abort, MoveTarget.Result(
                outcome=Outcome.REJECTED.name, message=str(refusal)))
            return
        self.end('another goal was set')
        self._handle, self._answer, self._last = handle, answer, None
        self._arrival = Arrival(settle, timeout, '' if answer.feasible else answer.message)

    def _may_cancel(self, handle):
        return CancelResponse.ACCEPT if handle is self._handle else CancelResponse.REJECT

    def _finish(self, ending):
        if self._handle is None:
            return
        handle, result = self._handle, _result(ending, self._last, self._answer)
        self._handle = self._answer = self._arrival = self._last = None
        conclude = (handle.succeed if ending.reached else
                    handle.canceled if handle.is_cancel_requested else handle.abort)
        self._execute(handle, conclude, result)

    def _execute(self, handle, conclude, result):
        self._ends[bytes(handle.goal_id.uuid)] = conclude, result
        handle.execute()

    def _conclude(self, handle):
        conclude, result = self._ends.pop(bytes(handle.goal_id.uuid))
        conclude()
        return result


def _times(request):
    """(settle, timeout) [s]. Raises CommandRefused for one that is not finite or negative."""
    for name in ('settle_s', 'timeout_s'):
        value = getattr(request, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise CommandRefused(f'goal for {request.target}: {name} = {value:g}; must be a '
                                 'number of seconds, 0 or more')
    return request.settle_s or SETTLE, request.timeout_s


def _result(ending, step, answer):
    result = MoveTarget.Result(reached=ending.reached, message=ending.message,
                               reference=convert.point(answer.reference),
                               estimate=convert.point(answer.start))
    if step is not None:
        result.estimate, result.error = convert.point(step.estimate), convert.vector(step.error)
        result.outcome = step.outcome.name
    return result
