"""Damping error: a body that rings for longer or shorter than its model."""

from dataclasses import dataclass, replace
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec

_SOURCE = ('engineering judgement: damping of a phantom is known to a factor of two before it is '
           'measured; limits wider')


@dataclass(frozen=True)
class Damping(BodyTerm):
    """Both Rayleigh coefficients of the scene times a factor each; dynamics only.

    A mode of angular frequency w then has the damping ratio
    (alpha_factor alpha / w + beta_factor beta w) / 2. A scene without damping stays without.
    Test: tissue/terms/test_damping.py (logarithmic decrement)
    """

    alpha_factor: float = quantity(
        1.0, '', 'mass-proportional damping over that of the scene', low=0.0, high=100.0,
        prior=('lognormal', 1.0, 2.0), typical=2.0, source=_SOURCE, neutral=1.0)
    beta_factor: float = quantity(
        1.0, '', 'stiffness-proportional damping over that of the scene', low=0.0, high=100.0,
        prior=('lognormal', 1.0, 2.0), typical=2.0, source=_SOURCE, neutral=1.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='damping', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='the body rings for longer or shorter',
        equation='alpha -> alpha_factor alpha;  beta -> beta_factor beta',
        source='Rayleigh damping, ratio alpha / (2 w) + beta w / 2: Clough & Penzien 1993, '
               'Dynamics of Structures',
        invisible_when='the scene is quasi-static, nothing moves fast enough to ring, or there '
                       'is no damping to scale; one mode alone sees a sum of the two',
        leaves_open='the law: losses that do not go with speed, as of friction, or of a pad that'
                    ' radiates')

    def prepare(self, body):
        """Return `body` with its damping scaled."""
        alpha, beta = body.damping
        return replace(body, damping=(self.alpha_factor * alpha, self.beta_factor * beta))
