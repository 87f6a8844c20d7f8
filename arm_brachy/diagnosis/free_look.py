"""One recording of a released body: its scene, its release, how well the scene places its markers.

Test: diagnosis/test_free_body.py
"""

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.checks import refuse_misshapen
from arm_brachy.diagnosis.free_release import release_of
from arm_brachy.diagnosis.free_table import case_of
from arm_brachy.diagnosis.stream import OPTICAL
from arm_brachy.recording.rigid import fit_rigid


class Look:
    """A prepared.Prepared recording without pads.

    release : free_release.Release;  scene : core.scene.Scene
    placement : [m] per axis by which markers at rest are off their places
    """

    def __init__(self, prepared):
        self.prepared, self.scene = prepared, prepared.evidence.scene
        _refuse_other_markers(prepared)
        self.release = release_of(prepared)
        self.placement = _placement(prepared)

    def index(self, specimen):
        """Channels of the release among the points of a Specimen."""
        every = (*specimen.markers, *specimen.tools)
        return np.array([every.index(name) for name in self.release.names])

    def case(self, specimen, priors):
        """Its free_table.Case."""
        return case_of(self.release, self.scene, self.index(specimen), priors,
                       self.prepared.calibration)


def _refuse_other_markers(prepared):
    """Raise RecordingError if its markers at rest, on base and tissue, are not the scene's.

    A body that is held before it is let go has the shape of its scene then.
    """
    found, optical = prepared.registration, prepared.evidence.get(OPTICAL)
    if found is None or optical is None:
        return
    seen = np.isfinite(found.rest).all(axis=1)
    if seen.sum() >= 3:
        refuse_misshapen(prepared.evidence.name,
                         tuple(n for n, here in zip(optical.names, seen, strict=True) if here),
                         found.rest[seen], optical.rest[seen], prepared.evidence.scene)


def _placement(prepared):
    """[m] per axis: what the scene's places of all markers miss at rest, a frame taken out."""
    usual, found = prepared.calibration.placement, prepared.registration
    optical = prepared.evidence.get(OPTICAL)
    if found is None or optical is None:
        return usual
    seen = np.isfinite(found.rest).all(axis=1)
    if seen.sum() < 3:
        return usual
    try:
        off = fit_rigid(found.rest[seen], optical.rest[seen]).residual
    except RecordingError:      # on one line: no frame to take out
        return usual
    return max(usual, float(np.sqrt(np.sum(off ** 2) / (3 * seen.sum() - 6))))
