"""What is planted for the study of the diagnosis: which term, how large, where and when.

The patient is the breast on another mesh with quadratic elements, pushed by the protocol
probe_rich; the model is the scene as it stands. How large a term is, the registry says; where and
when it acts is drawn here, at places that the protocol moves. Every recording also has nuisances
that no laboratory calibrates away, each drawn uniformly within `Nuisance`.

What is the same for several recordings is run once. Sixty nulls are twelve plant runs, with five
draws of noise, registration, zeros and clocks each. Sensing terms are planted on the same runs, as
they change nothing but what is seen; damping has no effect on a quasi-static body, a point mass
none without gravity: they stand for four more nulls. All other terms have a run of their own at
either size: 62 runs, 130 recordings. What joined the registry later comes last: a case keeps its
number and its draws.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from arm_brachy.core.paths import config_dir
from arm_brachy.core.quantity import quantity
from arm_brachy.core.random import stream
from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.registry import TERMS, by_name
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.mesh import boundary_faces, load_mesh
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

SEED = 20260418
SCENARIO = config_dir() / 'scenarios' / 'probe_rich.yaml'
SCENE = config_dir() / 'scenes' / 'breast.yaml'             # the model
INERT_HERE = ('damping', 'point_mass')     # no inertia, no gravity
LATER = ('point_mass', 'axis_crosstalk')    # terms, whose cases come after the last null
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
    """Return every Case, in the order of making: some nulls, terms, other nulls, `LATER`."""
    nulls = [_plant(seed, f'null_{i:02d}') for i in range(NULL_PLANTS)]
    draws = [(nulls[i % NULL_PLANTS], None) for i in range(NULLS)]
    first = _faults(seed, nulls, [cls for cls in TERMS if cls.spec.name not in LATER])
    later = [one for name in LATER for one in _faults(seed, nulls, [by_name(name)])]
    ordered = [*draws[:FIRST], *first, *draws[FIRST:], *later]
    return tuple(Case(f'case_{i:03d}', int(stream(seed, f'case/{i}').integers(2**31)), *pair)
                 for i, pair in enumerate(ordered))


def _faults(seed, nulls, classes):
    """(Plant, Planted) of every class at every size; what shares `nulls` takes them in turn."""
    faults, shared = [], 0
    for size in SIZES:
        for cls in classes:
            label = f'{cls.spec.name}_{"typical" if size == 1.0 else "tenth"}'
            one = planted(cls, size, stream(seed, f'place/{label}'))
            if on_null(cls):
                faults.append((nulls[shared % NULL_PLANTS], one))
                shared += 1
            else:
                faults.append((_plant(seed, label, one), one))
    return faults


def on_null(cls):
    """True for a term class that the plant's motion does not depend on."""
    return cls.spec.kind is Kind.SENSING or cls.spec.name in INERT_HERE


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
    elif name == 'axis_crosstalk':      # of the axes that the push loads
        way = np.abs(_push(place))
    else:
        raise ValueError(f'{name} has a vector strength; its direction must be drawn here')
    return way / np.linalg.norm(way)


def _push(place):
    """Direction (3,) in which the pad of a place pushes."""
    name, = place['pads']
    return next(pad.direction for pad in base_cell().scene.pads if pad.name == name)


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
    'axis_crosstalk': _pad,
    'actuator_gain': _actuator, 'backlash': _actuator, 'actuator_compliance': _actuator,
    'lost_steps': lambda rng: {**_actuator(rng), **_onset(rng)},
    'inclusion': _inside, 'base_debond': _on_base, 'anisotropy': _fibres,
    'obstacle': lambda rng: _free(rng, 35.0 * MM), 'point_mass': lambda rng: _free(rng, 30.0 * MM),
    'external_force': lambda rng: {**_free(rng, 30.0 * MM), **_onset(rng)},
    'breathing': lambda rng: {'phase': rng.uniform(-180, 180) * DEG},
    'marker_slip': _marker,
    'clock_offset': lambda rng: {'stream': str(rng.choice(('em', 'optical', 'force')))},
}


@cache
def base_cell():
    """The protocol's Cell as the file has it: scene, moves, devices."""
    return load_cell(SCENARIO)
