"""Anisotropy: fibres, ligaments or layers that make the tissue stiffer in one direction."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.body import Fibres


@dataclass(frozen=True)
class Anisotropy(BodyTerm):
    """One family of straight fibres, everywhere alike, in proportion to each element's modulus.

    Symbols: a_0 the unit vector of the fibres at rest, k their modulus. At small strain they add
    4 k along themselves: with ratio 0.5, 2 mu to the tissue's 3 mu. They turn with the tissue and
    resist shortening as they resist stretch, as long as tissue holds them straight: with a ratio
    above 0.5 they kink where they are shortened to l^2 < 1 - 1 / (2 ratio), and there the law
    loses ellipticity (Merodio & Ogden 2002, Arch Mech 54:525). One family only.
    Test: tissue/terms/test_anisotropy.py (bar along and across, shear, kinking, rotation)
    """

    ratio: float = quantity(
        0.0, '', 'modulus of the fibres over the shear modulus', low=0.0, high=20.0,
        prior=('uniform', 0.0, 2.0), typical=0.5,
        source="Young's modulus up by two thirds along the fibres (engineering judgement: "
               'ligaments, or a fabric in a phantom); limits wider', neutral=0.0)
    azimuth: float = quantity(
        0.0, 'deg', 'direction in the x-y plane of the world, from x towards y', low=-180.0,
        high=180.0,
        prior=('uniform', -90.0, 90.0), source='every axis once: a_0 and -a_0 are the same fibres')
    elevation: float = quantity(
        0.0, 'deg', 'angle above the x-y plane, towards z', low=-90.0, high=90.0,
        prior=('uniform', -90.0, 90.0), source='as azimuth')

    spec: ClassVar[TermSpec] = TermSpec(
        name='anisotropy', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='fibres stiffen one direction',
        equation='Psi -> Psi + k / 2 (|F a_0|^2 - 1)^2;  k = ratio mu, a_0 = (cos elevation cos '
                 'azimuth, cos elevation sin azimuth, sin elevation)',
        source='standard reinforcing model: Qiu & Pence 1997, J Elasticity 49:1; I4 whole, not '
               'its isochoric part: Helfenstein et al. 2010, Int J Solids Struct 47:2056',
        invisible_when='the fibres are not strained; pushed by one pad alone, it hardly differs '
                       'from another modulus or a gradient of it',
        leaves_open='fibres that follow the shape or turn from place to place; two families; '
                    'fibres that carry tension only')

    @property
    def direction(self):
        """Unit vector a_0 (3,), world frame."""
        level = np.cos(self.elevation)
        return np.array([level * np.cos(self.azimuth), level * np.sin(self.azimuth),
                         np.sin(self.elevation)])

    def prepare(self, body):
        """Return `body` with fibres. Raises ConfigError if it has some already."""
        if not self.ratio:
            return body
        if body.fibres is not None:
            raise ConfigError('anisotropy: the body has fibres already; must be one family; leave '
                              'out one of the terms')
        return replace(body, fibres=Fibres(self.ratio * body.mu,
                                           np.tile(self.direction, (len(body.mu), 1))))
