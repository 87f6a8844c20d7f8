"""A scenario: one experiment as a file, resolved against its scene. Only departures are written.

The plant (what plays the patient) and the model (what controllers believe) are two overlays on
one scene. A seed is always given.
"""

import copy
import re
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Literal

from ruamel.yaml import YAML

from arm_brachy import registry
from arm_brachy.control.manipulator import ManipulatorParams
from arm_brachy.control.moves import Move, check_moves
from arm_brachy.control.procedure_params import ProcedureParams
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.place import Place, names_of, refuse_twice
from arm_brachy.core.quantity import quantity
from arm_brachy.core.scene import TISSUE, MeshFile, Scene, load_scene
from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.needle_driver import NeedleDriverParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.devices.surface_scanner import ScannerParams
from arm_brachy.devices.ultrasound_imager import ImagerParams
from arm_brachy.estimation.graph_vae.params import GraphVaeParams
from arm_brachy.estimation.kf_admm import KfAdmmParams
from arm_brachy.estimation.live import EstimationParams
from arm_brachy.estimation.map import MapParams, own_mesh
from arm_brachy.estimation.pod_params import PodParams
from arm_brachy.robot.probe_arm_params import PERIOD, ProbeArmParams
from arm_brachy.robot.template import TemplateParams
from arm_brachy.viewing.params import ViewerParams

ROS_NAME = re.compile('[A-Za-z][A-Za-z0-9_]*')  # a token of a topic name
PADS_BY_NUMBER = ('actuators', 'pad', 'carrier')  # parameters of terms that also take names
TICK_ROUNDING_NS = 1e-3  # what conversion from ms leaves at most


@dataclass(frozen=True)
class Overlay:
    """Departures from the scene: mesh, pads, material, damping, terms (`- {name: ..., ...}`)."""

    mesh: MeshFile | None = None
    element: Literal['quadratic', 'linear'] | None = None
    contact: Literal['bonded', 'touching'] | None = None   # of all pads, instead of the scene's
    E: float = quantity(..., 'kPa', "Young's modulus instead of the scene's", low=0.01, high=1e6)
    nu: float = quantity(..., '', "Poisson's ratio instead of the scene's", low=0.0, high=0.4999)
    rayleigh_alpha: float = quantity(..., 'per_s', "mass-proportional damping instead of the "
                                     "scene's (implicit only)", low=0.0)
    rayleigh_beta: float = quantity(..., 'ms', "stiffness-proportional damping instead of the "
                                    "scene's (implicit only)", low=0.0)
    terms: tuple[dict, ...] = ()


@dataclass(frozen=True)
class Task:
    """One goal of the operator: bring a target somewhere, then let the pads go home."""

    name: str
    target: str
    axes: tuple[Literal['x', 'y', 'z'], ...]
    displacement: tuple = quantity(None, 'mm', 'from where the target is when asked', shape=(3,))
    duration: float = quantity(20.0, 's', 'how long the goal is pursued and held', low=0.1,
                               high=3600.0)


@dataclass(frozen=True)
class Limits:
    """What the supervisor tolerates."""

    pad_force: float = quantity(30.0, 'N', 'largest force on one pad', low=0.1, high=1e3,
                                source='own choice: above what a 6 kPa phantom returns at full '
                                       'stroke, far below what bruises')
    probe_force: float = quantity(10.0, 'N', 'largest force on the probe', low=0.1, high=1e3,
                                  source='own choice: three times the goal of the contact force')
    needle_force: float = quantity(8.0, 'N', 'largest force along the needle', low=0.1, high=1e3,
                                   source='own choice: above the limit of its drive, which stops '
                                          'first')
    needle_age: float = quantity(0.5, 's', 'age of what is known of the needle, from which on all '
                                 'hold', low=0.05, high=60.0,
                                 source='control.stale_after')
    silence: float = quantity(0.7, 's', 'longest silence of a node, the supervisor too '
                                        '(wall pace)', low=0.05, high=60.0,
                              source='with two ticks and the braking of a needle that withdraws '
                                     'all rests within 1 s (PX4: COM_RC_LOSS_T, COM_OF_LOSS_T)')


