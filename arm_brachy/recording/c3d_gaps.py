"""Numbers in a C3D file that say that a point was not seen."""

import numpy as np

FARTHEST = 1e3     # m; no camera sees farther, writers of gaps put 1e38 and the like
LARGEST_STEP = 3.0  # of the point's longest step between frames; zeros nearer may be a passage


def hide_gaps(points, names, resolution):
    """Return (points with gaps as NaN, notes): places that are no positions.

    points : (n, k, 3) [m], NaN = not seen;  names : of the k points, for the notes
    resolution : [m] step of the file's values, 0 for floats
    A gap is a coordinate beyond FARTHEST, and 0 0 0 in all axes unless the point comes by the
    origin: it is seen just before or after, within LARGEST_STEP of its longest steps. Some writers
    leave 0 0 0 where a point is lost and mark nothing (c3d.org asks for a residual of -1).
    """
    points, notes = points.copy(), []
    far = (np.abs(points) > FARTHEST).any(axis=2)
    points[far] = np.nan
    for k, name in enumerate(names):
        zero = _impossible_zeros(points[:, k], resolution)
        points[zero, k] = np.nan
        for mask, what in ((zero, '0 0 0'), (far[:, k], f'more than {FARTHEST:g} m away')):
            if mask.any():
                notes.append(f'{name}: {mask.sum()} of {len(mask)} frames are {what}: read as not '
                             'seen')
    return points, notes


def _impossible_zeros(track, resolution):
    """Frames (n,) of one point (n, 3) that are 0 0 0 though it is not near the origin."""
    zero = (track == 0.0).all(axis=1)
    seen = np.isfinite(track).all(axis=1) & ~zero
    if not zero.any() or not seen.any():
        return zero
    at = np.flatnonzero(seen)
    steps = np.linalg.norm(np.diff(track[at], axis=0), axis=1)[np.diff(at) == 1]
    reach = LARGEST_STEP * max(steps.max(initial=0.0), resolution)
    distance = np.linalg.norm(track, axis=1)
    frames = np.flatnonzero(zero)
    after = np.searchsorted(at, frames)
    beside = np.stack([distance[at[np.maximum(after - 1, 0)]],
                       distance[at[np.minimum(after, len(at) - 1)]]])
    hidden = np.zeros(len(track), dtype=bool)
    hidden[frames] = beside.min(axis=0) > reach
    return hidden
