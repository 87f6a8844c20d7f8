"""Composition root: a resolved scenario in, wired plant, devices and controller out.

The nodes and the in-process loop build what they need here and nowhere else, so that both run
the same objects. Nothing here knows ROS.
"""

import importlib
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from arm_brachy import registry
from arm_brachy.control.manipulator import Manipulator
from arm_brachy.control.needle_plan import NeedleCourse
from arm_brachy.control.probe_press import pressed
from arm_brachy.control.procedure import Procedure
from arm_brachy.control.pursuit import Pursuit
from arm_brachy.control.push_protocol import PushProtocol
from arm_brachy.control.sequencer import Sequencer
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core.errors import CommandRefused, ConfigError, InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.random import stream
from arm_brachy.core.term import Stage
from arm_brachy.devices.actuator import SimulatedBank
from arm_brachy.devices.actuator_driver import load_driver
from arm_brachy.devices.em_tracker import EmTracker
from arm_brachy.devices.force_sensor import ForceSensor
from arm_brachy.devices.needle import NeedleForce
from arm_brachy.devices.needle_driver import NeedleDriver, nominal_offset
from arm_brachy.devices.optical_tracker import OpticalTracker
from arm_brachy.devices.surface_scanner import PadShadow, Plate, SurfaceScanner
from arm_brachy.devices.ultrasound_imager import Imager
from arm_brachy.estimation.live import LiveEstimator
from arm_brachy.estimation.marker_motion import MarkerMotion
from arm_brachy.robot.panda_parameters import DH, JOINT_NAMES
from arm_brachy.robot.probe_planner import PLANNERS, CentrePlanner
from arm_brachy.robot.reference import rotation
from arm_brachy.robot.rigid_body import Arm, frames
from arm_brachy.robot.scissor_place import base_axes, linkage_line
from arm_brachy.robot.scissor_urdf import BASE as SCISSOR_BASE
from arm_brachy.robot.scissor_urdf import link_frames, scissor_urdf
from arm_brachy.robot.surface_mesh import MeshSurface
from arm_brachy.robot.template import ImageGeometry, Template
from arm_brachy.robot.urdf import BASE as ARM_BASE
from arm_brachy.robot.urdf import panda_urdf
from arm_brachy.tissue.build import build_body, build_pad, load_scene_mesh, placement_mesh
from arm_brachy.tissue.contact_poses import ridden
from arm_brachy.tissue.instruments import Instruments, Tools
from arm_brachy.tissue.mesh import (
    boundary_faces,
    embed,
    interpolate,
    rotations,
    surface_triangles,
)
from arm_brachy.tissue.needle_beam import NeedleBeam
from arm_brachy.tissue.newton import NewtonOptions
from arm_brachy.tissue.probe_face import ProbeFace
from arm_brachy.tissue.probe_reading import ProbeReading
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.viewing import drawing
from arm_brachy.viewing.description import arm_links, description


@dataclass(frozen=True)
class Reading:
    """Everything a sensor of the cell could look at, at one time. World frame, SI.

    points : (k, 3) markers then targets, in the order of `Body.point_names`
    rotations : (k, 3, 3) local rotation from rest
    pad_displacement, pad_force, pad_moment : (p, 3); wrench of the tissue on the pad
    x : (n, 3) nodes, None where the reading came over the wire
    probe : ProbeReading, None in a cell without probe
    needle_force : [N] of the tissue along the needle, positive against insertion
    shaft : (k, 3) [m] of the needle as the tissue bends it, template to tip; None = outside
    """

    t: float
    names: tuple
    points: np.ndarray
    rotations: np.ndarray
    pad_displacement: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    x: np.ndarray | None = None
    outcome: Outcome = Outcome.OK
    iterations: int = 0
    probe: ProbeReading | None = None
    needle_force: float = 0.0
    shaft: np.ndarray | None = None


# What a cell's body leaves open at every tick, at most: 10 nm, four decades below what a tracker
# sees. A hundredth of it, as solvers have by default, costs half as much again.
STATICS = NewtonOptions(tolerance=1e-8)
_AT_ONCE = 4    # steps that look for an equilibrium one after another
STUCK = 2.0     # s without an equilibrium after which a body is no plant any more


