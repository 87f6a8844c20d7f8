"""What every node says of itself: outcomes when they change, diagnostics once a second."""

from arm_brachy import graph
from arm_brachy.control.gate import Tally
from arm_brachy.core.outcome import Outcome
from arm_brachy.nodes import convert, parameters

PERIOD_NS = 1_000_000_000


class Health:
    """Publishes cell/outcome and /diagnostics through a node's Ticker.

    Only figures that follow from the data are published, so that a recording does not depend on
    how loaded the machine was.
    """

    def __init__(self, node, ticker, frame):
        self._node, self._frame = node, frame
        self._outcome_pub = ticker.publisher(graph.OUTCOME)
        self._diagnostics_pub = ticker.publisher(graph.DIAGNOSTICS)
        self._outcome, self._message, self._next_ns = Outcome.OK, '', 0
        self._ticker, self._tally = ticker, Tally()
        ticker.on_refusal = self._foreign

    def note(self, t_ns, outcome, message=''):
        """Take the outcome of a step; it is published and logged when it changes."""
        if outcome is self._outcome and message == self._message:
            return
        self._outcome, self._message = outcome, message
        self._say(t_ns, outcome, message)

    def refuse(self, t_ns, outcome, message):
        """Publish and log one refusal at once."""
        self._say(t_ns, outcome, message)

    def turn_away(self, t_ns, kind, message):
        """Count one more refusal of its kind; it is published and logged at most once a second."""
        if self._tally.note(t_ns * 1e-9, kind):
            self._say(t_ns, Outcome.REJECTED, message)

    @property
    def refused(self):
        """How many orders were turned away."""
        return sum(self._tally.counts.values())

    def _foreign(self, topic, reason):
        self.turn_away(self._ticker.last_ns, f'{reason}, {topic}', f'{topic}: {reason}; only '
                       'nodes that were started with the session key may publish here')

    def _say(self, t_ns, outcome, message):
        self._outcome_pub(convert.outcome(t_ns, self._frame, self._node.get_name(), outcome,
                                          message))
        if outcome.ok:
            self._node.get_logger().info('back to normal')
        else:
            self._node.get_logger().warning(f'{outcome.name}: {message or outcome.advice}')

    def beat(self, t_ns, values):
        """Publish the diagnostics of this node if a second of its time has passed.

        values : mapping of names to figures; callable, evaluated only when it is time
        """
        if t_ns < self._next_ns:
            return
        self._next_ns = (t_ns // PERIOD_NS + 1) * PERIOD_NS
        self._diagnostics_pub(convert.diagnostics(t_ns, self._node.get_name(), self._outcome,
                                                  self._message, {
                                                      **values(), **self._parameters(),
                                                      **self._refusals()}))

    def _refusals(self):
        return {f'refused: {kind}': n for kind, n in sorted(self._tally.counts.items())}

    def _parameters(self):
        """What was set by -p and not by the scenario: a recording is to hold it."""
        return {f'parameter {name}': value
                for name, value in sorted(parameters.given(self._node).items())}
