"""The body in two views: its surface coloured by displacement, with pads, targets and markers."""

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patheffects import withStroke

from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.style import GOAL, INK, MM, Plate, new_figure, styled

LEAST_SPAN = 0.1    # mm, so that a body at rest does not show its rounding errors in colour
HALO = (withStroke(linewidth=2.0, foreground='white'),)
HEAD_ON = 0.8       # cosine beyond which a pad points along the line of sight


@dataclass(frozen=True)
class View:
    """Orthographic view: `across` and `up` are the axes on paper, `toward` (3,) faces the eye."""

    name: str
    across: int
    up: int
    toward: tuple


VIEWS = (View('from above (along −z)', 0, 1, (0, 0, 1)),
         View('from the side (along +y)', 0, 2, (0, -1, 0)))


@styled
def body(run, index):
    """The tissue at snapshot `index` of run.tissue; for who wants to see what was done to it."""
    tissue = run.tissue
    t, positions = tissue.t[index], tissue.positions[index]
    figure, axes = _two_views(tissue, positions, 'displacement / mm')
    for axis, view in zip(axes, VIEWS, strict=True):
        _draw_pads(axis, view, run, t, np.ptp(positions, axis=0).max())
        _draw_markers(axis, view, run, t)
        _draw_targets(axis, view, run, t)
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside upper center', ncols=4)
    return Plate('body', figure, (
        f'The tissue at t = {t:.2f} s, when it was deformed most, true to scale. Colour: '
        'displacement of the surface from rest.'
        + (' Arrows: pads and the way they push (a cross where that is away from the reader; '
           'pads behind the body are left out).' if run.pads else '')
        + (' Targets lie inside and are drawn through the surface, hollow at rest and filled '
           'where they are.' if run.truth else '')))


def _two_views(tissue, positions, label):
    """Both views of the surface at `positions` (n, 3) [m]; Returns (figure, axes)."""
    spans = [np.ptp(positions[:, view.across]) for view in VIEWS]
    tallest = max(np.ptp(positions[:, view.up]) for view in VIEWS)
    figure = new_figure(9.5, np.clip(1.6 + 7.0 * tallest / sum(spans), 2.8, 5.2))
    axes = figure.subplots(1, 2, gridspec_kw={'width_ratios': spans})
    moved = np.linalg.norm(positions - tissue.rest, axis=1) * MM
    faces = boundary_triangles(tissue.tets)
    for axis, view in zip(axes, VIEWS, strict=True):
        image = _draw_surface(axis, view, positions, faces, moved)
        axis.set_title(view.name)
        axis.set(xlabel=f'{"xyz"[view.across]} / mm', ylabel=f'{"xyz"[view.up]} / mm')
        axis.set_aspect('equal', adjustable='box')
        axis.margins(0.08)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, label=label)
    bar.outline.set_visible(False)
    return figure, axes


