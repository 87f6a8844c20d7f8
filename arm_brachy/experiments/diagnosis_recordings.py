"""Recordings for the study of the diagnosis: a plant runs once, its sensors observe it many times.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy import cell as cells
from arm_brachy import inprocess
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.random import stream
from arm_brachy.core.scene import MeshFile
from arm_brachy.core.term import Kind
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.clock_offset import ClockOffset
from arm_brachy.devices.terms.em_offset import EmOffset
from arm_brachy.devices.terms.force_drift import ForceDrift
from arm_brachy.evaluation.timeseries import RunData
from arm_brachy.experiments.diagnosis_plan import SCENARIO, Nuisance, base_cell
from arm_brachy.inprocess_log import RunLog
from arm_brachy.registry import to_entries
from arm_brachy.scenario import Overlay, resolve

PLANT_MESH = '../scenes/breast/breast_plant.msh'    # beside the scenario


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
        self.point_names, self.mesh = body.point_names, body.mesh

    def step(self, t, q):
        """See cell.Body."""
        self.readings.append(replace(self._body.step(t, q), x=None))
        return self.readings[-1]


def move(plant, also=()):
    """Run the protocol on a Plant, terms `also` in it; returns Motion.

    Raises NotConverged if the tissue was not solved at every tick or a move was not made.
    """
    scale = plant.modulus * base_cell().scene.material.E
    mesh = MeshFile(str((SCENARIO.parent / PLANT_MESH).resolve()))
    terms = [ActuatorGain(gain=0.0, offset=d, actuators=(i,)) for i, d in enumerate(plant.touch)]
    if plant.planted is not None:
        terms.append(plant.planted.term)
    terms.extend(also)
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
