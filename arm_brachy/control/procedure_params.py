"""What a procedure with needle and probe is asked to do, and how long each step may take."""

from dataclasses import dataclass, field
from typing import Literal

from arm_brachy.core.quantity import quantity, word

_OWN = 'own choice: several times what an undisturbed step takes'


@dataclass(frozen=True)
class StepLimits:
    """Longest time of each step of a procedure; a step that is not over then ends it by name."""

    registering: float = quantity(15.0, 's', 'until the estimator says where the target is',
                                  low=0.1, high=600.0, source=_OWN)
    scanning: float = quantity(5.0, 's', 'until the skin has been scanned', low=0.1, high=600.0,
                               source=_OWN)
    moving: float = quantity(30.0, 's', 'until the pads have brought the target to its goal',
                             low=0.1, high=600.0, source=_OWN)
    placing: float = quantity(30.0, 's', 'until the needle stands where the probe can see it',
                              low=0.1, high=600.0, source=_OWN)
    approaching: float = quantity(30.0, 's', 'until the probe is in contact over the tip',
                                  low=0.1, high=600.0, source=_OWN)
    meeting: float = quantity(30.0, 's', 'until the tip is in the image plane', low=0.1,
                              high=600.0, source=_OWN)
    inserting: float = quantity(60.0, 's', 'until the needle is at its depth', low=0.1,
                                high=3600.0, source=_OWN)
    withdrawing: float = quantity(60.0, 's', 'until the needle is out', low=0.1, high=3600.0,
                                  source=_OWN)
    retracting: float = quantity(30.0, 's', 'until the probe is off the skin', low=0.1,
                                 high=600.0, source=_OWN)
    homing: float = quantity(60.0, 's', 'until the pads are home', low=0.1, high=600.0,
                             source=_OWN)
    standing: float = quantity(2.0, 's', 'that a needle which was sent on stands still', low=0.1,
                               high=600.0, source='own choice: more than the 0.1 s from an order '
                                                  'to a change of the measured depth')
    waiting: float = quantity(5.0, 's', 'that the needle stands still because tip, skin or '
                                        'target are lost, or because the cell holds', low=0.1,
                              high=600.0,
                              source='ten times the goal for regaining contact, 0.5 s')


@dataclass(frozen=True)
class SteeringParams:
    """The person who looks at the overlay: reads the tip against the grid, turns the needle.

    What is simulated: a look every so often. If the place where the tip will be at the target's
    depth is off the target by more than can be seen, the base of the needle is turned by half a
    turn or less, and the bevel steers it there. That place comes from the curvature that the
    images of the tip show; the overlay marks it.
    """

    look: float = quantity(0.5, 's', 'from one look at the screen to the next', low=0.05,
                           high=60.0, source='a fixation and a reaction of 0.25 s each, Card, '
                                             'Moran, Newell 1983, The Psychology of '
                                             'Human-Computer Interaction, ch. 2')
    seen: float = quantity(0.5, 'mm', 'distance of the foretold tip from the target, from which '
                                      'on the needle is turned', low=0.0, high=50.0,
                           source='a tenth of the pitch of the grid (own choice)')


@dataclass(frozen=True)
class ProcedureParams:
    """Register, bring the target onto the needle's path, insert under the probe, withdraw.

    target : name of a target of the scene
    hole : column and row of the template, the first of each 0; what is not given is chosen
    axes : of the world in which the pads move the target
    overlay : the person sees the template's holes over the image, and corrects
    turn : the plan may turn the needle over on its way to where the probe first sees it
    foresee : the plan counts on where the probe's force will have moved the target
    recentre : the pads take the target, once the images show it, onto where the tip will be
    """

    target: str
    hole: tuple[int, ...] = word('column and row of the template, the first of each 0; a '
                                 'column alone, or empty: the rest is chosen', default=())
    axes: tuple[Literal['x', 'y', 'z'], ...] = word('in which the pads move the target',
                                                    default=('x', 'y'))
    overlay: bool = word("the template's holes are drawn over the image, and the person who "
                         'looks corrects', default=True)
    turn: bool = word('the needle is turned over on its way to where the probe first sees it, so '
                      'that needles that bend unlike end alike', default=True)
    foresee: bool = word("the plan counts on where the probe's force will have moved the target, "
                         "by the controller's model", default=True)
    recentre: bool = word('the pads take the target, once the images show it, onto where the tip '
                          'will be', default=False)
    reach: float = quantity(8.0, 'mm', 'largest displacement of the target by the pads', low=0.0,
                            high=50.0, source='tasks of 5 mm and their diagonal, thesis ch. 3')
    miss: float = quantity(2.0, 'mm', 'by which the planned path may pass the target, where no '
                           'pad moves it', low=0.0, high=50.0,
                           source='own choice: four times what the tip may be off the image plane')
    tolerance: float = quantity(0.5, 'mm', 'distance from its goal at which the target has '
                                           'arrived', low=0.01, high=10.0,
                                source='twice the steady-state error of target_1_markers')
    calm: float = quantity(1.0, 's', 'that the target has to stay at its goal, and the '
                           'probe in contact, before the next step', low=0.0, high=60.0,
                           source='ten control periods')
    view: float = quantity(20.0, 'mm', 'before the target, along the needle, where the probe '
                           'finds the tip for the first time', low=0.0, high=200.0,
                           source='own choice: a probe that turns by 40 degrees about a point 20 '
                                  'mm over the needle sees 17 mm to either side; a needle turned '
                                  '20 mm before can still be led 20^2 / 2 R = 0.5 mm aside')
    speed: float = quantity(5.0, 'mm_s', 'of insertion', low=0.1, high=200.0,
                            source='robotic insertion: 5 to 20 mm/s')
    near: float = quantity(4.0, 'mm', 'before its depth, from which on the needle goes slowly; '
                           'it slows down on as much before, and speeds up on as much after the '
                           'start', low=0.0, high=50.0,
                           source='own choice: the images show the target by then')
    near_speed: float = quantity(2.0, 'mm_s', 'of insertion there', low=0.1, high=200.0,
                                 source='own choice: a probe that follows the tip 0.1 s late goes '
                                        'on by 0.2 mm once it stops')
    entry: float = quantity(20.0, 'mm_s', 'speed of the way to where the probe sees the tip first',
                            low=0.1, high=200.0, source='own choice')
    withdrawal: float = quantity(40.0, 'mm_s', 'speed of the way out, the probe off', low=0.1,
                                 high=200.0, source='a third of the 123 mm/s mean of clinical '
                                                    'maxima of needle speed')
    dwell: float = quantity(2.0, 's', 'that the needle stays at the target', low=0.0, high=600.0,
                            source='own choice: longer than the relaxation of the tissue')
    lost: float = quantity(2.0, 'mm', 'distance of the tip from the image plane at which the '
                                      'needle waits for the probe', low=0.1, high=50.0,
                           source="the beam's width across the plane")
    tip_patience: float = quantity(0.5, 's', 'of the insertion without the tip in an image, from '
                                   'which on the needle waits', low=0.05, high=60.0,
                                   source='own choice: ten images, 2.5 mm of the way')
    limits: StepLimits = field(default_factory=StepLimits)
    steering: SteeringParams = field(default_factory=SteeringParams)
