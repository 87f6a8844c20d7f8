"""What is planted for the study of the diagnosis, and the recordings of it.

The patient is the breast on another mesh with quadratic elements, pushed by the protocol
probe_rich; the model is the scene as it stands. How large a term is, the registry says; where and
when it acts is drawn here, at places that the protocol moves. Every recording also has nuisances
that no laboratory calibrates away, each drawn uniformly within `Nuisance`.

What is the same for several recordings is run once. Sixty nulls are twelve plant runs, with five
draws of noise, registration, zeros and clocks each. Sensing terms are planted on the same runs, as
they change nothing but what is seen; damping has no effect on a quasi-static body and stands for
two more nulls. All other terms have a run of their own at either size: 62 runs, 126 recordings.

`python -m arm_brachy.experiments.diagnosis_cases FOLDER` makes every recording from one seed, a
process per core; what is there already is kept.
"""

import json
import os
import sys
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy import cell as cells
from arm_brachy import inprocess
from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.quantity import quantity
from arm_brachy.core.random import stream
from arm_brachy.core.scene import MeshFile
from arm_brachy.core.term import Kind
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.em_offset import EmOffset
from arm_brachy.devices.terms.force_drift import ForceDrift
from arm_brachy.diagnosis.hypothesis import hypothesis
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.inprocess_log import RunLog
from arm_brachy.registry import TERMS, to_entries
from arm_brachy.scenario import Overlay, load_cell, resolve
from arm_brachy.tissue.mesh import boundary_faces, load_mesh
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

SEED = 20260418
SCENARIO = config_dir() / 'scenarios' / 'probe_rich.yaml'
PLANT_MESH = '../scenes/breast/breast_plant.msh'
SIZES = (1.0, 0.1)                      # of what the registry calls typical
NULLS, NULL_PLANTS, FIRST = 60, 12, 6   # draws, plant runs shared by them, nulls made first
TOGETHER = {'base_compliance': ('normal', 'tangential')}   # else the first strength alone
ANYWHERE = ('marker_slip', 'em_offset', 'force_drift')     # vectors of any direction
LEVEL = ('gravity', 'stiffness_gradient')                  # tilted, or across the body
PUSHED = (0, 1, 2)                      # pads that the protocol pushes alone, slow and fast
BUSY = (12.0, 70.0)                     # s, begins and ends with pushes
MM, DEG = 1e-3, np.pi / 180.0


@dataclass(frozen=True)
class Nuisance:
    """Largest size of what is no fault; all within diagnosis.finding.Calibration and Priors."""

    modulus: float = quantity(0.15, '', 'relative error of the modulus')
    shift: float = quantity(0.3, 'mm', 'registration of the optical tracker, per axis')
    turn: float = quantity(0.3, 'deg', 'registration of the optical tracker, per axis')
    em: float = quantity(0.2, 'mm', 'zero of the EM tracker, per axis')
    zero: float = quantity(0.03, 'N', 'zero of a force sensor, per axis')
    touch: float = quantity(0.2, 'mm', 'pad position where the encoder says zero')
    clock: float = quantity(2.0, 'ms', 'offset of the clock of a stream')


@dataclass(frozen=True)
class Planted:
    """A term of the registry as it is planted.

    term : instance;  size : in typical sizes;  strengths, place : its fields that were set, those
    that carry the size and those that say where, when or in which direction
    """

    term: object
    size: float
    strengths: tuple
    place: tuple


@dataclass(frozen=True)
class Plant:
    """One run of the patient.  modulus : factor;  touch : (p,) [m];  planted : or None."""

    name: str
    modulus: float
    touch: tuple
    planted: Planted | None = None


@dataclass(frozen=True)
class Case:
    """One recording: a plant run, what the sensors make of it, and what is to be found.

    seed : of noise and of the sensors' nuisances;  planted : Planted, None for a null
    """

    name: str
    seed: int
    plant: Plant
    planted: Planted | None = None


