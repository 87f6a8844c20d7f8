"""What noise of the encoders leaves open of where the pads are is no cause's."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from arm_brachy.diagnosis.isolation.positioning_error import Course
from arm_brachy.diagnosis.likelihood.discrepancy import course_errors, path_errors
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE

LOUD = 1e-4     # m


@pytest.fixture(scope='module')
def matched(breast, once):
    """Matched of a recording with encoders of which noise was taken."""
    recorded = breast.record(once)
    encoder = recorded.streams[ENCODER]
    encoder = replace(encoder, taken=np.full(len(encoder.names), LOUD))
    return breast.beside(replace(recorded, streams=recorded.streams | {ENCODER: encoder}))


def test_every_state_may_have_every_pad_elsewhere_by_what_its_window_leaves(matched):
    baseline, states = matched.baseline, matched.recorded.states
    found = path_errors(baseline, matched.recorded)
    pads = baseline.model.specimen.pads
    assert len(found.names) == len(states.t) * len(pads)
    i = int(np.argmax(states.width))
    j = found.names.index(f'path_{pads[1]}_{states.t[i]:.2f}')
    column = found.values[FORCE][..., j]
    assert not np.delete(column, i, axis=0).any()
    size = LOUD * min(0.5, np.sqrt(matched.recorded.prepared.evidence.get(ENCODER).period
                                   / states.width[i]))
    expected = baseline.pads_moved(i, size * np.eye(len(pads))[1])[FORCE]
    np.testing.assert_allclose(column[i], expected, rtol=1e-12, atol=0.0)


def test_they_are_each_recordings_own(matched):
    found = path_errors(matched.baseline, matched.recorded)
    own = replace(matched, nuisances=found).own
    assert own.all()


def test_a_course_that_is_another_is_explained_and_pads_that_go_evenly_have_none(matched):
    """Where the encoder was put right by a wrong course the pad is elsewhere, in every state."""
    assert course_errors(matched.baseline, matched.recorded).names == ()
    baseline, recorded = matched.baseline, matched.recorded
    encoder = recorded.prepared.evidence.get(ENCODER)
    pad, knots = encoder.names[np.ptp(encoder.values[..., 0], axis=0).argmax()], np.linspace(
        0.0, 0.01, 4)
    modes = BSpline(np.pad(knots, 3, 'edge'), 1e-5 * np.diag([0.0, 1.0, 2.0, 3.0, 2.0, 1.0]), 3)
    course = Course(BSpline(modes.t, np.zeros(6), 3), modes, 1e-4, 50.0, 0.0)
    structure = replace(recorded.structure, pads=(SimpleNamespace(pad=pad, course=course),))
    found = course_errors(baseline, replace(recorded, structure=structure))
    u = np.interp(baseline.t, encoder.t, encoder.values[:, encoder.names.index(pad), 0])
    share = np.array([0.3, -1.0, 0.5, 2.0, -0.4, 1.0])
    off = course.unsure(u) @ share
    unit = np.array([float(one == pad) for one in baseline.model.specimen.pads])
    for i in (0, len(u) // 2, len(u) - 1):
        moved = baseline.pads_moved(i, off[i] * unit)
        for kind, change in moved.items():
            np.testing.assert_allclose(found.values[kind][i] @ share, change, atol=1e-12)
    assert np.abs(off).max() > 1e-5
