"""Balance of forces, where a balance carries the base: which pad's sensor has the wrong scale."""

import numpy as np

from arm_brachy.diagnosis.results.finding import Finding, sigma, threshold
from arm_brachy.diagnosis.signals.noise import data_sheet_sd
from arm_brachy.diagnosis.signals.stream import FORCE
from arm_brachy.diagnosis.statistics.gls import regress
from arm_brachy.diagnosis.statistics.noise_process import residual_colour

FEWEST = 100     # samples


def balance_findings(prepared):
    """Findings about scales of pad sensors, from base force + sum of pad forces = constant.

    The tissue carries what the pads do to it on to the base, quasi-statically; its weight is the
    constant. The base force is regressed on the pads' forces axis by axis: a pad whose coefficient
    departs from that of the others reads wrong, all alike is the scale of the balance.
    Needs two pads that push, all axes of their forces and the wrench of a balance under the base.
    Test: diagnosis/structural/test_force.py
    """
    base, force = prepared.evidence.base_force, prepared.evidence.get(FORCE)
    if base is None or force is None or force.along is not None or len(force.names) < 2:
        return ()
    valid = base.valid[:, 0] & (base.t >= force.t[0]) & (base.t <= force.t[-1])
    pushed = [k for k in range(len(force.names)) if force.valid[:, k].sum() >= FEWEST]
    if valid.sum() < FEWEST or len(pushed) < 2:
        return ()
    pads = force.channels(pushed).at(base.t)
    weight, total = np.zeros(len(pushed)), np.zeros(len(pushed))
    for axis in range(3):
        columns = {'1': np.ones(len(base.t))} | {
            name: -pads[:, i, axis] for i, name in enumerate(force.names[k] for k in pushed)}
        value, error = _coefficients(base, axis, columns, valid, prepared)
        weight += error ** -2
        total += value * error ** -2
    return _judged(prepared, [force.names[k] for k in pushed], total / weight, weight ** -0.5)


def _coefficients(base, axis, columns, valid, prepared):
    y, colour = base.values[:, 0, axis:axis + 1], prepared.noise[FORCE].colour
    sd = data_sheet_sd(FORCE)
    fit = regress(base.t, y, columns, valid, colour, np.array([sd]))
    colour, louder = residual_colour(base.t, fit.residual, valid, colour, sd)
    fit = regress(base.t, y, columns, valid, colour, louder)
    return fit.value[1:, 0], fit.sd[1:, 0]


def _judged(prepared, names, ratio, error):
    """Findings from the coefficients (k,): true over apparent force, times the balance's scale."""
    usual, slack = float(np.median(ratio)), np.sqrt(2.0) * prepared.calibration.force_gain
    out = []
    for name, one, sd in zip(names, ratio, error, strict=True):
        gain, sd = usual / one - 1.0, usual * sd / one ** 2
        z = sigma(gain, sd, slack)
        if z > threshold(len(names)):
            out.append(Finding(
                FORCE, name, 'force_gain', 'gain', float(gain), '1', float(sd), z,
                *map(float, prepared.evidence.span), f'The force on {name} reads '
                f'{100.0 * gain:+.1f} % against the balance of all forces on the tissue.',
                parameters={'gain': float(gain), 'pads': (name,)}, slack=slack))
    return tuple(out)
