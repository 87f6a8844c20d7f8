"""Where, when and how a term may act: its hypotheses, a bounded number of each.

Test: diagnosis/forward/test_candidates.py
"""

import dataclasses
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial.distance import cdist

from arm_brachy.diagnosis.isolation.handover import Occasions
from arm_brachy.diagnosis.model.hypothesis import Hypothesis, strengths, tie_of
from arm_brachy.tissue.mesh import boundary_faces, volumes

INTERIOR, SURFACE, BASE_PLACES = 60, 24, 30     # places in a body, on it, under it
RELAXATION_TIMES = (0.5, 3.0, 15.0)     # s: what a recording of a minute tells apart
BUMP_RADII = (0.013, 0.020)             # m: either side of the prior's median
SOFTENING_ENERGIES = (15.0, 150.0)      # J/m^3: strains of 7 and 22 %
# Azimuth, elevation [deg] of fibres: axes, diagonals of the faces and of the body of a cube, some
# of them less than 28 degrees from any direction.
TILT = float(np.degrees(np.arctan(np.sqrt(0.5))))
FIBRES = ((0.0, 90.0), *((a, 0.0) for a in (0.0, 45.0, 90.0, -45.0)),
          *((a, e) for a in (0.0, 90.0) for e in (45.0, -45.0)),
          *((a, e) for a in (45.0, -45.0) for e in (TILT, -TILT)))
# Amplitudes at which responses are taken, of terms whose effect is far from proportional: a sector
# off the base shows five times as much at 26 mm as at 15, and elsewhere.
SIZES = {'base_debond': (0.7, 1.2)}
RODS = (0.0, 0.015, 0.03)   # m behind a pad's face: where the metal that it is on may be
BESIDE = 0.03           # m from a body: metal that stays
SECOND_BRANCH = 40.0    # s, beside a first that is faster by far: creep of tissue has both




def candidates(cls, specimen, occasions=None):
    """Return the Hypotheses (a tuple) of a term class on a specimen.Specimen.

    occasions : Occasions, None = nothing is known: what begins has then begun before the recording
    Places in the tissue are the middles of regions of equal volume, those on the surface of
    regions of equal area. A term whose event no occasion supports has no hypothesis, nor has the
    step of a marker that a finding explains.
    """
    occasions = occasions or Occasions()
    names = {f.name for f in dataclasses.fields(cls)}
    choices = [one for one in _CHOICES if one.applies(cls, names)]
    places = [one.options(cls, specimen, occasions) for one in choices]
    sizes = SIZES.get(cls.spec.name, (1.0,))
    combined = (({k: v for part in combination for k, v in part.items()}, combination)
                for combination in product(*places))
    return tuple(Hypothesis(cls, place, _free(cls, combination), size=size)
                 for place, combination in combined if occasions.is_news(place)
                 for size in sizes)


def _free(cls, combination):
    """All strengths but those whose place is not given: one part of a cause hides no other."""
    given = {None, *(key for part in combination for key in part)}
    return tuple(s for s in strengths(cls) if tie_of(cls, s.name) in given)


@dataclass(frozen=True)
class _Choice:
    """One field, or fields that belong together, and the options for it."""

    applies: callable
    options: callable


def _has(*fields, but=()):
    return lambda cls, names: set(fields) <= names and cls.spec.name not in but


def _called(name):
    return lambda cls, names: cls.spec.name == name


def _each(field, items):
    """Every item alone, then all of them."""
    single = [{field: (item,)} for item in items]
    return [*single, {field: ()}] if len(items) > 1 else [{field: ()}]


def interior_places(mesh, count):
    """Return (count, 3) [m], middles of regions of about equal volume of a TetMesh."""
    return _middles(mesh.nodes[mesh.tets].mean(axis=1), volumes(mesh), count)


def surface_places(specimen, count, *, base):
    """Return (count, 3) [m] on the fixed faces of a Specimen's surface, or on the free ones.

    base : which. Faces under pads count as free.
    """
    mesh, outer = specimen.mesh, boundary_faces(specimen.mesh)
    faces = outer[np.isin(outer, specimen.body.fixed).all(axis=1) == base]
    corners = mesh.nodes[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                   corners[:, 2] - corners[:, 0]), axis=1)
    if not len(faces):
        return np.zeros((0, 3))
    centres = corners.mean(axis=1)
    middles = _middles(centres, area, count)
    return centres[np.unique(cdist(middles, centres).argmin(axis=1))]