@dataclass(frozen=True)
class Scenario:
    """One experiment. Keys in the file are these names; `<name>_<unit>` where there is a unit.

    tasks : goals that the controller pursues;  moves : or what the pads do without feedback
    procedure : or needle and probe under the guide `template`; without it the cell has neither
    feedback : where the controller hears the target from: the EM sensor in the tissue, or an
        estimator that sees markers and encoders only, and then there is no EM tracker
    estimators : that run beside, heard by recorder and evaluation alone
    """

    name: str
    seed: int
    scene: str
    description: str = ''
    pace: Literal['lockstep', 'wall'] = 'lockstep'
    tick: float = quantity(50.0, 'ms', 'period of the cell clock', low=1.0, high=250.0,
                           source='half the control period; sensors sample between ticks at their '
                                  'own rates, along the straight line from tick to tick')
    settle: float = quantity(2.0, 's', 'rest before the first task or move and after each homing; '
                             'without task or move all that is recorded, after the release',
                             low=0.0, high=600.0)
    mesh_rate: float = quantity(5.0, 'Hz', 'how often the mesh is published', low=0.01, high=100.0)
    release: float = quantity(..., 's', 'when a body held in its stress-free shape is let go',
                              low=0.0)
    plant: Overlay = field(default_factory=Overlay)
    model: Overlay = field(default_factory=Overlay)
    actuator_driver: str = 'simulated'
    actuators: ActuatorParams = field(default_factory=ActuatorParams)
    em: EmTrackerParams = field(default_factory=EmTrackerParams)
    em_tools: tuple[str, ...] = ()
    optical: OpticalParams = field(default_factory=OpticalParams)
    force: ForceSensorParams = field(default_factory=ForceSensorParams)
    control: ManipulatorParams = field(default_factory=ManipulatorParams)
    feedback: Literal['em', 'kf_admm', 'graph_vae', 'map', 'pod'] = 'em'
    estimators: tuple[Literal['kf_admm', 'graph_vae', 'map', 'pod'], ...] = ()
    estimation: EstimationParams = field(default_factory=EstimationParams)
    map: MapParams = field(default_factory=MapParams)
    pod: PodParams = field(default_factory=PodParams)
    graph_vae: GraphVaeParams = field(default_factory=GraphVaeParams)
    kf_admm: KfAdmmParams = field(default_factory=KfAdmmParams)
    limits: Limits = field(default_factory=Limits)
    tasks: tuple[Task, ...] = ()
    moves: tuple[Move, ...] = ()
    template: TemplateParams = field(default_factory=TemplateParams)
    needle: NeedleDriverParams = field(default_factory=NeedleDriverParams)
    ultrasound: ImagerParams = field(default_factory=ImagerParams)
    scanner: ScannerParams = field(default_factory=ScannerParams)
    probe: ProbeArmParams = field(default_factory=ProbeArmParams)
    procedure: ProcedureParams | None = None
    viewer: ViewerParams = field(default_factory=ViewerParams)


@dataclass(frozen=True)
class Cell:
    """A scenario with everything it names looked up: nothing is read from disk after this.

    scene : as the laboratory describes it;  plant, model : the two overlays applied
    plant_terms, model_terms : term instances, in registry order
    """

    scenario: Scenario
    scene: Scene
    plant: Scene
    model: Scene
    plant_terms: tuple
    model_terms: tuple
    path: Path

    @property
    def em_tools(self):
        """Targets that carry an EM sensor: those listed, else those of the tasks, else all."""
        listed = self.scenario.em_tools or tuple(dict.fromkeys(
            t.target for t in self.scenario.tasks))
        return listed or tuple(t.name for t in self.scene.targets)

    @property
    def tick_ns(self):
        """Period of the cell clock [ns]."""
        return round(self.scenario.tick * 1e9)


def load_cell(path):
    """Read a scenario file and everything it names; paths are relative to the scenario file.

    Raises ConfigError before anything runs, with the line of the file where there is one.
    """
    path = Path(path).resolve()
    source = config.read_yaml(path)
    if 'scene' not in source and {'mesh', 'fixed'} <= set(source):
        raise ConfigError(f'{path}: is a scene; must be a scenario, which names it: name, seed, '
                          f'scene: {path.name}, and tasks or moves; see arm-brachy keys scenario')
    return resolve(config.from_mapping(Scenario, source, str(path)), path, source)