class _Lost:
    """An equilibrium that was looked for in vain `tries` times."""

    def __init__(self, state, good, pads, tries):
        """state : TissueState;  good, pads : (p, 3) [m] at the last equilibrium, and now"""
        self.state, self.tries = state, tries
        self._good, self._off = good, np.abs(pads - good).max(initial=0.0)
        self._left = 2 ** max(tries - _AT_ONCE, 0) - 1

    def waits(self, pads):
        """True while it is not worth looking for again; pads : (p, 3) [m] as they are now."""
        self._left -= 1
        return self._left >= 0 and np.abs(pads - self._good).max(initial=0.0) >= self._off


class Body:
    """A soft body with its markers and targets: pad positions in, Reading out."""

    def __init__(self, scene, terms, release=None, instruments=None):
        """release : [s] when a body held in its stress-free shape is let go; None = never held.

        instruments : tissue.instruments.Instruments of a cell with probe or needle, None = none
        """
        self._release, self._started = release, False
        self._good = -np.inf     # s, of the last equilibrium
        self._lost = None        # a _Lost since then
        self._body = build_body(scene)
        self.mesh = self._body.mesh
        self.surface = boundary_faces(self.mesh)
        options = STATICS if scene.dynamics == 'quasi_static' else None
        self._simulator = TissueSimulator(self._body, terms, dynamics=scene.dynamics,
                                          options=options, instruments=instruments)
        self.pad_names = self._body.pad_names
        true_pads = self._simulator.body.pads
        self._directions = np.array([p.direction for p in true_pads]).reshape(-1, 3)
        self._pads = np.zeros_like(self._directions)    # m, at the last equilibrium
        markers, targets = scene.markers, scene.targets
        self.point_names = tuple(m.name for m in (*markers, *targets))
        self._rest = np.array([m.position for m in (*markers, *targets)]).reshape(-1, 3)
        self._carrier = [m.body for m in markers] + ['tissue'] * len(targets)
        for pad, true in zip(self._body.pads, true_pads, strict=True):
            # where a term has moved a pad at rest, it has moved what is fixed to it
            riders = [c == pad.name for c in self._carrier]
            self._rest[riders] = ridden(self._rest[riders], *(
                (one.centre, one.direction) for one in (pad, true)))
        self._in_tissue = np.array([c == 'tissue' for c in self._carrier], dtype=bool)
        names = [n for n, inside in zip(self.point_names, self._in_tissue, strict=True) if inside]
        self._embedding = embed(placement_mesh(self.mesh, self._simulator.body),
                                self._rest[self._in_tissue], names=names)
        self._check_carriers(scene)

    def _check_carriers(self, scene):
        allowed = ('tissue', 'base', *self.pad_names)
        for name, carrier in zip(self.point_names, self._carrier, strict=True):
            if carrier not in allowed:
                raise ConfigError(f'scene {scene.name}: marker {name} is on {carrier!r}; must be '
                                  f'one of {", ".join(allowed)}')

    def step(self, t, q, probe=None, needle=None):
        """Advance to t [s] with pads at q (p,) [m] along their directions; returns Reading.

        probe : (R (3, 3), p (3,) [m]) of its frame in W, None = away;  needle : NeedleInTissue of
        tissue.needle_path, None = outside. A body without instruments takes no notice of either.
        The first call is the start: the body is found at rest in equilibrium with q, or, where a
        release is set, as it was held until then; instruments act from the second call on.
        Without an equilibrium the body stands still and the outcome says so. Raises NotConverged
        where it has stood for STUCK: what sensors would see then is no tissue's motion.
        """
        displacement = self._directions * np.asarray(q, dtype=float)[:, None]
        if self._release is not None and t <= self._release:
            state = self._simulator.reset(t)
        elif not self._started:
            self._simulator.reset(t)
            state, self._pads = self._simulator.settle(displacement), displacement
        else:
            state = self._advance(t, displacement, Tools(probe, needle))
        self._refuse_stuck(t, state.outcome, q, probe)
        self._started = True
        return self._reading(state, displacement)

    def _advance(self, t, displacement, tools):
        """The TissueState at t. An equilibrium that is not there takes many times as long to look
        for as one that is: after four steps without, it is looked for ever less often, and at
        once when the pads come back.
        """
        if self._lost is not None and self._lost.waits(displacement):
            return replace(self._lost.state, t=t, iterations=0)
        state = self._simulator.step(t, displacement, tools)
        if state.outcome.ok:
            self._lost, self._pads = None, displacement
        else:
            tries = 0 if self._lost is None else self._lost.tries
            self._lost = _Lost(state, self._pads, displacement, tries + 1)
        return state

    def _refuse_stuck(self, t, outcome, q, probe):
        if outcome.ok or not self._started:
            self._good = t
        elif t - self._good > STUCK:
            under = '' if probe is None else ' and a probe at {:.0f}, {:.0f}, {:.0f} mm'.format(
                *(1e3 * np.asarray(probe[1])))
            raise NotConverged(
                f'the body has had no equilibrium since {self._good:.2f} s ({outcome.name}), with '
                f'pads at {", ".join(f"{1e3 * x:.1f}" for x in q)} mm{under}; must be loads that '
                'it can bear: push less, or press less and away from rims. What was recorded '
                'until then holds')

    def _reading(self, state, displacement):
        points, turns = self._rest.copy(), np.tile(np.eye(3), (len(self._rest), 1, 1))
        points[self._in_tissue] = interpolate(self._embedding, state.x)
        turns[self._in_tissue] = rotations(self._embedding, state.x)
        for carrier, shift in (*zip(self.pad_names, displacement, strict=True),
                               ('base', state.base)):
            points[[c == carrier for c in self._carrier]] += shift
        felt = state.instruments
        extra = () if felt is None else (felt.probe, felt.needle_force, felt.shaft)
        return Reading(state.t, self.point_names, points, turns, displacement, state.pad_force,
                       state.pad_moment, state.x, state.outcome, state.iterations, *extra)


