"""A scenario: one experiment as a file, resolved against its scene. Only departures are written.

The plant (what plays the patient) and the model (what controllers believe) are two overlays on
one scene. A seed is always given.
"""

from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Literal

from ruamel.yaml import YAML

from arm_brachy import registry
from arm_brachy.control.manipulator import ManipulatorParams
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.scene import MeshFile, Scene, load_scene
from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams


@dataclass(frozen=True)
class Overlay:
    """Departures from the scene: mesh, material, physics terms (`- {name: ..., ...}`)."""

    mesh: MeshFile | None = None
    E: float = quantity(..., 'kPa', "Young's modulus instead of the scene's", low=0.01, high=1e6)
    nu: float = quantity(..., '', "Poisson's ratio instead of the scene's", low=0.0, high=0.4999)
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
    silence: float = quantity(1.0, 's', 'longest silence of a node (wall pace)', low=0.05,
                              high=60.0, source='own choice: actuators under position control '
                                                'cannot run away within it')


@dataclass(frozen=True)
class Scenario:
    """One experiment. Keys in the file are these names; `<name>_<unit>` where there is a unit."""

    name: str
    seed: int
    scene: str
    description: str = ''
    pace: Literal['lockstep', 'wall'] = 'lockstep'
    tick: float = quantity(20.0, 'ms', 'period of the cell clock', low=1.0, high=1000.0,
                           source='half the EM period of 25 ms, rounded down')
    settle: float = quantity(2.0, 's', 'rest before the first task and after each homing',
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
    limits: Limits = field(default_factory=Limits)
    tasks: tuple[Task, ...] = ()


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
    """Read a scenario file and everything it names.

    Raises ConfigError or MeshError before anything runs; paths are relative to the scenario file.
    """
    path = Path(path).resolve()
    return resolve(config.load(Scenario, path), path)


def resolve(scenario, path):
    """Look up what a Scenario names; `path` is its file (for messages and relative paths)."""
    scene = load_scene((path.parent / scenario.scene).resolve())
    _check_names(scenario, scene, path)
    return Cell(scenario, scene, _overlaid(scene, scenario.plant, path),
                _overlaid(scene, scenario.model, path),
                registry.parse_terms(scenario.plant.terms, f'{path}: plant.terms'),
                registry.parse_terms(scenario.model.terms, f'{path}: model.terms'), path)


def _overlaid(scene, overlay, path):
    material = scene.material
    if overlay.E is not None:
        material = replace(material, E=overlay.E)
    if overlay.nu is not None:
        material = replace(material, nu=overlay.nu)
    mesh = scene.mesh
    if overlay.mesh is not None:
        mesh = MeshFile(str((path.parent / overlay.mesh.file).resolve()), overlay.mesh.unit)
    return replace(scene, material=material, mesh=mesh)


def _check_names(scenario, scene, path):
    targets = [t.name for t in scene.targets]
    wanted = [(f'tasks.{i}.target', t.target) for i, t in enumerate(scenario.tasks)]
    wanted += [(f'em_tools.{i}', tool) for i, tool in enumerate(scenario.em_tools)]
    for key, name in wanted:
        if name not in targets:
            raise ConfigError(f'{path}: {key} = {name!r}; must be a target of scene '
                              f'{scene.name}: {", ".join(targets) or "it has none"}')


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
        raise ConfigError(f'got {", ".join(files) or "no files"}; a recorded cell holds '
                          'scenario.yaml: give a scenario with --scenario')
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return folder / 'scenario.yaml'
