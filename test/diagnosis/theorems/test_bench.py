"""A bench that gives way or trembles as little as a careful laboratory leaves: no physics."""

import numpy as np

from arm_brachy.diagnosis.likelihood.match import SET_UP
from arm_brachy.diagnosis.likelihood.nuisances import MODULUS
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import BASE, OPTICAL, TISSUE


def test_a_bench_that_gives_way_a_little_is_within_the_tolerances(breast, once):
    """Base markers move by 0.02 mm at the deepest push: the nuisances take that up."""
    matched = breast.watch(once, markers=(TISSUE, BASE))
    base = np.array([body == BASE for body in matched.baseline.model.specimen.carriers])
    push = np.abs(matched.baseline.path.at(matched.baseline.t)).max(axis=1)
    moved = {kind: np.zeros_like(shown) for kind, shown in matched.baseline.shown.items()}
    moved[OPTICAL][:, base, 2] = Calibration().base * (push / push.max())[:, None]
    effect = matched.observables.residual(
        {k: matched.baseline.shown[k] - moved[k] for k in moved}) - matched.r
    assert np.linalg.norm(effect) > 1.0
    left = effect - matched.U @ np.linalg.lstsq(matched.U, effect, rcond=None)[0]
    # Encoders of the other pads wobble by a count, 1e-4 of the push.
    assert np.linalg.norm(left) < 1e-3 * np.linalg.norm(effect)


def test_what_is_set_up_anew_is_no_property_of_the_body_or_its_sensors(breast, once):
    names = breast.watch(once, markers=(TISSUE, BASE)).nuisances.names
    anew = {name for name in names if name.startswith(SET_UP)}
    assert {'frame_shift_x', 'touch_pad_1', 'force_pad_1_z'} <= anew
    assert not anew & {'gain_pad_1', MODULUS}
    assert not [name for name in anew if name.startswith(('optical_', 'base_', 'gain', 'mesh'))]


def test_a_floor_that_trembles_a_little_is_within_the_tolerances_where_it_is_seen(breast, rich):
    """By 0.02 mm in any direction and phase, where base markers show the rhythm."""
    wave = {'name': 'breathing', 'amplitude_mm': 0.02, 'frequency_Hz': 0.37, 'phase_deg': 40.0,
            'direction': [0.3, -0.2, 1.0]}
    for floor, taken in ((wave | {'amplitude_mm': 0.04}, True), (None, False)):
        matched = breast.watch(rich, *([floor] if floor else []), markers=(TISSUE, BASE))
        assert not [f for f in matched.recorded.structure.findings if f.term == 'breathing']
        effect = matched.observables.whiten(breast.changed(matched, wave))[:, 0]
        assert np.linalg.norm(effect) > 1.0
        left = effect - matched.U @ np.linalg.lstsq(matched.U, effect, rcond=None)[0]
        part = np.linalg.norm(left) / np.linalg.norm(effect)
        assert part < 0.1 if taken else part > 0.3
