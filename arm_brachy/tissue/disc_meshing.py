"""Meshes of bodies with the rims of disc-shaped pads among their edges.

Test: test_refinement.py
"""

import contextlib

import igl
import numpy as np
import trimesh

from arm_brachy.tissue.meshing import check_edge_length, positive, tetrahedralize
from arm_brachy.tissue.outlines import follow_rims
from arm_brachy.tissue.rims import FlatElement, fit_rim, frame, not_flat
from arm_brachy.tissue.surface import read_surface

PLUG_SIDES = 48      # of the prism that stands for a disc's cylinder while meshing
ATTEMPTS = 4         # of the mesher; one in ten has been seen to fail
ENVELOPE, DEPTH = 0.06, 0.45    # of the edge length; of the smallest disc's radius


def mesh_with_discs(source, patches, *, edge_length, envelope=None, depth=None, unit='mm'):
    """Fill a closed surface with tetrahedra whose surface has the discs' rims among its edges.

    source, unit : see `surface.read_surface`;  patches : core.scene.PadPatch
    edge_length : wished for inside [m]; near the rims elements come out smaller, of `depth`
    envelope : how far the mesh may leave surface and rims [m], None = ENVELOPE; how many nodes a
        rim gets follows from it: 360 deg / acos(1 - envelope / radius), roughly
    depth : [m] how far the cylinder of a disc is followed into the body, None = DEPTH
    Returns TetMesh in metres, rim nodes exactly on the cylinder and on the surface, outlines
    closed.
    The mesher gets the body and, standing in it, a prism for each disc; what it makes outside the
    body is dropped. It is not deterministic (see `meshing`): keep the mesh, do not remake it. For
    the same reason it is asked again, ATTEMPTS times in all, if rim nodes crush an element.
    Raises MeshError for a bad surface or edge length, or if an element is still flatter than
    FLATTEST.
    """
    envelope = ENVELOPE * edge_length if envelope is None else envelope
    depth = DEPTH * min(patch.radius for patch in patches) if depth is None else depth
    for _ in range(ATTEMPTS - 1):
        with contextlib.suppress(FlatElement):
            return _with_discs(source, patches, edge_length, envelope, depth, unit)
    return _with_discs(source, patches, edge_length, envelope, depth, unit)


def _with_discs(source, patches, edge_length, envelope, depth, unit):
    """One attempt of `mesh_with_discs`."""
    surface, _ = read_surface(source, unit=unit)
    check_edge_length(surface, edge_length)
    parts = [surface, *(_plug(patch, depth) for patch in patches)]
    together = trimesh.util.concatenate(parts)
    mesh = _inside(surface, *tetrahedralize(together, edge_length, envelope))
    for patch in patches:
        mesh = fit_rim(mesh, patch, reach=1.5 * envelope)
    return not_flat(follow_rims(mesh, patches, surface))


def _plug(patch, depth):
    """The prism around a disc's axis, from `depth` outside the surface to `depth` inside."""
    centre, direction, across = frame(patch)
    prism = trimesh.creation.cylinder(patch.radius, 2.0 * depth, sections=PLUG_SIDES)
    place = np.eye(4)
    place[:3, :3] = np.column_stack([*across, direction])
    place[:3, 3] = centre
    return prism.apply_transform(place)


def _inside(surface, nodes, tets):
    """TetMesh of the elements with their centre inside a closed surface."""
    winding = igl.fast_winding_number(np.ascontiguousarray(surface.vertices),
                                      np.ascontiguousarray(surface.faces, np.int64),
                                      nodes[tets].mean(axis=1))
    return positive(nodes, tets[winding > 0.5])
