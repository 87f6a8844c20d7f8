"""What a release is compared by: one vector of numbers whose errors are known, row by row.

Held: how far from its place in the scene every channel, on the tissue or on the base, was when the
hand let go. Settled: how far it went from there. Creep: what was missing from that in earlier
windows. Base: how far its markers went. Frequency, damping, shape of the ringing, and
what moves beside it.
Test: diagnosis/test_free_release.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.preparation import rigid_motion

HELD, SETTLED, CREEP, BASE, FREQUENCY, DAMPING, SHAPE, BESIDE = (
    'held', 'settled', 'creep', 'base', 'frequency', 'damping', 'shape', 'beside')


@dataclass(frozen=True)
class FreePriors:
    """Standard deviations of what is no missing physics, and of what a reduced model leaves."""

    modulus: float = quantity(0.5, '', 'logarithm of the modulus of the whole body', low=0.0,
                              high=10.0, source='own choice: weak, known within a factor of two')
    turn: float = quantity(2.0, 'deg', 'registration of the tracker, about each axis', low=0.0,
                           high=90.0, source='own choice: three markers 30 mm apart, each placed '
                                             'within 1 mm')
    frame: float = quantity(3.0, 'mm', 'origin of the tracker, along each axis', low=0.0,
                            high=1000.0, source='own choice: as far as its turn moves what is '
                                                '100 mm away')
    hold: float = quantity(0.05, '', 'by how much of its length a hand holds a body too high or '
                           'too low', low=0.0, high=1.0,
                           source='own choice: 2 to 5 % of silicone beams held straight by eye')
    hang: float = quantity(2.0, 'mm', 'where a weight hangs, along each axis', low=1e-3,
                           high=100.0,
                           source='own choice: a hook or a thread; of a silicone beam it is known '
                                  'to a few mm')
    rehang: float = quantity(1.0, 'mm', 'how far apart weights of several scenes hang that have '
                                        'them at one place, along each axis', low=0.0, high=100.0,
                             source='own choice: another weight on the same hook')
    base: float = quantity(0.1, 'mm', 'motion of the base, turns by what they move its markers',
                           low=0.0, high=100.0, source='own choice: a clamp that gives a little; '
                                                       'its markers show how much')
    creep: float = quantity(0.01, 'mm', 'change between two windows, per axis', low=0.0, high=10.0,
                            source='own choice: a tracker that warms up')
    settled: float = quantity(0.003, '', 'error of where it settles, of the longest way', low=0.0,
                              high=1.0, source='own choice: what elements leave beside their '
                                               'better mesh, and hands beside their shapes')
    frequency: float = quantity(0.003, '', 'relative error of small vibrations for large ones',
                                low=0.0, high=1.0, source='test_free_model: 0.3 % at a swing of '
                                                          'a fifth of the length')
    damping: float = quantity(0.07, '', 'the same of the damping ratio', low=0.0, high=1.0,
                              source='test_free_model: 2 % of a slender, 7 % of a stout body')
    damped: float = quantity(0.3, '', 'damping ratio where the scene has none', low=0.0, high=1.0,
                             source='own choice: any that lets a body ring')
    beside: float = quantity(0.025, '', 'what a mode leaves of a ringing body, of its size',
                             low=0.0, high=1.0, source='1 to 3 % of silicone beams and bars, for '
                                                       'they swing far')
    shape: float = quantity(0.005, '', 'the same of a shape of unit norm', low=0.0, high=1.0,
                            source='test_free_model')


@dataclass(frozen=True)
class Row:
    """recording, kind, channel ('' = all together), axis 0 to 2 or -1;  scene : its name"""

    recording: str
    scene: str
    kind: str
    channel: str = ''
    axis: int = -1


@dataclass(frozen=True)
class Case:
    """A release.Release beside its scene.

    index : (k,) of its channels among the points of the specimen;  rows : Row each
    hand : initial_shape.Held
    values, sd : (n,) measured, SI, and their errors
    """

    release: object
    scene: str
    index: np.ndarray
    hand: object
    rows: tuple
    values: np.ndarray
    sd: np.ndarray


def case_of(release, scene, index, hand, priors=None, calibration=None):
    """Return the Case of a Release.

    scene : core.scene.Scene;  hand : initial_shape.Held;  priors : FreePriors
    calibration : finding.Calibration
    """
    priors, calibration = priors or FreePriors(), calibration or Calibration()
    parts = [*_held(release, calibration.base), *_settled(release, calibration.base, priors),
             *_creep(release, priors.creep), *_base(release, calibration.base),
             *_ringing(release, priors)]
    parts = [part for part in parts if np.isfinite(part[3]) and np.isfinite(part[4])]
    rows = tuple(Row(release.name, scene.name, *part[:3]) for part in parts)
    return Case(release, scene.name, np.asarray(index), hand, rows,
                *(np.array([part[i] for part in parts]) for i in (3, 4)))


def predicted(case, swing, base=None):
    """Return (n,) what a model.Swing, at the windows of the case, makes of its rows.

    base : (b, 3) [m] motion of the base's markers, None = it stands
    """
    moved, shape = swing.moved[:, case.index], swing.shape[case.index]
    shape = shape / np.linalg.norm(shape)
    names = case.release.names
    bent = case.hand.bent.points[case.index]
    known = {(HELD, n): np.zeros(3) for n in case.release.base_names}
    known |= {(HELD, n): bent[k] for k, n in enumerate(names)}
    known |= {(SETTLED, n): moved[-1, k] - bent[k] for k, n in enumerate(names)}
    known |= {(SHAPE, n): shape[k] for k, n in enumerate(names)}
    for w in range(len(moved) - 1):
        known |= {(creep(w), n): moved[w, k] - moved[-1, k] for k, n in enumerate(names)}
    for k, name in enumerate(case.release.base_names):
        known[BASE, name] = np.zeros(3) if base is None else base[k]
    scalar = {FREQUENCY: np.log(swing.frequency), DAMPING: swing.damping, BESIDE: swing.others}
    return np.array([scalar[r.kind] if r.axis < 0 else known[r.kind, r.channel][r.axis]
                     for r in case.rows])


def creep(window):
    """Kind of the rows of an earlier window."""
    return f'{CREEP} {window}'


def _held(release, floor):
    """Rows of all channels; where one is held, few frames count, which are noise and the hand."""
    for names, off in ((release.names, release.held), (release.base_names, release.base_held)):
        for k, name in enumerate(names):
            for axis in range(3):
                yield HELD, name, axis, off[k, axis], np.hypot(release.noise.max(), floor)


def _settled(release, floor, priors):
    last = release.moved[-1]
    model = priors.settled * np.linalg.norm(last, axis=1).max()
    for k, name in enumerate(release.names):
        for axis in range(3):
            noise = release.noise[k, axis] / np.sqrt(release.count[-1])
            yield SETTLED, name, axis, last[k, axis], np.hypot(np.hypot(noise, floor), model)


def _creep(release, floor):
    for w, moved in enumerate(release.moved[:-1]):
        for k, name in enumerate(release.names):
            for axis in range(3):
                sd = np.hypot(release.noise[k, axis] * np.sqrt(2.0 / release.count[-1]), floor)
                yield creep(w), name, axis, moved[k, axis] - release.moved[-1, k, axis], sd


def _base(release, floor):
    """Rows of the base; where its markers move against each other, that is their error."""
    moved = release.base[-1]
    if not len(moved):
        return
    sd = np.hypot(floor, base_misfit(release))
    for k, name in enumerate(release.base_names):
        for axis in range(3):
            yield BASE, name, axis, moved[k, axis], sd


def base_misfit(release):
    """[m] rms per degree of freedom by which the base's markers moved as no rigid body would."""
    rest, moved = release.base_rest, release.base[-1]
    free = 3 * len(rest) - 6
    if free <= 0:
        return 0.0
    left = rigid_motion(rest, moved[None], np.ones((1, len(rest)), dtype=bool))[1]
    return float(np.sqrt(np.sum(left ** 2) / free))


def _ringing(release, priors):
    ring = release.ring
    if ring is None:
        return
    yield (FREQUENCY, '', -1, np.log(ring.frequency),
           np.hypot(ring.frequency_sd / ring.frequency, priors.frequency))
    yield (DAMPING, '', -1, ring.damping,
           np.hypot(ring.damping_sd, priors.damping * ring.damping))
    size = ring.amplitude / np.sqrt(ring.shape.size)
    other = np.sqrt(max(ring.left ** 2 - np.mean(release.noise ** 2), 0.0))
    yield BESIDE, '', -1, other / size, priors.beside
    for k, name in enumerate(release.names):
        for axis in range(3):
            yield SHAPE, name, axis, ring.shape[k, axis], np.hypot(ring.shape_sd, priors.shape)
