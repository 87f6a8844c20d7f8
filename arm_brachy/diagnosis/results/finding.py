"""What the recording says by itself: one finding per statement, and what is still no fault."""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit
from scipy.stats import chi2, f

from arm_brachy.diagnosis.settings import FindingRules

ALARM = 1e-3   # probability of a false finding in a recording without faults, all tests together
ALIKE = 3.0    # standard deviations within which two estimates are one
LOUDEST = 37.0  # z whose tail as a chi^2 is still a number
CERTAIN = 38.0  # z whose tail is the smallest number there is: for what is seen, not estimated


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
    ways : rival -> parameters, as above, of each of those that it would take together; a rival
        that is not in it has the finding's own place
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
    ways: dict = field(default_factory=dict)

    @property
    def nameless(self):
        """True if it is a departure from the model that no term says; silence [s] is none."""
        return self.term is None and self.unit != 's'

    @property
    def probability(self):
        """Probability that it is there, by its size z alone."""
        return probability(self.z, np.size(self.value))

    @property
    def sure(self):
        """True if it is a cause without the model being asked."""
        return self.probability >= FindingRules().told


def threshold(tests, dof=1):
    """z above which one of `tests` tests is a finding; `dof` components make up its chi^2."""
    return float(np.sqrt(chi2.isf(ALARM / max(tests, 1), dof)))


def probability(z, dof=1, rules=None):
    """Probability of a fault that shows as `z` standard deviations of `dof` components together.

    Upper bound over the sizes that a fault may have: a tail p gives odds of at most
    1 / (-e p ln p) (Sellke, Bayarri & Berger 2001, Am Stat 55:62), times the prior odds of
    settings.FindingRules. Valid for p < 1 / e; 0 for more.
    """
    log_tail = chi2.logsf(min(z, LOUDEST)**2, dof)
    if log_tail > -1.0:
        return 0.0
    log_odds = np.log((rules or FindingRules()).prior) - 1.0 - log_tail - np.log(-log_tail)
    return float(expit(log_odds))


def sigma(value, sd, slack=0.0):
    """z of an estimate: its size over error and calibration together.

    value, sd : float or (c,);  slack : standard deviation per component that is no fault
    """
    both = np.sqrt(np.square(sd) + slack ** 2)
    return float(np.sqrt(np.sum(np.square(np.asarray(value) / both))))


def log_tail(value, sd, dof, slack=0.0):
    """Log of the chance of an estimate as large as `value` (c,), whose sd (c,) is estimated too.

    dof : degrees of freedom from which sd is known;  slack : as of `sigma`
    Of the Fisher statistic; with slack, which is known, the degrees of freedom are Satterthwaite's
    (1946, Biometrics Bull 2:110), of the axis that has fewest.
    Valid for errors that are Gaussian and independent.
    """
    value, sd = np.atleast_1d(value), np.atleast_1d(sd)
    plain = sigma(value, sd, slack)
    known = dof * ((sd**2 + slack**2) / np.maximum(sd**2, 1e-300))**2
    return float(f.logsf(plain**2 / len(value), len(value), known.min()))


def sigma_of_tail(log_chance, dof=1):
    """z of the chi^2 of `dof` components that is as rare."""
    if log_chance < np.log(1e-300):
        return CERTAIN
    return float(np.sqrt(chi2.isf(min(np.exp(log_chance), 1.0), dof)))


def weighted_mean(estimates, slack=0.0):
    """Mean of (value, sd) pairs by their errors and `slack` together; (value, sd)."""
    values, errors = (np.array(x) for x in zip(*estimates, strict=True))
    weight = 1.0 / (errors ** 2 + slack ** 2)
    return float(np.sum(weight * values) / weight.sum()), float(weight.sum() ** -0.5)


def alike(estimates, slack=0.0):
    """True if (value, sd) pairs agree with their mean within errors and `slack`."""
    mean, _ = weighted_mean(estimates, slack)
    return all(sigma(value - mean, sd, slack) < ALIKE for value, sd in estimates)
