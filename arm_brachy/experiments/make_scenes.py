"""Make the shipped scenes: surfaces from their formulas, meshes, scene files, quality tables.

    python -m arm_brachy.experiments.make_scenes [--meshes]

Surfaces, scene files and the beam's mesh come out the same every time. The mesher does not (see
tissue.meshing), so other meshes are made anew only when asked for or absent.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.scene import (
    Marker,
    Material,
    MeshFile,
    PadPatch,
    PointLoad,
    Region,
    Scene,
    Target,
)
from arm_brachy.tissue import meshing
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.disc_meshing import mesh_with_discs
from arm_brachy.tissue.formats.writing import write_mesh

SCENES = Path(__file__).resolve().parents[2] / 'config' / 'scenes'
STANDARD_GRAVITY = 9.81  # m/s^2, as in the beam's published protocol


@dataclass(frozen=True)
class BreastShape:
    """A breast phantom as a closed parametric surface, base plate at z = 0, z up. SI.

    A point is given by t in [0, pi/2], rim to apex, and the azimuth theta:
        z = height sin(t)^(2/n),  rho = cos(t)^(2/n)  (a superellipse: upright at the rim)
        R(theta) = radius (1 + lobe cos(theta - lobe_angle) + oval cos 2 theta)
        (x, y) = R rho (cos theta, sin theta) + apex (z / height)^2

    radius, height : 130 mm across and 58 mm high, the size of the thesis' phantom (Figs. 3.4, 4.4)
    lobe, oval, apex : departures from a body of revolution of the order of a real breast's
    exponent : n; 2 is an ellipsoid, more is fuller
    """

    radius: float = 0.065
    height: float = 0.058
    exponent: float = 2.2
    lobe: float = 0.02
    lobe_angle: float = np.radians(-60.0)
    oval: float = 0.025
    apex: tuple = (0.004, -0.005)

    def point(self, t, theta):
        """Surface point (..., 3) [m]; t in [0, pi/2] rim to apex, theta azimuth [rad]."""
        rho = np.cos(t) ** (2.0 / self.exponent)
        z = self.height * np.sin(t) ** (2.0 / self.exponent)
        outline = self.radius * (1.0 + self.lobe * np.cos(theta - self.lobe_angle)
                                 + self.oval * np.cos(2.0 * theta))
        lift = (z / self.height) ** 2
        x = outline * rho * np.cos(theta) + self.apex[0] * lift
        y = outline * rho * np.sin(theta) + self.apex[1] * lift
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)

    def at_height(self, z, theta):
        """Surface point (3,) [m] at height z in (0, height), azimuth theta of its section."""
        return self.point(np.arcsin((z / self.height) ** (self.exponent / 2.0)), theta)

    def facing(self, z, azimuth):
        """Surface point (3,) at height z met by the horizontal ray from the z axis at azimuth."""
        theta = azimuth
        for _ in range(20):  # the shift of the axis is small: a contraction by about 0.1 a turn
            x, y, _ = self.at_height(z, theta)
            theta += (azimuth - np.arctan2(y, x) + np.pi) % (2.0 * np.pi) - np.pi
        return self.at_height(z, theta)

    def surface(self, n_around=96, n_up=28, n_base=10):
        """The closed triangulation (trimesh.Trimesh, metres), rings from base centre to apex."""
        theta = np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False)
        rings = [self.point(0.0, theta) * s for s in np.linspace(0.0, 1.0, n_base + 1)[1:]]
        rings += [self.point(t, theta) for t in np.linspace(0.0, np.pi / 2, n_up + 1)[1:-1]]
        return _stack(rings, np.zeros(3), np.array([*self.apex, self.height]))


# Pads at mid height, as wide as the heel of a hand. Small ones sink in: at nu = 0.49 a 30 mm push
# moves the middle of the breast by 3.8 mm with discs of 10 mm radius and by 8.6 mm with 20 mm; the
# thesis' tasks ask for 5 mm. (With linear elements 10 mm seem to do, because those lock.)
PAD_HEIGHT, PAD_RADIUS, PAD_STROKE = 0.027, 0.020, 0.030
MARKER_STANDOFF = 0.012  # optical marker on the rod, behind the pad's plate
# Five targets in the pad plane inside a circle of 22 mm (layout after thesis Fig. 3.5) [mm].
TARGETS_MM = ((0, 0), (15, 7), (-9, 15), (-14, -10), (8, -17))
# Rings of tissue markers between the pads of both scenes: height [mm], azimuths [deg]; 18 and the
# apex make 19. At least 6 mm from every rim: nearer, meshes differ by a tenth of the push.
MARKER_RINGS = ((14, (25, 45, 65, 115, 135, 155, 240, 300)), (30, (45, 135, 240, 300)),
                (44, (30, 55, 120, 150, 240, 300)))
BASE_MARKERS_MM = ((82, 60, 0), (-82, 60, 0), (-82, -60, 0))


def breast_scene(pad_azimuths, mesh_file, name, description):
    """The breast phantom with pads at the given azimuths [deg], as a Scene."""
    shape = BreastShape()
    pads = tuple(_pad(shape, i + 1, np.radians(a)) for i, a in enumerate(pad_azimuths))
    height = PAD_HEIGHT
    return Scene(
        name=name,
        mesh=MeshFile(mesh_file),
        fixed=Region('half_space', point=(0.0, 0.0, 0.5e-3), normal=(0.0, 0.0, -1.0)),
        material=Material(E=6e3, nu=0.49, density=1000.0),
        pads=pads,
        markers=_tissue_markers(shape) + _rigid_markers(pads),
        targets=tuple(Target(f'target_{i + 1}', (x * 1e-3, y * 1e-3, height))
                      for i, (x, y) in enumerate(TARGETS_MM)),
        description=description,
        source='size, modulus, four co-planar pads, five targets, 19 markers: thesis ch. 3 and 4',
    )


# The beam's damping, fitted to the free vibration of the two recordings under its own weight: the
# mean over their three tip markers, 0.0528 to 0.0540 at 7.76 Hz (results/silicone-beam.json).
# Mass and stiffness take equal shares there, so that the ratio stays within 4 % from 5.9 to 10.2
# Hz: silicone's loss is nearly the same at all frequencies. Neither share alone can be right: from
# this fit it would say 0.095 (mass) or 0.030 (stiffness) for the loaded beam's 4.3 Hz; equal
# shares say 0.062, and 0.053 and 0.061 were measured.
BEAM_DAMPING_RATIO, BEAM_FREQUENCY = 0.0534, 7.76  # 1, Hz
BEAM_CELLS = (8, 3, 3)     # along, across, up: within 1 % of twice as fine (silicone_beam)
BEAM_GRADING = 1.5         # x grows with this power of the cell count from the clamp


def beam_mesh(cells=BEAM_CELLS):
    """The beam as a TetMesh of 6 tetrahedra per cell, cells shorter towards the clamp.

    cells : (3,) along, across, up. Near nu = 0.5 the clamp, which keeps the section from
    narrowing, decides how fast meshes converge: 1536 tetrahedra of even cells do less well.
    """
    mesh = box_mesh((1.0, 1.0, 1.0), cells)
    nodes = mesh.nodes * [1.0, 0.03, 0.03]
    nodes[:, 0] = 0.1 * mesh.nodes[:, 0] ** BEAM_GRADING - 0.1
    return TetMesh(nodes, mesh.tets)


def beam_scene(name, loads, description):
    """The clamped silicone beam as a Scene: x = -100 mm (clamp) .. 0 (tip), z up."""
    omega = 2.0 * np.pi * BEAM_FREQUENCY
    tips = ((0, 15, 36), (0, -6, 24), (0, 36, 6))
    bases = ((-94, -10, -1), (-94, 40, 27.5), (-94, 40, 0))
    return Scene(
        name=name,
        mesh=MeshFile('silicone_beam/beam.msh'),
        fixed=Region('half_space', point=(-0.0995, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
        material=Material(E=264e3, nu=0.499, density=1070.0),
        dynamics='implicit',
        gravity=(0.0, 0.0, -STANDARD_GRAVITY),
        rayleigh_alpha=round(BEAM_DAMPING_RATIO * omega, 4),
        rayleigh_beta=round(BEAM_DAMPING_RATIO / omega, 7),
        markers=tuple(Marker(f'Tip-{i + 1}', _metres(p)) for i, p in enumerate(tips))
        + tuple(Marker(f'Base-{i + 1}', _metres(p), 'base') for i, p in enumerate(bases)),
        loads=loads,
        description=description,
        source='Dubied et al., IEEE RA-L 2022, Sim-to-Real for Soft Robots using Differentiable '
               'FEM; github.com/srl-ethz/diffPD_sim2real, realbeam_experiments (MIT licence); '
               'damping fitted to their runs beam_gravity (make_scenes)',
    )


# The body that solvers are compared on: half an ellipsoid, simple enough to be made anywhere.
DOME_RADIUS, DOME_HEIGHT, DOME_PAD_RADIUS = 0.065, 0.055, 0.015


def dome_scene(size):
    """The comparison dome, pad on its apex, on its mesh called `size`, as a Scene."""
    return Scene(
        name=f'dome_{size}',
        mesh=MeshFile(f'dome/{size}_rims.msh'),
        fixed=Region('half_space', point=(0.0, 0.0, 0.5e-3), normal=(0.0, 0.0, -1.0)),
        material=Material(E=6e3, nu=0.49, density=1000.0),
        pads=(PadPatch('apex', centre=(0.0, 0.0, DOME_HEIGHT), direction=(0.0, 0.0, -1.0),
                       radius=DOME_PAD_RADIUS, stroke=0.03),),
        targets=(Target('centre', (0.0, 0.0, 0.5 * DOME_HEIGHT)),),
        description='half an ellipsoid pushed at its apex, for comparing solvers',
    )


def dome_surface(n_around=72, n_up=24, radius=DOME_RADIUS, height=DOME_HEIGHT):
    """Half an ellipsoid on its base disc as a closed triangulation (trimesh.Trimesh, metres)."""
    theta = np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False)
    around = np.stack([np.cos(theta), np.sin(theta), np.zeros(n_around)], axis=1)
    rings = [radius * s * around for s in np.linspace(0.0, 1.0, 9)[1:]]
    rings += [radius * np.cos(t) * around + np.array([0.0, 0.0, height * np.sin(t)])
              for t in np.linspace(0.0, np.pi / 2, n_up + 1)[1:-1]]
    return _stack(rings, np.zeros(3), np.array([0.0, 0.0, height]))


def beam_surface():
    """The beam, a 100 x 30 x 30 mm box, as a closed triangulation in metres (12 triangles)."""
    return trimesh.creation.box(bounds=[[-0.1, 0.0, 0.0], [0.0, 0.03, 0.03]])


def scenes():
    """Every shipped scene, file name -> Scene."""
    load = PointLoad('weight', (0.0, 0.015, 0.0), 0.51012 / STANDARD_GRAVITY)
    return {
        'breast.yaml': breast_scene((0, 90, 180, 270), 'breast/breast_rims.msh', 'breast',
                                    'breast phantom with four co-planar pads'),
        'breast_3pads.yaml': breast_scene((90, 210, 330), 'breast/breast_3pads.msh',
                                          'breast_3pads',
                                          'breast phantom with three co-planar pads'),
        'silicone_beam.yaml': beam_scene('silicone_beam', (), 'clamped beam under its own weight'),
        'silicone_beam_load52.yaml': beam_scene(
            'silicone_beam_load52', (load,), 'clamped beam with a weight on the lower tip edge'),
        'dome_small.yaml': dome_scene('small'),
        'dome_large.yaml': dome_scene('large'),
    }


def surfaces():
    """Every shipped surface, file name -> trimesh.Trimesh in metres."""
    return {'breast/breast.stl': BreastShape().surface(), 'dome/dome.stl': dome_surface(),
            'silicone_beam/beam.stl': beam_surface()}


# Mesh file -> (surface file, what is wished for): a count of elements or nodes, or the rims of a
# scene's pads as edges, without which a disc is another one, of whatever outline its nodes have
# (reaction of the breast's quadratic elements: 19 % off). 2331 and 4223: thesis ch. 3 and 5. The
# plant's mesh differs from the model's in size and in every node. The envelope of the coarse mesh
# is wide because 15 mm edges cannot follow this surface closer than half a millimetre.
MESHES = {
    'breast/breast_rims.msh': ('breast/breast.stl', {
        'rims': 'breast.yaml', 'edge_length': 18e-3, 'envelope': 1.1e-3, 'depth': 6e-3}),
    'breast/breast_3pads.msh': ('breast/breast.stl', {
        'rims': 'breast_3pads.yaml', 'edge_length': 18e-3, 'envelope': 1.0e-3, 'depth': 6e-3}),
    'breast/breast_plant.msh': ('breast/breast.stl', {
        'rims': 'breast.yaml', 'edge_length': 24e-3, 'envelope': 1.1e-3, 'depth': 7e-3}),
    'breast/breast_2331.msh': ('breast/breast.stl', {'tets': 2331, 'envelope': 0.06}),
    # plants on which estimators are fitted: no disc has its outline, as on 2331
    'breast/breast_1900.msh': ('breast/breast.stl', {'tets': 1900, 'envelope': 0.06}),
    'breast/breast_3000.msh': ('breast/breast.stl', {'tets': 3000, 'envelope': 0.06}),
    'breast/breast_rims_800.msh': ('breast/breast.stl', {
        'rims': 'breast.yaml', 'edge_length': 30e-3, 'envelope': 2.2e-3, 'depth': 9e-3}),
    'breast/breast_600.msh': ('breast/breast.stl', {'tets': 600, 'envelope': 0.06,
                                                    'tolerance': 0.02}),
    'breast/breast_4223.msh': ('breast/breast.stl', {'nodes': 4223}),
    'dome/small.msh': ('dome/dome.stl', {'tets': 2376, 'envelope': 0.06, 'tolerance': 0.02}),
    'dome/small_rims.msh': ('dome/dome.stl', {
        'rims': 'dome_small.yaml', 'edge_length': 15e-3, 'envelope': 0.9e-3, 'depth': 4e-3}),
    'dome/large_rims.msh': ('dome/dome.stl', {
        'rims': 'dome_large.yaml', 'edge_length': 6e-3, 'envelope': 0.4e-3, 'depth': 3e-3}),
}


def make(folder=SCENES, *, remesh=False):
    """Write surfaces, scene files and, if asked for or absent, meshes into `folder`.

    Returns mesh file -> rows of the quality table, for the meshes made in this call.
    """
    folder = Path(folder)
    write_surfaces(folder)
    for name, scene in scenes().items():
        _write_scene(folder / name, scene)
    tables = {}
    for name, (surface, wish) in MESHES.items():
        if remesh or not (folder / name).is_file():
            mesh, tables[name] = _meshed(folder / surface, **wish)
            write_mesh(folder / name, mesh)
    write_mesh(folder / 'silicone_beam/beam.msh', beam_mesh())  # the same every time
    return tables


def _meshed(surface, *, rims=None, **wish):
    """(TetMesh, quality) of a surface file; rims : scene whose pads' rims are to be edges."""
    if rims is None:
        mesh, report = meshing.mesh_with_count(surface, **wish)
        return mesh, report.rows()
    mesh = mesh_with_discs(surface, scenes()[rims].pads, **wish)
    return mesh, {'tetrahedra': len(mesh.tets),
                  'worst_mean_ratio': float(meshing.mean_ratio(mesh).min())}


