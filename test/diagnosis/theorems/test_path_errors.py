"""What noise of the encoders leaves open of where the pads are is no cause's."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.model_error import path_errors
from arm_brachy.diagnosis.stream import ENCODER, FORCE

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
