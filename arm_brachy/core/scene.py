"""A scene: one soft body, where it is held, what touches it, what is marked on it. Any body."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.place import Place, names_of, refuse_twice
from arm_brachy.core.quantity import quantity, word

TISSUE, BASE = 'tissue', 'base'     # what a marker may be glued to, besides a pad


@dataclass(frozen=True)
class MeshFile:
    """A tetrahedral mesh file in any format meshio reads, or an .npz (`tissue.mesh.load_mesh`)."""

    file: str = word('.msh, .vtu, ... with node sets as physical groups, or .npz: nodes (n, 3), '
                     'tets (m, 4), and node indices (k,) under the name of each set')
    unit: Literal['m', 'mm'] = word('of the nodes', default='m')


@dataclass(frozen=True)
class Material:
    """Homogeneous Neo-Hookean tissue (3.18)."""

    E: float = quantity(6.0, 'kPa', "Young's modulus at small strain", low=0.01, high=1e6,
                        source='plastisol phantom, compression test, thesis sec. 3.4.4')
    nu: float = quantity(0.49, '', "Poisson's ratio at small strain; the energy is mu/2 (J^(-2/3) "
                         'I1 - 3) + kappa/2 (J - 1)^2', low=0.0, high=0.4999,
                         source='nearly incompressible soft tissue')
    density: float = quantity(1000.0, 'kg_m3', 'mass density', low=1.0, high=2e4,
                              source='water; plastisol is within 5 %')


@dataclass(frozen=True)
class Region:
    """Which nodes: those of a named set, in a half space, or in a box (world frame)."""

    kind: Literal['set', 'half_space', 'box'] = word(
        'of the nodes that do not move, the base: its normal is that of their faces; two clamps '
        'and more are one set')
    set: str = word('name of a node set of the mesh file', default='')
    point: tuple = quantity([0, 0, 0], 'mm', 'a point of the bounding plane, some tenths of a '
                            'millimetre inside the body where a flat face is meant', shape=(3,))
    normal: tuple = quantity([0, 0, -1], '', 'points into the region', shape=(3,))
    low: tuple = quantity([0, 0, 0], 'mm', 'lower corner', shape=(3,))
    high: tuple = quantity([0, 0, 0], 'mm', 'upper corner', shape=(3,))


@dataclass(frozen=True)
class PadPatch:
    """A disc-shaped pad on the surface: nodes within `radius` of the axis, on the facing side.

    `set` names the nodes instead where the mesh file carries them. A bonded pad carries those
    nodes along. A touching one is a flat rigid disc with a rounded edge: it pushes, never pulls,
    and slides against Coulomb friction; zero travel is where it just touches the body at rest.
    """

    name: str
    centre: tuple = quantity(None, 'mm', 'centre of the disc on the stress-free body, world '
                             'frame; of a set, the point that moments refer to', shape=(3,))
    direction: tuple = quantity(None, '', 'push direction, into the tissue', shape=(3,))
    radius: float = quantity(8.0, 'mm', 'radius of the disc, across the push: an oblique one '
                             'meets an ellipse', low=0.5, high=200.0)
    stroke: float = quantity(30.0, 'mm', 'largest push', low=0.0, high=200.0)
    set: str = word('name of a node set of the mesh file, in place of a disc', default='')
    contact: Literal['bonded', 'touching'] = word(
        'bonded pads hold their nodes at zero travel where these are stress-free, whatever weighs',
        default='bonded')
    friction: float = quantity(0.3, '', 'Coulomb coefficient (touching only)', low=0.0, high=5.0,
                               source='own choice within the 0.2 to 0.5 of dry skin on smooth '
                                      'polymers, Derler & Gerhardt 2012, Tribol Lett 45:1')
    edge_radius: float = quantity(2.0, 'mm', 'rounding of the edge (touching only), at most '
                                  'the radius', low=0.05, high=200.0,
                                  source='own choice: a pad that is comfortable to wear')


@dataclass(frozen=True)
class Marker:
    """An optical marker, glued to the tissue surface, a pad or the base (`body`)."""

    name: str
    position: tuple = quantity(None, 'mm', 'on the stress-free body, world frame; up to 8 mm '
                               'off the tissue, it rides on the nearest surface; on a pad or the '
                               'base, which are rigid, anywhere', shape=(3,))
    body: str = word('what it is glued to: tissue, base or the name of a pad', default=TISSUE)


@dataclass(frozen=True)
class Target:
    """A point inside the tissue that can carry an EM sensor, the tool of the same name."""

    name: str
    position: tuple = quantity(None, 'mm', 'in the stress-free body, world frame', shape=(3,))


@dataclass(frozen=True)
class PointLoad:
    """A dead weight hung on the tissue at a point (its mass takes part in the dynamics)."""

    name: str
    position: tuple = quantity(None, 'mm', 'where it hangs on the stress-free body, world '
                               'frame', shape=(3,))
    mass: float = quantity(None, 'g', 'hanging mass', low=0.0)


@dataclass(frozen=True)
class Scene:
    """One soft body as a file. Frames: world, z up unless the scene says otherwise; SI inside."""

    name: str
    mesh: MeshFile
    fixed: Region
    element: Literal['quadratic', 'linear'] = word('linear ones lock', default='quadratic')
    material: Material = field(default_factory=Material)
    dynamics: Literal['quasi_static', 'implicit'] = word('implicit: inertia and damping',
                                                         default='quasi_static')
    gravity: tuple = quantity([0, 0, 0], 'm_s2', 'gravity, in a liquid what buoyancy leaves of it',
                              shape=(3,))
    rayleigh_alpha: float = quantity(0.0, 'per_s', 'mass-proportional damping (implicit only)',
                                     low=0.0)
    rayleigh_beta: float = quantity(0.0, 'ms', 'stiffness-proportional damping (implicit only)',
                                    low=0.0)
    pads: tuple[PadPatch, ...] = ()
    markers: tuple[Marker, ...] = ()
    targets: tuple[Target, ...] = ()
    loads: tuple[PointLoad, ...] = ()
    description: str = ''
    source: str = ''


def load_scene(path):
    """Read a scene file; the mesh path inside it is relative to the scene file.

    Returns Scene with `mesh.file` made absolute. Raises ConfigError, also for names given twice,
    a pad without direction and a marker on something that the scene does not have.
    """
    path = Path(path)
    scene = config.load(Scene, path)
    check_scene(scene, Place(path))
    return with_mesh(scene, (path.parent / scene.mesh.file).resolve(), scene.mesh.unit)


def check_scene(scene, place):
    """Refuse what a schema cannot see, with a ConfigError; place : a place.Place."""
    refuse_twice(place, names_of(scene, 'pads'))
    # markers and targets are the points of one body, told apart by name
    refuse_twice(place, {**names_of(scene, 'markers'), **names_of(scene, 'targets')})
    for i, pad in enumerate(scene.pads):
        if not any(pad.direction):
            raise ConfigError(f"{place('pads', i, 'direction')} = {list(pad.direction)}; must not "
                              'be zero: it says where the pad pushes')
    carriers = (TISSUE, BASE, *(pad.name for pad in scene.pads))
    for i, marker in enumerate(scene.markers):
        if marker.body not in carriers:
            raise ConfigError(f"{place('markers', i, 'body')} = {marker.body!r}; must be one of "
                              f'{", ".join(carriers)}')


def with_mesh(scene, mesh_file, unit='m'):
    """Return the scene on another mesh file (absolute path)."""
    return replace(scene, mesh=MeshFile(str(mesh_file), unit))
