"""A recorded run as a film: what was measured, estimated and true at each of its frames."""

import numpy as np

from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.viewing.drawing import Pad, Seen, Stage, Truth, draw, draw_truth
from arm_brachy.viewing.film import Film
from arm_brachy.viewing.params import ViewerParams
from arm_brachy.viewing.surface import thinned

LOOK = ViewerParams()
TRIANGLES = 2000     # of the surface, at most: what a page of some MB can hold


def film_times(run, most):
    """Times (n,) [s] of the frames: those of the tissue, else evenly over the recording.

    run : evaluation.timeseries.RunData;  most : frames
    """
    if run.tissue is not None and len(run.tissue.t):
        every = -(-len(run.tissue.t) // most)
        return np.unique(np.append(run.tissue.t[::every], run.tissue.t[-1]))
    first, last = run.span()
    if not np.isfinite(first):
        return np.zeros(0)
    return np.linspace(first, last, min(most, max(2, round((last - first) * LOOK.rate))))


def run_film(run, most):
    """Return the Film of a RunData, at most `most` frames; it has none if nothing was recorded.

    Displacement is coloured up to the largest of the run.
    """
    thin, full = _surface(run)
    stage = Stage(pads=tuple(Pad(p.name, np.asarray(p.centre), np.asarray(p.direction),
                                 p.radius) for p in run.pads),
                  holes=_holes(run), full_colour=full, arrow=LOOK.arrow)
    film = Film(full)
    for t in film_times(run, most):
        film.add(t, [*draw_truth(stage, _truth(run, thin, t)), *draw(stage, _seen(run, t))])
    return film


def _surface(run):
    """(ThinSurface or None, displacement [m] of the last colour) of the tissue."""
    if run.tissue is None or not len(run.tissue.t):
        return None, LOOK.full_colour
    thin = thinned(run.tissue.rest, boundary_triangles(run.tissue.tets), TRIANGLES)
    moved = np.linalg.norm(run.tissue.positions[:, thin.nodes] - thin.rest, axis=2).max()
    return thin, float(max(moved, 1e-4))


def _truth(run, thin, t):
    surface = None
    if thin is not None:
        k = int(np.abs(run.tissue.t - t).argmin())
        surface = thin, run.tissue.positions[k]
    shafts = {} if run.procedure is None else run.procedure.shafts
    return Truth(surface, {name: at(series, t) for name, series in run.truth.items()
                           if len(series.t)},
                 _nearest(shafts, t) if shafts else np.zeros((0, 3)))


def _seen(run, t):
    travel = {} if run.encoder is None or not len(run.encoder.t) else dict(
        zip([p.name for p in run.pads], at(run.encoder, t), strict=False))
    forces = {}
    if run.force is not None and len(run.force.t):
        now = run.force.values[np.abs(run.force.t - t).argmin()]
        names = run.force_pads or [pad.name for pad in run.pads]
        forces = {name: f for name, f in zip(names, now, strict=False)
                  if np.isfinite(f).all()}
    return Seen(travel=travel, forces=forces, markers=_markers(run, t), tools=_tools(run, t),
                estimates=_estimates(run, t), goal=_goal(run, t), **_instruments(run, t))


def at(series, t):
    """Values (...) of a Series at t [s], linear between samples."""
    flat = series.values.reshape(len(series.t), -1)
    return np.array([np.interp(t, series.t, column) for column in flat.T]).reshape(
        series.values.shape[1:])


def _fresh(times, t):
    """Index of the newest time that is not stale at t, None if there is none."""
    k = int(np.searchsorted(times, t, side='right')) - 1
    return k if k >= 0 and t - times[k] <= LOOK.stale else None


def _markers(run, t):
    if run.optical is None or (k := _fresh(run.optical.t, t)) is None:
        return np.zeros((0, 3))
    return run.optical.points[k][run.optical.visible[k]]


def _tools(run, t):
    tracked = {tool: samples.tracked() for tool, samples in run.em.items()}
    return {tool: series.values[k] for tool, series in tracked.items()
            if (k := _fresh(series.t, t)) is not None}


def _estimates(run, t):
    return {(name, target): (said.points[k], said.covariance[k])
            for name, targets in run.estimates.items() for target, said in targets.items()
            if (k := _fresh(said.t, t)) is not None}


def _goal(run, t):
    return next(((task.goal, task.target) for task in run.tasks
                 if task.t_start <= t <= task.t_end), None)


def _nearest(by_time, t):
    return by_time[min(by_time, key=lambda one: abs(one - t))]


def _holes(run):
    picture = None if run.procedure is None else run.procedure.picture
    return np.zeros((0, 3)) if picture is None else np.reshape(picture.holes, (-1, 3))


def _instruments(run, t):
    """Keys of Seen about needle and probe, by what the cell's own sensors say."""
    data, out = run.procedure, {}
    if data is None:
        return out
    if data.probe_told is not None and (k := _fresh(data.probe_told.t, t)) is not None:
        row = data.probe_told.values[k]
        out['probe'] = row[:9].reshape(3, 3), row[9:]
    if data.tip_image is not None and (k := _fresh(data.tip_image.t, t)) is not None:
        out['image_tip'] = data.tip_image.values[k]
    return out