def write_surfaces(folder):
    """Write every shipped surface into `folder` as binary STL in millimetres."""
    for name, surface in surfaces().items():
        path = Path(folder) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        _in_millimetres(surface).export(path)


def main():
    """Command line of the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--meshes', action='store_true', help='make the meshes anew as well')
    parser.add_argument('--folder', type=Path, default=SCENES, help='where to write')
    arguments = parser.parse_args()
    for name, rows in make(arguments.folder, remesh=arguments.meshes).items():
        print(name, json.dumps(rows))


def _stack(rings, bottom, top):
    """Close a stack of rings, each (n, 3) and counter-clockwise seen from above, by two poles."""
    n = len(rings[0])
    here, after = np.arange(n), np.roll(np.arange(n), -1)
    faces = [np.stack([np.full(n, 0), 1 + after, 1 + here], axis=1)]
    for k in range(len(rings) - 1):
        low, high = 1 + k * n, 1 + (k + 1) * n
        faces.append(np.stack([low + here, low + after, high + after], axis=1))
        faces.append(np.stack([low + here, high + after, high + here], axis=1))
    last, pole = 1 + (len(rings) - 1) * n, 1 + len(rings) * n
    faces.append(np.stack([last + here, last + after, np.full(n, pole)], axis=1))
    return trimesh.Trimesh(np.vstack([bottom, *rings, top]), np.vstack(faces), process=False)


def _pad(shape, number, azimuth):
    inward = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return PadPatch(f'pad_{number}', centre=_rounded(shape.facing(PAD_HEIGHT, azimuth)),
                    direction=tuple(np.round(inward, 9) + 0.0), radius=PAD_RADIUS,
                    stroke=PAD_STROKE)


def _tissue_markers(shape):
    points = [shape.facing(height * 1e-3, np.radians(azimuth))
              for height, azimuths in MARKER_RINGS for azimuth in azimuths]
    points.append((*shape.apex, shape.height))
    return tuple(Marker(f'tissue_{i + 1}', _rounded(p)) for i, p in enumerate(points))


def _rigid_markers(pads):
    on_pads = tuple(Marker(p.name, _rounded(np.array(p.centre)
                                            - MARKER_STANDOFF * np.array(p.direction)), p.name)
                    for p in pads)
    return on_pads + tuple(Marker(f'base_{i + 1}', _metres(p), 'base')
                           for i, p in enumerate(BASE_MARKERS_MM))


def _rounded(point):
    """To the micrometre, so that the scene file reads well."""
    return tuple(float(v) + 0.0 for v in np.round(point, 6))


def _metres(point_mm):
    return tuple(float(v) * 1e-3 for v in point_mm)


def _in_millimetres(surface):
    return trimesh.Trimesh(surface.vertices * 1e3, surface.faces, process=False)


def _write_scene(path, scene):
    """Write what departs from the defaults, in edge units."""
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 99
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', encoding='utf-8') as file:
        file.write('# Made by arm_brachy.experiments.make_scenes; change it there.\n')
        yaml.dump(_departures(scene), file)


def _departures(scene):
    bare = Scene(scene.name, scene.mesh, Region(scene.fixed.kind))
    full, plain = config.to_mapping(scene), config.to_mapping(bare)
    kept = {k: v for k, v in full.items() if v != plain[k] or k in ('name', 'mesh', 'material')}
    kept['fixed'] = {k: v for k, v in full['fixed'].items()
                     if k == 'kind' or v != plain['fixed'][k]}
    kept['fixed'].setdefault('normal', full['fixed']['normal'])
    return kept


if __name__ == '__main__':
    main()
