"""Effects in the sensors: each changes what one stream shows, before frame, zero and noise.

Every function: streams, a dict of `Stream` by name, changed in place; travel (t, p) of the pads
at the stream's own times is in `Stream.travel`; names of all; parameters as in the catalogue.
"""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.actuation import chosen


@dataclass
class Stream:
    """One sensor: true times and stamps (t,) [s], values (t, k) or (t, k, 3), travel (t, p)."""

    names: tuple
    true: np.ndarray
    stamps: np.ndarray
    values: np.ndarray
    travel: np.ndarray


def marker_slip(streams, v):
    """One marker is shifted from the onset on."""
    optical = streams['optical']
    late = optical.true >= v['onset_s']
    optical.values[late, v['marker']] += np.array(v['offset_mm']) * 1e-3


def optical_scale(streams, v):
    """Positions scaled about a point."""
    centre = np.array(v['centre_mm']) * 1e-3
    optical = streams['optical']
    optical.values = centre + (1 + v['scale']) * (optical.values - centre)


def em_distortion(streams, v):
    """Stretch and rotation that fade with distance, and a shift with the travel of pads."""
    em = streams['em']
    arm = em.values - np.array(v['centre_mm']) * 1e-3
    fade = np.exp(-(arm**2).sum(-1, keepdims=True) / (2 * (v['extent_mm'] * 1e-3)**2))
    error = v['gradient_mm_per_mm'] * arm + np.cross(np.array(v['rotation_mm_per_mm']), arm)
    moved = em.travel if v['pad'] < 0 else em.travel[:, [v['pad']]]
    shift = np.abs(moved).sum(1)[:, None] * np.array(v['pad_coupling_mm_per_mm'])
    em.values = em.values + error * fade + shift[:, None]


def em_offset(streams, v):
    """Constant error of targets."""
    em = streams['em']
    which = chosen(em.names, v['tools'])
    em.values[:, which] += np.array(v['offset_mm']) * 1e-3


def force_gain(streams, v):
    """Sensitivity error."""
    forces = streams['forces']
    forces.values[:, chosen(forces.names, v['pads'])] *= 1 + v['gain']


def axis_crosstalk(streams, v):
    """Shares of the force along every axis in the other two."""
    forces = streams['forces']
    which = chosen(forces.names, v['pads'])
    x, y, z = np.moveaxis(forces.values[:, which], -1, 0)
    (xy, yz, zx), (xz, yx, zy) = v['onward'], v['backward']     # from, to
    forces.values[:, which] = np.stack([x + yx * y + zx * z, y + xy * x + zy * z,
                                        z + xz * x + yz * y], axis=-1)


def force_drift(streams, v):
    """Zero error that grows."""
    forces = streams['forces']
    rate = np.array(v['rate_N_min']) / 60
    error = np.array(v['bias_N']) + forces.true[:, None] * rate
    forces.values[:, chosen(forces.names, v['pads'])] += error[:, None]


def clock_offset(streams, v):
    """Stamps of one stream late."""
    streams[v['stream']].stamps = streams[v['stream']].stamps + v['delay_ms'] * 1e-3


SENSING = {
    'marker_slip': marker_slip,
    'optical_scale': optical_scale,
    'em_distortion': em_distortion,
    'em_offset': em_offset,
    'force_gain': force_gain,
    'axis_crosstalk': axis_crosstalk,
    'force_drift': force_drift,
    'clock_offset': clock_offset,
}
