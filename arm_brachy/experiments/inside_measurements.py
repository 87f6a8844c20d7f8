"""What an estimator of the inside is given of a plant: encoders and tracked markers."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.random import stream
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.estimation.estimate import Surface

PERIOD = 0.1     # s between frames, the control period of the cell
REST_FRAMES = 3  # before the first push
# Of every push: what an estimator knows at the end of them is scored.
HOLD_FRAMES = 6
TRACKER = OpticalParams(rate=1.0 / PERIOD, latency=0.0)


@dataclass(frozen=True)
class Session:
    """One push as an estimator sees it.

    surfaces : Surface, in time order;  ends : (d,) index of the last one of every depth
    """

    surfaces: tuple
    ends: np.ndarray


def session(scene, push, names, seed, name):
    """Measure a Push with the simulated optical tracker; returns Session.

    scene : of the plant, for its landmarks;  push : inside_plants.Push
    names : tissue markers that are seen, in the order of the estimator's
    seed, name : of the noise; all sets of markers see the same draws
    The pads go from depth to depth between two frames.
    """
    tissue = [m for m in scene.markers if m.body == 'tissue']
    keep = [i for m in names for i, one in enumerate(tissue) if one.name == m]
    rng = stream(seed, f'registration/{name}')
    # rotations are about the centroid of the markers that the estimator knows
    frame = Registration(scene, push.markers[0][keep].mean(axis=0), rng)
    tracker = OpticalTracker(TRACKER, [m.name for m in tissue], (),
                             stream(seed, f'optical_tracker/{name}'))
    order = np.repeat(np.arange(len(push.q)), [REST_FRAMES] + [HOLD_FRAMES] * (len(push.q) - 1))
    surfaces = tuple(Surface(PERIOD * (k + 1), push.q[i].copy(),
                             frame.apply(seen.points)[keep], frame.covariance)
                     for k, (i, seen) in enumerate(zip(order, _frames(tracker, push, order),
                                                       strict=True)))
    return Session(surfaces, REST_FRAMES + HOLD_FRAMES * np.arange(1, len(push.q)) - 1)


def _frames(tracker, push, order):
    nothing = np.zeros((push.q.shape[1], 3))
    for k, i in enumerate(order):
        before = push.markers[order[max(k - 1, 0)]]
        yield from tracker.advance(PERIOD * k, before, PERIOD * (k + 1), push.markers[i],
                                   nothing, nothing)


class Registration:
    """The rigid error with which the tracker's frame was brought into W, drawn once.

    Landmarks are the rigid markers of base and homed pads, each off by the tracker's calibration
    error; the covariance is that of their least squares fit to first order (Fitzpatrick, West &
    Maurer 1998, IEEE Trans Med Imaging 17:694).
    """

    def __init__(self, scene, about, rng):
        """about : (3,) [m] point that rotations are about."""
        landmarks = np.array([m.position for m in scene.markers if m.body != 'tissue'])
        error = TRACKER.calibration_error / np.sqrt(3.0)
        rows = np.vstack([np.hstack([-_cross(p - about), np.eye(3)]) for p in landmarks])
        self.covariance = error**2 * np.linalg.inv(rows.T @ rows)
        draw = np.linalg.cholesky(self.covariance) @ rng.standard_normal(6)
        self._about, self._R, self._p = about, Rotation.from_rotvec(draw[:3]), draw[3:]

    def apply(self, points):
        """Points (k, 3) [m] in W as the registration has them."""
        return self._about + self._R.apply(points - self._about) + self._p


def _cross(v):
    """(3, 3) matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
