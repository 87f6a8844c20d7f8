"""A scene as its author can compare it with the rig: from six sides, all of it by name."""

from dataclasses import dataclass, field

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.spatial import cKDTree

from arm_brachy.evaluation.body_place import Body, draw_pad, draw_surface
from arm_brachy.evaluation.body_view import HALO, VIEWS, View, on_paper
from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.style import GOAL, INK, MM, Plate, new_figure, styled

SIDES = (*VIEWS, View('from the end (along −x)', 1, 2, (1, 0, 0)),
         View('from below (along +z)', 0, 1, (0, 0, -1)),
         View('from the side (along −y)', 0, 2, (0, 1, 0)),
         View('from the end (along +x)', 1, 2, (-1, 0, 0)))
MIRRORED = 3        # of SIDES, from there on: what is across runs to the left
FACING = 0.15       # cosine from which on a spot of the surface can be seen
HELD, INSIDE, WRONG = '#d9b44a', '#2c7fb8', '#d7191c'
RIM = np.linspace(0.0, 2.0 * np.pi, 61)     # corners of a circle that looks round


@dataclass(frozen=True)
class SceneBody(Body):
    """A Body with all that a scene says of it.

    held : node indices that do not move;  radii : pad name -> [m] of those that are discs
    targets : name -> (3,) [m]
    """

    held: tuple = ()
    radii: dict = field(default_factory=dict)
    targets: dict = field(default_factory=dict)


@styled
def scene_plate(body, wrong=(), wrong_pads=()):
    """The surface of a SceneBody from six sides; what is held, pads, markers, targets by name.

    A marker is drawn where the surface under it faces the eye.
    wrong : names of markers and targets that are drawn in red, whatever hides them
    wrong_pads : names of pads whose rims are
    """
    faces = boundary_triangles(body.tets)
    figure = new_figure(13.0, 8.9)
    size = np.ptp(body.rest, axis=0).max()
    for i, (axis, view) in enumerate(zip(figure.subplots(2, 3).ravel(), SIDES, strict=True)):
        draw_surface(axis, view, body.rest, faces)
        _draw_held(axis, view, body, faces)
        for pad in body.pads:
            _draw_disc(axis, view, pad, body.radii.get(pad.name), pad.name in wrong_pads)
            draw_pad(axis, view, pad, size, pointed_out=False)
        _name_markers(axis, view, body, faces, set(wrong))
        _name_targets(axis, view, body, set(wrong))
        axis.set_title(view.name)
        axis.set(xlabel=f'{"xyz"[view.across]} / mm', ylabel=f'{"xyz"[view.up]} / mm')
        axis.set_aspect('equal', adjustable='box')
        axis.margins(0.15)
        if i >= MIRRORED:
            axis.invert_xaxis()
    figure.legend(handles=_keys(body, (*wrong, *wrong_pads)), loc='outside upper center', ncols=5)
    return Plate('scene', figure, 'The scene from six sides: what is held, pads and the way they '
                                  'push, markers by their names, targets through the surface.')


def _keys(body, wrong):
    """Handles of the legend, of what there is."""
    dot = {'linestyle': '', 'markersize': 6}
    out = [Patch(color=HELD, alpha=0.75, label='held')] if len(body.held) else []
    out += [Line2D([], [], color=INK, label='pad: rim (dashed: behind), push')] * bool(body.pads)
    out += [Line2D([], [], color=GOAL, marker='o', label='marker', **dot)] * bool(body.markers)
    out += [Line2D([], [], color=INSIDE, marker='D', label='target, inside', **dot)] * bool(
        body.targets)
    return out + [Line2D([], [], color=WRONG, marker='X', label='cannot be meant', **dot)] * bool(
        [name for name in wrong if name])


def _draw_held(axis, view, body, faces):
    """Faces that face the eye and all of whose nodes are held; edge on, their outline."""
    held = faces[np.isin(faces, body.held).all(axis=1)]
    corners = body.rest[held]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine = normal @ np.asarray(view.toward, dtype=float) / np.linalg.norm(normal, axis=1)
    shown = corners[cosine > -FACING][:, :, (view.across, view.up)] * MM
    axis.add_collection(PolyCollection(shown, facecolors=HELD, edgecolors=HELD, alpha=0.75,
                                       linewidths=1.2, rasterized=True))


def _draw_disc(axis, view, pad, radius, wrong):
    """The rim of a disc, dashed where the body is between it and the eye."""
    if radius is None:
        return
    along = np.asarray(pad.direction)
    side = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    side /= np.linalg.norm(side)
    rim = np.asarray(pad.centre) + radius * (
        np.outer(np.cos(RIM), side) + np.outer(np.sin(RIM), np.cross(along, side)))
    behind = along @ np.asarray(view.toward, dtype=float) > FACING
    axis.plot(*on_paper(view, rim.T), color=WRONG if wrong else INK, lw=1.4 if wrong else 1.1,
              linestyle='--' if behind else '-', zorder=4)


def _name_markers(axis, view, body, faces, wrong):
    seen = dict(_in_sight(view, body, faces))
    for name in (*seen, *(n for n in body.markers if n in wrong and n not in seen)):
        _point(axis, view, name, body.markers[name], *(
            ('X', WRONG, 7.0) if name in wrong else ('o', GOAL, 3.5)))


def _name_targets(axis, view, body, wrong):
    """By name from above and below, and what is wrong: from the side they hide each other."""
    for name, point in body.targets.items():
        _point(axis, view, name if view.up == 1 or name in wrong else '', point, *(
            ('X', WRONG, 7.0) if name in wrong else ('D', INSIDE, 4.0)))


def _point(axis, view, name, point, sign, colour, size):
    axis.plot(*on_paper(view, point), sign, color=colour, markersize=size, zorder=5)
    if not name:
        return
    axis.annotate(name, on_paper(view, point), xytext=(3, 3), textcoords='offset points',
                  fontsize=6.5, color=colour, path_effects=HALO, zorder=6)


def _in_sight(view, body, faces):
    """(name, position) of the markers over surface that faces the eye."""
    corners = body.rest[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normal @ np.asarray(view.toward, dtype=float) > FACING * np.linalg.norm(
        normal, axis=1)
    middles = cKDTree(corners.mean(axis=1))
    return [(name, point) for name, point in body.markers.items()
            if facing[middles.query(point)[1]]]
