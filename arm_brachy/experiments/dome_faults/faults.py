"""What is put wrong: in the streams of a recording, or in the scene that is said to be shown.

The dome rig's recordings are another code's, and nothing is hidden in them. What wears, slips,
drifts or runs late in a cell is put into what was measured: encoders that count less than a pad
goes are a pad that goes further than its encoder says. What a scene says wrongly of the body, the
tissue lacks in the model.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.core.scene import Scene
from arm_brachy.evaluation.timeseries import EmSamples, RunData, Series

MM, MINUTE = 1e-3, 60.0
ONSET = 18.0            # s, in the first recording, between two pushes
GAIN, SHORT, SLIP = 0.06, 0.6, (0.6, -0.4, 0.3)             # 1, mm, mm
LATE, EARLY = 60.0, -50.0                                   # ms
SCALE, LOUDER, DRIFT = 0.008, 0.15, (0.2, 0.0, -0.15)       # 1, 1, N/min
MOVED = (2.0, -1.5, 1.0)                                    # mm
HIGHER, TURN, WEIGHT = 0.04, 15.0, 9.81                     # 1, degrees, m/s^2
SOFT = 5000.0           # Pa, of the altered scene; theirs is 8 kPa within 15 %
POISSON, THEIRS = 0.40, 0.48                                # of the altered scene, of theirs
# Their bulk modulus over that of the altered scene, when their shear moduli are the same.
BULK = (1 + THEIRS) / (1 - 2 * THEIRS) * (1 - 2 * POISSON) / (1 + POISSON)


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    name : of the case;  term : of the registry that it amounts to, None = nothing is missing
    truth, place : as `told` has them
    spoil : (RunData, number of the recording) -> RunData;  alter : Scene -> Scene
    stretched : (3,) by which the scene's mesh is off the body, per axis
    """

    name: str
    term: str | None = None
    truth: dict = field(default_factory=dict)
    place: dict = field(default_factory=dict)
    spoil: Callable[[RunData, int], RunData] = lambda run, number: run
    alter: Callable[[Scene], Scene] = lambda scene: scene
    stretched: tuple = (1.0, 1.0, 1.0)


def _pad(run, pad, names):
    return np.arange(len(names)) == names.index(pad)


def _undercounted(run, number):
    scale = np.where(_pad(run, 'pad_1', run.encoder_pads), 1.0 / (1.0 + GAIN), 1.0)
    return replace(run, encoder=replace(run.encoder, values=scale * run.encoder.values))


def _steps_lost(run, number):
    """Made up for: the pad goes where it went, and the encoder counts more from then on."""
    if number:
        return run
    more = (run.encoder.t >= ONSET)[:, None] * _pad(run, 'pad_1', run.encoder_pads) * SHORT * MM
    return replace(run, encoder=replace(run.encoder, values=run.encoder.values + more))


def _shifted(series, milliseconds):
    return Series(series.t + 1e-3 * milliseconds, series.values)


def _slipped(run, number):
    if number:
        return run
    moved = np.zeros_like(run.optical.points)
    moved[run.optical.t >= ONSET, run.optical.ids.index('m05')] = np.array(SLIP) * MM
    return replace(run, optical=replace(run.optical, points=run.optical.points + moved))


def _force(run, change):
    return replace(run, force=replace(run.force, values=change(run.force.values)))


def _louder(run, number):
    scale = np.where(_pad(run, 'pad_3', run.force_pads), 1.0 + LOUDER, 1.0)[:, None]
    return _force(run, lambda values: values * scale)


def _drifting(run, number):
    minutes = (run.force.t - run.force.t[0]) / MINUTE
    pad = _pad(run, 'pad_1', run.force_pads)[:, None]
    return _force(run, lambda values: values + minutes[:, None, None] * pad * np.array(DRIFT))


def _tool_moved(run, number):
    one = run.em['em0']
    return replace(run, em={**run.em, 'em0': EmSamples(
        one.t, one.position + np.array(MOVED) * MM, one.quality, one.status)})


def _turned(scene):
    """The third pad's direction TURN degrees off, level: what the tissue feels is another."""
    turn = np.radians(TURN)
    level = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0],
                      [0.0, 0.0, 1.0]])
    pads = list(scene.pads)
    pads[2] = replace(pads[2], direction=tuple((level @ pads[2].direction).tolist()))
    return replace(scene, pads=tuple(pads))


def _taller(scene):
    """The drawing is HIGHER than the body: what is on the tissue is drawn with it."""
    up = {pad.name: HIGHER * pad.centre[2] for pad in scene.pads}    # their markers with them
    markers = (_moved(one, up[one.body]) if one.body in up else one if one.body == 'base'
               else _moved(one, HIGHER * one.position[2]) for one in scene.markers)
    return replace(scene, markers=tuple(markers), pads=tuple(
        replace(pad, centre=(*pad.centre[:2], (1.0 + HIGHER) * pad.centre[2]))
        for pad in scene.pads), targets=tuple(
        _moved(one, HIGHER * one.position[2]) for one in scene.targets))


def _moved(one, up):
    x, y, z = one.position
    return replace(one, position=(x, y, z + up))


def _with_material(**changed):
    return lambda scene: replace(scene, material=replace(scene.material, **changed))


FAULTS = (
    Fault('sound'),
    Fault('undercounted', 'actuator_gain', {'gain': GAIN}, {'actuators': [1]},
          spoil=_undercounted),
    Fault('steps_lost', 'lost_steps', {'shortfall_mm': SHORT, 'onset_s': ONSET},
          {'actuators': [1]}, spoil=_steps_lost),
    Fault('late_force', 'clock_offset', {'delay_ms': LATE}, {'stream': 'force'},
          spoil=lambda run, number: replace(run, force=_shifted(run.force, LATE))),
    Fault('early_optical', 'clock_offset', {'delay_ms': EARLY}, {'stream': 'optical'},
          spoil=lambda run, number: replace(run, optical=replace(
              run.optical, t=run.optical.t + 1e-3 * EARLY))),
    Fault('slipped', 'marker_slip', {'offset_mm': SLIP, 'onset_s': ONSET}, {'marker': 'm05'},
          spoil=_slipped),
    Fault('scaled', 'optical_scale', {'scale': SCALE},
          spoil=lambda run, number: replace(run, optical=replace(
              run.optical, points=(1.0 + SCALE) * run.optical.points))),
    Fault('louder', 'force_gain', {'gain': LOUDER}, {'pads': ['pad_3']}, spoil=_louder),
    Fault('drifting', 'force_drift', {'rate_N_min': DRIFT}, {'pads': ['pad_1']},
          spoil=_drifting),
    Fault('tool_moved', 'em_offset', {'offset_mm': MOVED}, {'tools': ['em0']},
          spoil=_tool_moved),
    Fault('soft_label', alter=_with_material(E=SOFT)),
    Fault('incompressible', 'compressibility', {'factor': BULK},
          alter=_with_material(nu=POISSON)),
    Fault('too_high', 'reference_shape', {'height': 1.0 / (1.0 + HIGHER) - 1.0},
          alter=_taller, stretched=(1.0, 1.0, 1.0 + HIGHER)),
    Fault('turned', 'pad_misplacement', place={'pads': ['pad_2']}, alter=_turned),
    Fault('weighed', 'gravity', {'added_m_s2': (0.0, 0.0, WEIGHT)},
          alter=lambda scene: replace(scene, gravity=(0.0, 0.0, -WEIGHT))),
)

BY_NAME = {fault.name: fault for fault in FAULTS}
