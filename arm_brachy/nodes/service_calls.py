"""Services of other nodes that a node calls within its tick."""

import time

from rclpy.task import Future

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.nodes.keyed_goal import KeyedGoals
from arm_brachy.nodes.keyed_trigger import KeyedClient
from arm_brachy.nodes.ticker import call_every

PATIENCE_S = 30.0  # with a service; the longest takes one solve of the model


class ServiceCalls:
    """The clients of a node; a call that is not answered in time ends the node.

    A tick in which a service is called is answered when the call is: return `begin()` from the
    tick's work and set its result when everything called in the tick has answered.
    """

    def __init__(self, node):
        self._node, self._clients, self._asked = node, [], None
        call_every(node, 1.0, self._watch)

    def client(self, kind, name):
        """Create the client of a service."""
        self._clients.append(self._node.create_client(kind, name))
        return self._clients[-1]

    def keyed(self, session, name):
        """Create the client of a KeyedTrigger; session : of the cell, None without a key."""
        keyed = KeyedClient(self._node, session, name)
        self._clients.append(keyed.client)
        return keyed

    def goals(self, session):
        """Create the client of `mpc_manipulator/set_goal`; session as of `keyed`."""
        goals = KeyedGoals(self._node, session)
        self._clients += goals.clients
        return goals

    def unready(self):
        """Services that are not there yet: a request sent to nobody is never answered."""
        return [c.srv_name for c in self._clients if not c.service_is_ready()]

    def begin(self):
        """The answer to this tick, due when the calls made in it are done."""
        self._asked, finished = time.monotonic(), Future()
        finished.add_done_callback(lambda _: setattr(self, '_asked', None))
        return finished

    def _watch(self):
        if self._asked is not None and time.monotonic() - self._asked > PATIENCE_S:
            names = ', '.join(c.srv_name for c in self._clients)
            raise ArmBrachyError(f'{self._node.get_name()}: a service has not answered for '
                                 f'{PATIENCE_S:.0f} s; see the logs of those who serve {names}')
