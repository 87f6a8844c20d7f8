"""Figures of one run. Each function returns a style.Plate: figure, name, caption in words."""

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from arm_brachy.evaluation import metrics
from arm_brachy.evaluation.style import (
    BAND,
    GOAL,
    INK,
    MEASURED,
    MM,
    TRUTH,
    Plate,
    colour,
    new_figure,
    styled,
)
from arm_brachy.evaluation.timeseries import Series

AXIS_NAMES = ('x', 'y', 'z')
LEAST_SPAN = 2.0  # mm, so that noise on an axis at rest does not look like motion
COLUMNS = 3  # tasks side by side that stay legible on a page
MOST_MARKERS = 6  # curves that can be told apart
LEAST_PER_BIN = 2  # messages: of fewer a count says nothing, they are drawn one by one
FLOW = LinearSegmentedColormap.from_list('flow', ['#b2182b', '#f4a582', '#dfe6ea', '#92c5de',
                                                  '#2166ac'])


@styled
def time_response(run, tasks, tolerance):
    """Target position, error and actuators over time, one column per task (as Fig. 3.6-3.11).

    run : timeseries.RunData;  tasks : at most three TaskWindow;  tolerance : [m]
    For who asks: did the target arrive, by which way, and what did the actuators do for it?
    """
    figure = new_figure(3.7 * max(len(tasks), 2), 8.2)
    rows = figure.subplots(5, len(tasks), sharex='col', sharey='row', squeeze=False,
                           gridspec_kw={'height_ratios': (1, 1, 1, 1, 1.15)})
    for column, task in enumerate(tasks):
        axes = rows[:, column]
        axes[0].set_title(f'{task.name} ({task.mode.replace("_", " ")})')
        for k in range(3):
            _draw_axis(axes[k], run, task, k, tolerance)
        _draw_error(axes[3], run, task, tolerance)
        _draw_actuators(axes[4], run, task)
        axes[4].set_xlabel('time since the goal was set / s')
    for axis in rows[:3, 0]:
        _widen(axis, LEAST_SPAN)
    for column, task in enumerate(tasks):
        for k in np.flatnonzero(~np.asarray(task.axes, dtype=bool)):
            _say_free(rows[k, column], run, task, k)
    labels = (*(f'{name} displacement' for name in AXIS_NAMES), 'error', 'actuator push')
    for axis, label in zip(rows[:, 0], labels, strict=True):
        axis.set_ylabel(f'{label}\n/ mm')
    figure.align_ylabels(rows[:, 0])
    _shared_legend(figure, rows)
    names = ', '.join(task.name for task in tasks)
    return Plate('time_response', figure, (
        f'Time response: {names}. Displacement of the target from where it was when the goal was '
        f'set: {_measurement(run)}s (dots), truth where it was recorded (line), goal (dashed) and '
        f'tolerance of ±{tolerance * MM:g} mm (band). An axis marked free is not controlled. '
        'Below: distance from the goal on the controlled axes (logarithmic), and how far each '
        'actuator pushes from rest (encoder).'))


def _draw_axis(axis, run, task, k, tolerance):
    measured, true = _target_series(run, task)
    if measured is not None:
        axis.plot(measured.t - task.t_start, (measured.values[:, k] - task.start[k]) * MM, '.',
                  color=MEASURED, markersize=2.2, label=_measurement(run), rasterized=True)
    if true is not None:
        axis.plot(true.t - task.t_start, (true.values[:, k] - task.start[k]) * MM, color=TRUTH,
                  label='truth')
    if not task.axes[k]:
        return
    goal = (task.goal[k] - task.start[k]) * MM
    axis.axhspan(goal - tolerance * MM, goal + tolerance * MM, color=BAND, alpha=0.22, lw=0,
                 label='tolerance')
    axis.axhline(goal, color=GOAL, linestyle='--', lw=1.1, label='goal')


def _say_free(axis, run, task, k):
    """The word 'free' at the right edge, above or below the data, wherever there is more room."""
    low, high = axis.get_ylim()
    drawn = [series.values[series.t > 0.8 * task.t_end + 0.2 * task.t_start, k]
             for series in _target_series(run, task) if series is not None]
    end = (np.concatenate([np.zeros(0), *drawn]) - task.start[k]) * MM
    above = not len(end) or high - end.max() >= end.min() - low
    axis.text(0.98, 0.93 if above else 0.07, 'free', transform=axis.transAxes, ha='right',
              va='top' if above else 'bottom', style='italic', color='#6c7a86')


