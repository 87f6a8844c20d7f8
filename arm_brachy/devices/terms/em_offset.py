"""An EM tool seen beside where it is: registration or the sensor's place in the tool is off."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_names


@dataclass(frozen=True)
class EmOffset(SensingTerm):
    """Positions of some or all tools are shifted by a constant vector.

    Symbols: p_i true position of tool i, b `offset` [m]. The shift keeps its direction in the
    world frame, as a registration does; a sensor that sits wrong in its target turns with the
    tissue, which matters when that turns by more than about 10 deg (17 % of the shift).
    Test: devices/terms/test_em_offset.py
    """

    offset: tuple = quantity(
        [1.0, 0.0, 0.0], 'mm', 'apparent minus true position, world frame', low=-50.0, high=50.0,
        shape=(3,), prior=('normal', 0.0, 1.0), typical=1.0,
        source='an Aurora errs by 0.96 mm over 50 mm (Hummel et al. 2005, Med. Phys. 32:2371)',
        neutral=0.0)
    tools: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='em_offset', kind=Kind.SENSING, stage=Stage.EM,
        summary='EM positions are off by a constant',
        equation='y_i = p_i + b',
        source='definition: the constant term of a registration',
        invisible_when='only displacements from a rest frame are used, or the place of the sensor '
                       'in the tissue is known no better than the offset',
        leaves_open='an offset that settles with time, or turns with the sensor')

    def distort(self, t, names, values, pads):
        """Return the apparent positions (k, 3) [m].

        Raises ConfigError if the stream has no tool of a name in `tools`.
        """
        chosen = chosen_names(self.tools, names, 'em_offset: tools')
        return values + chosen[:, None] * np.array(self.offset)
