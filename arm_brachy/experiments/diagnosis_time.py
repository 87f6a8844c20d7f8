"""What a diagnosis takes: CPU time and memory, on the thesis-size mesh and on a laboratory's dome.

The breast, 2278 quadratic elements, is recorded for its whole protocol by a plant on another mesh,
once as the model has it and with one and two causes planted. The laboratory's three recordings,
in which nothing is missing, are told together. Each answer is made in a process of its own, one
after another, on one thread: nothing else should run meanwhile.
Test: experiments/test_diagnosis_time.py
"""

import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import dome_rig, recordings
from arm_brachy.experiments.diagnosis_cases import load, store
from arm_brachy.experiments.diagnosis_plan import SCENE, Case, Plant
from arm_brachy.experiments.diagnosis_recordings import move, observe
from arm_brachy.experiments.diagnosis_study import absolute
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.offline import load_run
from arm_brachy.registry import parse_terms

NAME = 'diagnosis-time'
SEED = 11
SINGLES, PAIRS = 60.0, 180.0    # s of CPU, that were asked for
STIFFENING = {'name': 'strain_stiffening', 'ratio': 1.0}
YIELD = {'name': 'actuator_compliance', 'compliance_mm_N': 0.25, 'actuators': [1]}
# name of the case -> what is planted, and how much CPU time was asked for
PLANTED = {'nothing': ((), SINGLES), 'one cause': ((STIFFENING,), SINGLES),
           'two causes': ((STIFFENING, YIELD), PAIRS)}


@dataclass(frozen=True)
class Timed:
    """A diagnosis to be timed.

    case : its name;  files : of `diagnosis_cases.store`, or bags;  scene : path
    allowed : [s] of CPU, None = nothing was asked for
    """

    case: str
    files: tuple
    scene: Path
    allowed: float | None


def reproduce(out_dir):
    """Return the Result: a row for each answer, and the goals; no figures go to `out_dir`.

    Raises InputError if the laboratory's recordings are absent.
    """
    source = recordings.folder(dome_rig.SET)
    with tempfile.TemporaryDirectory() as scratch:
        scene, bags = dome_rig.imported(source, Path(scratch))
        asked = [Timed(case, (_recorded(case, terms, Path(scratch)),), SCENE, allowed)
                 for case, (terms, allowed) in PLANTED.items()]
        asked.append(Timed("a laboratory's dome", tuple(bags.values()), scene, None))
        rows = tuple(map(alone, asked))
    goals = tuple(_goal(row, one.allowed) for row, one in zip(rows, asked, strict=True)
                  if one.allowed is not None)
    return Result(NAME, SEED, commit_of(share_dir()), str(machine_description()), rows, goals)


def _recorded(case, terms, folder):
    """Path of the recording of a case, made now."""
    plant = Plant(case, 1.0, (0.0,) * len(load_scene(SCENE).pads), None)
    path = folder / f'{case.replace(" ", "_")}.npz'
    store(path, observe(Case(case, SEED, plant, None), move(plant, parse_terms(terms, NAME))))
    return path


def alone(one):
    """The row of a Timed, answered in a process of its own, which nothing was done in before."""
    with process_pool(1) as pool:
        return pool.submit(answered, one).result()


def answered(one):
    """The row (dict) of a Timed, answered in this process, whose peak of memory it tells."""
    scene = load_scene(one.scene)
    runs = [load(path) if path.suffix == '.npz' else load_run(path) for path in one.files]
    evidences = [evidence_of(run, scene) for run in runs]
    wall, cpu = time.perf_counter(), time.process_time()
    d = absolute(evidences, one.scene, seed=SEED)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return {'case': one.case, 'recordings': len(runs),
            'recorded_s': sum(float(run.encoder.t[-1] - run.encoder.t[0]) for run in runs),
            'elements': len(specimen_of(scene).mesh.tets), 'verdict': d.verdict,
            'causes': ', '.join(sorted({cause.term for cause in d.causes})), 'cpu_s': cpu,
            'wall_s': wall,
            'peak_MB': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6}


def _goal(row, allowed):
    return Target(f'{row["case"]}: CPU time', row['cpu_s'], 's', f'<= {allowed:g}',
                  row['cpu_s'] <= allowed)
