"""Which point of an optical frame is which marker: identity kept, outliers left out by name."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from arm_brachy.core.quantity import quantity

_FORBIDDEN = 1e6   # [m] cost of a pair that no gate admits


@dataclass(frozen=True)
class IntakeParams:
    """How far from its prediction a point may be and still be the marker."""

    first_gate: float = quantity(
        10.0, 'mm', 'largest distance of a marker from where the model has it at first, and '
        'whenever it comes back', low=0.1, high=100.0,
        source='half of the 20 mm at which an outlier has to be found; markers of the scene are '
               '20 mm apart and more')
    gate: float = quantity(
        3.0, 'mm', 'largest distance from the prediction for a marker seen a moment ago at rest',
        low=0.1, high=100.0, source='100 times the noise of an optical tracker; reaction of '
        'tissue that the prediction lacks')
    gate_share: float = quantity(
        0.5, '', 'by which the gate opens for each predicted motion since the marker was seen',
        low=0.0, high=2.0, source='first-order prediction against the model: 20 % at 20 mm pushes')
    gate_speed: float = quantity(
        1.0, 'mm_s', 'by which the gate opens with time since the marker was seen', low=0.0,
        high=1000.0, source='own choice: relaxation of a soft phantom after a push')


@dataclass(frozen=True)
class Intake:
    """The markers of one frame.

    points : (m, 3) [m] W, in the order of the scene, NaN where not seen or left out
    rejected : names whose own point lies where no marker can be
    swapped : names whose point carried another marker's label
    labelled : number of markers of the scene that the frame has a point of
    """

    points: np.ndarray
    rejected: tuple
    swapped: tuple
    labelled: int


class MarkerIntake:
    """Assigns the points of a frame to markers by least summed distance to their prediction.

    A marker's prediction is where it was last, moved by what the model says that the pads have
    moved it since. A point is no candidate for a marker outside the marker's gate, so that one
    that jumps is left out for as long as it stays away.
    Valid while markers are further apart than the gate: nearer ones can change places unseen.
    Test: estimation/test_marker_intake.py
    """

    def __init__(self, params, motion):
        """params : IntakeParams;  motion : marker_motion.MarkerMotion."""
        self.params, self._motion = params, motion
        self._index = {name: i for i, name in enumerate(motion.names)}
        self.reset()

    def reset(self):
        """Forget where markers were."""
        m = len(self._index)
        self._last, self._when = np.full((m, 3), np.nan), np.full(m, -np.inf)
        self._predicted_then = np.full((m, 3), np.nan)

    def take(self, t, q, ids, points):
        """Identify one frame.

        t : [s], later than the last;  q : (p,) [m] travel at t
        ids : labels;  points : (n, 3) [m] in W, NaN where hidden
        Returns Intake.
        """
        modelled = self._motion.at(q)
        seen = np.isfinite(points).all(axis=1)
        labels, points = [n for n, s in zip(ids, seen, strict=True) if s], points[seen]
        marker, point = self._pairs(*self._predicted(t, modelled), points)
        found = np.full(modelled.shape, np.nan)
        found[marker] = points[point]
        self._last[marker], self._when[marker] = points[point], t
        self._predicted_then[marker] = modelled[marker]
        return Intake(found, *self._said(labels, marker, point))

    def _predicted(self, t, modelled):
        """(predictions (m, 3), gates (m,)) for time t."""
        p = self.params
        known = np.isfinite(self._when)
        moved = np.where(known[:, None], modelled - self._predicted_then, 0.0)
        where = np.where(known[:, None], self._last + moved, modelled)
        since = np.where(known, t - self._when, 0.0)
        gate = p.gate + p.gate_share * np.linalg.norm(moved, axis=1) + p.gate_speed * since
        return where, np.where(known, np.minimum(gate, p.first_gate), p.first_gate)

    @staticmethod
    def _pairs(where, gate, points):
        """Indices (markers, points) of the assignment, pairs outside a gate left out."""
        distance = np.linalg.norm(where[:, None] - points[None], axis=2)
        allowed = distance <= gate[:, None]
        marker, point = linear_sum_assignment(np.where(allowed, distance, _FORBIDDEN))
        kept = allowed[marker, point]
        return marker[kept], point[kept]

    def _said(self, labels, marker, point):
        """(rejected, swapped, labelled), names in the order of the scene."""
        names = self._motion.names
        taken, given = set(point.tolist()), set(marker.tolist())
        swapped = tuple(names[m] for m, k in zip(marker, point, strict=True)
                        if labels[k] in self._index and labels[k] != names[m])
        rejected = tuple(n for n in names if n in labels and self._index[n] not in given
                         and labels.index(n) not in taken)
        return rejected, swapped, sum(n in self._index for n in labels)