class PointFeed:
    """Turns a sequence of Readings into the intervals that trackers are advanced over."""

    def __init__(self, names):
        """names : points the tracker looks at, in its order."""
        self._names, self._index, self._last = tuple(names), None, None

    def interval(self, reading):
        """Return (before, now), each (t, points, rotations, Reading); None at the first one."""
        if self._index is None:
            where = {name: i for i, name in enumerate(reading.names)}
            self._index = np.array([where[n] for n in self._names], dtype=int)
        before, self._last = self._last, reading
        if before is None or reading.t <= before.t:
            return None
        return self._view(before), self._view(reading)

    def _view(self, reading):
        return (reading.t, reading.points[self._index], reading.rotations[self._index], reading)


def em_samples(tracker, feed, reading):
    """Samples an EmTracker delivers up to a Reading."""
    span = feed.interval(reading)
    if span is None:
        return []
    (t0, p0, r0, a), (t1, p1, r1, b) = span
    return tracker.advance(t0, p0, r0, t1, p1, r1, a.pad_displacement, b.pad_displacement)


def optical_samples(tracker, feed, reading):
    """Frames an OpticalTracker delivers up to a Reading."""
    span = feed.interval(reading)
    if span is None:
        return []
    (t0, p0, _, a), (t1, p1, _, b) = span
    return tracker.advance(t0, p0, t1, p1, a.pad_displacement, b.pad_displacement)


def force_samples(sensor, feed, reading):
    """Samples a ForceSensor delivers up to a Reading."""
    span = feed.interval(reading)
    if span is None:
        return []
    (t0, _, _, a), (t1, _, _, b) = span
    return sensor.advance(t0, a.pad_force, a.pad_moment, t1, b.pad_force, b.pad_moment,
                          a.pad_displacement, b.pad_displacement)


def build_tissue(cell, side):
    """The body as 'plant' or as 'model', with that overlay's terms."""
    if side == 'plant':
        return Body(cell.plant, registry.split(cell.plant_terms)[Stage.BODY],
                    cell.scenario.release, _instruments(cell))
    return Body(cell.model, registry.split(cell.model_terms)[Stage.BODY], cell.scenario.release)


def _instruments(cell):
    """Probe and needle of a procedure, None in any other cell."""
    if cell.scenario.procedure is None:
        return None
    needle = cell.scenario.needle.needle
    return Instruments(ProbeFace(), NeedleForce(needle), NeedleBeam(needle.rigidity,
                                                                    needle.beside))


def build_actuators(cell, params):
    """The driver that the scenario names; the simulated bank also gets the plant's terms."""
    names = tuple(p.name for p in cell.scene.pads)
    strokes = np.array([p.stroke for p in cell.scene.pads])
    driver = load_driver(cell.scenario.actuator_driver)
    if issubclass(driver, SimulatedBank):
        return driver(names, strokes, params, terms=_terms(cell, Stage.SETPOINT,
                                                           Stage.TRANSMISSION, Stage.ENCODER),
                      rng=stream(cell.scenario.seed, 'actuators'))
    return driver(names, strokes, params)


