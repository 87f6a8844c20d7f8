"""Bulk modulus error: the tissue gives more or less volume than the model thinks."""

from dataclasses import dataclass, replace
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class Compressibility(BodyTerm):
    """Bulk modulus times one factor; the shear modulus stays, so Poisson's ratio changes.

    nu = (3 kappa - 2 mu) / (6 kappa + 2 mu): a factor of 0.3 takes 0.490 to 0.467. Where the
    tissue is free to bulge the effect is of the order mu / kappa.
    Test: tissue/terms/test_compressibility.py (confined and free block, hydrostatic pressure)
    """

    factor: float = quantity(
        1.0, '', 'bulk modulus over the bulk modulus of the scene', low=0.01, high=100.0,
        prior=('lognormal', 1.0, 2.0), typical=0.3,
        source='kappa / mu of 50 taken for 15 (nu = 0.49 and 0.467): models of the breast use nu '
               'from 0.45 to 0.5 (engineering judgement); limits wider', neutral=1.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='compressibility', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='bulk modulus off',
        equation='kappa -> factor kappa',
        source='(3.18): kappa / 2 (J - 1)^2 is the only part of the energy that sees volume',
        invisible_when='the tissue deforms without change of volume: pure shear, or kappa >> mu '
                       'before and after with room to bulge (effect of order mu / kappa)',
        leaves_open='where: the bulk modulus may be off in a part of the body; fluid that leaves'
                    ' with time')

    def prepare(self, body):
        """Return `body` with the bulk modulus scaled."""
        return replace(body, kappa=self.factor * body.kappa)
