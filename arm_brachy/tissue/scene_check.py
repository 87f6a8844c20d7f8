"""What a scene makes of its mesh, in numbers that its author can compare with the rig.

Test: tissue/test_scene_check.py
"""

import numpy as np

from arm_brachy.core.scene import Scene
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.build import RIM
from arm_brachy.tissue.mesh import boundary_faces, surface_distance, with_midside
from arm_brachy.tissue.meshing import mean_ratio
from arm_brachy.tissue.outlines import crossing

MM = 1e3
# Of the radius: nodes no farther out than that are held (`build`). A scene whose pads were rounded
# after its mesh was made has such.
ON_HELD = RIM - 1.0
ONE_WAY = 0.2       # of the area of a base, what its faces have together: less is no direction


def body_row(body: SoftBody):
    """Size, quality and base of a SoftBody: a flat dict, units in its keys.

    `base_normal` points into the body; the base is the faces all of whose nodes are held. Two
    opposite clamps and a rod through the body have none.
    """
    mesh, area = body.mesh, _areas(body.mesh, body.fixed)
    volume = np.sum(body.geometry.weights)
    total, size = np.linalg.norm(area.sum(axis=0)), np.linalg.norm(area, axis=1).sum()
    return {
        'nodes': len(mesh.nodes), 'elements': len(mesh.tets),
        'size_mm': _triple(MM * np.ptp(mesh.nodes, axis=0), 1),
        'volume_cm3': 1e6 * float(volume),
        'worst_mean_ratio': float(mean_ratio(mesh).min()),
        'held_nodes': len(body.fixed),
        'base_cm2': 1e4 * float(size),
        'base_normal': _triple(-area.sum(axis=0) / total, 3) if total > ONE_WAY * size else 'none',
    }


def pad_rows(scene: Scene, body: SoftBody):
    """A row for each pad: its nodes, the share of its disc that they cover, how far it is off.

    `covers_percent` is seen along the push, of a disc of `radius`; `off_surface_mm` that of its
    centre along the push to the nearest of its nodes. Of a node set `inside` is how many of its
    nodes are not on the surface, `off_set_mm` the way from its centre to the nearest of them.
    """
    rows, surface = [], with_midside(body.mesh, np.unique(boundary_faces(body.mesh)))
    for patch, pad in zip(scene.pads, body.pads, strict=True):
        covered = -float((_areas(body.mesh, pad.nodes) @ pad.direction).sum())
        off = float(np.abs((body.mesh.nodes[pad.nodes] - pad.centre) @ pad.direction).min())
        row = {'pad': pad.name, 'nodes': len(pad.nodes), 'area_mm2': 1e6 * covered}
        if not patch.set:
            row |= {'covers_percent': 100.0 * covered / (np.pi * patch.radius**2),
                    'rim': 'cut' if cut(body.mesh, patch) else 'followed',
                    'off_surface_mm': MM * off}
        else:
            away = np.linalg.norm(body.mesh.nodes[pad.nodes] - pad.centre, axis=1).min()
            row |= {'inside': int((~np.isin(pad.nodes, surface)).sum()), 'off_set_mm': MM * away}
        rows.append(row)
    return rows


def point_rows(scene: Scene, body: SoftBody):
    """A row for each marker on tissue and each target: its way to the surface, inside < 0."""
    points = [(m.name, 'marker', m.position) for m in scene.markers if m.body == 'tissue']
    points += [(t.name, 'target', t.position) for t in scene.targets]
    if not points:
        return []
    away = surface_distance(body.mesh, np.array([p for *_, p in points]))
    return [{'point': name, 'kind': kind, 'off_surface_mm': MM * float(off)}
            for (name, kind, _), off in zip(points, away, strict=True)]


def cut(mesh, patch):
    """True if surface edges of a TetMesh cross the rim of a core.scene.PadPatch."""
    return bool(len(crossing(mesh, patch, ON_HELD)))


def _areas(mesh, nodes):
    """Outward area vectors (f, 3) [m^2] of the boundary faces all of whose nodes are given."""
    faces = boundary_faces(mesh)
    a, b, c = (mesh.nodes[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)[np.isin(faces, nodes).all(axis=1)]


def _triple(values, digits):
    return ' '.join(f'{value:.{digits}f}' for value in np.round(values, digits) + 0.0)
