"""Field distortion of the electromagnetic tracker by metal, far or near, at rest or on a pad."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec

NEAR = 0.05         # m from a piece of metal: where `pull` is the shift
NEAREST = 0.01      # m: closer to it the error grows no more


@dataclass(frozen=True)
class EmDistortion(SensingTerm):
    """A position error: far metal bends the field smoothly, near metal draws what is close to it.

    Symbols: p true position, c `centre`, L `extent` [m], g `gradient`, w `rotation` (half the
    curl), d_j pad displacement [m], k `pad_coupling`, q `pull`, R 50 mm, m `metal` and how far its
    pad has gone. Near the centre the error is the linear map g I + [w]x: divergence 3 g, curl 2 w;
    it fades over L. To first order this is what low-order polynomial calibration removes, of a
    field that stretches alike in all directions. Orientation is left alone. Holds at distances
    from the metal large against its size.

    A piece of metal at m shifts by q what is R from it, and by the inverse cube of the distance
    elsewhere, but no more than at 10 mm. Its direction, that of the metal's moment, is taken as
    the same everywhere: right where one tool is close to it, or several are on the same side.
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
    pad: int = -1  # index of the pad that carries this metal; -1 means that every pad does
    pull: tuple = quantity(
        [0.0, 0.0, 0.0], 'mm', 'apparent shift 50 mm from a piece of metal', low=-20.0, high=20.0,
        shape=(3,), prior=('normal', 0.0, 0.5), typical=0.5,
        source='an Aurora errs by 4.2 mm 20 mm from a steel rod (Hummel et al. 2005, Med. Phys. '
               '32:2371): by the cube 0.3 mm at 50 mm, of larger pieces more', neutral=0.0)
    metal: tuple = quantity(
        [0.0, 0.0, 0.0], 'mm', 'where it is at rest, world frame', low=-1000.0, high=1000.0,
        shape=(3,), prior=('normal', 0.0, 100.0),
        source='engineering judgement: within the reach of its error')
    carrier: int = -1  # index of the pad that it is on; -1 means none, it stays

    spec: ClassVar[TermSpec] = TermSpec(
        name='em_distortion', kind=Kind.SENSING, stage=Stage.EM,
        summary='metal in the field displaces apparent EM positions',
        equation='y = p + (g I + [w]x)(p - c) exp(-|p - c|^2 / (2 L^2)) + k sum_j |d_j| '
                 '+ q (R / |p - m|)^3',
        source='calibration by polynomials, at first order: survey of Kindratenko 2000, Virtual '
               'Reality 5:169; the inverse cube of the distance to metal: Nixon et al. 1998, '
               'Presence 7:204; fading and direction are own choices',
        invisible_when='the sensor does not move (static part) and the pads do not move '
                       '(pad part); one pad and one direction cannot split the two',
        leaves_open='several pieces of metal; a field that changes with time; coupling to pads '
                    'that is not linear')

    def distort(self, t, names, values, pads):
        """Return the apparent positions (k, 3) [m].

        Raises ConfigError if `pad` or `carrier` is not among the pads.
        """
        arm = np.asarray(values, dtype=float) - self.centre
        fade = np.exp(-0.5 * np.sum(arm**2, axis=1) / self.extent**2)
        static = fade[:, None] * (self.gradient * arm + np.cross(self.rotation, arm))
        pads = np.asarray(pads, dtype=float).reshape(-1, 3)
        shift = self._travel(pads) * np.array(self.pad_coupling)
        return values + static + shift + self._pulled(np.asarray(values, dtype=float), pads)

    def _travel(self, pads):
        travel = np.linalg.norm(pads, axis=1)
        _refuse('pad', self.pad, 'all', len(travel))
        return travel.sum() if self.pad < 0 else travel[self.pad]

    def _pulled(self, values, pads):
        """(k, 3) [m] by which the piece of metal shifts what is at `values` (k, 3) [m]."""
        if not any(self.pull):
            return np.zeros_like(values)
        _refuse('carrier', self.carrier, 'none', len(pads))
        there = self.metal + (pads[self.carrier] if self.carrier >= 0 else np.zeros(3))
        r = np.maximum(np.linalg.norm(values - there, axis=1), NEAREST)
        return np.outer((NEAR / r)**3, self.pull)


def _refuse(field, index, nothing, count):
    """Raise ConfigError for the index of a pad that there is not."""
    if index >= count:
        raise ConfigError(f'em_distortion: {field} = {index}; must be -1 ({nothing}) or an index '
                          f'0 to {count - 1}')
