"""Markers on the base of a released body: one that moved against all others is at fault itself.

Test: diagnosis/test_free_release.py
"""

import numpy as np

from arm_brachy.diagnosis.results.finding import Finding, sigma
from arm_brachy.diagnosis.signals.stream import OPTICAL


def base_marker_findings(releases, slack):
    """Findings of the markers that free_release.Releases left out; a tuple.

    slack : [m] standard deviation per axis of what a sound base may move
    """
    return tuple(_finding(release, *release.odd, slack) for release in releases
                 if release.odd is not None)


def _finding(release, name, moved, slack):
    sd, size = np.full(3, slack), float(np.linalg.norm(moved))
    return Finding(OPTICAL, name, None, '', moved, 'm', sd, sigma(moved, sd), release.t,
                   release.t + float(release.since[-1]),
                   f'{release.name}: {name} moves by {1e3 * size:.2f} mm against the other '
                   'markers of the base when the body is let go; the marker or its track is at '
                   'fault.')