def plan(seed=SEED):
    """Return every Case, in the order in which they are made: some nulls, terms, other nulls."""
    nulls = [_plant(seed, f'null_{i:02d}') for i in range(NULL_PLANTS)]
    draws = [(nulls[i % NULL_PLANTS], None) for i in range(NULLS)]
    faults, shared = [], 0
    for size in SIZES:
        for cls in TERMS:
            label = f'{cls.spec.name}_{"typical" if size == 1.0 else "tenth"}'
            one = planted(cls, size, stream(seed, f'place/{label}'))
            if on_null(cls):
                faults.append((nulls[shared % NULL_PLANTS], one))
                shared += 1
            else:
                faults.append((_plant(seed, label, one), one))
    ordered = [*draws[:FIRST], *faults, *draws[FIRST:]]
    return tuple(Case(f'case_{i:03d}', int(stream(seed, f'case/{i}').integers(2**31)), *pair)
                 for i, pair in enumerate(ordered))


def on_null(cls):
    """True for a term class that the plant's motion does not depend on."""
    return cls.spec.kind is Kind.SENSING or cls.spec.name == 'damping'


def _plant(seed, name, one=None):
    rng, most = stream(seed, f'plant/{name}'), Nuisance()
    modulus = 1.0 + rng.uniform(-most.modulus, most.modulus)
    if one is not None and isinstance(one.term, StiffnessScale):
        modulus = 1.0   # it is the same thing
    touch = rng.uniform(-most.touch, most.touch, len(base_cell().scene.pads))
    return Plant(name, float(modulus), tuple(float(d) for d in touch), one)


def planted(cls, size, rng):
    """A term class at `size` times its typical value, at a place drawn from `rng`: Planted."""
    name = cls.spec.name
    place = PLACES[name](rng) if name in PLACES else {}
    first = hypothesis(cls).strengths[0].name
    one = hypothesis(cls, TOGETHER.get(name, (first,)), **place)
    vector = one.strengths[0].component is not None
    way = _direction(name, place, rng) if vector else np.ones(len(one.strengths))
    return Planted(one.term(size * way), size, tuple(dict.fromkeys(s.name for s in one.strengths)),
                   tuple(place))


def _direction(name, place, rng):
    """Unit vector (3,) along which a vector strength acts."""
    if name == 'external_force':    # pressed in, towards the middle of the body
        way = np.array([0.0, 0.0, 25.0 * MM]) - place['centre']
    elif name in LEVEL:
        way = np.array([*rng.standard_normal(2), 0.0])
    elif name in ANYWHERE:
        way = rng.standard_normal(3)
    else:
        raise ValueError(f'{name} has a vector strength; its direction must be drawn here')
    return way / np.linalg.norm(way)


def _pad(rng):
    return {'pads': (base_cell().scene.pads[rng.choice(PUSHED)].name,)}


def _actuator(rng):
    return {'actuators': (int(rng.choice(PUSHED)),)}


def _onset(rng):
    return {'onset': float(rng.uniform(*BUSY))}


def _inside(rng):
    """At least 20 mm up and 8 mm below the surface, off the axis, where nothing strains."""
    rho, azimuth = rng.uniform(10.0, 30.0) * MM, rng.uniform(0.0, 2.0 * np.pi)
    return {'centre': (rho * np.cos(azimuth), rho * np.sin(azimuth), rng.uniform(22, 38) * MM)}


def _on_base(rng):
    """Below a pad that is pushed, where the glue is sheared and pulled."""
    azimuth = rng.choice(PUSHED) * 0.5 * np.pi + rng.uniform(-20, 20) * DEG
    rho = rng.uniform(30.0, 40.0) * MM
    return {'centre': (rho * np.cos(azimuth), rho * np.sin(azimuth), 0.0)}


