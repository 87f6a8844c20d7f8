"""Sudden steps of single channels, beside what an honest tissue does with the pads' history."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.diagnosis.results.finding import sigma
from arm_brachy.diagnosis.signals.regressors import drift_columns, history_columns
from arm_brachy.diagnosis.signals.stream import BASE, EM, FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.change_points import Step, joined, steps
from arm_brachy.diagnosis.statistics.change_retest import steadfast
from arm_brachy.diagnosis.statistics.gls import regress
from arm_brachy.diagnosis.statistics.noise_process import residual_colour

FEWEST = 100    # samples of a channel
KINKS = 24      # times at which something slow may set in
# Of a channel's motion or force: what the regressors may miss of an honest tissue.
BEND = {OPTICAL: 0.01, EM: 0.01, FORCE: 0.02}


@dataclass(frozen=True)
class Jump:
    """One channel at one instant. body : what it sits on;  step : size (3,), SI, world frame.

    z : size of the step against its error, what the regressors may miss, counts, and what no
        laboratory calls a step
    """

    kind: str
    channel: str
    body: str
    step: Step
    z: float


def jumps(prepared, travel, late, *, alarm):
    """Jumps of every channel but the markers on pads (`pad_tracking` sees to these); a tuple.

    travel : (t, q (m, p)) of the pads, play included;  late : kind -> [s] delay of the stream
    alarm : probability of a false jump per channel
    Forces may remember; of positions under given pushes a tissue alike everywhere remembers
    nothing, and what does is left to the noise that the steps have to exceed.
    Not for bodies without pads, whose free motion follows nothing that was recorded.
    Test: diagnosis/structural/test_events.py
    """
    found = []
    for kind, bodies in ((OPTICAL, (BASE, TISSUE)), (EM, (TISSUE,)),
                         (FORCE, prepared.evidence.pads)):
        stream, noise = prepared.on(kind, *bodies)
        if stream is None:
            continue
        columns = {'1': np.ones(len(stream.t))} | drift_columns(stream.t) | history_columns(
            stream.t - late.get(kind, 0.0), travel, prepared.motion.touch, memory=kind == FORCE)
        slack = np.hypot(noise.rounding, 0.0 if kind == FORCE else prepared.calibration.slip)
        for k in range(len(stream.names)):
            found += _jumps(stream, noise, k, columns, alarm, slack)
    return tuple(found)


def _jumps(stream, noise, k, columns, alarm, slack):
    valid = stream.valid[:, k]
    if valid.sum() < FEWEST:
        return []
    # a camera's depth is loud, and along none of the world's axes: a step of noise in depth would
    # count in each of these
    axes, known = noise.own_axes(k)
    y = stream.values[:, k] @ axes
    fit = regress(stream.t, y, columns, valid, noise.colour, known)
    colour, sd = residual_colour(stream.t, fit.residual, valid, noise.colour, known)
    nuisance = np.stack([c for name, c in columns.items() if name != '1'], axis=1)
    bend = BEND[stream.kind] * float(np.ptp((y - fit.residual)[valid], axis=0).max())
    found = steps(stream.t, y, valid, colour, sd, nuisance, alarm=alarm)
    if found:   # what sets in and goes on is a step from afar: not one that a kink does away with
        ramp = _kink(stream.t, y, columns, valid, colour, sd)
        nuisance = np.column_stack([nuisance, ramp])
        found = steps(stream.t, y, valid, colour, sd, nuisance, alarm=alarm)
        found = steadfast(found, stream.t, y, valid, known, nuisance, alarm=alarm)
    return [Jump(stream.kind, stream.names[k], stream.bodies[k], _turned(step, axes),
                 sigma(step.size, step.sd, np.hypot(bend, slack))) for step in joined(found)]


def _turned(step, axes):
    """A Step along `axes` (c, c), columns, as one in the world frame."""
    return replace(step, size=axes @ step.size, sd=np.sqrt(axes**2 @ step.sd**2))


def _kink(t, y, columns, valid, colour, sd):
    """(n,) of the ramps that begin at KINKS even times the one that explains most of y (n, 3)."""
    begins = np.linspace(t[0], t[-1], KINKS + 2)[1:-1, None]
    ramps = np.maximum(t - begins, 0.0) / (t[-1] - begins)
    left = [regress(t, y, {**columns, 'kink': ramp}, valid, colour, sd).chi2.sum()
            for ramp in ramps]
    return ramps[int(np.argmin(left))]