def _widen(axis, span):
    low, high = axis.get_ylim()
    spare = max(span - (high - low), 0.0) / 2.0
    axis.set_ylim(low - spare, high + spare)


def _draw_error(axis, run, task, tolerance):
    measured, true = _target_series(run, task)
    for series, look in ((measured, {'marker': '.', 'linestyle': '', 'markersize': 2.2,
                                     'color': MEASURED, 'rasterized': True}),
                         (true, {'color': TRUTH})):
        if series is not None:
            size = metrics.magnitude(metrics.deviation(series.values, task.goal, task.axes))
            axis.plot(series.t - task.t_start, size * MM, **look)
    axis.axhline(tolerance * MM, color=BAND, lw=1.1)
    axis.set_yscale('log')
    low, high = axis.get_ylim()
    axis.set_ylim(max(low, 1e-3), high)
    axis.yaxis.set_major_formatter('{x:g}')


def _draw_actuators(axis, run, task):
    if run.encoder is None:
        axis.text(0.5, 0.5, 'no encoder recorded', transform=axis.transAxes, ha='center')
        return
    inside = run.encoder.between(task.t_start, task.t_end)
    for p in range(inside.values.shape[1]):
        axis.plot(inside.t - task.t_start, inside.values[:, p] * MM, color=colour(p),
                  label=_pad_name(run, p))


def _target_series(run, task):
    """(measured, true) Series of the task's target inside its window, None where absent."""
    truth = run.truth.get(task.target)
    said = run.estimates.get(run.feedback, {}).get(task.target)
    if run.feedback == 'em':
        em = run.em.get(task.target)
        said = None if em is None else em.tracked()
    elif said is not None:
        said = Series(said.t, said.points)
    return (None if said is None else said.between(task.t_start, task.t_end),
            None if truth is None else truth.between(task.t_start, task.t_end))


def _measurement(run):
    """What the dots are: what the controller heard."""
    return 'EM measurement' if run.feedback == 'em' else f'{run.feedback} estimate'


def _pad_name(run, p):
    return run.pads[p].name if p < len(run.pads) else f'actuator {p + 1}'


def _shared_legend(figure, axes):
    entries = {}
    for axis in np.ravel(axes):
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        legend = figure.legend(entries.values(), entries.keys(), loc='outside upper center',
                               ncols=min(len(entries), round(figure.get_figwidth() / 1.4)))
        for handle in legend.legend_handles:
            if hasattr(handle, 'set_markersize'):
                handle.set_markersize(7)


@styled
def pad_travel(run):
    """Travel of every pad over the run; for who wants to see what a probing protocol did."""
    figure = new_figure(9.5, 2.8)
    axis = figure.subplots()
    for p in range(run.encoder.values.shape[1]):
        axis.plot(run.encoder.t, run.encoder.values[:, p] * MM, color=colour(p), lw=1.2,
                  label=_pad_name(run, p))
    _mark_begins(axis, run)
    axis.set(xlabel='time / s', ylabel='pad travel / mm')
    axis.set_ylim(bottom=0.0)
    axis.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    return Plate('pad_travel', figure, (
        'Travel of each pad from home, by its encoder. Vertical lines: a prescribed move began.'))


@styled
def marker_travel(run):
    """How far the optical markers have gone since they were first seen; for a body let go."""
    figure = new_figure(9.5, 2.8)
    axis = figure.subplots()
    ways = _marker_ways(run.optical)
    farthest = sorted(ways, key=lambda name: -np.nanmax(ways[name]))[:MOST_MARKERS]
    for k, name in enumerate(farthest):
        axis.plot(run.optical.t, ways[name] * MM, color=colour(k), lw=1.2, label=name)
    axis.set(xlabel='time / s', ylabel='marker travel / mm')
    axis.set_ylim(bottom=0.0)
    axis.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    return Plate('marker_travel', figure, (
        'Distance of the optical markers from where they were first seen, as the tracker has '
        f'it{"" if len(ways) == len(farthest) else f"; the {MOST_MARKERS} that went farthest"}.'))


