"""A linear ultrasound probe that looks into a deforming body: picture, overlay, tip of the needle.

Scatterers ride on the plant's mesh (`speckle`), the image is formed in the true pose of the probe
(`ultrasound`), with the needle where its true shaft crosses the plane (`needle_echo`). What is
added to it is drawn and searched by what a person or a controller would know: the pose of the
probe by its encoders, the tip as told, where it will be as the operator foretells.

Loss of contact. The echo of a point at depth z is received by a part of the face z / F wide (F the
f-number). Strips of the face without pressure neither send nor receive, so that the amplitude
falls with the square of the share of that part which is in contact.
Left out: attenuation and enhancement behind regions, refraction, reverberation of the face,
electronic noise, lines that are taken at different times.
"""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity
from arm_brachy.devices.cavity_detector import (
    Cavity,
    CavityDetector,
    CavityDetectorParams,
    CavityLocaliser,
)
from arm_brachy.devices.needle_echo import NeedleEcho, NeedleEchoParams
from arm_brachy.devices.overlay import overlay
from arm_brachy.devices.sampling import SampleTimes
from arm_brachy.devices.speckle import EchoRegion, TissueScatterers
from arm_brachy.devices.tip_detector import Detection, TipDetector, TipDetectorParams
from arm_brachy.devices.ultrasound import ImageFormer, UltrasoundParams

_SHORTEST = 1e-6     # m of needle, below which it has no direction
_AIM_AGE = 0.5       # s, age from which on a foretold tip is not drawn any more


@dataclass(frozen=True)
class ImagerParams:
    """The probe, what the tissue looks like in it, and how it is searched."""

    image: UltrasoundParams = field(default_factory=UltrasoundParams)
    echo: NeedleEchoParams = field(default_factory=NeedleEchoParams)
    detector: TipDetectorParams = field(default_factory=TipDetectorParams)
    cavity: CavityDetectorParams = field(default_factory=CavityDetectorParams)
    stiff_echo: float = quantity(-10.0, 'dB', 'of inclusions stiffer than the tissue', low=-60.0,
                                 high=30.0, source='malignant masses are mostly hypoechoic, '
                                                   'Stavros et al. 1995, Radiology 196:123; the '
                                                   'level is an own choice')
    soft_echo: float = quantity(5.0, 'dB', 'of inclusions softer than the tissue', low=-60.0,
                                high=30.0, source='fat lobules and lipomas, as above')
    seroma_centre: tuple = quantity([0.0, 0.0, 30.0], 'mm', 'of the cavity at rest, world frame',
                                    shape=(3,))
    seroma_radius: float = quantity(0.0, 'mm', 'of the cavity after surgery; 0 = none', low=0.0,
                                    high=60.0, source='own choice: none')
    target_radius: float = quantity(0.0, 'mm', "of a cavity around the procedure's target, which "
                                    'the images are then searched for; 0 = no echo of its own',
                                    low=0.0, high=60.0, source='own choice: none')
    seroma_echo: float = quantity(-40.0, 'dB', 'of the fluid in cavities', low=-100.0, high=30.0,
                                  source='fluid is anechoic')
    contact_pressure: float = quantity(100.0, 'Pa', 'of a strip of the face, from which on it has '
                                       'contact', low=0.0, high=1e5,
                                       source='a hundredth of the mean pressure of 3 N')
    f_number: float = quantity(4.0, '', 'depth over the part of the face that a point is seen by',
                               low=0.5, high=20.0, source="that of the beam's width")
    recorded_rate: float = quantity(5.0, 'Hz', 'pictures per second that the recorder keeps, of '
                                    'those published', low=0.01, high=100.0,
                                    source='2 MB/s: half of a bag of 300 MB in 75 s')
    recorded_overlay_rate: float = quantity(1.0, 'Hz', 'overlays per second that the recorder '
                                            'keeps', low=0.01, high=100.0,
                                            source='1.2 MB/s; a picture and the recorded poses '
                                                   'give it back')


@dataclass(frozen=True)
class Frame:
    """One image at time t [s].

    picture : (height, width) uint8;  overlay : (height, width, 3) uint8, RGB
    detection : Detection, or None where nothing was searched
    tip_W : (3,) [m] of the tip in W, by the told pose of the probe; None if not found
    cavity : Cavity, in W by the told poses of the probe so far; None while it is not located, and
        in a picture without its outline
    """

    t: float
    picture: np.ndarray
    overlay: np.ndarray
    detection: Detection | None
    tip_W: np.ndarray | None
    cavity: Cavity | None
    outcome: Outcome
    message: str = ''


