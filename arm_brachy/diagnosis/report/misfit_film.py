"""Where simulation and recording part, as a film: the model, and what the markers are off by.

One recording at its load states: the surface and the markers of the recalibrated model without
new physics, an arrow from each marker by what is left of its residual, longer than it is, and the
same with what was found. Registration, zeros and clocks are fitted to each; what the mesh may be
wrong by is left in, as in the residuals over time.
Test: diagnosis/theorems/test_misfit_film.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.results.formatting import spoken
from arm_brachy.diagnosis.selection.problem import left_over
from arm_brachy.diagnosis.signals.stream import EM, OPTICAL
from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.viewing.drawing import PAD_THICKNESS, STEEL, Stage, frame_along, tissue
from arm_brachy.viewing.film import Film
from arm_brachy.viewing.shapes import Kind, Shape
from arm_brachy.viewing.surface import ThinSurface, thinned

TRIANGLES = 1200        # of the surface, at most
MOST_FRAMES = 150       # with these a film takes about 1 MB
LONGEST = 15e-3        # m, of an arrow as drawn
STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)     # of their scale
LEAST_COLOUR = 1e-4     # m of displacement that is the last colour, at least
MARKER, SHAFT, PAD_RADIUS = 2.5e-3, 1.2e-3, 6e-3    # m
PLAIN, BEFORE, AFTER, PLACE = ((0.9, 0.9, 0.9, 1.0), (0.85, 0.2, 0.15, 1.0),
                               (0.1, 0.55, 0.25, 1.0), (0.95, 0.6, 0.1, 0.35))


@dataclass(frozen=True)
class MisfitStates:
    """One recording at n load states; k markers and tools. World frame, SI.

    recording : name;  t : (n,);  surface : ThinSurface;  x : (n, c, 3) of its corners
    pads : p pairs of the place (3,) at rest and the push direction (3,)
    moved : (n, p, 3) of the pads;  markers : (n, k, 3) as the model has them
    before, after : (n, k, 3) residual, NaN where nothing was measured; after None = nothing found
    """

    recording: str
    t: np.ndarray
    surface: ThinSurface
    x: np.ndarray
    pads: tuple
    moved: np.ndarray
    markers: np.ndarray
    before: np.ndarray
    after: np.ndarray | None = None

    @property
    def scale(self):
        """By which arrows are drawn longer than the residual."""
        most = np.nanmax(np.linalg.norm(self.before, axis=2))
        return max((one for one in STEPS if one * most <= LONGEST), default=STEPS[0])


def misfit_states(assembly, found):
    """MisfitStates of the recording whose markers are off most, None without markers.

    assembly : problem.Assembly;  found : judge.Explanation each, of what was found
    """
    before = left_over(assembly, (), mesh=True)
    every = conclusions.split_rows(assembly, np.arange(len(before)))
    parts = [(m, rows) for m, rows in every[:len(every) - assembly.sound]
             if _of_points(m).any()]
    if not parts:
        return None
    m, rows = max(parts, key=lambda part: np.mean(before[part[1]][_of_points(part[0])]**2))
    lines = [before, *([left_over(assembly, found, mesh=True)] if found else [])]
    left = [_by_point(m, line[rows]) for line in lines]
    return _states(m, left)


def _of_points(m):
    return np.array([row.kind in (OPTICAL, EM) for row in m.observables.rows], dtype=bool)


def _by_point(m, whitened):
    """(n, k, 3) [m] residual of markers, then tools; NaN where nothing was measured."""
    specimen = m.baseline.model.specimen
    points = [*((OPTICAL, name) for name in specimen.markers),
              *((EM, name) for name in specimen.tools)]
    number = {point: i for i, point in enumerate(points)}
    out = np.full((len(m.baseline.t), len(number), 3), np.nan)
    for row, value in zip(m.observables.rows, m.observables.coloured(whitened), strict=True):
        if row.kind in (OPTICAL, EM):
            out[row.state, number[row.kind, row.channel], row.axis] = value
    return out


def _states(m, left):
    baseline, specimen = m.baseline, m.baseline.model.specimen
    every = np.arange(0, len(baseline.t), -(-len(baseline.t) // MOST_FRAMES))
    thin = thinned(specimen.mesh.nodes, boundary_triangles(specimen.mesh.tets), TRIANGLES)
    markers = np.stack([np.concatenate([baseline.truth[i][kind] for kind in (OPTICAL, EM)])
                        for i in every])
    pads = tuple((np.array(pad.centre), direction) for pad, direction in zip(
        specimen.scene.pads, specimen.directions, strict=True))
    return MisfitStates(
        m.recorded.name, baseline.t[every], thin,
        np.stack([baseline.x(i)[thin.nodes] for i in every]), pads,
        np.stack([baseline.pads(i) for i in every]), markers, *(one[every] for one in left))


def misfit_film(states, places):
    """Return the JSON text of a film of MisfitStates, which opens where the markers are off most.

    places : results.parts.Place each; those with a position are drawn as their 90 % region
    """
    full = max(LEAST_COLOUR, float(np.linalg.norm(states.x - states.surface.rest, axis=2).max()))
    film, stage = Film(full), Stage(full_colour=full)
    regions = [_region(place) for place in places if place.position is not None]
    for i, t in enumerate(states.t):
        film.add(t, [_tissue(states, i, stage), *_pads(states, i), *_markers(states, i),
                     *regions])
    return film.text(start=int(np.nansum(states.before**2, axis=(1, 2)).argmax()))


def _tissue(states, i, stage):
    thin = states.surface
    corners = ThinSurface(np.arange(len(thin.nodes)), thin.triangles, thin.rest)
    return tissue('model, recalibrated', stage, (corners, states.x[i]))


def _pads(states, i):
    return [Shape('pads', Kind.DISC, (centre + moved)[None], STEEL, axes=frame_along(direction),
                  scale=(2.0 * PAD_RADIUS, 2.0 * PAD_RADIUS, PAD_THICKNESS))
            for (centre, direction), moved in zip(states.pads, states.moved[i], strict=True)]


def _markers(states, i):
    here = states.markers[i]
    shapes = [Shape('markers of the model', Kind.SPHERES, here, PLAIN, MARKER)]
    for layer, colour, left in (('off, without new physics', BEFORE, states.before),
                                ('off, with what was found', AFTER, states.after)):
        if left is None:
            continue
        seen = np.isfinite(left[i]).all(axis=1)
        shapes += [Shape(layer, Kind.ARROW, np.stack([p, p + states.scale * d]), colour, SHAFT)
                   for p, d in zip(here[seen], left[i][seen], strict=True)]
    return shapes


def _region(place):
    width = 2.0 * max(place.radius or 0.0, MARKER)
    return Shape(f'where: {spoken(place.term)}' if place.term else 'where something is left',
                 Kind.ELLIPSOID, np.asarray(place.position, dtype=float)[None], PLACE,
                 scale=(width, width, width))


def misfit_note(states):
    """What the film shows, in words."""
    more = ('' if states.after is None else
            ' Green arrows: the same with what was found.')
    return (f'{states.recording}, at its load states. Surface and grey spheres: the recalibrated '
            'model without new physics, coloured by displacement. Red arrows: from each marker '
            f'of the model to where it was measured, {states.scale:g} times as long; '
            f'registration, zeros and clocks are fitted.{more}')
