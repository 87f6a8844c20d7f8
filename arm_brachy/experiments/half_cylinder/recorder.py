"""What the laboratory's sensors make of the half-cylinder.

Clocks, noise, gaps, the trackers' frames and where markers were glued are not told to the
diagnosis, and none of it counts as missing physics; see `cases.BESIDE`.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.random import stream
from arm_brachy.experiments.csv_files import EM, ENCODERS, FORCES, OPTICAL, Recorded
from arm_brachy.experiments.half_cylinder import sensors
from arm_brachy.experiments.half_cylinder.layout import (
    BASE_MARKERS,
    DIRECTIONS,
    MARKERS,
    MM,
    PADS,
    TARGETS,
)
from arm_brachy.experiments.half_cylinder.protocol import END, response, travel
from arm_brachy.experiments.half_cylinder.sensors import DEVICES

FINE_STEP = 0.01        # s, between which states are straight: off by 0.5 um where pads start
ZERO = 0.02             # N, sd of the zeros of the forces
GLUE = {'tissue': 0.1 * MM, 'pads': 0.05 * MM, 'em': 0.15 * MM}    # sd per axis
# Elements that yield, side by side with the pads' forces: where [N], and their shares.
YIELDS = ((0.025, 0.4), (0.0875, 0.35), (0.225, 0.25))
FORMATS = {ENCODERS: ('q_{key}', '%.5f'), OPTICAL: ('{key}_{axis}', '%.4f'),
           FORCES: ('{key}_{axis}', '%.5f'), EM: ('{key}_{axis}', '%.3f')}     # mm, forces N


@dataclass(frozen=True)
class Setup:
    """What is true of one recording and not said in its files.

    modulus : over that of the bodies
    slip : marker, onset [s] and shift (3,) [m] of one that slides, or None
    aside : pad, and how far along x [m] its marker sits from its place with it, or None
    jump : pad, onset [s], size (3,) [N] and time constant [s] of a force zero that jumps and
        comes back, or None
    hysteresis : of the pads' forces: stiffness of what yields over the tissue's, before it does
    """

    modulus: float = 1.0
    slip: tuple | None = None
    aside: tuple | None = None
    jump: tuple | None = None
    hysteresis: float = 0.0


class Recorder:
    """Records a body in a Setup.

    rays : name -> ray.Ray;  beyond : bodies.Beyond of what it remembers, or None
    seed, name : of the recording; every device draws from a random stream of its own
    Test: experiments/half_cylinder/test_recorder.py
    """

    def __init__(self, rays, setup, seed, name, *, beyond=None):
        self._rays, self._beyond, self._setup = rays, beyond, setup
        self._seed, self._name = seed, name
        self._fine = np.arange(0.0, END + FINE_STEP, FINE_STEP)

    def record(self):
        """Device -> Recorded."""
        return {ENCODERS: self._encoders(), FORCES: self._forces(), OPTICAL: self._optical(),
                EM: self._em()}

    def _rng(self, what):
        return stream(self._seed, f'{self._name}/{what}')

    def _glued(self, what, count):
        """Where markers are beside their places in the scene (count, 3) [m], in all recordings."""
        return stream(self._seed, f'glue/{what}').normal(0.0, GLUE[what], (count, 3))

    def _begun(self, device):
        """Random stream, instants (t,) [s] and the clock's stamps of a device."""
        rng, of = self._rng(device), DEVICES[device]
        t = sensors.instants(of, END, rng)
        return rng, t, sensors.clock(of, rng).stamps(t)

    def _seen(self, device, names, stamps, clean, rng):
        """With the device's noise and gaps."""
        values = clean + sensors.noise(DEVICES[device], clean.shape, rng)
        if DEVICES[device].gaps:
            sensors.lose(values, DEVICES[device], rng)
        return Recorded(tuple(names), stamps, values)

    def _states(self, what):
        """'u' or 'force' at the fine instants, (k, ..., 3); forces with the Setup's modulus."""
        out = response(self._rays, self._fine, what)
        if self._beyond is not None:
            out = out + self._beyond.at(self._fine, what)
        return out if what == 'u' else self._setup.modulus * (
            out + yielding(out, self._setup.hysteresis))

    def _at(self, t, what):
        return np.apply_along_axis(lambda one: np.interp(t, self._fine, one), 0,
                                   self._states(what))

    def _encoders(self):
        rng, t, stamps = self._begun(ENCODERS)
        return self._seen(ENCODERS, [pad.name for pad in PADS], stamps, travel(t), rng)

    def _forces(self):
        rng, t, stamps = self._begun(FORCES)
        clean = self._at(t, 'force') + rng.normal(0.0, ZERO, (len(PADS), 3))
        if self._setup.jump is not None:
            name, onset, size, tau = self._setup.jump
            since = np.maximum(t - onset, 0.0)
            clean[:, [pad.name for pad in PADS].index(name)] += np.outer(
                (t >= onset) * np.exp(-since / tau), size)
        return self._seen(FORCES, [pad.name for pad in PADS], stamps, clean, rng)

    def _optical(self):
        rng, t, stamps = self._begun(OPTICAL)
        seen = self._on_tissue(t) | self._on_pads(t) | {
            name: np.tile(at, (len(t), 1)) for name, at in BASE_MARKERS.items()}
        clean = sensors.in_frame(np.stack([*seen.values()], axis=1), rng)
        return self._seen(OPTICAL, seen, stamps, clean, rng)

    def _on_tissue(self, t):
        """Marker -> where it is, (t, 3) [m]."""
        moved = self._at(t, 'u')[:, :len(MARKERS)] + self._glued('tissue', len(MARKERS))
        out = {name: at + moved[:, i] for i, (name, at) in enumerate(MARKERS.items())}
        if self._setup.slip is not None:
            name, onset, shift = self._setup.slip
            out[name][t >= onset] += shift
        return out

    def _on_pads(self, t):
        """Marker on a pad, called as the pad -> where it is, (t, 3) [m]."""
        gone, glued = travel(t), self._glued('pads', len(PADS))
        out = {pad.name: pad.marker + glued[p] + np.outer(gone[:, p], DIRECTIONS[p])
               for p, pad in enumerate(PADS)}
        if self._setup.aside is not None:
            name, shift = self._setup.aside
            out[name][:, 0] += shift
        return out

    def _em(self):
        rng, t, stamps = self._begun(EM)
        at = np.array([*TARGETS.values()]) + self._glued('em', len(TARGETS))
        clean = sensors.in_frame(at + self._at(t, 'u')[:, len(MARKERS):], rng)
        return self._seen(EM, TARGETS, stamps, clean, rng)


def yielding(force, ratio):
    """What elements that yield add to forces (t, ...) [N], whatever the rate (Iwan's chains).

    ratio : of their stiffness to that of what the forces come from, before any yields
    Source: Iwan 1966, J Appl Mech 33:893, in parallel, each component by itself.
    """
    out = np.zeros_like(force)
    if ratio:
        for most, share in YIELDS:
            out += ratio * share * _yielded(force, most)
    return out


def _yielded(force, most):
    """One element: follows the changes of forces (t, ...) between -most and most [N]."""
    out = np.zeros_like(force)
    for before, now in enumerate(range(1, len(force))):
        out[now] = np.clip(out[before] + force[now] - force[before], -most, most)
    return out
