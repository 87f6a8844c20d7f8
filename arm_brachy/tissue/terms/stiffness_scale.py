"""Uniform modulus error: the tissue is stiffer or softer than the model, everywhere alike."""

from dataclasses import dataclass
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class StiffnessScale(BodyTerm):
    """Every modulus times one factor; Poisson's ratio stays, and the shape of the law.

    Forces scale with the factor. Positions do not change as long as the body is driven by
    displacements alone, because the equilibrium equations are homogeneous in the modulus; a dead
    load, a spring support or inertia breaks that.
    Test: tissue/terms/test_stiffness_scale.py
    """

    factor: float = quantity(
        1.0, '', 'modulus over the modulus of the scene', low=0.05, high=20.0,
        prior=('lognormal', 1.0, 1.5), typical=1.2,
        source='breast tissues span 1 (fat) to 13 (carcinoma) x gland (Samani et al. 2007, Phys '
               'Med Biol 52:1565); limits wider, engineering judgement', neutral=1.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='stiffness_scale', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='modulus uniformly off',
        equation='mu -> factor mu;  kappa, c, k likewise',
        source='equilibrium div P = 0 is homogeneous of degree one in the moduli',
        invisible_when='only positions are recorded, pads are displacement-driven and no dead '
                       'load, spring support or inertia acts',
        leaves_open='whether the bulk modulus is off as well; a factor that differs from place '
                    'to place')

    def prepare(self, body):
        """Return `body` with all moduli scaled."""
        return body.with_stiffness(self.factor)
