"""Goals in a cell with a key: a ticket announces the one goal that a request may then set.

Neither a SetGoal request nor a MoveTarget goal has a field for a proof. Its ticket (core.session)
is made for the service and the SHA-256 of what is asked, and is given to the parameter
`set_goal_ticket` of the controller first. Nobody without the key can set another goal in its
place.
"""

import hashlib
import time

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.task import Future

from arm_brachy.core.session import TICKET_LIFE_S
from arm_brachy.nodes.keyed_trigger import TICKET, ticket_request
from arm_brachy_msgs.srv import SetGoal

SERVICE = 'mpc_manipulator/set_goal'
PARAMETER = TICKET.format('set_goal')


class GoalProof:
    """What the node that serves `~/set_goal` knows of the goals that it may accept."""

    def __init__(self, node, session):
        """session : core.session.Session, None in a cell without a key: every goal is allowed."""
        self._session, self._announced = session, {}
        self._full = f'{node.get_fully_qualified_name()}/set_goal'
        if session is not None:
            node.declare_parameter(PARAMETER, '', ParameterDescriptor(
                description='ticket of the session key: announces the goal that is set next'))
            node.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, given):
        ticket = next((str(p.value) for p in given if p.name == PARAMETER), None)
        if ticket is None:
            return SetParametersResult(successful=True)
        action, now = ticket.partition(':')[0], time.time_ns()
        refusal = self._session.refusal(ticket, action, now) \
            if action.startswith(f'{self._full}/') else f'no ticket for {self._full}'
        if refusal:
            return SetParametersResult(successful=False, reason=f'{self._full}: {refusal}')
        self._announced[action] = now
        return SetParametersResult(successful=True)

    def refusal(self, request):
        """Why a request is not to be obeyed, in one line; '' if it is, once.

        request : SetGoal.Request or MoveTarget.Goal: what a ticket covers is in both
        """
        if self._session is None:
            return ''
        begin = time.time_ns() - TICKET_LIFE_S * 1e9
        self._announced = {a: t for a, t in self._announced.items() if t >= begin}
        if self._announced.pop(action_of(self._full, request), None) is None:
            return (f'{self._full} needs the session key: in a cell that is running, arm-brachy '
                    f'goal BAG {request.target} --x MM sets a goal, and so does the page of '
                    'arm-brachy view BAG --live')
        return ''


class KeyedGoals:
    """Sets goals, each with its ticket where the cell has a key."""

    def __init__(self, node, session):
        """session : core.session.Session of the cell, None without a key."""
        self._session, self._full = session, node.resolve_service_name(SERVICE)
        self.client = node.create_client(SetGoal, SERVICE)
        self.clients = (self.client,)
        if session is not None:
            self._tickets = node.create_client(
                SetParameters, SERVICE.rpartition('/')[0] + '/set_parameters')
            self.clients += (self._tickets,)

    def call_async(self, request):
        """Ask for a goal; returns a Future of a SetGoal.Response."""
        if self._session is None:
            return self.client.call_async(request)
        answered = Future()
        announced = self._tickets.call_async(ticket_request(
            self._session, self._full, action_of(self._full, request)))
        announced.add_done_callback(lambda f: self._ask(f.result(), request, answered))
        return answered

    def _ask(self, announced, request, answered):
        result, = announced.results
        if not result.successful:
            answered.set_result(SetGoal.Response(accepted=False, message=result.reason))
            return
        self.client.call_async(request).add_done_callback(
            lambda f: answered.set_result(f.result()))


def action_of(full_name, request):
    """Name of what a ticket of a request allows; by value, since CDR leaves padding unwritten."""
    stamp, goal = request.header.stamp, request.goal
    asked = (stamp.sec, stamp.nanosec, request.header.frame_id, request.target,
             bool(request.relative), *(float(v).hex() for v in (goal.x, goal.y, goal.z)),
             *(bool(a) for a in request.axes))
    return f'{full_name}/{hashlib.sha256(repr(asked).encode()).hexdigest()}'
