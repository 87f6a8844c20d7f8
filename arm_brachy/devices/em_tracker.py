"""An electromagnetic tracker of the NDI Aurora kind: one pose per tool and frame."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.devices.sampling import DelayLine, SampleTimes, fraction, lateness, lerp, slerp

# The specification of the tracker (thesis sec. 3.4.4), written down from memory.
_NDI = 'NDI Aurora V2, Planar 20-20 (specification, not checked against a copy): '
# NDI reports the fit residual as an indicator from 0 (best) to this (from memory as well).
_WORST_INDICATOR = 9.9
# The field of a dipole falls as r^-3 (Raab et al. 1979, IEEE Trans. AES 15:709): for constant
# receiver noise, position noise then grows as r^4 and orientation noise as r^3.
_POSITION_POWER = 4
_ORIENTATION_POWER = 3


class ToolStatus(IntEnum):
    """State of one tool in one frame; NDI's transform status codes (its Combined API sample)."""

    OK = 0x00
    OUT_OF_VOLUME = 0x09
    BAD_FIT = 0x11
    MISSING = 0x1F


@dataclass(frozen=True)
class EmTrackerParams:
    """Rate, noise, measurement volume and place of the field generator.

    Generator frame G: origin in the middle of its face, z out of the face into the volume. The
    volume is a box from `volume_near` to `volume_near + volume_depth` along z, `volume_width` wide
    in x and y (the characterised cube volume).
    """

    rate: float = quantity(40.0, 'Hz', 'frames per second', low=1.0, high=400.0,
                           source=_NDI + '40 Hz')
    phase: float = quantity(0.0, 'ms', 'time of frame 0', low=0.0, high=1e4)
    latency: float = quantity(25.0, 'ms', 'from acquisition to delivery', low=0.0, high=1000.0,
                              source='one frame: a pose is solved while the next is acquired '
                                     '(engineering judgement)')
    position_noise: float = quantity(
        0.14, 'mm', 'rms length of the position error, up to the reference distance', low=0.0,
        high=20.0, source='positional jitter of an Aurora, Hummel et al. 2005, Med. Phys. '
                          '32:2371 (a model before the V2)')
    orientation_noise: float = quantity(
        0.2, 'deg', 'rms angle of the orientation error, up to the reference distance', low=0.0,
        high=20.0, source=_NDI + '0.20 deg rms, 5DOF, cube volume')
    reference_distance: float = quantity(
        350.0, 'mm', 'distance from the generator beyond which noise grows', low=10.0, high=5000.0,
        source='chosen so that the rms over the cube volume, 0.45 mm, stays within the 0.48 mm '
               'of the specification (6DOF; not checked against a copy)')
    noise_correlation: float = quantity(0.0, 's', 'correlation time of the noise (0 = white)',
                                        low=0.0, high=100.0, source='white unless measured')
    dropout_probability: float = quantity(
        0.001, '', 'probability that a tool is missing from a frame', low=0.0, high=1.0,
        source='engineering judgement: one frame in 25 s')
    bad_fit_residual: float = quantity(
        3.0, 'mm', 'rms residual that is reported as a bad fit', low=0.01, high=100.0,
        source='engineering judgement: about six times the specified accuracy')
    sensor: Literal['5dof', '6dof'] = '5dof'
    generator_position: tuple = quantity([0.0, 0.0, -250.0], 'mm', 'origin of G, world frame',
                                         shape=(3,), source='below the couch, in mid-volume')
    generator_axis: tuple = quantity([0.0, 0.0, 1.0], '', 'z of G, world frame', shape=(3,))
    generator_side: tuple = quantity([1.0, 0.0, 0.0], '', 'x of G, world frame, made normal to z',
                                     shape=(3,))
    volume_near: float = quantity(50.0, 'mm', 'start of the volume', low=0.0, high=5000.0,
                                  source=_NDI + 'cube volume starts 50 mm from the face')
    volume_depth: float = quantity(500.0, 'mm', 'depth of the volume', low=1.0, high=5000.0,
                                   source=_NDI + 'cube volume 500 x 500 x 500 mm')
    volume_width: float = quantity(500.0, 'mm', 'width of the volume', low=1.0, high=5000.0,
                                   source=_NDI + 'cube volume 500 x 500 x 500 mm')


@dataclass(frozen=True)
class ToolSample:
    """One tool in one frame.

    t : s, time of acquisition by the tracker's clock
    frame_number : from 0, the same for all tools of a frame
    position : (3,) [m], world frame, NaN unless status is OK
    quaternion : (4,) x, y, z, w, tool to world, w >= 0, NaN unless status is OK. A 5DOF sensor has
        no roll about its axis (tool z): reported is the smallest rotation that takes world z to
        the axis
    quality : NDI's indicator, 0 (best) to 9.9, of the residual of the fit; NaN without a fit. It
        says how noisy the place is; it is independent of the error of this very sample
    """

    t: float
    tool: str
    frame_number: int
    position: np.ndarray
    quaternion: np.ndarray
    quality: float
    status: ToolStatus


