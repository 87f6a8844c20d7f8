"""Field distortion of the electromagnetic tracker by metal, at rest or carried by the pads."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec


@dataclass(frozen=True)
class EmDistortion(SensingTerm):
    """A smooth position error: fixed metal bends the field, moving metal shifts it.

    Symbols: p true position, c `centre`, L `extent` [m], g `gradient`, w `rotation` (half the
    curl), d_j pad displacement [m], k `pad_coupling`. Near the centre the error is the linear map
    g I + [w]x: divergence 3 g, curl 2 w; it fades over L. To first order this is what low-order
    polynomial calibration removes. Orientation is left alone. Holds at distances from the metal
    large against its size; 20 mm from a steel rod the error is far from linear.
    Test: devices/terms/test_em_distortion.py
    """

    centre: tuple = quantity([0.0, 0.0, 0.0], 'mm', 'where the static error vanishes, world frame',
                             low=-1000.0, high=1000.0, shape=(3,), prior=('normal', 0.0, 50.0),
                             source='the origin of calibration, by convention the scene origin')
    gradient: float = quantity(
        0.1, 'mm_per_mm', 'isotropic stretch of apparent position', low=-0.5, high=0.5,
        prior=('normal', 0.0, 0.1), typical=0.1,
        source='an Aurora errs by 4.2 mm at worst with a steel rod 20 mm away (Hummel et al. '
               '2005, Med. Phys. 32:2371); over a few centimetres that is about 0.1', neutral=0.0)
    rotation: tuple = quantity(
        [0.0, 0.0, 0.0], 'mm_per_mm', 'rotation vector of apparent position', low=-0.5, high=0.5,
        shape=(3,), prior=('normal', 0.0, 0.1), typical=0.1, source='as gradient',
        neutral=0.0)
    extent: float = quantity(
        150.0, 'mm', 'distance over which the static error fades', low=10.0, high=2000.0,
        prior=('lognormal', 150.0, 2.0), typical=150.0,
        source='about the size of a breast phantom (engineering judgement)')
    pad_coupling: tuple = quantity(
        [0.0, 0.0, 0.0], 'mm_per_mm', 'apparent shift per travel of the pad', low=-1.0, high=1.0,
        shape=(3,), prior=('normal', 0.0, 0.1), typical=0.1,
        source='as gradient, for metal that comes closer by the travel', neutral=0.0)
    pad: int = -1  # index of the pad that carries the metal; -1 means that every pad does

    spec: ClassVar[TermSpec] = TermSpec(
        name='em_distortion', kind=Kind.SENSING, stage=Stage.EM,
        summary='metal in the field displaces apparent EM positions',
        equation='y = p + (g I + [w]x)(p - c) exp(-|p - c|^2 / (2 L^2)) + k sum_j |d_j|',
        source='calibration by polynomials, at first order: survey of Kindratenko 2000, Virtual '
               'Reality 5:169; the fading is an own choice',
        invisible_when='the sensor does not move (static part) and the pads do not move '
                       '(pad part); one pad and one direction cannot split the two')

    def distort(self, t, names, values, pads):
        """Return the apparent positions (k, 3) [m].

        Raises ConfigError if `pad` is not among the pads.
        """
        arm = np.asarray(values, dtype=float) - self.centre
        fade = np.exp(-0.5 * np.sum(arm**2, axis=1) / self.extent**2)
        static = fade[:, None] * (self.gradient * arm + np.cross(self.rotation, arm))
        return values + static + self._travel(pads) * np.array(self.pad_coupling)

    def _travel(self, pads):
        travel = np.linalg.norm(np.asarray(pads, dtype=float).reshape(-1, 3), axis=1)
        if self.pad >= len(travel):
            raise ConfigError(f'em_distortion: pad = {self.pad}; must be -1 (all) or an index 0 '
                              f'to {len(travel) - 1}')
        return travel.sum() if self.pad < 0 else travel[self.pad]