def resolve(scenario, path, source=None):
    """Look up what a Scenario names.

    path : its file (for messages and relative paths)
    source : the mapping it was read from, which knows the lines; None if it was made in Python
    Returns Cell. Raises ConfigError, also for what a schema cannot see: names given twice, a pad
    without direction, a stroke longer than the actuator's, a tick that is no whole nanosecond, or
    with a probe no whole period of its arm's loop, a force limit that the sensor cannot measure,
    tasks and moves at once, moves that the bank cannot make.
    """
    scene_path = (path.parent / scenario.scene).resolve()
    scene = load_scene(scene_path)
    _check_scene(scene, Place(scene_path))
    _check_scenario(scenario, scene, Place(path))
    cell = Cell(scenario, scene, _overlaid(scene, scenario.plant, path),
                _overlaid(scene, scenario.model, path),
                *(_terms(scenario, scene, source, path, side) for side in ('plant', 'model')),
                path)
    for side in ('scene', 'plant', 'model'):
        mesh = Path(getattr(cell, side).mesh.file)
        if not mesh.is_file():
            raise ConfigError(f'{mesh}: no such mesh file; named by the {side} of {path}')
    if scenario.map.mesh:
        own_mesh(cell.model, scenario.map)
    return cell


def _terms(scenario, scene, source, path, side):
    """Terms of one overlay, from the mapping as read where there is one: it knows the lines."""
    entries = getattr(scenario, side).terms
    if source is not None and entries:
        entries = source[side]['terms']
    where = f'{path}: {side}.terms'
    pads = [pad.name for pad in scene.pads]
    return registry.parse_terms([_by_number(entry, pads, f'{where}[{i}]')
                                 for i, entry in enumerate(entries)], where)


def _by_number(entry, pads, where):
    """The entry with numbers for names of pads, where its term wants numbers."""
    out = copy.copy(entry)
    for key in PADS_BY_NUMBER:
        if isinstance(entry, dict) and key in entry:
            given, many = entry[key], isinstance(entry[key], (list, tuple))
            numbers = [_pad_number(one, pads, f'{where} {entry.get("name", "")}: {key}')
                       for one in (given if many else [given])]
            out[key] = numbers if many else numbers[0]
    return out


def _pad_number(given, pads, where):
    if not isinstance(given, str):
        return given
    if given not in pads:
        raise ConfigError(f'{where} = {given!r}; must be among '
                          f'{", ".join(pads) or "the pads, of which the scene has none"}, or '
                          'their numbers, the first of the scene 0')
    return pads.index(given)


def _overlaid(scene, overlay, path):
    material = scene.material
    if overlay.E is not None:
        material = replace(material, E=overlay.E)
    if overlay.nu is not None:
        material = replace(material, nu=overlay.nu)
    mesh = scene.mesh
    if overlay.mesh is not None:
        mesh = MeshFile(str((path.parent / overlay.mesh.file).resolve()), overlay.mesh.unit)
    element = scene.element if overlay.element is None else overlay.element
    pads = scene.pads if overlay.contact is None else tuple(
        replace(pad, contact=overlay.contact) for pad in scene.pads)
    damping = {name: getattr(overlay, name) for name in ('rayleigh_alpha', 'rayleigh_beta')
               if getattr(overlay, name) is not None}
    return replace(scene, material=material, mesh=mesh, element=element, pads=pads, **damping)


def _check_scene(scene, place):
    for keys, name in {**names_of(scene, 'pads'), **names_of(scene, 'targets')}.items():
        if not ROS_NAME.fullmatch(name):
            raise ConfigError(f'{place(*keys)} = {name!r}; must be letters, digits and _, a '
                              'letter first: it becomes part of a topic')