def _free(rng, clear):
    """Middle of a face of the scene's free surface, 15 mm up, `clear` [m] away from every pad."""
    scene = base_cell().scene
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    middles = mesh.nodes[boundary_faces(mesh)].mean(axis=1)
    far = np.min([np.linalg.norm(middles - p.centre, axis=1) for p in scene.pads], axis=0)
    found = middles[(far > clear) & (middles[:, 2] > 15.0 * MM)]
    return {'centre': tuple(float(c) for c in found[rng.integers(len(found))])}


def _fibres(rng):
    return {'azimuth': rng.uniform(-90, 90) * DEG, 'elevation': rng.uniform(-30, 30) * DEG}


def _marker(rng):
    """Any on the tissue."""
    choice = [m.name for m in base_cell().scene.markers if m.body == 'tissue']
    return {'marker': str(rng.choice(choice)), **_onset(rng)}


PLACES = {
    'pad_misplacement': _pad, 'pad_slip': _pad, 'force_gain': _pad, 'force_drift': _pad,
    'actuator_gain': _actuator, 'backlash': _actuator, 'actuator_compliance': _actuator,
    'lost_steps': lambda rng: {**_actuator(rng), **_onset(rng)},
    'inclusion': _inside, 'base_debond': _on_base, 'anisotropy': _fibres,
    'obstacle': lambda rng: _free(rng, 35.0 * MM),
    'external_force': lambda rng: {**_free(rng, 30.0 * MM), **_onset(rng)},
    'breathing': lambda rng: {'phase': rng.uniform(-180, 180) * DEG},
    'marker_slip': _marker,
    'clock_offset': lambda rng: {'stream': str(rng.choice(('em', 'optical', 'force')))},
}


@dataclass(frozen=True)
class Motion:
    """Truth of a plant run at the ticks of the cell.

    t : (n,) [s];  encoder : (n, p) [m];  points : (n, k, 3) [m] markers, then targets
    pads : (n, p, 3) [m] displacements;  force : (n, p, 3) [N] tissue on pad
    """

    t: np.ndarray
    encoder: np.ndarray
    points: np.ndarray
    pads: np.ndarray
    force: np.ndarray


class _Watched:
    """A cell's body whose Readings are kept."""

    def __init__(self, body):
        self._body, self.readings = body, []
        self.point_names = body.point_names

    def step(self, t, q):
        """See cell.Body."""
        self.readings.append(replace(self._body.step(t, q), x=None))
        return self.readings[-1]


def move(plant):
    """Run the protocol on a Plant; returns Motion.

    Raises NotConverged if the tissue was not solved at every tick or a move was not made.
    """
    scale = plant.modulus * base_cell().scene.material.E
    mesh = MeshFile(str((SCENARIO.parent / PLANT_MESH).resolve()))
    terms = [ActuatorGain(gain=0.0, offset=d, actuators=(i,)) for i, d in enumerate(plant.touch)]
    if plant.planted is not None:
        terms.append(plant.planted.term)
    loop = inprocess.InProcess(_cell(plant.name, 0, terms, mesh=mesh, E=scale), sensors=())
    loop.body = watched = _Watched(loop.body)
    while not loop.finished:
        loop.tick()
    run = loop.data()
    solved = all(r.outcome is Outcome.OK for r in watched.readings)
    if not solved or len(run.moves) < run.moves_planned or not all(m.made for m in run.moves):
        raise NotConverged(f'{plant.name}: {run.outcomes}; must solve every tick and make every '
                           'move; plant something smaller')
    return Motion(run.encoder.t, run.encoder.values,
                  *(np.stack([getattr(r, name) for r in watched.readings])
                    for name in ('points', 'pad_displacement', 'pad_force')))


def _cell(name, seed, terms, **overlay):
    base = base_cell()
    plant = Overlay(element='quadratic', terms=tuple(to_entries(terms)), **overlay)
    return resolve(replace(base.scenario, name=name, seed=seed, plant=plant, model=Overlay()),
                   base.path)


@cache
def base_cell():
    """The protocol's Cell as the file has it: scene, moves, devices."""
    return load_cell(SCENARIO)