class EmTracker:
    """Simulated tracker of k tools; advanced tick by tick along the true motion.

    params : EmTrackerParams;  tools : k names;  rng : numpy Generator
    terms : sensing terms of Stage.EM, applied to the true positions, before noise
    Not modelled: distortion of orientations and the effect of distortion on the fit residual.
    Test: devices/test_em_tracker.py
    """

    def __init__(self, params, tools, terms, rng):
        self.params = params
        self.tools = tuple(tools)
        self._terms = tuple(terms)
        self._rng = rng
        self.times = SampleTimes(params.rate, params.phase)
        self._line = DelayLine(self.times, params.latency, lateness(self._terms))
        self._noise = ColouredNoise((len(self.tools), 6), params.noise_correlation,
                                    1.0 / params.rate, rng)
        self._R_GW = _generator_axes(params)

    def advance(self, t0, points0, rot0, t1, points1, rot1, pads0, pads1):
        """Follow the truth from t0 to t1 [s] and return the ToolSamples delivered in (t0, t1].

        points0, points1 : (k, 3) [m] true positions at t0 and t1, world frame
        rot0, rot1 : (k, 3, 3) true rotations, tool to world
        pads0, pads1 : (p, 3) [m] true pad displacements
        Samples are acquired in (t0, t1] and delivered `latency` later, in order; ticks must
        follow each other without gap.
        """
        acquired = []
        for instant in self.times.between(t0, t1):
            f = fraction(instant, t0, t1)
            frame = self._frame(instant, lerp(points0, points1, f), slerp(rot0, rot1, f),
                                lerp(pads0, pads1, f))
            acquired += [(instant.number, sample) for sample in frame]
        return self._line.exchange(acquired, t0, t1)

    def _frame(self, instant, points, rotations, pads):
        """All tools at one instant. Draws the same count whatever the state, in a fixed order."""
        noise, v, lost = self._draw()
        p_G = (points - self.params.generator_position) @ self._R_GW.T
        growth = np.maximum(np.linalg.norm(p_G, axis=1) / self.params.reference_distance, 1.0)
        residual = _residual(self.params, growth, v)
        status = self._status(p_G, residual, lost)
        seen = points
        for term in self._terms:
            seen = term.distort(instant.t, self.tools, seen, pads)
        scale = growth[:, None]**_POSITION_POWER * self.params.position_noise / np.sqrt(3.0)
        seen = seen + scale * noise[:, :3]
        turned = self._turn(rotations, growth, noise[:, 3:])
        return [_sample(self._line.stamped(instant), *tool)
                for tool in zip(self.tools, seen, turned, residual, status, strict=True)]

    def _draw(self):
        k = len(self.tools)
        return (self._noise.draw(), self._rng.standard_normal((k, 3)),
                self._rng.random(k) < self.params.dropout_probability)

    def _turn(self, rotations, growth, noise):
        """Noisy quaternions (k, 4); a 5DOF sensor has two angles to be wrong by and no roll."""
        rms = growth[:, None]**_ORIENTATION_POWER * self.params.orientation_noise
        if self.params.sensor == '6dof':
            error = Rotation.from_rotvec(rms / np.sqrt(3.0) * noise)
            return (Rotation.from_matrix(rotations) * error).as_quat(canonical=True)
        tilted = _tilted_axis(rms / np.sqrt(2.0) * noise[:, :2])
        return np.array([smallest_rotation(R @ a)
                         for R, a in zip(rotations, tilted, strict=True)]).reshape(-1, 4)

    def _status(self, p_G, residual, lost):
        half = 0.5 * self.params.volume_width
        depth = p_G[:, 2] - self.params.volume_near
        inside = ((np.abs(p_G[:, :2]) <= half).all(axis=1)
                  & (depth >= 0.0) & (depth <= self.params.volume_depth))
        status = np.full(len(p_G), int(ToolStatus.OK))
        status[residual > _WORST_INDICATOR] = ToolStatus.BAD_FIT
        status[~inside] = ToolStatus.OUT_OF_VOLUME
        status[lost] = ToolStatus.MISSING
        return [ToolStatus(code) for code in status]


def smallest_rotation(axis):
    """Return the quaternion (x, y, z, w), w >= 0, of the least rotation from world z to `axis`.

    axis : (3,), any length. axis = -z, where every horizontal line would do, is reached about x.
    """
    x, y, z = axis / np.linalg.norm(axis)
    across = np.hypot(x, y)
    if across == 0.0:
        return np.array([0.0, 0.0, 0.0, 1.0]) if z > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
    half = 0.5 * np.arctan2(across, z)
    return np.array([-y * np.sin(half) / across, x * np.sin(half) / across, 0.0, np.cos(half)])


def _tilted_axis(angle):
    """Tool z after turning it about tool x and y together by `angle` (k, 2) [rad]; (k, 3)."""
    size = np.linalg.norm(angle, axis=1)
    sine = np.sinc(size / np.pi)  # sin(size) / size
    return np.column_stack([sine * angle[:, 1], -sine * angle[:, 0], np.cos(size)])


def _residual(params, growth, v):
    """NDI's indicator (k,), from the residual of a fit whose noise is independent of the error."""
    rms = params.position_noise * growth**_POSITION_POWER * np.linalg.norm(v, axis=1) / np.sqrt(3)
    return _WORST_INDICATOR * rms / params.bad_fit_residual


def _sample(instant, tool, position, quaternion, residual, status):
    position, quaternion = position.copy(), quaternion.copy()
    quality = min(float(residual), _WORST_INDICATOR)
    if status is not ToolStatus.OK:
        position[:] = np.nan
        quaternion[:] = np.nan
    if status in (ToolStatus.MISSING, ToolStatus.OUT_OF_VOLUME):
        quality = np.nan
    return ToolSample(instant.t, tool, instant.number, position, quaternion, quality, status)


def _generator_axes(params):
    """Rotation (3, 3) from world to G. Raises ConfigError if the axes are parallel or zero."""
    z, side = np.array(params.generator_axis), np.array(params.generator_side)
    y = np.cross(z, side)
    if not np.linalg.norm(y) > 1e-6 * np.linalg.norm(z) * np.linalg.norm(side):
        raise ConfigError(f'em_tracker: generator_axis = {list(z)} and generator_side = '
                          f'{list(side)}; must be non-zero and not parallel')
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return np.array([np.cross(y, z), y, z])
