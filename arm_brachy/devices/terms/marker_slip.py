"""An optical marker that slid or was knocked: it is tracked well, but sits elsewhere."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec


@dataclass(frozen=True)
class MarkerSlip(SensingTerm):
    """One marker is shifted by a constant vector from an instant on.

    Symbols: p_i true position of marker i, s `marker`, b `offset` [m], t_s `onset` [s]. The shift
    keeps its direction in the world frame; a real marker also turns with the surface, which
    matters when that turns by more than about 10 deg (17 % of the shift).
    Test: devices/terms/test_marker_slip.py
    """

    marker: str | int = 0  # name, or index into the stream
    onset: float = quantity(0.0, 's', 'when it slips', low=0.0, high=1e5,
                            prior=('uniform', 0.0, 60.0), source='any time; 0 = before the start')
    offset: tuple = quantity([0.8, 0.0, 0.0], 'mm', 'where it went, world frame', low=-50.0,
                             high=50.0, shape=(3,), prior=('normal', 0.0, 1.0), typical=0.8,
                             source='a fifth of the 4 mm marker diameter (thesis sec. 4.4)',
                             neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='marker_slip', kind=Kind.SENSING, stage=Stage.OPTICAL,
        summary='one optical marker no longer sits where it was glued',
        equation='y_i(t) = p_i(t) + b if i = s and t >= t_s else p_i(t)',
        source='soft-tissue artefact of skin markers: Leardini et al. 2005, Gait & Posture 21:212',
        invisible_when='the marker is hidden from the onset on, or the onset precedes the '
                       'recording and the reference position is taken from it',
        leaves_open='a marker that creeps over seconds, or slips several times')

    def distort(self, t, names, values, pads):
        """Return values (k, 3) with one row shifted from the onset on.

        Raises ConfigError if the stream has no such marker.
        """
        out = np.array(values, dtype=float)
        index = self._index(names)
        if t >= self.onset:
            out[index] += self.offset
        return out

    def _index(self, names):
        names = list(names)
        if isinstance(self.marker, int) and 0 <= self.marker < len(names):
            return self.marker
        if self.marker in names:
            return names.index(self.marker)
        raise ConfigError(f'marker_slip: marker = {self.marker!r}; must be one of '
                          f'{", ".join(names)} or an index 0 to {len(names) - 1}')
