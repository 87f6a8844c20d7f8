"""A mesh is at fault where a better one explains more than physics; named if it shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.selection.mesh_check import ALLOWED, mesh_fault
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL

N, NOISE = 4000, 5e-5       # rows; m


class Made:
    """A match.Matched of N rows, positions first, in which a better mesh changes `share` sd."""

    def __init__(self, share):
        rng = stream(2, 'mesh fault')
        error = rng.standard_normal(N)
        self.U = np.column_stack([rng.standard_normal((N, 3)), 2.0 * share * error])
        self.r = rng.standard_normal(N) + share * error
        self.own = np.zeros(4, dtype=bool)
        self.nuisances = SimpleNamespace(names=('touch_1', 'touch_2', 'member', 'elements'))
        rows = [SimpleNamespace(kind=OPTICAL if i < N // 2 else FORCE) for i in range(N)]
        self.observables = SimpleNamespace(rows=rows, coloured=lambda values: NOISE * values)
        self.loosened = []

    def loosen(self, names, factor):
        self.loosened.append((names, factor))


@pytest.mark.parametrize('share, material', [(0.2, False), (1.0, True)])
def test_what_a_better_mesh_would_change_is_told_in_noise(share, material):
    made = Made(share)
    found = mesh_fault([made], physics=1.0)
    assert found.material is material
    assert found.share == pytest.approx(share, abs=0.03)
    assert found.error.value == pytest.approx(share * NOISE, rel=0.15)
    assert found.error.low < share * NOISE < found.error.high
    assert [factor for _, factor in made.loosened] == ([ALLOWED] if material else [])
    assert f'{1e3 * found.error.value:.3f} mm' in found.note


def test_what_calibration_takes_up_is_no_reason_for_another_mesh():
    """Forces 6 % off in all pads alike are another modulus, at ten of its deviations too."""
    made = Made(1.0)
    made.U[:, 0] = 0.05 * made.U[:, 3]
    found = mesh_fault([made], physics=1.0)
    assert found.gain > 20.0 and found.share < 0.1
    assert not found.material and made.loosened == []


def test_a_mesh_that_changes_nothing_is_sound():
    made = Made(0.02)
    assert mesh_fault([made], physics=1.0) is None and made.loosened == []


def test_physics_that_explains_more_is_no_fault_of_the_mesh():
    assert mesh_fault([Made(0.2)], physics=500.0) is None
