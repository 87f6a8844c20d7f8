"""CPU time of one plant step on the breast scene: pads bonded, touching, touching with friction.

    OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python test/benchmark/contact_steps.py

Prints one line of JSON per element and size of step, with machine and commit. `ratio` is against
bonded pads, which bear from the start what touching ones come to bear after 2 to 3.5 mm.
"""

import dataclasses
import json
import time

import numpy as np

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import MeshFile, load_scene
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.simulator import TissueSimulator

SHARES = np.array([[1.0], [0.0], [0.0], [0.5]])  # of the push that each pad makes
RUNS = {'ticks': (2e-4, 30), 'steps': (5e-3, 5)}  # m per step, steps
FOLDER = config_dir() / 'scenes'
PADS = {'bonded': {}, 'frictionless': {'contact': 'touching', 'friction': 0.0},
        'friction_0.3': {'contact': 'touching', 'friction': 0.3}}


def scene_of(element, pads):
    """The breast on the plant's mesh; pads : fields of PadPatch to replace."""
    scene = load_scene(FOLDER / 'breast.yaml')
    return dataclasses.replace(
        scene, element=element, mesh=MeshFile(str(FOLDER / 'breast' / 'breast_plant.msh')),
        pads=tuple(dataclasses.replace(pad, **pads) for pad in scene.pads))


def timed(body, step, count):
    """CPU ms of each TissueSimulator step, and the last TissueState."""
    simulator = TissueSimulator(body)
    directions = np.array([p.direction for p in body.pads])
    simulator.settle()
    times = []
    for k in range(1, count + 1):
        start = time.process_time()
        state = simulator.step(float(k), k * step * SHARES * directions)
        times.append(1e3 * (time.process_time() - start))
        if not state.outcome.ok:
            break
    return times, state


def main():
    """Print the table."""
    origin = {'commit': commit_of(share_dir()), 'machine': machine_description()}
    for element in ('linear', 'quadratic'):
        bodies = {name: build_body(scene_of(element, pads)) for name, pads in PADS.items()}
        for body in bodies.values():
            timed(body, 1e-3, 2)  # compiles
        for run, (step, count) in RUNS.items():
            bonded = None
            for name, body in bodies.items():
                times, state = timed(body, step, count)
                median = float(np.median(times))
                bonded = median if bonded is None else bonded
                print(json.dumps({
                    'run': run, 'element': element, 'tets': len(body.mu), 'pads': name,
                    'step_mm': 1e3 * step, 'steps': len(times), 'outcome': state.outcome.name,
                    'median_ms': round(median, 1), 'max_ms': round(max(times), 1),
                    'ratio': round(median / bonded, 2),
                    'force_N': round(float(np.linalg.norm(state.pad_force[0])), 3), **origin}),
                    flush=True)


if __name__ == '__main__':
    main()