def _marker_ways(frames):
    """Name -> distance (n,) [m] from where a marker was first seen, NaN where it is not."""
    seen = np.where(frames.visible[..., None], frames.points, np.nan)
    first = {str(name): np.flatnonzero(frames.visible[:, k]) for k, name in enumerate(frames.ids)}
    return {name: np.linalg.norm(seen[:, k] - seen[there[0], k], axis=1)
            for k, (name, there) in enumerate(first.items()) if len(there)}


@styled
def pad_forces(run):
    """Contact force of every pad over the run, tasks shaded; for who minds the patient's skin."""
    figure = new_figure(9.5, 2.8)
    axis = figure.subplots()
    size = np.linalg.norm(run.force.values, axis=2)
    for p in range(size.shape[1]):
        axis.plot(run.force.t, size[:, p], color=colour(p), lw=1.2, label=_pad_name(run, p))
    _mark_begins(axis, run)
    axis.set(xlabel='time / s', ylabel='contact force / N')
    axis.set_ylim(bottom=0.0)
    axis.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    return Plate('pad_forces', figure, (
        'Size of the force between tissue and each pad. Vertical lines: a goal was set, or a '
        'prescribed move began.'))


def _mark_begins(axis, run):
    top = axis.get_xaxis_transform()
    for move in run.moves:  # too many for their names
        axis.axvline(move.t_start, color='#9aa5ad', lw=0.9)
    for task in run.tasks:
        axis.axvline(task.t_start, color='#9aa5ad', lw=0.9)
        axis.text(task.t_start, 1.01, ' ' + task.name, transform=top, fontsize=8, va='bottom',
                  color='#55636e')


@styled
def streams(run, qualities, *, bin_width=0.5):
    """Message flow of every topic over time; for who must know whether a stream stalled.

    qualities : topic -> metrics.StreamQuality;  bin_width : [s]
    """
    first, last = run.span()
    edges = np.linspace(first, last, max(round((last - first) / bin_width), 1) + 1)
    figure = new_figure(9.5, 0.9 + 0.27 * len(run.topics))
    axis = figure.subplots()
    image = None
    for row, record in enumerate(run.topics):
        flow = _flow(record.stamps, edges, bin_width / LEAST_PER_BIN)
        if flow is None:
            axis.plot(record.stamps, np.full(len(record.stamps), row), '|', color=INK,
                      markersize=9)
        else:
            image = axis.pcolormesh(edges, [row - 0.38, row + 0.38], flow[None], cmap=FLOW,
                                    vmin=0.0, vmax=2.0, rasterized=True)
        axis.text(1.01, row, _stream_text(qualities[record.topic], flow is not None), fontsize=8,
                  va='center', transform=axis.get_yaxis_transform())
    axis.set_yticks(range(len(run.topics)), [r.topic for r in run.topics])
    axis.set(xlabel='time / s', ylim=(len(run.topics) - 0.5, -0.5),
             xlim=(first - 0.01 * (last - first), last + 0.01 * (last - first)))
    axis.grid(False)
    if image is not None:
        bar = figure.colorbar(image, ax=axis, pad=0.17, aspect=18, ticks=[0.0, 1.0, 2.0])
        bar.ax.set_yticklabels(['silent', 'usual', 'twice'])
        bar.outline.set_visible(False)
    return Plate('streams', figure, (
        f'Messages per {bin_width:g} s of every topic, relative to its own usual rate: grey as '
        'usual, red too few, blue too many. Ticks: single messages of topics that speak now and '
        'then or in bursts. '
        "Right: mean rate and messages lost, by the publishers' sequence counters."))


def _flow(stamps, edges, longest):
    """Counts per bin over the median count, or None for a topic that speaks now and then.

    longest : [s] silence within which half of the time lies, at most; in bursts it is longer
    """
    if _usual_silence(stamps) > longest:
        return None
    counts, _ = np.histogram(stamps, edges)
    usual = np.median(counts)
    return counts / usual if usual >= 1 else None


def _usual_silence(stamps):
    """Silence [s] between messages that half of the time is shorter than; infinite for one."""
    gaps = np.sort(np.diff(np.sort(stamps)))
    if not gaps.sum() > 0.0:
        return np.inf
    return gaps[np.searchsorted(np.cumsum(gaps), 0.5 * gaps.sum())]


def _stream_text(quality, periodic):
    rate = f'{quality.rate:.1f} Hz' if periodic else f'{quality.count} messages'
    lost = '' if quality.lost is None else f', {quality.lost} lost'
    return rate + lost
