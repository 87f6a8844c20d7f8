"""What a recording holds, stream by stream over time, with what is missing marked.

For a look at an import before anything is computed: encoders, markers and EM tools as the distance
from where they were first seen, forces by size.
Test: evaluation/test_stream_figures.py
"""

import numpy as np

from arm_brachy.evaluation.style import GOAL, MM, Plate, colour, new_figure, styled

WIDTH, HEIGHT = 9.0, 1.9    # inches, of a panel
LEGEND = 12                 # names that fit beside a panel
POINTS = 4000               # of a line: more than a page has pixels
LONG = 1.5                  # median periods of a step over which nothing was recorded
FIRST = 20                  # samples whose median is where a point was first seen


def shown_streams(run):
    """(title, label of the values, t (n,), names, values (n, k)) of every stream of a RunData."""
    return [panel for panel in (_encoder(run), _optical(run), _em(run), _force(run))
            if panel is not None]


@styled
def streams_plate(run):
    """Plate of an evaluation.timeseries.RunData: a panel for each stream that it holds, or None.

    Under every panel a row of marks, one line for a channel, shows when it was not measured.
    """
    panels = shown_streams(run)
    if not panels:
        return None
    figure = new_figure(WIDTH, HEIGHT * len(panels) + 0.5)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (title, unit, t, names, values) in zip(axes, panels, strict=True):
        _draw(axis, title, unit, t, names, values)
    axes[-1].set_xlabel('time [s]')
    return Plate('streams', figure,
                 'What was recorded, by stream. Markers and tools: distance from where they were '
                 'first seen; forces: size. Orange below: not measured.')


def _draw(axis, title, unit, t, names, values):
    thin = max(1, len(t) // POINTS)
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    # A line breaks where rows were lost, as it does where values are missing.
    lost = np.flatnonzero(np.diff(t) > LONG * period) if period else np.zeros(0, dtype=int)
    drawn = np.insert(t[::thin].astype(float), lost // thin + 1, np.nan)
    for k, name in enumerate(names):
        shown = np.insert(values[::thin, k], lost // thin + 1, np.nan)
        axis.plot(drawn, shown, color=colour(k), lw=1.0, label=name if k < LEGEND else None)
    low, high = axis.get_ylim()
    room = 0.05 * (high - low)
    missing = 0
    for k in range(len(names)):
        gone = np.isnan(values[:, k])
        missing += int(gone.sum())
        level = low - room * (1.0 + k / max(len(names), 1) * 2.0)
        axis.plot(t[gone], np.full(gone.sum(), level), '|', color=GOAL, ms=5, mew=1.0)
    for i in lost:
        axis.axvspan(t[i], t[i + 1], color=GOAL, alpha=0.15, lw=0)
    rate = f'{1.0 / period:.4g} Hz' if period else 'one sample'
    axis.set_title(f'{title}: {rate}, {missing} missing values' + (
        f', rows lost at {len(lost)} places' if len(lost) else ''), loc='left')
    axis.set_ylabel(unit)
    more = len(names) - LEGEND
    axis.legend(loc='center left', bbox_to_anchor=(1.01, 0.5), handlelength=1.0,
                title=f'and {more} more' if more > 0 else None)


def _encoder(run):
    if run.encoder is None or not len(run.encoder):
        return None
    names = run.encoder_pads or tuple(f'{i + 1}' for i in range(run.encoder.values.shape[1]))
    return 'Encoders', 'travel [mm]', run.encoder.t, names, run.encoder.values * MM


def _optical(run):
    if run.optical is None or not len(run.optical.t):
        return None
    seen = np.where(run.optical.visible[..., None], run.optical.points, np.nan)
    return ('Optical markers', 'moved [mm]', run.optical.t, run.optical.ids, _moved(seen) * MM)


def _em(run):
    tools = {name: one for name, one in run.em.items() if len(one.t)}
    if not tools:
        return None
    t = np.unique(np.concatenate([one.t for one in tools.values()]))
    values = np.full((len(t), len(tools), 3), np.nan)
    for i, one in enumerate(tools.values()):
        known = one.tracked()
        values[np.searchsorted(t, known.t), i] = known.values
    return 'EM tools', 'moved [mm]', t, tuple(tools), _moved(values) * MM


def _force(run):
    if run.force is None or not run.force_pads or not len(run.force.t):
        return None
    values = np.array(run.force.values, dtype=float)
    size = np.sqrt(np.nansum(values ** 2, axis=2))
    gone = np.isnan(values).all(axis=2)
    # Cells read one by one have rows of their own: what another's row lacks is no gap.
    own = [~gone[:, k] for k in range(gone.shape[1])]
    if len(own) > 1 and all(mine.mean() < 0.9 for mine in own):
        k = int(np.argmax([mine.sum() for mine in own]))
        t = run.force.t[own[k]]
        size = np.column_stack([np.interp(t, run.force.t[mine], size[mine, i])
                                if mine.any() else np.full(len(t), np.nan)
                                for i, mine in enumerate(own)])
        return 'Forces', 'size [N]', t, run.force_pads, size
    size[gone] = np.nan
    return 'Forces', 'size [N]', run.force.t, run.force_pads, size


def _moved(points):
    """Distance (n, k) [m] of points (n, k, 3) from where each was first seen."""
    out = np.full(points.shape[:2], np.nan)
    for k in range(points.shape[1]):
        seen = points[np.isfinite(points[:, k]).all(axis=1), k]
        if len(seen):
            out[:, k] = np.linalg.norm(points[:, k] - np.median(seen[:FIRST], axis=0), axis=1)
    return out
