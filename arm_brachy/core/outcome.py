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
    TOO_FEW_MARKERS = 'too few markers are seen; clear the line of sight of the optical tracker'
    MARKERS_REJECTED = 'markers were left out of the estimate; the message names them'
    MARKERS_SWAPPED = "markers carried each other's label and were put right; relabel them"
    UNKNOWN_LOAD = ('something that the model does not know presses on the tissue; take it away, '
                    'or mind the ellipses')
    LOST_REGISTRATION = ("the optical tracker's frame is not known; show it three markers of base "
                         'or pads')
    WRONG_SCENE = 'the markers are not those of the scene; give the scene of this body'
    IMAGE_EMPTY = 'the image plane meets no tissue; move the probe onto the skin'
    TIP_OUT_OF_IMAGE = 'the needle tip is not in the image; move the probe or the needle'
    TIP_NOT_SEEN = ('no needle is seen where its tip is expected; check contact, hole and depth '
                    'of the needle')
    NOT_POSITIVE_DEFINITE = ('a covariance is not positive definite and the estimate is withheld; '
                             'reset the estimator and report the recording')

    UNREACHABLE = 'the probe cannot get there; the message says what is in the way'
    NO_SURFACE = 'the skin is not known where the probe shall stand; scan it again'
    NO_CONTACT = 'the probe found no skin and went back; scan again or give more time'
    OUT_OF_IMAGE = "the needle's tip lies outside the depth of the image; withdraw the needle"
    LIMIT_PASSED = 'a limit of force, speed or place was passed and the probe went back'
    NO_PLAN = 'no needle path to the target; move the template or take another hole or needle'
    NEEDLE_STANDS = ('the needle does not go where it was sent; look at its drive, and at the '
                     'force that stops it')
    TIMED_OUT = 'a step of the procedure took longer than allowed; the message names it'

    @property
    def ok(self):
        """True if the step did what was asked."""
        return self is Outcome.OK

    @property
    def advice(self):
        """What a person should try."""
        return self.value
