"""Effects of no catalogue: what else goes wrong in a laboratory.

Those of the drive act between motor and tissue or on a sensor; those of the body add models.
"""
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from arm_brachy.prove.generator.actuation import chosen, play
from arm_brachy.prove.generator.catalogue import (
    Effect,
    draw_size,
    lump_place,
    mm,
    sign,
    some_pad,
    when,
)
from arm_brachy.prove.generator.tissue import inclusion


def force_crosstalk(streams, v):
    """One force sensor shows a share of another's load, with hysteresis."""
    forces = streams['forces']
    i, j = (forces.names.index(v[k]) for k in ('pad', 'from_pad'))
    source = np.linalg.norm(forces.values[:, j], axis=1, keepdims=True)
    forces.values[:, i, v['axis']] += v['share'] * (play(source, v['width_N'])[:, 0])


def em_creep(streams, v):
    """The tool that holds a target creeps through the tissue, as the logarithm of time."""
    em = streams['em']
    late = np.log1p(np.maximum(em.true - v['onset_s'], 0) / v['time_s'])
    em.values[:, em.names.index(v['target'])] += late[:, None] * np.array(v['creep_mm']) * 1e-3


def camera_warmth(streams, v):
    """A camera warms: positions bend quadratically across the field, settling with time."""
    optical = streams['optical']
    x = optical.values - optical.values.mean((0, 1))
    bend = (x @ np.array(v['along']))**2 / 0.05 * v['share']
    grown = 1 - np.exp(-optical.true / v['time_s'])
    optical.values = optical.values + (grown[:, None] * bend)[..., None] * np.array(v['towards'])


def encoder_ripple(streams, v):
    """An eccentric screw: the encoder errs periodically with travel."""
    encoders = streams['encoders']
    i = encoders.names.index(v['pad'])
    turn = 2 * np.pi * encoders.values[:, i] / (v['pitch_mm'] * 1e-3)
    encoders.values[:, i] += v['amplitude_mm'] * 1e-3 * (np.sin(turn + v['phase'])
                                                         - np.sin(v['phase']))


STRANGE_SENSING = {f.__name__: f for f in (force_crosstalk, em_creep, camera_warmth,
                                           encoder_ripple)}


def air_gap(v, names, strokes):
    """Air grows under a pad while it is pushed and leaks away at rest: tissue sees less travel.

    Returns a function of times (t,) and pad travel (t, p) on any clock.
    """
    which = chosen(names, (v['pad'],))

    def touch(t, y):
        step = np.gradient(t)
        width = np.zeros_like(y)
        gap = np.zeros(len(names))
        for k in range(len(t)):
            pushed = np.clip(y[k] / strokes, 0, 1)
            gap = gap + step[k] * (pushed * (v['gap_mm'] * 1e-3 - gap) / v['fill_s']
                                   - (1 - pushed) * gap / v['leak_s'])
            width[k] = gap
        return y - np.where(which, width * np.clip(y / strokes, 0, 1), 0)
    return touch


STRANGE_TOUCH = {'air_gap': air_gap}


def heat(t, y, i, time_s):
    """Warmth (t,) of the motor of pad i, about 1 when it has run for `time_s`."""
    power = np.abs(np.gradient(y[:, i], t)) / 0.002
    power = np.minimum(power, 3.0) * np.gradient(t) / time_s
    rho = np.exp(-np.median(np.diff(t)) / (4 * time_s))
    return lfilter([1.0], [1.0, -rho], power)


def thermal_bending(model, body, v, modulus):
    """The arm of a pad bends aside as its motor warms, and takes the pad along."""
    i = [p.name for p in body.pads].index(v['pad'])
    nudge = np.zeros((len(body.pads), 3))
    nudge[i] = np.array(v['bend_mm']) * 1e-3
    return replace(model, nudge=nudge), lambda t, y: heat(t, y, i, v['time_s'])


def pad_rocking(model, body, v, modulus):
    """A pad on a loose joint tilts in proportion to how far it is pushed."""
    i = [p.name for p in body.pads].index(v['pad'])
    turn = np.zeros((len(body.pads), 3))
    turn[i] = np.deg2rad(v['tilt_deg']) * np.array(v['axis'])
    return (replace(model, turn=turn),
            lambda t, y: np.clip(y[:, i] / body.pads[i].stroke, 0, None))