def _check_scenario(scenario, scene, place):
    tools = {('em_tools', i): tool for i, tool in enumerate(scenario.em_tools)}
    refuse_twice(place, tools)
    refuse_twice(place, names_of(scenario, 'tasks'))
    refuse_twice(place, names_of(scenario, 'moves'))
    known = [t.name for t in scene.targets]
    goals = {('tasks', i, 'target'): t.target for i, t in enumerate(scenario.tasks)}
    if scenario.procedure is not None:
        goals['procedure', 'target'] = scenario.procedure.target
    for keys, name in {**goals, **tools}.items():
        if name not in known:
            raise ConfigError(f'{place(*keys)} = {name!r}; must be a target of scene '
                              f'{scene.name}: {", ".join(known) or "it has none"}')
    for i, task in enumerate(scenario.tasks):
        if not task.axes or len(set(task.axes)) < len(task.axes):
            raise ConfigError(f"{place('tasks', i, 'axes')} = {list(task.axes)}; must be one to "
                              'three of x, y, z, each once')
    if scenario.seed < 0:
        raise ConfigError(f"{place('seed')} = {scenario.seed}; must be at least 0")
    if abs(scenario.tick * 1e9 - round(scenario.tick * 1e9)) > TICK_ROUNDING_NS:
        raise ConfigError(f"{place('tick_ms')} = {scenario.tick * 1e3:.12g}; must be a whole "
                          'number of nanoseconds')
    _check_strokes(scenario.actuators.stroke, scene, place)
    _check_estimators(scenario, scene, place)
    if scenario.tasks and scenario.moves:
        raise ConfigError(f"{place('moves')} = {len(scenario.moves)} beside tasks = "
                          f'{len(scenario.tasks)}; must be one or the other: tasks close the '
                          'loop, moves are prescribed')
    _check_procedure(scenario, scene, place)
    check_moves(scenario.moves, scene, scenario.actuators, scenario.tick, place)
    limit, most = scenario.limits.pad_force, scenario.force.range
    if limit >= most:
        raise ConfigError(f"{place('limits', 'pad_force_N')} = {limit:g}; must be below the "
                          f'{most:g} N of force.range_N: a saturated sensor reads no more, and '
                          'the supervisor would never stop')


def _check_procedure(scenario, scene, place):
    asked = scenario.procedure
    if asked is None:
        return
    for other in ('tasks', 'moves'):
        if getattr(scenario, other):
            raise ConfigError(f"{place('procedure')} beside {other} = "
                              f'{len(getattr(scenario, other))}; must be one of them: a procedure '
                              'sets its own goals')
    if scenario.feedback == 'em':
        raise ConfigError(f"{place('procedure')} with feedback = 'em'; must be an estimator: "
                          'kf_admm, graph_vae, map or pod: where a needle goes there is no sensor')
    if not scene.pads:
        raise ConfigError(f"{place('procedure')}: scene {scene.name} has no pads; needs one at "
                          'least, to move the target')
    if not asked.axes or len(set(asked.axes)) < len(asked.axes):
        raise ConfigError(f"{place('procedure', 'axes')} = {list(asked.axes)}; must be one to "
                          'three of x, y, z, each once')
    _check_probe(scenario, place)
    _check_needle(scenario, place)
    size = scenario.template.columns, scenario.template.rows
    for key, most in zip(('column', 'row'), size, strict=True):
        if getattr(scenario.needle, key) >= most:
            raise ConfigError(f"{place('needle', key)} = {getattr(scenario.needle, key)}; must be "
                              f'0 to {most - 1}, a hole of the template')
    if len(asked.hole) > len(size) or not all(
            0 <= k < n for k, n in zip(asked.hole, size, strict=False)):
        raise ConfigError(f"{place('procedure', 'hole')} = {list(asked.hole)}; must be a column "
                          f'from 0 to {size[0] - 1} and a row from 0 to {size[1] - 1} of the '
                          'template, a column alone, or empty: the rest is chosen')