def build_em_tracker(cell, params):
    """The EM tracker with the plant's EM terms."""
    return EmTracker(params, cell.em_tools, _terms(cell, Stage.EM),
                     stream(cell.scenario.seed, 'em_tracker'))


def build_optical_tracker(cell, params):
    """The optical tracker with the plant's optical terms."""
    return OpticalTracker(params, marker_names(cell), _terms(cell, Stage.OPTICAL),
                          stream(cell.scenario.seed, 'optical_tracker'))


def build_force_sensor(cell, params):
    """The force sensors with the plant's force terms."""
    return ForceSensor(params, tuple(p.name for p in cell.scene.pads), _terms(cell, Stage.FORCE),
                       stream(cell.scenario.seed, 'force_sensor'))


# Imported when one is built: a network would cost every process a second and 200 MB.
ESTIMATORS = {
    'kf_admm': 'arm_brachy.estimation.kf_admm',
    'graph_vae': 'arm_brachy.estimation.graph_vae.estimator',
    'map': 'arm_brachy.estimation.map',
    'pod': 'arm_brachy.estimation.pod',
}


def build_estimator(cell, name):
    """A LiveEstimator on the model side of the cell: markers and encoders in, all targets out.

    name : key of ESTIMATORS. Raises ConfigError for a scene without targets or markers on tissue.
    """
    scene, terms = cell.model, registry.split(cell.model_terms)[Stage.BODY]
    targets = tuple(t.name for t in scene.targets)
    motion = MarkerMotion(scene, terms)
    markers = tuple(n for n, there in zip(motion.names, motion.on_tissue, strict=True) if there)
    params = cell.scenario.estimation
    if not targets or len(markers) < params.fewest:
        raise ConfigError(f'{cell.path}: scene {scene.name} has {len(targets)} targets and '
                          f'{len(markers)} markers on tissue; {name}_estimator needs a target and '
                          f'{params.fewest:g} markers')
    estimator = importlib.import_module(ESTIMATORS[name]).build(
        scene, terms, targets, markers, getattr(cell.scenario, name))
    optical = cell.scenario.optical
    tracker = optical.noise / np.sqrt(3.0), optical.calibration_error / np.sqrt(3.0)
    mesh = getattr(estimator, 'mesh', None)   # most estimate on the model's own
    return LiveEstimator(estimator, motion, params, tracker,
                         load_scene_mesh(scene) if mesh is None else mesh)


def heard_targets(cell):
    """Targets that the manipulator hears of: with an EM sensor, or those of an estimator."""
    if cell.scenario.feedback == 'em':
        return cell.em_tools
    return tuple(t.name for t in cell.scene.targets)


def build_controller(cell):
    """The manipulator on the model side of the cell."""
    pads, params = cell.scene.pads, cell.scenario.control
    if cell.scenario.feedback != 'em':      # estimators judge their markers themselves
        params = replace(params, gate=replace(params.gate, floor=np.inf))
    model = TissueModel(cell.model, registry.split(cell.model_terms)[Stage.BODY])
    strokes = np.array([p.stroke for p in pads])
    manipulator = Manipulator(params, model, strokes, cell.scenario.actuators.max_speed,
                              [p.name for p in pads])
    return Pursuit(manipulator, model, heard_targets(cell), strokes, [p.name for p in pads])


def build_protocol(cell):
    """The scenario's moves. Raises ConfigError if it has none."""
    if not cell.scenario.moves:
        raise ConfigError(f'{cell.path}: moves is empty; must list a move at least, for '
                          'push_protocol to make')
    return PushProtocol(cell.scenario.moves, [p.name for p in cell.scene.pads],
                        cell.scenario.settle)


def build_sequencer(cell):
    """The scenario's tasks; without any, the rest alone, after the release where there is one."""
    scenario = cell.scenario
    held = 0.0 if scenario.tasks or scenario.release is None else scenario.release
    return Sequencer(scenario.tasks, scenario.settle + held)


def build_template(cell):
    """The guide template in its place."""
    return Template.placed(cell.scenario.template)