def echo_regions(params, inclusions, target=None):
    """Return the EchoRegions of an ImagerParams: inclusions, then the seroma and the target.

    inclusions : of (centre (3,) [m], radius [m], ratio of stiffness)
    target : (3,) [m] of the target at rest, or None
    """
    regions = [EchoRegion(tuple(centre), radius, _amplitude(
        params.stiff_echo if ratio > 1.0 else params.soft_echo))
        for centre, radius, ratio in inclusions if ratio != 1.0]
    if params.seroma_radius > 0.0:
        regions.append(EchoRegion(params.seroma_centre, params.seroma_radius,
                                  _amplitude(params.seroma_echo)))
    if target is not None and params.target_radius > 0.0:
        regions.append(EchoRegion(tuple(target), params.target_radius,
                                  _amplitude(params.seroma_echo)))
    return regions


def _amplitude(decibel):
    return 10.0**(decibel / 20.0)


class Imager:
    """Simulated probe; `see` once a tick. Same seed, same bits.

    params : ImagerParams;  rest, elements : of the plant's mesh, see speckle.TissueScatterers
    inclusions, target : see `echo_regions`;  rng : numpy Generator
    template : has in_image(R, p, geometry) -> (columns, rows, 2) [pixel] and piercing(R, p,
        geometry, points (k, 3) [m]) -> (k, 2), or None
    geometry : what it needs to know of the image
    Test: devices/test_ultrasound_imager.py
    """

    def __init__(self, params, rest, elements, inclusions, rng, template=None, geometry=None,
                 target=None):
        """Draw the scatterers; see the class."""
        self.params, self._template, self._geometry = params, template, geometry
        self._scatterers = TissueScatterers(rest, elements, params.image.density,
                                            echo_regions(params, inclusions, target), rng)
        self._former = ImageFormer(params.image)
        self._echo = NeedleEcho(params.echo, params.image)
        self._detector = TipDetector(params.detector, params.image, params.echo)
        self._outlines = self._cavity = None
        if target is not None and params.target_radius > 0.0:
            self._outlines = CavityDetector(params.cavity, params.image)
            self._cavity = CavityLocaliser(params.cavity)
        self._times, self._last = SampleTimes(params.image.rate), None
        self._contact, self._share = None, None
        self._aim = -np.inf, None

    def hear_aim(self, t, points):
        """Take where the tip will be and where it is to be, (2, 3) [m], as foretold at t [s].

        One older than the last is no news. Raises InputError for anything but two places.
        """
        points = np.asarray(points, dtype=float)
        if points.shape != (2, 3):
            raise InputError(f'what is foretold of the tip: {len(points)} places; must be two, '
                             'where it will be and where it is to be')
        if t >= self._aim[0]:
            self._aim = t, points

    @property
    def nodes(self):
        """Number of nodes that `see` takes."""
        return len(self._scatterers.rest)

    def see(self, t, x, probe, pressure, shaft, told_probe, told_tip):
        """Return the Frame at t [s], or None if none is due since the last call; the first is due.

        x : (n, 3) [m] nodes now;  probe : (R, p) of P in W, true
        pressure : (s,) [Pa] in strips of the face from -x to +x; None = contact all over
        shaft : (k, 3) [m] of the true needle, template to tip, or None
        told_probe : (R, p) by the encoders, or None;  told_tip : (R, p), z along it, or None
        """
        due = self._last is None or self._times.between(self._last, t)
        self._last = t
        if not due:
            return None
        picture, seen = self._picture(x, *probe, pressure, shaft)
        holes, aim, complaint = self._grid(t, told_probe)
        detection, place, outcome, message = self._search(picture, told_probe, told_tip)
        if seen == 0:
            outcome, message = Outcome.IMAGE_EMPTY, Outcome.IMAGE_EMPTY.advice
        elif complaint and outcome.ok:
            outcome, message = Outcome.REJECTED, complaint
        tip_W, found, head = None, None, place
        if detection is not None and detection.found:
            R, p = told_probe
            tip_W = p + R @ [detection.x, 0.0, detection.z]
            head = np.array([detection.x, detection.z])
            found = self.params.image.pixels(head)
        cavity, outline = self._locate(t, picture, told_probe, place, head)
        expected = None if place is None else self.params.image.pixels(place)
        drawn = overlay(picture, self.params.image.pixel, holes, expected, found, outline, aim)
        return Frame(t, picture, drawn, detection, tip_W, cavity, outcome, message)

    def _picture(self, x, R, p, pressure, shaft):
        """Picture (height, width) uint8, and the number of scatterers in it."""
        envelope, seen = self._former.tissue(self._scatterers, (x - p) @ R)
        needle = _crossing(None if shaft is None else (shaft - p) @ R)
        if needle is not None:
            self._echo.add_to(envelope, *needle)
        share = self._aperture(pressure)
        if share is not None:
            envelope = envelope * share
        return self._former.compress(envelope), seen

    def _aperture(self, pressure):
        """Amplitude (height, width) that loss of contact leaves, None without loss."""
        if pressure is None:
            return None
        contact = np.asarray(pressure) >= self.params.contact_pressure
        if contact.all() and len(contact):
            return None
        if self._contact is None or not np.array_equal(contact, self._contact):
            self._contact = contact
            self._share = aperture_share(contact, self.params.image, self.params.f_number)**2
        return self._share

    def _grid(self, t, told_probe):
        """Holes, and what is foretold of the tip, in the picture; what is wrong with them."""
        if self._template is None or told_probe is None:
            return None, None, ''
        told_at, points = self._aim
        try:
            holes = self._template.in_image(*told_probe, self._geometry)
            if not abs(t - told_at) <= _AIM_AGE:
                return holes, None, ''
            return holes, self._template.piercing(*told_probe, self._geometry, points), ''
        except InputError as error:
            return None, None, str(error)

    def _search(self, picture, told_probe, told_tip):
        """Detection, the expected place (2,) [m] in the plane, Outcome and message."""
        if told_probe is None or told_tip is None:
            return None, None, Outcome.OK, ''
        (R, p), (R_tip, p_tip) = told_probe, told_tip
        tip, axis = (np.asarray(p_tip) - p) @ R, R.T @ R_tip[:, 2]
        place, _ = self._echo.crossing(tip, axis)
        place, image = place[[0, 2]], self.params.image
        u, v = self.params.image.pixels(place)
        if abs(tip[1]) > image.elevation or not (0 <= u < image.width and 0 <= v < image.height):
            return None, place, Outcome.TIP_OUT_OF_IMAGE, (
                f'imager: the tip is {1e3 * tip[1]:.1f} mm from the image plane, '
                f'{1e3 * tip[0]:.1f} mm along and {1e3 * tip[2]:.1f} mm below the face; must be '
                f'within {1e3 * image.elevation:g} mm, +-{5e2 * image.aperture:g} mm and '
                f'0 to {1e3 * image.depth:g} mm')
        detection = self._detector.find(picture, place)
        if detection.found:
            return detection, place, Outcome.OK, ''
        return detection, place, Outcome.TIP_NOT_SEEN, (
            f'imager: no needle within {1e3 * self.params.detector.window:g} mm of where its tip '
            f'is expected (correlation {detection.correlation:.2f}); check contact, hole and '
            'depth')

    def _locate(self, t, picture, told_probe, place, head):
        """The Cavity as known by now, and its outline in this picture (k, 2) [pixel], or two None.

        A picture without an outline says nothing of where the cavity is now.
        place, head : (2,) [m] in the plane of the needle, as expected and as seen
        """
        if self._outlines is None or place is None:
            return None, None
        outline = self._outlines.outline(picture, place, head)
        self._cavity.see(t, *told_probe, outline)
        if outline is None:
            return None, None
        return self._cavity.cavity, self.params.image.pixels(outline)


