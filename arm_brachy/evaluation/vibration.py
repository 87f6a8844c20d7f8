"""Free vibration of a body that was let go: recording beside model, marker by marker."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.evaluation.page import Cell, Column, Grid, number
from arm_brachy.evaluation.regimes import RINGING, SETTLED, inside
from arm_brachy.evaluation.ringing import Ringing, ringing

MM = 1e3
REGIME = 'free vibration'
VISIBLE = 10.0  # a marker rings if its largest departure exceeds this many noise floors


@dataclass(frozen=True)
class Pair:
    """One marker: Ringing measured and predicted, and where it settles from rest (3,) [m]."""

    marker: str
    measured: Ringing
    predicted: Ringing
    sag_measured: np.ndarray
    sag_predicted: np.ndarray

    def row(self):
        """The pair as a row of a result, units in the keys."""
        row = {'marker': self.marker, 'regime': REGIME}
        for name, one, sag in (('measured', self.measured, self.sag_measured),
                               ('model', self.predicted, self.sag_predicted)):
            row |= {f'frequency_{name}_Hz': one.frequency, f'damping_ratio_{name}': one.damping,
                    f'amplitude_{name}_mm': one.amplitude * MM, f'sag_z_{name}_mm': sag[2] * MM}
        return row


def compare(data, floor):
    """Pair for every marker that rings; none if `data` has no ringing.

    data : timeseries.ResidualData;  floor : (k,) [m] noise
    The mode is fitted to measured and predicted positions alike over the ringing regime, and the
    sag is their mean over the settled one. Comparison only: nothing goes back into the model.
    """
    ringing_frames = inside(data.t, data.regimes, (RINGING,))
    settled_frames = inside(data.t, data.regimes, (SETTLED,))
    if data.kind != 'position' or not ringing_frames.any():
        return ()
    t = data.t[ringing_frames]
    pairs = []
    for k, marker in enumerate(data.names):
        measured, predicted = data.measured[:, k], data.predicted[:, k]
        free = measured[ringing_frames]
        if not np.nanmax(np.linalg.norm(free - np.nanmean(free, axis=0), axis=1)) > (
                VISIBLE * floor[k]):
            continue
        if not np.ptp(predicted[ringing_frames], axis=0).any():
            continue  # on the base: the model says it stands
        sags = [np.nanmean(x[settled_frames], axis=0) - data.rest[k]
                for x in (measured, predicted)]
        pairs.append(Pair(marker, ringing(t, free), ringing(t, predicted[ringing_frames]), *sags))
    return tuple(pairs)


def grid(pairs):
    """The table of the report, page.Grid; without rows if nothing rings."""
    columns = [Column('Marker', numeric=False)]
    for title, unit in (('Frequency', 'Hz'), ('Damping ratio', '1'), ('Amplitude', 'mm'),
                        ('Settles at z', 'mm')):
        columns += [Column(f'{title}, measured', unit), Column(f'{title}, model', unit)]
    rows = tuple((Cell(pair.marker), *(Cell(text) for text in _texts(pair))) for pair in pairs)
    return Grid(tuple(columns), rows, (
        'One decaying mode, fitted to the motion along its main direction while the body rings; '
        'amplitude at the moment of release. Settles at: mean over the settled stretch, from '
        'rest. Fitted for comparison only; nothing goes back into the model.'))


def _texts(pair):
    m, p = pair.measured, pair.predicted
    return (number(m.frequency), number(p.frequency), number(m.damping, 4), number(p.damping, 4),
            number(m.amplitude * MM), number(p.amplitude * MM),
            number(pair.sag_measured[2] * MM), number(pair.sag_predicted[2] * MM))
