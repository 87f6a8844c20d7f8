"""By how much an actuator errs from place to place: a screw, a gear or a scale that is not even.

The marker on a pad minus the encoder as a function of where the encoder says the pad is, beyond
what a gain and a smooth bend make: a cubic spline beside all else that the pad's marker shows.
No term of the registry says it; what is left of the marker is looked at without it.
Test: diagnosis/structural/test_course.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.stats import chi2

from arm_brachy.diagnosis.statistics.gls import regress

COUNTS = (8, 15, 30, 60)    # coefficients that are tried; 60 show turns of 0.4 mm over 6 mm
DEGREE = 3
SMOOTH = (1, 2, 3)      # powers of the travel that are no unevenness: slides and arms bend
# Of its standard deviation, what a course is taken to be known to beside the marker that it was
# found from, so that this counts hardly more than once.
UNSURE = 3.0


@dataclass(frozen=True)
class Course:
    """An error that follows the place, a gain and what yields in proportion to it included.

    spline : of the encoder's travel [m], error [m];  modes : the same of k errors of it, one
        standard deviation each, that have nothing to do with each other
    rms : [m] of the course where the pad is away from home, beyond a cubic
    chance : probability of so much beyond a cubic without any;  statistic : its fall of chi^2
    """

    spline: BSpline
    modes: BSpline
    rms: float
    statistic: float
    chance: float

    def error(self, u):
        """How much farther than u (n,) [m] the pad is; as at the ends beyond what was seen."""
        return self.spline(self._within(u))

    def unsure(self, u):
        """By how much the error at u (n,) [m] may be another, UNSURE times: (n, k) [m]."""
        return UNSURE * self.modes(self._within(u))

    def _within(self, u):
        return np.clip(u, self.spline.t[DEGREE], self.spline.t[-DEGREE - 1])


def course_of(t, y, travel, others, rivals, valid, colour, sd, *, away):
    """The Course that y follows, whatever its chance; None where the pad hardly moved.

    t : (n,) [s];  y : (n, 1) [m] marker minus encoder along the push;  travel : (n,) [m]
    others, rivals : name -> column (n,) of what the marker shows besides, and of what it might
        show in the place of a course: that is tested beside all, its shape found without these
    valid : (n,);  colour, sd : of the noise, as gls.regress
    away : [m] from home that counts as moved
    """
    low, high = float(travel.min()), float(travel.max())
    moved = valid & (np.abs(travel) > away)
    if high - low <= 2.0 * away or not moved.any():
        return None
    powers = np.stack([(travel / max(abs(low), abs(high)))**k for k in SMOOTH], axis=1)
    smooth = {f'travel^{k}': column for k, column in zip(SMOOTH, powers.T, strict=True)}
    fits = [_splined(t, y, travel, others, count, valid, colour, sd) for count in COUNTS]
    found, modes, columns = min(fits, key=lambda one: one[3])[:3]
    plain = regress(t, y, others | rivals | smooth, valid, colour, sd)
    uneven = regress(t, y, others | rivals | columns, valid, colour, sd)
    shape, bend = found(travel[moved]), np.column_stack([np.ones(moved.sum()), powers[moved]])
    beyond = shape - bend @ np.linalg.lstsq(bend, shape, rcond=None)[0]
    fall, more = float(plain.chi2[0] - uneven.chi2[0]), plain.dof - uneven.dof
    return Course(found, modes, float(np.sqrt(np.mean(beyond**2))), fall,
                  min(1.0, len(COUNTS) * float(chi2.sf(fall, max(more, 1)))))


def _splined(t, y, travel, others, count, valid, colour, sd):
    """(Course.spline and modes, 0 at home, their columns, information criterion (BIC)) of
    `count` terms.
    """
    low, high = float(travel.min()), float(travel.max())
    inner = np.linspace(low, high, count - DEGREE + 1)
    knots = np.concatenate([[low] * DEGREE, inner, [high] * DEGREE])
    every = BSpline(knots, np.eye(count), DEGREE)(np.clip(travel, low, high))
    columns = {f'course {k}': column for k, column in enumerate(every.T)}
    fit = regress(t, y, others | columns, valid, colour, sd)
    found = np.array([fit.of(name)[0] for name in columns])
    index = [fit.names.index(name) for name in columns]
    power, ways = np.linalg.eigh(fit.covariance[np.ix_(index, index)])
    noise = sd[0] * np.sqrt(max(fit.chi2[0] / fit.dof, 1.0))
    spread = noise * ways * np.sqrt(np.maximum(power, 0.0))
    return (_from_home(knots, found), _from_home(knots, spread), columns,
            float(fit.chi2[0]) + count * np.log(valid.sum()))


def _from_home(knots, coefficients):
    """The spline less its value at home, or where a pad that never comes home is nearest to it."""
    home = BSpline(knots, coefficients, DEGREE)(np.clip(0.0, knots[0], knots[-1]))
    return BSpline(knots, coefficients - home, DEGREE)
