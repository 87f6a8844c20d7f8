"""A weight that hangs on the body and not in the scene, or is another one than the scene has."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.scene import PointLoad
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.build import load_masses, placement_mesh


@dataclass(frozen=True)
class PointMass(BodyTerm):
    """A mass added to what is carried at a material point, with its weight and its inertia.

    Symbols: m `mass`, X_c `centre`. The nodes around X_c share it as they share what a scene has
    under `loads` (`build.load_masses`): m there and m here are the same. Less than nothing takes
    such a load away, as far as every node keeps some mass. Rotary inertia of the weight and the
    length of its thread are left out.
    Test: tissue/terms/test_point_mass.py (cantilever, a scene's load, scales)
    """

    mass: float = quantity(
        0.0, 'g', 'mass added; negative takes a load of the scene away', low=-1e4, high=1e4,
        prior=('normal', 0.0, 30.0), typical=20.0,
        source='a marker with its cable, a weight of a set (engineering judgement)', neutral=0.0)
    centre: tuple = quantity(
        [0.0, 0.0, 58.0], 'mm', 'where it hangs, at rest, world frame', shape=(3,),
        low=-500.0, high=500.0, source='top of a 58 mm breast phantom')

    spec: ClassVar[TermSpec] = TermSpec(
        name='point_mass', kind=Kind.BOUNDARY, stage=Stage.BODY,
        summary='a weight hangs on the body that the scene does not have, or has otherwise',
        equation='M_aa -> M_aa + m N_a(X_c), f_a -> f_a + m N_a(X_c) g',
        source='lumped mass and dead load: Clough & Penzien 1993, Dynamics of Structures, ch. 10',
        invisible_when='the scene has no gravity and is quasi-static: neither weight nor inertia '
                       'acts; or it hangs where the body is held',
        leaves_open='the size of the weight, and inertia of rotation')

    def prepare(self, body):
        """Return `body` carrying the mass.

        Raises MeshError if `centre` lies off the body, ConfigError if a node has no mass left.
        """
        if self.mass == 0.0:
            return body
        load = PointLoad(self.spec.name, self.centre, 1.0)
        share = load_masses(placement_mesh(body.mesh, body), (load,))
        carried = 0.0 if body.nodal_mass is None else body.nodal_mass
        loaded = replace(body, nodal_mass=carried + self.mass * share)
        if self.mass < 0.0:
            self._refuse_less_than_nothing(loaded, share)
        return loaded

    def _refuse_less_than_nothing(self, body, share):
        left = Assembler(body).lumped_mass()
        worst = int(np.argmin(np.where(share > 0.0, left, np.inf)))
        if not left[worst] > 0.0:
            raise ConfigError(f'point_mass: mass = {1e3 * self.mass:g} g leaves '
                              f'{1e3 * left[worst]:.3g} g on node {worst}; must leave more than '
                              'nothing: take away no more than hangs there')
