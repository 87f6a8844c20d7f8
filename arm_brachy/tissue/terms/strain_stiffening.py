"""Strain stiffening: the further tissue is strained, the stiffer it gets."""

from dataclasses import dataclass, replace
from typing import ClassVar

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class StrainStiffening(BodyTerm):
    """Yeoh's second term with a constant in proportion to each element's shear modulus.

    Without change of volume the stress of a bar at stretch l is 1 + 4 ratio (Ib - 3) times the
    Neo-Hookean one, Ib - 3 = l^2 + 2 / l - 3: with a ratio of 1, 1.9 times at l = 1.3 and 2.4
    times at l = 0.7, and 3 % more at a strain of 5 %. It is even in strain: push and pull stiffen
    alike, to first order. It knows neither rate nor history. The moduli at rest stay.
    Test: tissue/terms/test_strain_stiffening.py (bar, shear, scaling with all moduli)
    """

    ratio: float = quantity(
        0.0, '', "Yeoh's second constant over the shear modulus", low=0.0, high=50.0,
        prior=('uniform', 0.0, 4.0), typical=1.0,
        source='stress doubled at a strain of 0.3 (engineering judgement; the modulus of breast '
               'tissue depends highly on its preload: Ramiao et al. 2016, Biomech Model '
               'Mechanobiol 15:1307); limits wider', neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='strain_stiffening', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='stiffer the more it is strained',
        equation='Psi -> Psi + c (Ib - 3)^2;  c = ratio mu, Ib = J^(-2/3) tr(F^T F)',
        source='Yeoh 1993, Rubber Chem Technol 66:754 (its second term)',
        invisible_when='strains stay below some 5 %: the effect on stress is of third order in '
                       'strain',
        leaves_open='the course: exponential laws grow faster at large strain, others begin '
                    'later')

    def prepare(self, body):
        """Return `body` with a stiffening law; added to what stiffening it has."""
        if not self.ratio:
            return body
        before = 0.0 if body.stiffening is None else body.stiffening
        return replace(body, stiffening=before + self.ratio * body.mu)