def _crossing(shaft):
    """Where a needle (k, 3) [m] crosses y = 0 nearest to its tip, and its direction there.

    Its tip if it does not cross; None without a needle.
    """
    if shaft is None or np.linalg.norm(shaft[-1] - shaft[0]) < _SHORTEST:
        return None
    y = shaft[:, 1]
    across = np.flatnonzero((y[:-1] > 0.0) != (y[1:] > 0.0))
    i = len(shaft) - 2 if not len(across) else across[-1]
    step = shaft[i + 1] - shaft[i]
    share = 1.0 if not len(across) else y[i] / (y[i] - y[i + 1])
    return shaft[i] + share * step, step / np.linalg.norm(step)


def aperture_share(contact, image, f_number):
    """Return the share (height, width) float32 of the part that sees each pixel which has contact.

    contact : (s,) bool, equal strips from -x to +x;  image : UltrasoundParams
    A point at depth z is seen by a part of the face z / f_number wide, at least a strip.
    """
    strips, (dx, dz) = len(contact), image.pixel
    edges = np.linspace(0.0, image.aperture, strips + 1)
    touching = np.concatenate([[0.0], np.cumsum(np.diff(edges) * contact)])   # m, from the left
    u = (np.arange(image.width) + 0.5) * dx
    half = 0.5 * np.maximum(np.arange(image.height) * dz / f_number, edges[1])[:, None]
    low, high = np.maximum(u - half, 0.0), np.minimum(u + half, image.aperture)
    return ((np.interp(high, edges, touching) - np.interp(low, edges, touching))
            / (high - low)).astype(np.float32)
