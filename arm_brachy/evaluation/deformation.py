"""How much the tissue is deformed: displacement and stretch of linear tetrahedra."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Deformation:
    """One state of the tissue against rest.

    mean_displacement : [m] mean of |u| over the nodes;  max_displacement : [m] largest nodal |u|
    volume_mean_displacement : [m] |u| averaged over the volume, which does not depend on where the
        mesh is fine
    max_stretch : largest principal stretch over the elements (1 = undeformed)
    """

    mean_displacement: float
    max_displacement: float
    volume_mean_displacement: float
    max_stretch: float


def deformation(rest, positions, tets):
    """Deformation of one snapshot.

    rest, positions : (n, 3) [m];  tets : (m, 4) node indices, positively oriented
    """
    size = np.linalg.norm(positions - rest, axis=1)
    volume = tet_volumes(rest, tets)
    element_mean = size[tets].mean(axis=1)
    stretch = principal_stretches(rest, positions, tets)
    return Deformation(float(size.mean()), float(size.max()),
                       float(volume @ element_mean / volume.sum()), float(stretch.max()))


def largest_deformation(tissue):
    """The snapshot of `tissue` (timeseries.Tissue) with the largest mean nodal |u|.

    Returns (index of the snapshot, Deformation).
    """
    mean = np.linalg.norm(tissue.positions - tissue.rest, axis=2).mean(axis=1)
    index = int(mean.argmax())
    return index, deformation(tissue.rest, tissue.positions[index], tissue.tets)


def principal_stretches(rest, positions, tets):
    """Principal stretches (m, 3), ascending: singular values of F = Ds Dm^-1 of each element.

    The gradient is constant over a linear tetrahedron; on coarse meshes local peaks are missed.
    """
    reference, current = _edges(rest, tets), _edges(positions, tets)
    F = current @ np.linalg.inv(reference)
    squared = np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)
    return np.sqrt(np.maximum(squared, 0.0))


def tet_volumes(rest, tets):
    """Volumes (m,) [m^3], positive for positively oriented elements."""
    return np.linalg.det(_edges(rest, tets)) / 6.0


def boundary_triangles(tets):
    """Faces that belong to one element only, (f, 3) node indices, turned outwards."""
    faces = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]],
                            tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True,
                                return_counts=True)
    return faces[np.sort(first[count == 1])]


def _edges(points, tets):
    corners = points[tets]
    return np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