def build_needle(cell):
    """The needle in its template, at depth zero."""
    template = build_template(cell)
    return NeedleDriver(cell.scenario.needle, template.holes, template.axis, template.R[:, 0],
                        stream(cell.scenario.seed, 'needle'))


def build_imager(cell):
    """The ultrasound probe that looks into the plant, with the template's holes drawn over it."""
    params, mesh = cell.scenario.ultrasound, load_scene_mesh(cell.plant)
    lumps = [(t.centre, t.radius, t.ratio) for t in cell.plant_terms if isinstance(t, Inclusion)]
    image, procedure = params.image, cell.scenario.procedure
    drawn = procedure is None or procedure.overlay
    target = next((t.position for t in cell.plant.targets
                   if procedure is not None and t.name == procedure.target), None)
    return Imager(params, mesh.nodes, mesh.connectivity, lumps,
                  stream(cell.scenario.seed, 'ultrasound_imager'),
                  build_template(cell) if drawn else None,
                  ImageGeometry(image.width, image.height, tuple(1.0 / image.pixel)), target)


def build_surface_scanner(cell):
    """The scanner over the plant; its pads and the template stand in its way."""
    params, mesh = cell.scenario.scanner, load_scene_mesh(cell.plant)
    pads = [PadShadow(np.array(patch.centre), np.array(direction), patch.radius,
                      build_pad(mesh, patch).nodes)
            for patch, direction in zip(cell.plant.pads, pad_directions(cell.plant), strict=True)]
    template = build_template(cell)
    size = np.array([template.params.columns - 1, template.params.rows - 1])
    plate = Plate(template.R, template.p, 0.5 * size * template.params.pitch + params.margin)
    return SurfaceScanner(params, mesh.nodes, surface_triangles(mesh), pads, plate,
                          stream(cell.scenario.seed, 'surface_scanner'))


def build_probe_arm(cell):
    """The arm that holds the probe, at rest at home, its sensor weighed.

    Its strategies see the skin from the middle of the model's mesh.
    """
    # Imported when one is built: PyBullet would cost every process half a second.
    arm = importlib.import_module('arm_brachy.robot.probe_arm')
    params = cell.scenario.probe
    if params.surface == 'model' and cell.scenario.feedback == 'em':
        raise ConfigError(f"{cell.path}: probe: surface = 'model' with feedback = 'em'; must be "
                          "scan, or feedback an estimator, whose mesh is the model's")
    return arm.ProbeArm(params, stream(cell.scenario.seed, 'probe_arm'),
                        inside=load_scene_mesh(cell.model).nodes.mean(axis=0),
                        image_depth=cell.scenario.ultrasound.image.depth)


def arm_line(cell, q):
    """Return (k, 3) [m] of what holds the probe in W, from joint to joint.

    q : of the joints. The Panda from its base on; of the linkage both branches
    """
    params = cell.scenario.probe
    if params.probe_holder == 'scissor_rcm':
        return linkage_line(params.scissor_rcm, q)
    R_WB, p_WB = arm_base(cell)
    joints = np.vstack([np.zeros(3), frames(Arm.panda().dh, np.asarray(q, dtype=float))[1]])
    return p_WB + joints @ R_WB.T


def arm_base(cell):
    """Return R_WB (3, 3), p_WB (3,) [m] of the base of the arm that holds the probe."""
    params = cell.scenario.probe
    if params.probe_holder == 'scissor_rcm':
        return base_axes(params.scissor_rcm.axis), np.array(params.scissor_rcm.centre)
    return rotation(np.array([0.0, 0.0, params.base_turn])), np.array(params.base)


def arm_base_name(cell):
    """Name of the frame of that base."""
    return SCISSOR_BASE if cell.scenario.probe.probe_holder == 'scissor_rcm' else ARM_BASE


def arm_frames(cell, q):
    """Return (parent, child, R (3, 3), p (3,) [m]) of every moving link of the arm at joints q."""
    params = cell.scenario.probe
    if params.probe_holder == 'scissor_rcm':
        return list(link_frames(params.scissor_rcm.linkage, q))
    return list(arm_links(DH, q))


def _arm_urdf(cell):
    own = cell.scenario.probe.scissor_rcm
    if cell.scenario.probe.probe_holder == 'scissor_rcm':
        return scissor_urdf(own, base_axes(own.axis).T @ [0.0, 0.0, -1.0])
    return panda_urdf(Arm.panda(), JOINT_NAMES)


