"""Make the sample of `arm-brachy import sample`: what a laboratory hands over, simulated.

    python -m arm_brachy.experiments.sample_phantom

Beside the scene and the column map in config/imports/phantom it writes the surface of the phantom
and the CSV files of one recording. The eastern pad goes 7 % less far than its encoder says, which
the scene does not know; nothing else is wrong but noise. The mesh, which is not kept, is another
at each call (tissue.meshing), so the files differ by what meshes differ by.
Test: experiments/test_sample_phantom.py
"""

import tempfile
from pathlib import Path

import numpy as np

from arm_brachy.core.paths import config_dir
from arm_brachy.core.random import stream
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.motion import Path as Travel
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.experiments.make_scenes import dome_surface
from arm_brachy.registry import parse_terms
from arm_brachy.tissue.mesh_command import mesh_command

SAMPLE = config_dir() / 'imports' / 'phantom'
SURFACE, RECORDING = 'phantom.stl', Path('monday') / 'push_1'
RADIUS, HEIGHT = 53e-3, 60e-3       # m, half axes of the phantom
EDGE_MM = 9.0                       # of the mesh that is recorded; the tutorial takes 12
FAULT = {'name': 'actuator_gain', 'gain': -0.07, 'actuators': [0]}     # of the eastern pad
SEED = 7
LATE = 35e-3        # s, by which the EM tracker's clock is behind, as the column map says
MISSING = '-9999'
# Pushes [mm] of (east, west), the speed [mm/s] of the way in and out, the hold [s].
PUSHES = (((5, 0), 4.0, 2.0), ((9, 0), 8.0, 2.0), ((0, 5), 8.0, 2.0), ((0, 9), 4.0, 2.0),
          ((5, 5), 8.0, 2.0), ((9, 9), 4.0, 2.0), ((9, 3), 8.0, 2.0))
REST = 2.0          # s between them, twice that before and after
STEP = 0.01         # s between samples of the path
# Period [s] and noise, sd [m or N], of each device.
MOTORS, CELLS, CAMERA, AURORA = (0.02, 2e-6), (0.05, 0.02), (0.1, 5e-5), (0.1, 1e-4)


def travel():
    """The signals.motion.Path of the motors, closely sampled: a fault may depend on the way."""
    t, q = [0.0, 2.0 * REST], [(0.0, 0.0)] * 2
    for push, speed, hold in PUSHES:
        way = max(push) / speed
        t += [t[-1] + way, t[-1] + way + hold, t[-1] + 2.0 * way + hold,
              t[-1] + 2.0 * way + hold + REST]
        q += [push, push, (0.0, 0.0), (0.0, 0.0)]
    corners = Travel(np.array([*t, t[-1] + REST]), 1e-3 * np.array([*q, (0.0, 0.0)]))
    clock = np.union1d(corners.t, np.arange(0.0, corners.t[-1], STEP))
    return Travel(clock, corners.at(clock))


def make(folder=SAMPLE):
    """Write surface and recording into `folder`, which holds the scene and the column map."""
    folder = Path(folder)
    surface = dome_surface(48, 14, RADIUS, HEIGHT)
    surface.apply_scale(1e3)
    surface.export(folder / SURFACE)
    scene = load_scene(folder / 'phantom.yaml')
    with tempfile.TemporaryDirectory() as scratch:
        mesh = Path(scratch) / 'phantom.msh'
        mesh_command(folder / SURFACE, mesh, edge_length_mm=EDGE_MM, patches=scene.pads)
        specimen = specimen_of(with_mesh(scene, mesh))
    (folder / RECORDING).mkdir(parents=True, exist_ok=True)
    record(specimen, folder / RECORDING)


def record(specimen, folder):
    """Write the files of one recording of a Specimen."""
    path, rng = travel(), stream(SEED, 'sample')
    model = ForwardModel(specimen, parse_terms((FAULT,), 'sample'))

    def seen(kind, device, off=0.0):
        """(stamps (n,) [s], values (n, k * axes)) of a device, with its noise."""
        period, noise = device
        t = np.arange(0.0, path.t[-1], period)
        values = path.at(t) if kind is None else model.predict(path, t + off).get(kind)
        return t, (values + noise * rng.standard_normal(values.shape)).reshape(len(t), -1)

    axes = [f'{name}.{axis}' for name in specimen.markers for axis in 'XYZ']
    tools = [f'{name}_{axis}' for name in specimen.tools for axis in 'xyz']
    t, q = seen(None, MOTORS)
    _write(folder / 'motors.csv', ['t_ms', 'E_pos_mm', 'W_pos_mm'], 1e3 * t, 1e3 * q, 3)
    t, force = seen(FORCE, CELLS)
    along = -np.einsum('npi,pi->np', force.reshape(len(t), -1, 3), specimen.directions)
    _write(folder / 'cells.csv', ['t_ms', 'E_load', 'W_load'], 1e3 * t, along, 3)
    t, points = seen(OPTICAL, CAMERA)
    points[rng.random(len(t)) < 0.01, :3] = np.nan      # the first marker is hidden now and then
    _write(folder / 'camera.csv', ['time', *axes], t, 1e3 * points, 2)
    t, places = seen(EM, AURORA, LATE)
    _write(folder / 'aurora.csv', ['time', *tools], t, 1e3 * places, 2)


def _write(path, names, t, values, digits):
    with path.open('w', encoding='utf-8') as file:
        file.write(','.join(names) + '\n')
        for stamp, row in zip(t, values, strict=True):
            cells = (MISSING if np.isnan(value) else f'{value:z.{digits}f}' for value in row)
            file.write(','.join([f'{stamp:.6g}', *cells]) + '\n')


if __name__ == '__main__':
    make()
