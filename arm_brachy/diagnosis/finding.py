"""What the recording says by itself: one finding per statement, and what is still no fault."""

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from arm_brachy.core.quantity import quantity

ALARM = 1e-3   # probability of a false finding in a recording without faults, all tests together
ALIKE = 3.0    # standard deviations within which two estimates are one
CERTAIN = 38.0  # z whose tail is the smallest number there is: for what is seen, not estimated


@dataclass(frozen=True)
class Calibration:
    """Standard deviations of what a laboratory that did nothing wrong leaves uncalibrated.

    An estimate is a fault only if it exceeds its own error and this together.
    """

    clock: float = quantity(2.0, 'ms', 'offset between the clocks of two streams', low=0.0,
                            high=1e3, source='own choice: streams stamped on one computer')
    gain: float = quantity(0.003, '', 'scale of an actuator or of its pad marker', low=0.0,
                           high=1.0, source='own choice: lead of a rolled screw, 0.3 %')
    play: float = quantity(0.02, 'mm', 'lost motion at a reversal', low=0.0, high=10.0,
                           source='own choice: two counts of a 12 bit encoder over 50 mm')
    compliance: float = quantity(0.01, 'mm_N', 'yield of an actuator', low=0.0, high=10.0,
                                 source='own choice: 100 N/mm is stiff for a bench')
    placement: float = quantity(0.3, 'mm', 'place of a marker on its body, per axis', low=0.0,
                                high=100.0, source='own choice: glued by hand to a drawing')
    scale: float = quantity(0.001, '', 'scale of an optical tracker', low=0.0, high=1.0,
                            source='own choice: calibration wand measured to 0.25 mm in 240 mm')
    em_registration: float = quantity(0.2, 'mm', 'zero of an EM tracker, and place of its '
                                      'sensor in the body, per axis', low=0.0, high=100.0,
                                      source='own choice: a shift of up to 0.5 mm')
    force_zero: float = quantity(0.03, 'N', 'zero of a force sensor, per axis', low=0.0,
                                 high=100.0, source='own choice: tared to one or two counts')
    force_gain: float = quantity(0.01, '', 'scale of a force sensor', low=0.0, high=1.0,
                                 source='own choice: hung with a few weights of 0.5 % each')
    sensor_axes: float = quantity(0.5, 'deg', 'turn of the axes of a force sensor, about each',
                                  low=0.0, high=90.0, source='own choice: screwed on to a stop; '
                                                             'as much as cross-talk of 1 %')
    force_drift: float = quantity(0.02, 'N_min', 'drift of a force sensor, per axis', low=0.0,
                                  high=100.0, source='own choice: 0.1 % of 20 N per minute')
    touch: float = quantity(0.2, 'mm', 'pad position where the encoder says zero', low=0.0,
                            high=10.0, source='own choice: where a pad first touches soft '
                                              'tissue, found by eye')
    direction: float = quantity(0.5, 'deg', 'direction of a push', low=0.0, high=90.0,
                                source='own choice: aligned by eye to a drawing')
    slip: float = quantity(0.01, 'mm', 'sudden step of a marker or pad, per axis', low=0.0,
                           high=10.0, source='own choice: glue and slides settle by microns')
    base: float = quantity(0.02, 'mm', 'motion of the base plate, per axis', low=0.0, high=10.0,
                           source='own choice: a bench that gives way a little')
    restless: float = quantity(0.02, 'mm', 'amplitude of a rhythm', low=0.0, high=10.0,
                               source='own choice: pumps and footsteps on a laboratory floor')


@dataclass(frozen=True)
class Finding:
    """One thing that is not as the scene and a sound cell would have it.

    stream : kind of stream (stream.ENCODER ...);  channel : marker, pad or tool, '' = all of them
    term : name of the term in the registry that says it, None if there is none
    parameter : of that term, '' if there is none
    value, sd : SI, float or (3,);  unit : SI unit in words
    z : size in standard deviations, calibration included (root of chi^2 for a vector)
    t_start, t_end : [s] from when to when
    statement : one sentence;  rivals : terms that this recording cannot tell from it
    onset : (low, high) [s] 90 % interval of a sudden beginning; None = it is there all along
    parameters : what the finding says of the term's fields, SI: `registry.by_name(term)` can be
        made from them; empty without a term
    slack : sd [SI] of what calibration leaves in the value besides; its interval has both
    errors : sd [SI] of other parameters that were estimated with it, of the same slack
    """

    stream: str
    channel: str
    term: str | None
    parameter: str
    value: float | np.ndarray
    unit: str
    sd: float | np.ndarray
    z: float
    t_start: float
    t_end: float
    statement: str
    rivals: tuple = ()
    onset: tuple | None = None
    parameters: dict = field(default_factory=dict)
    slack: float = 0.0
    errors: dict = field(default_factory=dict)

    @property
    def nameless(self):
        """True if it is a departure from the model that no term says; silence [s] is none."""
        return self.term is None and self.unit != 's'


def threshold(tests, dof=1):
    """z above which one of `tests` tests is a finding; `dof` components make up its chi^2."""
    return float(np.sqrt(chi2.isf(ALARM / max(tests, 1), dof)))


def sigma(value, sd, slack=0.0):
    """z of an estimate: its size over error and calibration together.

    value, sd : float or (c,);  slack : standard deviation per component that is no fault
    """
    both = np.sqrt(np.square(sd) + slack ** 2)
    return float(np.sqrt(np.sum(np.square(np.asarray(value) / both))))


def weighted_mean(estimates, slack=0.0):
    """Mean of (value, sd) pairs by their errors and `slack` together; (value, sd)."""
    values, errors = (np.array(x) for x in zip(*estimates, strict=True))
    weight = 1.0 / (errors ** 2 + slack ** 2)
    return float(np.sum(weight * values) / weight.sum()), float(weight.sum() ** -0.5)


def alike(estimates, slack=0.0):
    """True if (value, sd) pairs agree with their mean within errors and `slack`."""
    mean, _ = weighted_mean(estimates, slack)
    return all(sigma(value - mean, sd, slack) < ALIKE for value, sd in estimates)