def fluid_loss(model, body, v, modulus):
    """Fluid leaves what is squeezed and comes back at rest: the bulk gives, with time."""
    tissue = replace(model.tissue, kappa=v['drained'] * model.tissue.kappa)
    strokes = np.array([p.stroke for p in body.pads])

    def drained(t, y):
        goal = np.clip((y / strokes).max(1), 0, 1)
        rho = np.exp(-np.median(np.diff(t)) / v['time_s'])
        return lfilter([1 - rho], [1, -rho], goal)
    return replace(model, tissue=tissue), drained


def vessel_collapse(model, body, v, modulus):
    """A vessel snaps shut when a pad passes a travel, and opens again only far below it."""
    i = [p.name for p in body.pads].index(v['pad'])
    stroke = body.pads[i].stroke

    def shut(t, y):
        closed, out = False, np.zeros(len(t))
        for k, share in enumerate(y[:, i] / stroke):
            closed = share > v['shut'] or (closed and share > v['open'])
            out[k] = closed
        return lfilter([0.2], [1, -0.8], out)
    soft = {'centre_mm': v['centre_mm'], 'radius_mm': v['radius_mm'], 'ratio': v['ratio']}
    return inclusion(model, body, soft, modulus), shut


def slow_cure(model, body, v, modulus):
    """One half of the body sets during the run, from a flank inwards."""
    x = model.grid.points
    depth = x @ np.array(v['along']) / max(body.dome.radii)
    factor = 1 + v['share'] / (1 + np.exp(-depth / 0.15))
    t = model.tissue
    tissue = replace(t, mu=factor * t.mu, kappa=factor * t.kappa)
    return (replace(model, tissue=tissue),
            lambda t, y: 1 - np.exp(-np.maximum(t - v['onset_s'], 0) / v['time_s']))


STRANGE_TIMED = {f.__name__: f for f in (thermal_bending, pad_rocking, fluid_loss,
                                         vessel_collapse, slow_cure)}
STRANGE = {**STRANGE_SENSING, **STRANGE_TOUCH, **STRANGE_TIMED}


def draw_strange(rng, name, body):
    """Effect of no catalogue with random parameters, by the names its function takes."""
    s = draw_size(rng)
    (pad,) = some_pad(rng, body)
    other = [p.name for p in body.pads if p.name != pad]
    at = {p.name: p for p in body.pads}[pad]
    across = np.cross(at.direction, rng.normal(size=3))
    across /= np.linalg.norm(across)
    along = rng.normal(size=3) * [1, 1, 0.3]
    along /= np.linalg.norm(along)
    onset = when(rng)
    target = f'target_{int(rng.integers(len(body.targets))) + 1}'
    lump = lump_place(rng, body)
    values = {
        'force_crosstalk': {'pad': pad, 'from_pad': other[int(rng.integers(len(other)))],
                            'axis': int(rng.integers(3)), 'share': 0.15 * s * sign(rng),
                            'width_N': 0.3},
        'em_creep': {'target': target, 'onset_s': onset, 'time_s': 8.0,
                     'creep_mm': (0.8 * s * across).tolist()},
        'camera_warmth': {'along': along.tolist(), 'towards': across.tolist(),
                          'share': 0.01 * s * sign(rng), 'time_s': 20.0},
        'encoder_ripple': {'pad': pad, 'pitch_mm': float(rng.uniform(0.8, 1.5)),
                           'amplitude_mm': 0.12 * s, 'phase': float(rng.uniform(0, 6))},
        'air_gap': {'pad': pad, 'gap_mm': 1.0 * s, 'fill_s': 6.0, 'leak_s': 25.0},
        'thermal_bending': {'pad': pad, 'bend_mm': (0.8 * s * across).tolist(), 'time_s': 6.0},
        'pad_rocking': {'pad': pad, 'tilt_deg': 4 * s, 'axis': across.tolist()},
        'fluid_loss': {'drained': float(np.exp(-1.5 * s)), 'time_s': float(rng.uniform(2, 8))},
        'vessel_collapse': {'pad': pad, 'shut': float(rng.uniform(0.4, 0.6)),
                            'open': float(rng.uniform(0.1, 0.3)), 'centre_mm': mm(lump),
                            'radius_mm': 8.0, 'ratio': float(1 / (1 + 4 * s))},
        'slow_cure': {'along': along.tolist(), 'share': 0.4 * s, 'time_s': 25.0,
                      'onset_s': onset},
    }[name]
    place = np.array(values['centre_mm']) * 1e-3 if 'centre_mm' in values else (
        np.array(at.centre) if 'pad' in values else None)
    return Effect(name, values, s, None if place is None else tuple(place.tolist()),
                  values.get('onset_s'))
