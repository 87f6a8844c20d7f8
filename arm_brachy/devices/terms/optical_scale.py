"""A wrong unit of length of the optical tracker: everything looks larger or smaller."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec


@dataclass(frozen=True)
class OpticalScale(SensingTerm):
    """All marker positions are stretched alike, away from one point.

    Symbols: p true position, c `centre` [m], s `scale`. The centre is where the tracker's frame
    was matched with the world's; another one adds a constant, s (c - c'). Holds for a rig whose
    calibration knows shapes but got one length wrong; lenses that bend the space are left out.
    Test: devices/terms/test_optical_scale.py
    """

    scale: float = quantity(
        0.008, '', 'apparent length over length, minus one', low=-0.2, high=0.2,
        prior=('normal', 0.0, 0.008), typical=0.008,
        source='engineering judgement: a calibration wand of 240 mm taken 2 mm too long',
        neutral=0.0)
    centre: tuple = quantity([0.0, 0.0, 0.0], 'mm', 'the point that stays, world frame',
                             low=-1000.0, high=1000.0, shape=(3,), prior=('normal', 0.0, 50.0),
                             source='frames are matched at the base, by convention the scene '
                                    'origin')

    spec: ClassVar[TermSpec] = TermSpec(
        name='optical_scale', kind=Kind.SENSING, stage=Stage.OPTICAL,
        summary='optical positions are scaled about a point',
        equation='y = c + (1 + s) (p - c)',
        source='cameras know a scene up to a similarity only: Hartley & Zisserman 2004, Multiple '
               'View Geometry, sec. 10.2',
        invisible_when='no length is tied by encoders, EM tracker or gravity: then it equals a '
                       'body of another size; markers that do not move show nothing without a '
                       'known distance',
        leaves_open='a scale that differs between depth and the image plane; distortion of a '
                    'lens')

    def distort(self, t, names, values, pads):
        """Return the apparent positions (k, 3) [m]."""
        return values + self.scale * (np.asarray(values, dtype=float) - self.centre)
