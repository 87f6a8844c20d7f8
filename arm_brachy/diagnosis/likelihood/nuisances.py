"""What no cause is needed for: frames, zeros, places and the modulus, each to within its prior.

Test: diagnosis/forward/test_observables.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

MODULUS = 'modulus'     # what the nuisance of the whole body's stiffness is called,
TOUCH = 'touch_'        # and what those of pads off their zeros begin with


@dataclass(frozen=True)
class Priors:
    """Standard deviations of the nuisances that `finding.Calibration` does not have."""

    frame: float = quantity(1.0, 'mm', 'registration of the optical tracker, each of 6 motions, '
                            'turns by what they move a marker', low=0.0, high=100.0,
                            source='own choice: weak, so that a frame is no evidence')
    on_pad: float = quantity(3.0, 'mm', 'place of a marker on its pad, per axis', low=0.0,
                             high=100.0, source='own choice: at rest nothing tells whether a pad '
                             'or its marker is aside; how the tissue answers the push does')
    modulus: float = quantity(0.5, '', 'logarithm of the modulus of the whole body', low=0.0,
                              high=10.0, source='own choice: weak, known within a factor of two')


@dataclass(frozen=True)
class Nuisances:
    """Columns of nuisances, each times its prior standard deviation.

    names : k;  values : kind -> (n, c, 3, k) SI, channels in the model's order
    """

    names: tuple
    values: dict


def nuisances(baseline, calibration=None, priors=None, *, several=False):
    """Return the Nuisances of a linearised.Baseline.

    calibration : finding.Calibration;  priors : Priors; None = defaults
    several : True beside other recordings of the set-up: where a tool sits is the same in all, and
        the EM tracker's zero is each one's own; of one recording alone the two are one
    Registration 6, placement 3 per marker off the base and per tool, EM zero 3, force zero 3 and
    scale 1 per pad, touch offset 1 per pad, modulus 1. The linear answers hold for small ones.
    """
    calibration, priors = calibration or Calibration(), priors or Priors()
    specimen, n = baseline.model.specimen, len(baseline.t)
    counts = {OPTICAL: len(specimen.markers), EM: len(specimen.tools), FORCE: len(specimen.pads)}
    columns = [*_frame(baseline, priors.frame),
               *_shifts(OPTICAL, specimen.markers, [
                   max(priors.on_pad, calibration.placement) if on in specimen.pads
                   else calibration.placement for on in specimen.carriers]),
               *_shifts(EM, specimen.tools, [calibration.em_registration] * counts[EM]),
               *(_em_zero(counts[EM], calibration.em_registration) if several else ()),
               *_shifts(FORCE, specimen.pads, [calibration.force_zero] * counts[FORCE]),
               *_gains(baseline, calibration.force_gain),
               *_touches(baseline, calibration.touch), _modulus(baseline, priors.modulus)]
    values = {kind: np.zeros((n, count, 3, len(columns))) for kind, count in counts.items()}
    for j, (_, change) in enumerate(columns):
        for kind, part in change.items():
            values[kind][..., j] = part
    return Nuisances(tuple(name for name, _ in columns), values)


def _frame(baseline, sd):
    """Small rigid motions of the tracker's frame, about the middle of the markers."""
    points = np.stack([baseline.truth[i][OPTICAL] for i in range(len(baseline.t))])
    if not points.shape[1]:
        return
    arm = points - points.mean(axis=(0, 1))
    lever = max(float(np.sqrt(np.mean(np.sum(arm**2, axis=2)))), 1e-9)
    for axis, unit in zip('xyz', np.eye(3), strict=True):
        yield f'frame_shift_{axis}', {OPTICAL: np.broadcast_to(sd * unit, points.shape)}
    for axis, unit in zip('xyz', np.eye(3), strict=True):
        yield f'frame_turn_{axis}', {OPTICAL: sd / lever * np.cross(unit, arm)}


def _shifts(kind, names, sd):
    """A constant shift of every channel along every axis; sd : of each channel."""
    for c, name in enumerate(names):
        for i, axis in enumerate('xyz'):
            shift = np.zeros((len(names), 3))
            shift[c, i] = sd[c]
            yield f'{kind}_{name}_{axis}', {kind: shift}


def _em_zero(tools, sd):
    """A constant shift of all tools along every axis."""
    for axis, unit in zip('xyz', np.eye(3), strict=True):
        yield f'zero_em_{axis}', {EM: np.broadcast_to(sd * unit, (tools, 3))}


def _gains(baseline, sd):
    for c, name in enumerate(baseline.model.specimen.pads):
        scaled = np.zeros_like(baseline.shown[FORCE])
        scaled[:, c] = sd * baseline.shown[FORCE][:, c]
        yield f'gain_{name}', {FORCE: scaled}


def _touches(baseline, sd):
    for p, name in enumerate(baseline.model.specimen.pads):
        moved = sd * (np.arange(len(baseline.model.specimen.pads)) == p)
        changes = [baseline.pads_moved(i, moved) for i in range(len(baseline.t))]
        yield f'{TOUCH}{name}', {kind: np.stack([change[kind] for change in changes])
                                for kind in (OPTICAL, EM, FORCE)}


def _modulus(baseline, sd):
    scale = hypothesis(StiffnessScale)
    size = scale.strengths[0].typical - scale.strengths[0].neutral
    values = respond(baseline, scale).values
    return MODULUS, {kind: part[..., 0] * (sd / size) for kind, part in values.items()}
