"""Ends an emergency stop with the session key: what `arm-brachy release` starts."""

import time

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node

from arm_brachy import graph
from arm_brachy.core.errors import ArmBrachyError, ConfigError
from arm_brachy.core.session import Session
from arm_brachy.nodes import parameters
from arm_brachy.nodes.keyed_trigger import ticket_request
from arm_brachy.nodes.spin import act_once

PATIENCE_S = 10.0      # for a service to be found and to answer
RESUME_PATIENCE_S = 2.0    # for push_protocol to hear of the reset
DRIVERS = (graph.ACTUATOR_DRIVER, graph.NEEDLE_DRIVER, graph.PROBE_CONTROLLER)


class ReleaseClient(Node):
    """Resets the supervisor, then releases every driver that is there, each by a ticket.

    Then, where asked to, it resumes the moves that the scenario prescribes.

    calls set_parameters of the supervisor, of every driver and of push_protocol, with a ticket
    par   session_key (required), resume
    """

    def __init__(self, **kwargs):
        super().__init__('release_client', **kwargs)
        path = parameters.text(self, 'session_key', '', 'file with the key of the session')
        if not path:
            raise ConfigError('release_client: parameter session_key is missing; give -p '
                              'session_key:=<bag>.key')
        self._session = Session.load(path)
        self._resumes = parameters.flag(self, 'resume', False, 'interrupted moves go on')

    def release(self):
        """Do it. Raises ArmBrachyError with the first refusal."""
        self._act(graph.SUPERVISOR, 'reset', patience=0.0)
        there = {name for name, _ in self.get_service_names_and_types()}
        for driver in DRIVERS:
            if self._parameters_of(driver) in there:
                self._act(driver, 'release', patience=PATIENCE_S)
        if self._resumes:
            self._act(graph.PUSH_PROTOCOL, 'resume', patience=RESUME_PATIENCE_S)

    def _parameters_of(self, node):
        return self.resolve_service_name(f'{node.name}/set_parameters')

    def _act(self, node, action, patience):
        """A driver hears of the reset a tick later, so it is asked again for a while [s]."""
        end = time.monotonic() + patience
        full = self.resolve_service_name(f'{node.name}/{action}')
        while True:
            result, = self._call(SetParameters, self._parameters_of(node),
                                 ticket_request(self._session, full)).results
            if result.successful or time.monotonic() > end:
                break
            time.sleep(0.2)
        if not result.successful:
            raise ArmBrachyError(result.reason)
        print(f'{full}: {result.reason or "done"}', flush=True)

    def _call(self, kind, name, request):
        client = self.create_client(kind, name)
        if not client.wait_for_service(PATIENCE_S):
            raise ArmBrachyError(f'{name}: no such service in this DDS domain')
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self, future, timeout_sec=PATIENCE_S)
        if not future.done():
            raise ArmBrachyError(f'{name}: no answer within {PATIENCE_S:.0f} s')
        return future.result()


def main(args=None):
    """Run it; exit status 1 and one line if something was refused."""
    act_once(ReleaseClient, ReleaseClient.release, args)
