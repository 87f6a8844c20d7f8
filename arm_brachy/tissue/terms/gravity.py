"""Gravity that the model lacks, or that points elsewhere because the rig is tilted."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class Gravity(BodyTerm):
    """A uniform acceleration added to the scene's gravity, whatever that is, zero included.

    A scene without gravity whose z points up lacks (0, 0, -9.81) m/s^2. A rig under gravity g
    that leans by an angle a towards x adds g (sin a, 0, 1 - cos a): 2.54 and 0.33 m/s^2 at 15 deg.
    Hanging masses weigh the added acceleration too. The mesh remains the stress-free shape: a
    shape scanned under gravity has sagged already, which this term does not undo.
    Test: tissue/terms/test_gravity.py (column, shear layer, filled trough)
    """

    added: tuple = quantity(
        [0.0, 0.0, 0.0], 'm_s2', 'acceleration added to gravity, world frame', shape=(3,),
        low=-20.0, high=20.0, prior=('normal', 0.0, 4.0), typical=2.5,
        source='a tilt of 15 deg is 9.81 sin 15 deg, left out 9.81: both are met (engineering '
               'judgement)', neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='gravity', kind=Kind.TISSUE, stage=Stage.BODY,
        summary='gravity missing from the model, or tilted',
        equation='g -> g + added',
        source='dead load rho g per reference volume',
        invisible_when='rho |added| L << mu; or nearly incompressible tissue whose free surface '
                       'is a plane normal to it (pressure bears it); in one orientation, tied to '
                       'the shape and to the modulus',
        leaves_open='a density that differs from place to place')

    def prepare(self, body):
        """Return `body` with gravity changed."""
        return replace(body, gravity=np.asarray(body.gravity, dtype=float) + self.added)
