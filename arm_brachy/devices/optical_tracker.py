"""An optical tracker of the Vicon or OptiTrack kind: all markers of a frame in one message."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.devices.sampling import DelayLine, SampleTimes, fraction, lateness, lerp

_VICON = 'Merriaux et al. 2017, Sensors 17:1591 (Vicon): '
# Fewer cameras than this cannot triangulate a marker.
_CAMERAS_NEEDED = 2


@dataclass(frozen=True)
class Camera:
    """One camera of the rig."""

    position: tuple = quantity(None, 'mm', 'optical centre, world frame', shape=(3,))


@dataclass(frozen=True)
class OpticalParams:
    """Rate, noise and visibility.

    With `cameras` given, a marker is seen only while at least two of them see it within
    `facing_limit` of its outward normal; without, every marker could be seen.
    """

    rate: float = quantity(100.0, 'Hz', 'frames per second', low=1.0, high=2000.0,
                           source='usual for Vicon and OptiTrack (engineering judgement; thesis: '
                                  'none printed)')
    phase: float = quantity(0.0, 'ms', 'time of frame 0', low=0.0, high=1e4)
    latency: float = quantity(10.0, 'ms', 'from acquisition to delivery', low=0.0, high=1000.0,
                              source='one frame (engineering judgement)')
    noise: float = quantity(0.025, 'mm', 'rms length of the random error', low=0.0, high=20.0,
                            source=_VICON + 'static variability below 0.025 mm')
    noise_correlation: float = quantity(0.0, 's', 'correlation time of the noise (0 = white)',
                                        low=0.0, high=100.0,
                                        source='white unless measured; Skurowski & Pawlyta 2019, '
                                               'Sensors 19:4435 find coloured parts')
    calibration_error: float = quantity(
        0.15, 'mm', 'rms length of the constant error of each marker', low=0.0, high=20.0,
        source=_VICON + 'static mean absolute error 0.15 mm')
    occlusion_probability: float = quantity(
        0.005, '', 'fraction of the time that a marker is hidden', low=0.0, high=0.99,
        source='engineering judgement: five cameras about a phantom (thesis sec. 4.4), six (5.5)')
    occlusion_duration: float = quantity(0.2, 's', 'mean time that a marker stays hidden',
                                         low=1e-3, high=1e3,
                                         source='a hand or cable passing (engineering judgement)')
    dropout_probability: float = quantity(
        0.0005, '', 'probability that a visible marker is lost in one frame', low=0.0, high=1.0,
        source='engineering judgement: one frame in 20 s')
    cameras: tuple[Camera, ...] = ()
    facing_limit: float = quantity(70.0, 'deg', 'largest angle between normal and line of sight',
                                   low=1.0, high=180.0,
                                   source='a hemispherical 4 mm facial marker seen at 70 deg '
                                          'shows two thirds of its disc')


@dataclass(frozen=True)
class OpticalFrame:
    """All markers at one instant.

    t : s, time of acquisition by the tracker's clock;  frame_number : from 0
    ids : k marker names
    points : (k, 3) [m], world frame, NaN where hidden;  visible : (k,) bool
    """

    t: float
    frame_number: int
    ids: tuple
    points: np.ndarray
    visible: np.ndarray


class OpticalTracker:
    """Simulated tracker of k markers on tissue, pads and base; advanced tick by tick.

    params : OpticalParams;  names : k marker names;  rng : numpy Generator
    terms : sensing terms of Stage.OPTICAL, applied to the true positions, before noise
    normals : (k, 3) outward normals at rest, world frame; needed if params.cameras are given, and
        kept while the surface turns (good while it turns by less than about 20 deg)
    A frame is always delivered; markers are lost one by one. Swapped labels are not modelled.
    Test: devices/test_optical_tracker.py
    """

    def __init__(self, params, names, terms, rng, *, normals=None):
        self.params = params
        self.names = tuple(names)
        self._terms = tuple(terms)
        self._rng = rng
        k = len(self.names)
        self._normals = _unit_normals(params, normals, k)
        self._eyes = np.array([camera.position for camera in params.cameras]).reshape(-1, 3)
        self.times = SampleTimes(params.rate, params.phase)
        self._line = DelayLine(self.times, params.latency, lateness(self._terms))
        self._noise = ColouredNoise((k, 3), params.noise_correlation, 1.0 / params.rate, rng)
        self._bias = params.calibration_error / np.sqrt(3.0) * rng.standard_normal((k, 3))
        self._hidden = rng.random(k) < params.occlusion_probability

    def advance(self, t0, points0, t1, points1, pads0, pads1):
        """Follow the truth from t0 to t1 [s] and return the OpticalFrames delivered in (t0, t1].

        points0, points1 : (k, 3) [m] true marker positions, world frame, in the order of `names`
        pads0, pads1 : (p, 3) [m] true pad displacements
        Frames are acquired in (t0, t1] and delivered `latency` later, in order; ticks must follow
        each other without gap.
        """
        acquired = []
        for instant in self.times.between(t0, t1):
            f = fraction(instant, t0, t1)
            frame = self._frame(instant, lerp(points0, points1, f), lerp(pads0, pads1, f))
            acquired.append((instant.number, frame))
        return self._line.exchange(acquired, t0, t1)

    def _frame(self, instant, points, pads):
        noise = self._noise.draw()
        visible = self._visible(points)
        seen = points
        for term in self._terms:
            seen = term.distort(instant.t, self.names, seen, pads)
        seen = seen + self._bias + self.params.noise / np.sqrt(3.0) * noise
        seen[~visible] = np.nan
        return OpticalFrame(self._line.stamped(instant).t, instant.number, self.names, seen,
                            visible)

    def _visible(self, points):
        """Advance the occlusions by one frame; draws the same count whatever the state."""
        u, lost = self._rng.random((2, len(self.names)))
        self._hidden = u < hidden_next(self._hidden, self.params)
        return ~self._hidden & (lost >= self.params.dropout_probability) & self._faced(points)

    def _faced(self, points):
        if not len(self._eyes):
            return np.ones(len(points), dtype=bool)
        sight = self._eyes[None] - points[:, None]
        sight /= np.linalg.norm(sight, axis=2, keepdims=True)
        cosine = np.einsum('kcd,kd->kc', sight, self._normals)
        return np.sum(cosine >= np.cos(self.params.facing_limit), axis=1) >= _CAMERAS_NEEDED


def hidden_next(hidden, params):
    """Probability (k,) of being hidden in the next frame, given `hidden` (k,) in this one.

    The exact transition of a two-state Markov process with stationary probability
    occlusion_probability and mean stay 1 / mu = occlusion_duration; frame rate does not matter.
    """
    share = params.occlusion_probability
    mu = 1.0 / params.occlusion_duration
    decay = np.exp(-mu / (1.0 - share) / params.rate)
    return share + (hidden - share) * decay


def _unit_normals(params, normals, k):
    if not params.cameras:
        return None
    if normals is None or np.shape(normals) != (k, 3):
        raise ConfigError(f'optical_tracker: {len(params.cameras)} cameras but normals of shape '
                          f'{np.shape(normals)}; must be ({k}, 3), or leave cameras out')
    normals = np.array(normals, dtype=float)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
