"""Services that allow motion: open in a cell without a key, else for who holds the session's key.

A Trigger carries no proof of who calls it. In a cell with a key `~/<name>` is refused, and a
ticket (core.session) given to the parameter `<name>_ticket` of the same node does it in its place.
"""

import time

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import (
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters
from rclpy.task import Future
from std_srvs.srv import Trigger

from arm_brachy.core.errors import CommandRefused

TICKET = '{}_ticket'     # parameter of an action


class KeyedTrigger:
    """Offers an action as the service `~/<name>` or, in a cell with a key, for a ticket alone."""

    def __init__(self, node, session, name, action, *, hint='arm-brachy release BAG'):
        """action : acts and returns one line, or raises CommandRefused

        session : core.session.Session, None in a cell without a key
        hint : what whoever called without the key should do
        """
        self._node, self._session, self._name, self._action = node, session, name, action
        self._full, self._hint = f'{node.get_fully_qualified_name()}/{name}', hint
        node.create_service(Trigger, f'~/{name}', self._on_call)
        if session is not None:
            node.declare_parameter(TICKET.format(name), '', ParameterDescriptor(
                description=f'ticket of the session key: does ~/{name} once'))
            node.add_on_set_parameters_callback(self._on_set)

    def _on_call(self, request, response):
        if self._session is not None:
            response.message = (f'{self._node.get_name()}: {self._name} needs the session key: '
                                f'{self._hint}')
            return response
        response.success, response.message = self._done()
        return response

    def _on_set(self, given):
        ticket = next((p.value for p in given if p.name == TICKET.format(self._name)), None)
        if ticket is None:
            return SetParametersResult(successful=True)
        refusal = self._session.refusal(str(ticket), self._full, time.time_ns())
        done, message = (False, f'{self._full}: {refusal}') if refusal else self._done()
        return SetParametersResult(successful=done, reason=message)

    def _done(self):
        try:
            return True, self._action()
        except CommandRefused as refusal:
            return False, str(refusal)


class KeyedClient:
    """Calls a KeyedTrigger of another node, with a ticket where the cell has a key."""

    def __init__(self, node, session, service):
        """service : name as of the Trigger, 'actuator_driver/home'."""
        self._session, self._full = session, node.resolve_service_name(service)
        self.client = node.create_client(Trigger, service) if session is None else \
            node.create_client(SetParameters, service.rpartition('/')[0] + '/set_parameters')

    def call_async(self):
        """Ask; returns a Future of a Trigger.Response, whichever service was called."""
        if self._session is None:
            return self.client.call_async(Trigger.Request())
        answered = Future()
        asked = self.client.call_async(ticket_request(self._session, self._full))
        asked.add_done_callback(lambda f: answered.set_result(_as_trigger(f.result())))
        return answered


def ticket_request(session, full_name, action=None):
    """Request to `set_parameters` of a node that does an action, '/actuator_driver/home', once.

    action : what the ticket is made for, if it is more than the name of the service
    """
    name = TICKET.format(full_name.rpartition('/')[2])
    value = ParameterValue(type=ParameterType.PARAMETER_STRING,
                           string_value=session.ticket(action or full_name, time.time_ns()))
    return SetParameters.Request(parameters=[ParameterMessage(name=name, value=value)])


def _as_trigger(answer):
    result, = answer.results
    return Trigger.Response(success=result.successful, message=result.reason)