def build_stage(cell, look):
    """What never changes in a drawing of the cell, from the scene as the laboratory has it.

    look : viewing.params.ViewerParams
    """
    image = cell.scenario.ultrasound.image
    pads = tuple(drawing.Pad(pad.name, np.array(pad.centre), direction, pad.radius)
                 for pad, direction in zip(cell.scene.pads, pad_directions(cell.scene),
                                           strict=True))
    scales = {'full_colour': look.full_colour, 'arrow': look.arrow}
    if cell.scenario.procedure is None:
        return drawing.Stage(pads, **scales)
    return drawing.Stage(pads, build_template(cell).holes.reshape(-1, 3),
                         (image.aperture, image.depth), **scales)


def build_description(cell, frame):
    """URDF (text) of the cell's actuators and, in a procedure, of its arm; frame : of the base."""
    arm = None if cell.scenario.procedure is None else (
        *arm_base(cell), arm_base_name(cell), _arm_urdf(cell))
    return description(frame, build_stage(cell, cell.scenario.viewer).pads,
                       [pad.stroke for pad in cell.scene.pads],
                       cell.scenario.actuators.max_speed, arm)


def build_procedure(cell):
    """The scenario's procedure, with the arc that needles of this kind nominally take."""
    template, params = build_template(cell), cell.scenario.needle
    side = template.R[:, 0]
    curvature = 1.0 / params.needle.radius if params.told == 'arc' else 0.0
    needle = NeedleCourse(template.axis, side, params.needle.length,
                          nominal_offset(params, template.axis, side), curvature,
                         params.needle.skin)
    return Procedure(cell.scenario.procedure, template.holes, needle, cell.scenario.settle,
                     foretold_press(cell, template.axis))


def foretold_press(cell, along):
    """Return (3,) [m] by which the probe will move the procedure's target, as the model has it.

    along : (3,) of the needle. The probe stands where its strategy puts it once the tip is at the
    target. Zero where the scenario does not want to know, or where the probe cannot stand by the
    model's skin: then its approach will say why.
    Raises NotConverged where the model has no equilibrium under the probe.
    """
    asked, params = cell.scenario.procedure, cell.scenario.probe
    if not asked.foresee:
        return np.zeros(3)
    terms, mesh = registry.split(cell.model_terms)[Stage.BODY], load_scene_mesh(cell.model)
    target = next(np.array(t.position) for t in cell.model.targets if t.name == asked.target)
    skin = MeshSurface(mesh.nodes, surface_triangles(mesh))
    kind = PLANNERS[params.strategy]
    if params.probe_holder == 'scissor_rcm':
        kind = partial(CentrePlanner, np.array(params.scissor_rcm.centre))
    try:
        planner = kind(params, skin, target - asked.view * along, along,
                       np.array([0.0, 0.0, -1.0]))
        goal = planner.over(target, along)
    except InputError:
        return np.zeros(3)
    return pressed(cell.model, terms, asked.target, goal.R, goal.p, force=params.force,
                   face=ProbeFace(), deepest=params.deepest)


def _terms(cell, *stages):
    by_stage = registry.split(cell.plant_terms)
    return tuple(t for s in stages for t in by_stage[s])


def marker_names(cell):
    """Names of the optical markers of the scene."""
    return tuple(m.name for m in cell.scene.markers)


def pad_directions(scene):
    """(p, 3) unit push directions."""
    d = np.array([p.direction for p in scene.pads], dtype=float).reshape(-1, 3)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def push_back(pad_force, directions):
    """Force (p,) [N] with which the tissue pushes back on each pad along its axis.

    pad_force : 3 p values [N], tissue on pad;  directions : (p, 3) into the tissue
    """
    return -np.einsum('pi,pi->p', np.reshape(pad_force, (-1, 3)), directions)


def in_driver_order(names, values, order):
    """Values (p,) in the driver's order; `names` empty means they are already.

    For what the driver is told and for what it says. Raises CommandRefused for an unknown or
    missing actuator.
    """
    if not names:
        return np.array(values, dtype=float)
    if sorted(names) != sorted(order) or len(values) != len(names):
        raise CommandRefused(f'{", ".join(names)} with {len(values)} positions; must '
                             f'name each of {", ".join(order)} once, with one position each')
    given = dict(zip(names, values, strict=True))
    return np.array([given[n] for n in order], dtype=float)
