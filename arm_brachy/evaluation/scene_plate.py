"""A scene as its author can compare it with the rig: from six sides, pads and markers by name."""

import numpy as np
from scipy.spatial import cKDTree

from arm_brachy.evaluation.body_place import draw_pad, draw_surface
from arm_brachy.evaluation.body_view import HALO, VIEWS, View, on_paper
from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.style import GOAL, Plate, new_figure, styled

SIDES = (*VIEWS, View('from the end (along −x)', 1, 2, (1, 0, 0)),
         View('from below (along +z)', 0, 1, (0, 0, -1)),
         View('from the side (along −y)', 0, 2, (0, 1, 0)),
         View('from the end (along +x)', 1, 2, (-1, 0, 0)))
MIRRORED = 3        # of SIDES, from there on: what is across runs to the left
FACING = 0.15       # cosine from which on a spot of the surface can be seen


@styled
def scene_plate(body):
    """The surface of a body_place.Body from six sides, pads and markers by their names.

    A marker is drawn where the surface under it faces the eye.
    """
    faces = boundary_triangles(body.tets)
    figure = new_figure(13.0, 8.5)
    size = np.ptp(body.rest, axis=0).max()
    for i, (axis, view) in enumerate(zip(figure.subplots(2, 3).ravel(), SIDES, strict=True)):
        draw_surface(axis, view, body.rest, faces)
        for pad in body.pads:
            draw_pad(axis, view, pad, size, pointed_out=False)
        _name_markers(axis, view, body, faces)
        axis.set_title(view.name)
        axis.set(xlabel=f'{"xyz"[view.across]} / mm', ylabel=f'{"xyz"[view.up]} / mm')
        axis.set_aspect('equal', adjustable='box')
        axis.margins(0.15)
        if i >= MIRRORED:
            axis.invert_xaxis()
    return Plate('scene', figure, 'The scene from six sides: pads and the way they push, markers '
                                  'by their names.')


def _name_markers(axis, view, body, faces):
    for name, point in _in_sight(view, body, faces):
        axis.plot(*on_paper(view, point), 'o', color=GOAL, markersize=3.5, zorder=5)
        axis.annotate(name, on_paper(view, point), xytext=(3, 3), textcoords='offset points',
                      fontsize=6.5, color=GOAL, path_effects=HALO, zorder=6)


def _in_sight(view, body, faces):
    """(name, position) of the markers over surface that faces the eye."""
    corners = body.rest[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normal @ np.asarray(view.toward, dtype=float) > FACING * np.linalg.norm(
        normal, axis=1)
    middles = cKDTree(corners.mean(axis=1))
    return [(name, point) for name, point in body.markers.items()
            if facing[middles.query(point)[1]]]