def _middles(points, weights, count):
    """Middles (count, 3) of clusters of weighted points (k, 3), the same at every call."""
    if len(points) <= count:
        return points
    seeds = [int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    away = np.linalg.norm(points - points[seeds[0]], axis=1)
    while len(seeds) < count:       # farthest point after farthest point
        seeds.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[seeds[-1]], axis=1))
    _, label = kmeans2(points, points[seeds], minit='matrix', missing='warn')
    found = np.unique(label)
    total = np.bincount(label, weights, minlength=count)[found]
    sums = np.stack([np.bincount(label, weights * column, minlength=count)[found]
                     for column in points.T], axis=1)
    return sums / total[:, None]


def _centres(places):
    return [{'centre': tuple(place)} for place in places]


def _onsets(cls, specimen, occasions):
    return [{'onset': float(t)} for t in occasions.onsets]


def _onsets_or_some_time(cls, specimen, occasions):
    """What sets in slowly leaves no change point: from the start, or from any quarter on."""
    quarters = [0.25 * k * occasions.end for k in range(1, 4)] if occasions.end else []
    return [{'onset': float(t)} for t in (0.0, *quarters, *occasions.onsets)]


def _metals(specimen):
    """Places of pieces of metal: on the rod behind each pad, and beside the body, all around."""
    rods = [{'metal': tuple(map(float, np.array(pad.centre) - back * np.array(pad.direction))),
             'carrier': i} for i, pad in enumerate(specimen.body.pads) for back in RODS]
    nodes = specimen.mesh.nodes
    middle, half = 0.5 * (nodes.max(axis=0) + nodes.min(axis=0)), 0.5 * np.ptp(nodes, axis=0)
    return rods + [{'metal': tuple(map(float, middle + sign * (half[k] + BESIDE) * np.eye(3)[k]))}
                   for k in range(3) for sign in (-1.0, 1.0)]


def _windows(cls, specimen, occasions):
    return [{'onset': float(start), 'duration': float(end - start)}
            for start, end in occasions.windows]


def _rhythms(cls, specimen, occasions):
    """Every quarter of a period, so that phase is free; along each axis."""
    return [{'frequency': float(f), 'phase': phase, 'direction': tuple(axis)}
            for f in occasions.frequencies for phase in 0.5 * np.pi * np.arange(-1, 3)
            for axis in np.eye(3)]


_CHOICES = (
    _Choice(_has('actuators'),
            lambda cls, s, o: _each('actuators', range(len(s.pads)))),
    _Choice(_has('pads', but=('pad_misplacement',)), lambda cls, s, o: _each('pads', s.pads)),
    _Choice(_called('pad_misplacement'),
            lambda cls, s, o: [{'pads': (name,)} for name in s.pads]),
    _Choice(_has('tools'), lambda cls, s, o: _each('tools', s.tools)),
    _Choice(_has('marker'), lambda cls, s, o: [{'marker': name} for name in s.markers]),
    _Choice(_has('stream'), lambda cls, s, o: [{'stream': kind}
                                               for kind in ('em', 'optical', 'force')]),
    _Choice(_called('em_distortion'), lambda cls, s, o: [
        *({'pad': i} for i in (-1, *range(len(s.pads)))), *_metals(s)]),
    _Choice(_called('inclusion'),
            lambda cls, s, o: _centres(interior_places(s.mesh, INTERIOR))),
    _Choice(_called('base_debond'),
            lambda cls, s, o: _centres(surface_places(s, BASE_PLACES, base=True))),
    _Choice(_has('centre', but=('inclusion', 'base_debond', 'optical_scale', 'em_distortion')),
            lambda cls, s, o: _centres(surface_places(s, SURFACE, base=False))),
    _Choice(_has('bump_centre'), lambda cls, s, o: [{}] + [
        {'bump_centre': tuple(place), 'bump_radius': radius}
        for place in surface_places(s, SURFACE, base=False) for radius in BUMP_RADII]),
    _Choice(_has('azimuth', 'elevation'), lambda cls, s, o: [
        {'azimuth': np.radians(a), 'elevation': np.radians(e)} for a, e in FIBRES]),
    _Choice(_has('tau1'), lambda cls, s, o: [{'tau1': tau} for tau in RELAXATION_TIMES] + [
        {'tau1': tau, 'tau2': SECOND_BRANCH} for tau in RELAXATION_TIMES[:-1]]),
    _Choice(_has('damage', 'energy'),
            lambda cls, s, o: [{'energy': energy} for energy in SOFTENING_ENERGIES]),
    _Choice(_has('frequency'), _rhythms),
    _Choice(_has('onset', 'duration'), _windows),
    _Choice(_has('onset', but=('external_force', 'stiffness_drift', 'swelling_drift')), _onsets),
    _Choice(_has('onset', 'rate'), _onsets_or_some_time),
)