def _check_needle(scenario, place):
    """The needle can be as fast as it will be told to be, and is heard of often enough."""
    most = scenario.needle.max_speed
    for key in ('speed', 'near_speed', 'entry', 'withdrawal'):
        speed = getattr(scenario.procedure, key)
        if speed > most:
            raise ConfigError(f"{place('procedure', f'{key}_mm_s')} = {1e3 * speed:g}; must be at "
                              f'most {1e3 * most:g}, needle.max_speed_mm_s')
    rate, patience = scenario.ultrasound.image.rate, scenario.procedure.tip_patience
    if patience * rate < 1.0:
        raise ConfigError(f"{place('procedure', 'tip_patience_s')} = {patience:g}; must be at "
                          f'least {1.0 / rate:.3g}, the time from one image to the next '
                          '(ultrasound.image.rate_Hz): the needle would wait for ever')
    needle, limit = scenario.needle, scenario.limits.needle_age
    oldest = 1.0 / needle.depth_rate + needle.depth_latency + scenario.tick
    if oldest > limit:
        raise ConfigError(f"{place('limits', 'needle_age_s')} = {limit:g}; must be above "
                          f'{oldest:.3g}, the age that a depth comes to between two measurements '
                          '(needle.depth_rate_Hz, needle.depth_latency_ms): the supervisor would '
                          'hold for ever')


def _check_probe(scenario, place):
    """The arm's loop makes whole periods in a tick, and the supervisor lets it press."""
    if abs(scenario.tick - round(scenario.tick / PERIOD) * PERIOD) * 1e9 > TICK_ROUNDING_NS:
        raise ConfigError(f"{place('tick_ms')} = {scenario.tick * 1e3:.12g}; must be a "
                          f'multiple of {PERIOD * 1e3:g} ms, the period of the control loop of '
                          'the arm that holds the probe')
    force, most = scenario.probe.force, scenario.limits.probe_force
    if force >= most:
        raise ConfigError(f"{place('probe', 'force_N')} = {force:g}; must be below the {most:g} N "
                          'of limits.probe_force_N, at which the supervisor stops the cell')


def _check_estimators(scenario, scene, place):
    if scenario.feedback == 'em' and not scenario.estimators:
        return
    key, value = ('estimators', list(scenario.estimators)) if scenario.feedback == 'em' else (
        'feedback', scenario.feedback)
    seen, needed = sum(m.body == TISSUE for m in scene.markers), scenario.estimation.fewest
    if seen < needed or not scene.targets:
        raise ConfigError(f'{place(key)} = {value!r}; needs a target and {needed:g} markers on '
                          f'tissue in scene {scene.name}, which has {len(scene.targets)} and '
                          f'{seen}')


def _check_strokes(longest, scene, place):
    for pad in scene.pads:
        if pad.stroke > longest * (1 + 1e-9):  # a rounding of units is no difference
            raise ConfigError(f"{place('actuators', 'stroke_mm')} = {longest * 1e3:g}; must be at "
                              f'least the {pad.stroke * 1e3:g} mm of {pad.name} in scene '
                              f'{scene.name}')


def bundle(cell):
    """Everything the cell was started from as files that `load_cell` accepts again, elsewhere.

    Returns file name -> text or bytes: scenario.yaml (with every default written out), scene.yaml
    and the meshes of scene, plant and model.
    """
    files = {}
    scenario = cell.scenario
    sides = {}
    for side in ('plant', 'model'):
        overlay = getattr(scenario, side)
        if overlay.mesh is not None:
            mesh = getattr(cell, side).mesh
            sides[side] = replace(overlay, mesh=_bundled_mesh(files, side, mesh))
    scene = replace(cell.scene, mesh=_bundled_mesh(files, 'scene', cell.scene.mesh))
    if scenario.map.mesh:   # beside the model's, by its own name
        files[scenario.map.mesh] = own_mesh(cell.model, scenario.map).read_bytes()
    files['scenario.yaml'] = _yaml(replace(scenario, scene='scene.yaml', **sides))
    files['scene.yaml'] = _yaml(scene)
    return files


def _bundled_mesh(files, side, mesh):
    source = Path(mesh.file)
    name = f'mesh_{side}{source.suffix}'
    files[name] = source.read_bytes()
    return replace(mesh, file=name)


def _yaml(obj):
    stream = StringIO()
    YAML(typ='safe').dump(config.to_mapping(obj), stream)
    return stream.getvalue()


def unbundle(files, folder):
    """Write the files of a `bundle` into `folder` (made); returns the path of its scenario.

    Raises ConfigError if there is no scenario among them.
    """
    if 'scenario.yaml' not in files:
        raise ConfigError('holds no scenario, as a recorded cell does; give one: '
                          'arm-brachy replay BAG --scenario FILE')
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return folder / 'scenario.yaml'
