"""The service that ends an emergency stop: open in a cell without a key, else by a ticket."""

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from std_srvs.srv import Trigger

from arm_brachy.core.errors import CommandRefused

TICKET = 'release_ticket'


class Release:
    """Offers `~/release` and, in a cell with a key, the parameter `release_ticket`.

    A Trigger carries no proof of who calls it. In a cell with a key it is refused, and a ticket
    (core.session) given to the parameter releases in its place; `arm-brachy release` gives it.
    """

    def __init__(self, node, session, action):
        """action : releases or raises CommandRefused; returns nothing."""
        self._node, self._session, self._action = node, session, action
        self._name = f'{node.get_fully_qualified_name()}/release'
        node.create_service(Trigger, '~/release', self._on_call)
        if session is not None:
            node.declare_parameter(TICKET, '', ParameterDescriptor(
                description='ticket of the session key: releases after an emergency stop'))
            node.add_on_set_parameters_callback(self._on_set)

    def _on_call(self, request, response):
        if self._session is not None:
            response.message = (f'{self._node.get_name()}: release needs the session key: '
                                'arm-brachy release BAG')
            return response
        response.success, response.message = self._done()
        return response

    def _on_set(self, given):
        ticket = next((p.value for p in given if p.name == TICKET), None)
        if ticket is None:
            return SetParametersResult(successful=True)
        refusal = self._session.refusal(str(ticket), self._name,
                                        self._node.get_clock().now().nanoseconds)
        done, message = (False, f'{self._name}: {refusal}') if refusal else self._done()
        return SetParametersResult(successful=done, reason=message)

    def _done(self):
        try:
            self._action()
        except CommandRefused as refusal:
            return False, str(refusal)
        return True, 'released'
