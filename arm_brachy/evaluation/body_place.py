"""Where on the body: its surface at rest in two views, with regions, pads and markers on it."""

from dataclasses import dataclass, field

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patches import Circle

from arm_brachy.evaluation.body_view import HALO, HEAD_ON, VIEWS, draw_arrow, on_paper
from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.style import GOAL, INK, MM, Plate, new_figure, styled

PALE, DEEP = np.array([0.93, 0.95, 0.96]), np.array([0.66, 0.73, 0.78])
LIGHT = np.array([0.35, -0.55, 0.76])   # from where the surface is lit, over the eye's shoulder
FADED = '#8a97a1'


@dataclass(frozen=True)
class Spot:
    """A region to point out: centre (3,) [m], radius [m], and its name on paper.

    sure : drawn with a full line, else dashed (one of several, or where to look)
    """

    centre: np.ndarray
    radius: float
    label: str
    sure: bool = True


@dataclass(frozen=True)
class Body:
    """A body at rest.

    rest : (n, 3) [m];  tets : (m, 4) node indices
    pads : timeseries.PadMark each;  markers : name -> (3,) [m]
    """

    rest: np.ndarray
    tets: np.ndarray
    pads: tuple = ()
    markers: dict = field(default_factory=dict)


@styled
def body_place(body, spots=(), pads=(), markers=(), caption=''):
    """Regions, pads and markers of a Body pointed out; for who asks where to look.

    spots : Spot each;  pads, markers : names of those to point out
    """
    spans = [np.ptp(body.rest[:, view.across]) for view in VIEWS]
    tallest = max(np.ptp(body.rest[:, view.up]) for view in VIEWS)
    figure = new_figure(9.5, np.clip(1.3 + 5.2 * tallest / sum(spans), 3.0, 5.0))
    axes = figure.subplots(1, 2, gridspec_kw={'width_ratios': spans})
    faces = boundary_triangles(body.tets)
    size = np.ptp(body.rest, axis=0).max()
    for axis, view in zip(axes, VIEWS, strict=True):
        draw_surface(axis, view, body.rest, faces)
        for pad in body.pads:
            draw_pad(axis, view, pad, size, pad.name in pads)
        _draw_markers(axis, view, body.markers, markers, unnamed=pads)
        for spot in spots:
            _draw_spot(axis, view, spot, below=bool(markers))
        axis.set_title(view.name)
        axis.set(xlabel=f'{"xyz"[view.across]} / mm', ylabel=f'{"xyz"[view.up]} / mm')
        axis.set_aspect('equal', adjustable='box')
        axis.margins(0.12)
    return Plate('body_place', figure, caption)


def draw_surface(axis, view, rest, faces):
    """Faces turned towards the eye, far ones first, shaded so that the shape can be seen."""
    corners = rest[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    toward = np.asarray(view.toward, dtype=float)
    front = np.flatnonzero(normal @ toward > 0)
    order = front[np.argsort(corners[front].mean(axis=1) @ toward, kind='stable')]
    light = LIGHT + toward
    lit = np.clip(normal[order] @ (light / np.linalg.norm(light)), 0.0, 1.0)[:, None]
    axis.add_collection(PolyCollection(
        corners[order][:, :, (view.across, view.up)] * MM, facecolors=DEEP + lit * (PALE - DEEP),
        edgecolors='#ffffff55', linewidths=0.25, rasterized=True))
    axis.autoscale_view()


def draw_pad(axis, view, pad, size, pointed_out):
    """An arrow that ends on the pad; a cross where it points away from the reader."""
    tip, along = np.asarray(pad.centre), np.asarray(pad.direction)
    color, weight = (GOAL, 'bold') if pointed_out else (INK, 'normal')
    facing = np.dot(along, view.toward)
    label = tip - 0.26 * size * along
    if facing > HEAD_ON and not pointed_out:
        return
    if abs(facing) > HEAD_ON:
        axis.plot(*on_paper(view, tip), 'X', color=color, markersize=9)
        label = tip - 0.09 * size * np.eye(3)[view.up]
    else:
        draw_arrow(axis, view, tip, tip - 0.15 * size * along, color, 3.0 if pointed_out else 1.6)
    axis.text(*on_paper(view, label), pad.name, fontsize=8, ha='center', va='center', color=color,
              fontweight=weight, path_effects=HALO)
    axis.plot(*on_paper(view, label), alpha=0.0)


def _draw_markers(axis, view, markers, pointed_out, unnamed):
    """unnamed : names that something beside the marker has already"""
    others = np.array([p for n, p in markers.items() if n not in pointed_out]).reshape(-1, 3)
    axis.plot(*on_paper(view, others.T), 'o', color='white', markeredgecolor=FADED, markersize=3.5,
              markeredgewidth=0.8, linestyle='')
    for name in pointed_out:
        if name not in markers:
            continue
        axis.plot(*on_paper(view, markers[name]), 'o', color=GOAL, markersize=7, zorder=5)
        if name not in unnamed:
            outward = 1 if markers[name][view.across] >= 0.0 else -1
            axis.annotate(name, on_paper(view, markers[name]), xytext=(7 * outward, 6),
                          textcoords='offset points', ha='left' if outward > 0 else 'right',
                          fontsize=8.5, color=GOAL, fontweight='bold', path_effects=HALO)


def _draw_spot(axis, view, spot, *, below):
    """A circle and its name, below it where names of markers need the room above."""
    centre = on_paper(view, np.asarray(spot.centre))
    line = '-' if spot.sure else '--'
    axis.add_patch(Circle(centre, spot.radius * MM, facecolor=GOAL + '44', edgecolor=GOAL,
                          linestyle=line, lw=1.6, zorder=4))
    axis.plot(*centre, '+', color=GOAL, markersize=9, markeredgewidth=1.8, zorder=5)
    side = -1 if below else 1
    axis.annotate(spot.label, (centre[0], centre[1] + side * spot.radius * MM),
                  xytext=(0, side * 4), textcoords='offset points', ha='center',
                  va='top' if below else 'bottom', fontsize=8.5, color=GOAL, fontweight='bold',
                  path_effects=HALO, zorder=6)
