"""Tests over all channels at once: does a pad turn as it goes?

A joint that gives, a rod that bends: no term of the registry turns a pad. Every pad is tried about
three axes through its centre, by an angle in proportion to its push, and to the square of that.
Test: diagnosis/theorems/test_pad_turn_tests.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from arm_brachy.diagnosis.signals.motion import TOUCH
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL

POWERS = (1, 2)     # of the push, that an angle may follow


@dataclass(frozen=True)
class Turn:
    """What such a test looks for.

    pad : name of the one that would turn;  power : of its push, that the angle would follow
    """

    pad: str
    power: int

    @property
    def said(self):
        """A sentence on what stands out if this does."""
        return (f'What stands out most goes with the pushes of {self.pad}, as if {self.pad} '
                'turned as it goes. No term of the registry does that: look at its joint.')


def pad_turn_tests(matched, parts):
    """Columns (N, m), whitened, and the Turn of each; arguments as of `misfit_tests`."""
    specimen, columns, labels = matched[0].baseline.model.specimen, [], []
    goes = np.any([_moves(m) for m in matched], axis=0)
    for i in np.flatnonzero(goes):
        along = specimen.body.pads[i].direction
        for axis in (along, *null_space(along[None]).T):
            turns = np.zeros((len(goes), 3))
            turns[i] = axis
            columns.append(np.vstack([_columns(m, i, turns, *part)
                                      for m, part in zip(matched, parts, strict=True)]))
            labels += [Turn(specimen.pads[i], power) for power in POWERS]
    rows = sum(len(observables.rows) for observables, _ in parts)
    return np.hstack([np.zeros((rows, 0)), *columns]), tuple(labels)


def _moves(m):
    """(p,) True for pads that are pushed in a Matched."""
    return np.ptp(m.recorded.states.q, axis=0) > TOUCH


def _columns(m, i, turns, observables, kept):
    """Columns (N, len(POWERS)) of pads turned by `turns` (p, 3), as the i-th is pushed."""
    push = m.recorded.states.q[kept, i] / max(np.abs(m.recorded.states.q[:, i]).max(), TOUCH)
    share = np.stack([push**power for power in POWERS], axis=1)
    changes = [m.baseline.pads_turned(k, turns) for k in kept]
    return observables.whiten({
        kind: np.stack([one[kind] for one in changes])[..., None] * share[:, None, None, :]
        for kind in (OPTICAL, EM, FORCE)})
