"""The scene file that the laboratory hands over, on the mesh that a user made of the surface.

The mesh, config/scenes/half_cylinder/half_cylinder.msh, is fTetWild's: straight tetrahedra, the
round side in facets, nothing in common with the one on which the laboratory solves.
"""

import os

from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.experiments.half_cylinder.layout import (
    BASE_MARKERS,
    DENSITY,
    DISC,
    MARKERS,
    MM,
    NU,
    PADS,
    SAID,
    STROKE,
    TARGETS,
)


def mesh_file():
    """Path of the mesh, in metres."""
    return config_dir() / 'scenes' / 'half_cylinder' / 'half_cylinder.msh'


def half_cylinder_scene(mesh):
    """The Scene on a mesh file."""
    return Scene(
        name='half_cylinder',
        description='half-cylinder of gel, radius 36 mm, length 100 mm, three round pads of 18 mm',
        mesh=MeshFile(str(mesh), 'm'),
        fixed=Region('half_space', point=(0.0, 0.0, 0.5 * MM), normal=(0.0, 0.0, -1.0)),
        material=Material(SAID, NU, DENSITY),
        pads=tuple(PadPatch(pad.name, _plain(pad.centre), _plain(pad.direction), DISC, STROKE)
                   for pad in PADS),
        markers=(*(Marker(name, _plain(at)) for name, at in MARKERS.items()),
                 *(Marker(pad.name, _plain(pad.marker), pad.name) for pad in PADS),
                 *(Marker(name, _plain(at), 'base') for name, at in BASE_MARKERS.items())),
        targets=tuple(Target(name, _plain(at)) for name, at in TARGETS.items()))


def write_scene(path):
    """Write the scene file to `path`, the mesh by its path relative to it."""
    yaml, mesh = YAML(), os.path.relpath(mesh_file(), path.resolve().parent)
    yaml.width = 99
    with path.open('w', encoding='utf-8') as file:
        yaml.dump(config.to_mapping(half_cylinder_scene(mesh)), file)


def _plain(point):
    return tuple(round(float(v), 6) for v in point)
