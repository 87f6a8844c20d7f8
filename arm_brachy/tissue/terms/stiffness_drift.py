"""A modulus that drifts during the run: drying, warming, curing."""

from dataclasses import dataclass
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class StiffnessDrift(BodyTerm):
    """Every modulus and remembered stress times a factor that grows or falls from `onset` on.

    Stress that the tissue remembers (viscoelasticity) scales along, so the term acts after those
    with memory. The stress-free shape stays: `swelling_drift` changes that.
    Test: tissue/terms/test_stiffness_drift.py (bar, relaxing element, marker invariance)
    """

    rate: float = quantity(
        0.0, 'per_min', 'relative change of the modulus per time', low=-2.0, high=2.0,
        prior=('normal', 0.0, 0.1), typical=0.2,
        source='engineering judgement: a gel that dries, warms or still sets; limits wider',
        neutral=0.0)
    onset: float = quantity(
        0.0, 's', 'when the drift begins', low=0.0, high=1e5, prior=('uniform', 0.0, 60.0),
        source='the start of the run, or any time in its first minute')

    spec: ClassVar[TermSpec] = TermSpec(
        name='stiffness_drift', kind=Kind.TISSUE, stage=Stage.BODY, timed=True,
        summary='modulus drifts during the run',
        equation='(mu, kappa, c, k, S_added) -> (1 + s) (mu, kappa, c, k, S_added), or over '
                 '1 - s where s < 0;  s = rate max(t - onset, 0)',
        source='first order of any drift; equilibrium div P = 0 is homogeneous in the modulus',
        invisible_when='only positions are recorded, pads are displacement-driven and no dead '
                       'load, spring support or inertia acts',
        leaves_open='the course: a drift may set in slowly or level off; a part of the body '
                    'alone')

    def prepare(self, body):
        """Return `body` as it is: the scene's moduli are those before the onset."""
        return body

    def memory(self, body):
        """Return the factor reached, 1. Not None, so that it grows from substep to substep."""
        return 1.0

    def before_step(self, body, memory, t, dt, fields):
        """Scale moduli and added stress in `fields` by the factor at t."""
        factor = drift(self.rate, self.onset, t)
        fields.scale_all_but_bulk(factor)
        fields.kappa *= factor
        fields.stress *= factor

    def after_step(self, body, memory, x, t, dt):
        """Return the factor at t."""
        return drift(self.rate, self.onset, t)


def drift(rate, onset, t):
    """Factor at t [s] of what drifts by `rate` [1/s] of itself from `onset` [s] on.

    With s = rate (t - onset) it is 1 + s where it grows and 1 / (1 - s) where it falls: the same
    to first order, positive however long the run.
    """
    s = rate * max(t - onset, 0.0)
    return 1.0 + s if s >= 0.0 else 1.0 / (1.0 - s)
