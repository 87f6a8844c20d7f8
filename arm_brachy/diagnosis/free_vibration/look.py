"""One recording of a released body: its scene, its release, its markers' places.

Test: diagnosis/test_free_body.py
"""

import numpy as np

from arm_brachy.diagnosis.free_vibration.initial_shape import seen_held
from arm_brachy.diagnosis.free_vibration.observation import case_of
from arm_brachy.diagnosis.free_vibration.release import release_of
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.diagnosis.signals.validation import refuse_misshapen


class Look:
    """A preparation.Prepared recording without pads.

    release : release.Release;  scene : core.scene.Scene
    """

    def __init__(self, prepared):
        self.prepared, self.scene = prepared, prepared.evidence.scene
        _refuse_other_markers(prepared)
        self.release = release_of(prepared)

    def index(self, specimen):
        """Channels of the release among the points of a Specimen."""
        every = (*specimen.markers, *specimen.tools)
        return np.array([every.index(name) for name in self.release.names])

    def case(self, specimen, priors):
        """Its observation.Case."""
        calibration = self.prepared.calibration
        held = seen_held(self.release, specimen, priors, calibration.placement)
        return case_of(self.release, self.scene, self.index(specimen), held, priors, calibration)


def _refuse_other_markers(prepared):
    """Raise RecordingError if its markers at rest, on base and tissue, are not the scene's.

    A body that is held before it is let go has nearly the shape of its scene then.
    """
    found, optical = prepared.registration, prepared.evidence.get(OPTICAL)
    if found is None or optical is None:
        return
    seen = np.isfinite(found.rest).all(axis=1)
    if seen.sum() >= 3:
        refuse_misshapen(prepared.evidence.name,
                         tuple(n for n, here in zip(optical.names, seen, strict=True) if here),
                         found.rest[seen], optical.rest[seen], prepared.evidence.scene)

