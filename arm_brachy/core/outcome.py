"""What a step came to. Expected trouble is data: it is published and recorded, with advice."""

from enum import Enum


class Outcome(Enum):
    """Result of one step of a simulator, device, estimator or controller.

    The value is the advice printed beside the name. `ok` is true for OK only.
    """

    OK = 'nothing to do'
    NOT_CONVERGED = 'solver stopped short of its tolerance; take smaller steps'
    INVERTED_ELEMENT = 'an element turned inside out; push less far or refine the mesh'
    INFEASIBLE = 'the goal lies outside what pushing allows; see the closest reachable point'
    STALE_INPUT = 'no fresh measurement; the last command is held'
    REJECTED = 'the input was refused and ignored; see the message'
    DEPARTED = 'the cell departs from its model; record a push and run arm-brachy diagnose'
    HELD = 'held on request or by the safety state'

    @property
    def ok(self):
        """True if the step did what was asked."""
        return self is Outcome.OK

    @property
    def advice(self):
        """What a person should try."""
        return self.value