def observe(case, motion):
    """What the sensors record of a Motion: RunData without truth, plant and seed."""
    rng, most = stream(case.seed, 'nuisances'), Nuisance()
    terms = list(_miscalibrated(rng, most))
    if case.planted is not None and case.planted.term.spec.kind is Kind.SENSING:
        # what is planted is not miscalibrated besides: its size would not be known
        terms = [t for t in terms if t.spec != case.planted.term.spec] + [case.planted.term]
    log = _sensed(_cell(case.name, case.seed, terms), motion)
    seen = log.data(())
    turn = Rotation.from_rotvec(rng.uniform(-most.turn, most.turn, 3)).as_matrix()
    shift = rng.uniform(-most.shift, most.shift, 3)
    optical = replace(seen.optical, points=seen.optical.points @ turn.T + shift)
    return RunData(case.name, '', 0, 'unknown', 'unknown', em=seen.em, encoder=seen.encoder,
                   encoder_pads=seen.encoder_pads, force=seen.force, force_pads=seen.force_pads,
                   optical=optical)


def _miscalibrated(rng, most):
    """The sensors' nuisances that are terms of the registry at a harmless size."""
    yield EmOffset(offset=tuple(rng.uniform(-most.em, most.em, 3)))
    for pad in base_cell().scene.pads:
        yield ForceDrift(rate=(0.0, 0.0, 0.0), bias=tuple(rng.uniform(-most.zero, most.zero, 3)),
                         pads=(pad.name,))
    for kind in ('em', 'optical', 'force'):
        yield ClockOffset(stream=kind, delay=rng.uniform(-most.clock, most.clock))


def _sensed(cell, motion):
    """The RunLog of what a cell's sensors say of a Motion.

    Tools are taken not to turn: their places, which are all that is recorded, do not depend on it.
    """
    params, log = cell.scenario, RunLog(cell)
    em, optical = cells.build_em_tracker(cell, params.em), cells.build_optical_tracker(
        cell, params.optical)
    force = cells.build_force_sensor(cell, params.force)
    feeds = [cells.PointFeed(names) for names in (cell.em_tools, cells.marker_names(cell), ())]
    for reading, encoder in zip(_readings(cell, motion), motion.encoder, strict=True):
        log.add('encoder', reading.t, encoder)
        for s in cells.em_samples(em, feeds[0], reading):
            log.add(('em', s.tool), s.t, (*s.position, s.quality, s.status.value))
        for frame in cells.optical_samples(optical, feeds[1], reading):
            log.add('optical', frame.t, frame.points)
            log.add('visible', frame.t, frame.visible)
        for s in cells.force_samples(force, feeds[2], reading):
            log.add(('force', s.pad), s.t, s.force)
    return log


def _readings(cell, motion):
    scene = cell.scene
    names = tuple(m.name for m in (*scene.markers, *scene.targets))
    turns = np.tile(np.eye(3), (len(names), 1, 1))
    for t, points, pads, force in zip(motion.t, motion.points, motion.pads, motion.force,
                                      strict=True):
        yield cells.Reading(t, names, points, turns, pads, force, np.zeros_like(force))


def save(path, arrays):
    """Write arrays (str -> array) as .npz, whole or not at all."""
    part = path.with_suffix('.part.npz')
    np.savez_compressed(part, **arrays)
    os.replace(part, path)


def store(path, run):
    """Write the streams of RunData, metres and newtons in single precision (5 nm in 80 mm)."""
    em = {f'em/{tool}/{name}': getattr(s, name) for tool, s in run.em.items()
          for name in ('t', 'position', 'quality', 'status')}
    save(path, {
        'encoder/t': run.encoder.t, 'encoder/values': run.encoder.values,
        'encoder/pads': np.array(run.encoder_pads), 'force/t': run.force.t,
        'force/values': run.force.values.astype(np.float32),
        'force/pads': np.array(run.force_pads), 'optical/t': run.optical.t,
        'optical/points': run.optical.points.astype(np.float32),
        'optical/visible': run.optical.visible, 'optical/ids': np.array(run.optical.ids), **em})


