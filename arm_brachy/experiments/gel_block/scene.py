"""The scene file that the laboratory hands over, on the mesh in config/scenes/gel_block.

The mesh is Gmsh's, made from block.geo beside it: straight tetrahedra, as far from the generator's
bricks as a user's mesh would be.
"""

import math
import os

from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.experiments.gel_block.layout import (
    BASE_MARKERS,
    DENSITY,
    MARKERS,
    NU,
    PADS,
    SIDE,
    STROKE,
    TARGETS,
    E,
)


def mesh_file():
    """Path of the mesh, millimetres, with sets of nodes `base` and one per pad."""
    return config_dir() / 'scenes' / 'gel_block' / 'block.msh'


def gel_scene(mesh, *, poor=False):
    """The Scene on a mesh file;  poor : without markers on the pads."""
    on_pads = () if poor else tuple(
        Marker(f'on_{pad.name}', _plain(pad.marker), pad.name) for pad in PADS)
    return Scene(
        name='gel_block', description='gel block, 120 x 90 x 60 mm, two square pads of 28 mm',
        mesh=MeshFile(str(mesh), 'mm'), fixed=Region('set', set='base'),
        material=Material(E, NU, DENSITY),
        # what is carried is the set; the radius is that of a disc of the square's area
        pads=tuple(PadPatch(pad.name, pad.centre, pad.direction, SIDE / math.sqrt(math.pi),
                            STROKE, set=pad.name) for pad in PADS),
        markers=(*(Marker(name, _plain(at)) for name, at in MARKERS.items()), *on_pads,
                 *(Marker(name, _plain(at), 'base') for name, at in BASE_MARKERS.items())),
        targets=tuple(Target(name, _plain(at)) for name, at in TARGETS.items()))


def write_scene(path, *, poor=False):
    """Write the scene file to `path`, the mesh by its path relative to it."""
    yaml, mesh = YAML(), os.path.relpath(mesh_file(), path.resolve().parent)
    yaml.width = 99
    with path.open('w', encoding='utf-8') as file:
        yaml.dump(config.to_mapping(gel_scene(mesh, poor=poor)), file)


def _plain(point):
    return tuple(round(float(v), 9) for v in point)