def _draw_surface(axis, view, positions, faces, values):
    """Faces turned towards the eye, far ones first, coloured by the mean of `values`."""
    corners = positions[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front = np.flatnonzero(normal @ np.asarray(view.toward) > 0)
    depth = corners[front].mean(axis=1) @ np.asarray(view.toward)
    order = front[np.argsort(depth, kind='stable')]
    surface = PolyCollection(corners[order][:, :, (view.across, view.up)] * MM,
                             array=values[faces[order]].mean(axis=1), cmap='YlGnBu',
                             edgecolors='#ffffff66', linewidths=0.25, rasterized=True)
    surface.set_clim(0.0, max(float(values.max()), LEAST_SPAN))
    axis.add_collection(surface)
    axis.autoscale_view()
    return surface


def on_paper(view, point):
    """A point (3,) [m] in a View: (across, up) in mm."""
    return point[view.across] * MM, point[view.up] * MM


def _draw_pads(axis, view, run, t, size):
    """An arrow per pad that ends on the pad where it is at time t; `size` [m] of the body."""
    pushed = run.pad_displacement if run.pad_displacement is not None else run.encoder
    for p, pad in enumerate(run.pads):
        push = 0.0 if pushed is None else np.interp(t, pushed.t, pushed.values[:, p])
        facing = np.dot(pad.direction, view.toward)
        tip = np.asarray(pad.centre) + push * np.asarray(pad.direction)
        label = tip
        if facing < -HEAD_ON:
            axis.plot(*on_paper(view, tip), 'X', color=INK, markersize=8)
            label = tip - 0.09 * size * np.eye(3)[view.up]
        elif facing > HEAD_ON:
            continue
        else:
            draw_arrow(axis, view, tip, tip - 0.15 * size * np.asarray(pad.direction))
            label = tip - 0.27 * size * np.asarray(pad.direction)
        axis.text(*on_paper(view, label), f'{pad.name}\n{push * MM:.1f} mm', fontsize=7.5,
                  ha='center', va='center', path_effects=HALO)
        axis.plot(*on_paper(view, label), alpha=0.0)


def draw_arrow(axis, view, tip, tail, color=INK, width=1.6):
    """An arrow from `tail` to `tip`, both (3,) [m]; `width` in points."""
    axis.annotate('', on_paper(view, tip), on_paper(view, tail),
                  arrowprops={'arrowstyle': '-|>', 'color': color, 'lw': width,
                              'mutation_scale': 12, 'shrinkA': 0, 'shrinkB': 0})


def _draw_markers(axis, view, run, t):
    points, when = _markers_at(run, t)
    axis.plot(points[:, view.across] * MM, points[:, view.up] * MM, 'o', color='white',
              markeredgecolor=INK, markersize=3.5, markeredgewidth=0.8, linestyle='',
              label=f'optical marker{when}' if len(points) else None)


def _markers_at(run, t):
    """Markers (k, 3) [m] as seen nearest to t, else at rest; and a word on which."""
    if run.optical is not None and len(run.optical.t):
        frame = int(np.abs(run.optical.t - t).argmin())
        return run.optical.points[frame][run.optical.visible[frame]], ''
    return np.array(list(run.markers.values())).reshape(-1, 3), ' (at rest)'


def _draw_targets(axis, view, run, t):
    label = 'target (hollow: at rest)'
    for name, series in run.truth.items():
        now = [np.interp(t, series.t, series.values[:, k]) for k in range(3)]
        axis.plot(*on_paper(view, series.values[0]), 'o', markerfacecolor='none',
                  markeredgecolor=GOAL, markersize=7)
        axis.plot(*on_paper(view, now), 'o', color=GOAL, markersize=6, linestyle='', label=label)
        if name in _named(run, view):
            axis.annotate(name, on_paper(view, now), xytext=(6, 5), textcoords='offset points',
                          fontsize=8, color=GOAL, fontweight='bold', path_effects=HALO)
        label = None


def _named(run, view):
    """Targets to name: all from above; from the side, where they overlap, the tasks' own."""
    return run.truth.keys() if view is VIEWS[0] else {task.target for task in run.tasks}


@styled
def residual_body(data, r, index):
    """Residual vectors on the body at frame `index`; for who asks where the model is wrong.

    data : timeseries.ResidualData;  r : (n, k, 3) [m] measured - predicted
    """
    t = data.t[index]
    if data.tissue is None:
        figure = new_figure(9.5, 4.4)
        axes = figure.subplots(1, 2)
    else:
        nearest = int(np.abs(data.tissue.t - t).argmin())
        figure, axes = _two_views(data.tissue, data.tissue.positions[nearest],
                                  'predicted displacement / mm')
    scale = _arrow_scale(data, r[index])
    for axis, view in zip(axes, VIEWS, strict=True):
        _draw_residuals(axis, view, data, r[index], index, scale)
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside upper center', ncols=3)
    return Plate('residual_body', figure, (
        f'The body as predicted at t = {t:.2f} s, where the residual over all markers is largest. '
        f'Arrows: residual, measured minus predicted, drawn {scale:g} times its true length.'))


def _joined_labels(names, points, near=4.0):
    """Names of markers that fall within `near` mm of each other on paper, under one label."""
    groups = []
    for name, point in zip(names, points, strict=True):
        for group in groups:
            if np.linalg.norm(group[1] - point) < near:
                group[0].append(str(name))
                break
        else:
            groups.append(([str(name)], point))
    return [(', '.join(group), point) for group, point in groups]


def _arrow_scale(data, r):
    """Magnification (1, 2, 3, 5, ...) that draws the largest residual as a fifth of the body."""
    size = np.ptp(data.rest, axis=0).max() / 5.0
    largest = np.nanmax(np.linalg.norm(r, axis=1))
    wanted = size / largest if largest > 0 else 1.0
    steps = np.array([1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 300, 500, 1000])
    return int(steps[max(np.searchsorted(steps, wanted, side='right') - 1, 0)])


def _draw_residuals(axis, view, data, r, index, scale):
    paper = [view.across, view.up]
    start = data.predicted[index][:, paper] * MM
    seen = np.isfinite(r).all(axis=1)
    axis.plot(*start[seen].T, 'o', color='white', markeredgecolor=INK, markersize=5, linestyle='',
              label='marker as predicted')
    axis.quiver(*start[seen].T, *(r[seen][:, paper] * MM * scale).T, angles='xy',
                scale_units='xy', scale=1, color=GOAL, width=0.005, zorder=4,
                label=f'residual × {scale}')
    tips = start[seen] + r[seen][:, paper] * MM * scale
    axis.plot(*tips.T, alpha=0.0)
    for names, point in _joined_labels(np.array(data.names)[seen], start[seen]):
        axis.annotate(names, point, xytext=(5, 5), textcoords='offset points', fontsize=7.5,
                      path_effects=HALO)
    if data.tissue is None:
        axis.set_title(view.name)
        axis.set(xlabel=f'{"xyz"[view.across]} / mm', ylabel=f'{"xyz"[view.up]} / mm')
        axis.set_aspect('equal', adjustable='box')
        axis.margins(0.2)