def load(path):
    """Read what `store` wrote: RunData, for diagnosis.evidence.evidence_of(run, scene)."""
    with np.load(path) as file:
        given = {key: file[key] for key in file.files}
    tools = dict.fromkeys(key.split('/')[1] for key in given if key.startswith('em/'))
    em = {tool: EmSamples(*(given[f'em/{tool}/{name}']
                            for name in ('t', 'position', 'quality', 'status'))) for tool in tools}
    optical = OpticalFrames(given['optical/t'], tuple(given['optical/ids'].tolist()),
                            given['optical/points'].astype(float), given['optical/visible'])
    return RunData(Path(path).stem, '', 0, 'unknown', 'unknown', em=em, optical=optical,
                   encoder=Series(given['encoder/t'], given['encoder/values']),
                   encoder_pads=tuple(given['encoder/pads'].tolist()),
                   force=Series(given['force/t'], given['force/values'].astype(float)),
                   force_pads=tuple(given['force/pads'].tolist()))


def make(folder, seed=SEED):
    """Make every recording that `folder` lacks, with index.json as they come; returns the index.

    folder : receives plants/NAME.npz (truth), NAME.npz (recordings) and index.json (the labels)
    Raises InputError if it holds recordings of something else.
    """
    folder, cases = Path(folder), plan(seed)
    index = [labels(case, f'{case.name}.npz') for case in cases]
    _check(folder, index)
    (folder / 'plants').mkdir(parents=True, exist_ok=True)
    lacking = {c.name: c.plant for c in cases if not (folder / f'{c.name}.npz').is_file()}
    with hasty_pool(len(lacking)) as pool:
        runs = {plant.name: pool.submit(run_plant, folder / 'plants' / f'{plant.name}.npz', plant)
                for plant in dict.fromkeys(lacking.values())}
        for done, case in enumerate(cases, start=1):
            if case.name in lacking:
                with np.load(runs[case.plant.name].result()) as file:
                    store(folder / f'{case.name}.npz', observe(case, Motion(**file)))
                print(f'{case.name}: {done} of {len(cases)}', file=sys.stderr, flush=True)
            _write(folder / 'index.json', index[:done])
    return index


def _check(folder, index):
    path = folder / 'index.json'
    if not path.is_file():
        return
    held = json.loads(path.read_text(encoding='utf-8'))
    if held != json.loads(json.dumps(index[:len(held)])):
        raise InputError(f'{path}: lists other cases than would be made now; must be of the same '
                         'seed and registry; give a new folder')


@contextmanager
def hasty_pool(jobs):
    """A `process_pool` that drops what has not begun as soon as anything fails."""
    pool = process_pool(max(jobs, 1))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def run_plant(path, plant):
    """Run a Plant, unless its Motion is there already; returns `path`, its file."""
    if not path.is_file():
        save(path, vars(move(plant)))
    return path


def _write(path, index):
    part = path.with_suffix('.part')
    part.write_text(json.dumps(index, indent=1), encoding='utf-8')
    os.replace(part, path)


def labels(case, file):
    """What is in a case, SI: `parameters` carry the size, `fields` are all that the term has."""
    one, out = case.planted, {'name': case.name, 'file': file, 'seed': case.seed,
                              'plant': case.plant.name, 'modulus': case.plant.modulus,
                              'touch': case.plant.touch, 'term': None, 'size': 0.0,
                              'parameters': {}, 'place': {}, 'fields': {}}
    if one is None:
        return out
    fields = asdict(one.term)
    return out | {'term': one.term.spec.name, 'size': one.size, 'fields': fields,
                  'parameters': {name: fields[name] for name in one.strengths},
                  'place': {name: fields[name] for name in one.place}}


if __name__ == '__main__':
    make(sys.argv[1])
