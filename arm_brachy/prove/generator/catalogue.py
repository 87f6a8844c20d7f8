"""Draws of the parameters of every effect: sizes log-uniform in 0.2 to 2 times the typical one."""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.shape import direction_ball
from arm_brachy.prove.generator.world import target_names


@dataclass(frozen=True)
class Effect:
    """name, of the catalogue or an own one; values by the catalogue's parameter names, in the
    units those names end in; size: over the typical one; place (3,) [m], world frame, or None;
    onset [s] or None; form: of `forms.OTHER`, or the registry's.
    """

    name: str
    values: dict
    size: float
    place: tuple | None = None
    onset: float | None = None
    form: str = REGISTRY


def draw_size(rng):
    """Size over the typical one."""
    return float(np.exp(rng.uniform(np.log(0.2), np.log(2.0))))


def sign(rng):
    """Plus or minus one."""
    return 1.0 if rng.random() < 0.5 else -1.0


def direction(rng):
    """Random unit vector (3,)."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def some_pad(rng, body):
    """One pad's name in a tuple."""
    return (body.pads[int(rng.integers(len(body.pads)))].name,)


def when(rng):
    """Onset [s] within the first minute, after the idle start."""
    return float(rng.uniform(5, 55))


def on_surface(rng, body, low=0.3, high=0.95):
    """Point of the surface off the pads, in the half-ball (3,)."""
    while True:
        ball = direction_ball(rng.uniform(0, 2 * np.pi), rng.uniform(low, high))
        x = body.dome.place(ball[None])
        if all(p.rim_distance(x)[0] > 0.006 or not p.faces(x)[0] for p in body.pads):
            return ball


def mm(point):
    """Point [m] as a tuple in mm."""
    return tuple((1e3 * np.asarray(point)).tolist())


def actuation(rng, body, s):
    """Values of the terms of actuation at size s."""
    one = some_pad(rng, body)
    slip = when(rng)
    return {
        'actuator_lag': {'time_constant_ms': 20 * s, 'delay_ms': float(rng.uniform(0, 30 * s))},
        'actuator_gain': {'gain': 0.06 * s * sign(rng), 'offset_mm': 0.0, 'actuators': one},
        'backlash': {'width_mm': 0.25 * s, 'actuators': one},
        'lost_steps': {'onset_s': slip, 'shortfall_mm': 0.6 * s * sign(rng), 'actuators': one},
        'actuator_compliance': {'compliance_mm_N': 0.125 * s, 'actuators': one},
    }


def sensing(rng, body, s):
    """Values of the terms of sensing at size s."""
    one = some_pad(rng, body)
    stream = ('optical', 'em', 'forces')[int(rng.integers(3))]
    tool = target_names(body)[int(rng.integers(len(body.targets)))]
    drifting = rng.random() < 0.5
    return {
        'marker_slip': {'marker': int(rng.integers(len(body.surface_markers))),
                        'onset_s': when(rng), 'offset_mm': tuple(s * direction(rng))},
        'optical_scale': {'scale': 0.008 * s * sign(rng), 'centre_mm': (0.0, 0.0, 0.0)},
        'em_distortion': {
            'centre_mm': (0.0, 0.0, 0.0), 'gradient_mm_per_mm': 0.1 * s * sign(rng),
            'rotation_mm_per_mm': tuple(0.05 * s * direction(rng)),
            'extent_mm': float(150 * np.exp(rng.normal(0, 0.3))),
            'pad_coupling_mm_per_mm': tuple(0.1 * s * direction(rng)),
            'pad': int(rng.integers(len(body.pads)))},
        'em_offset': {'offset_mm': tuple(s * direction(rng)), 'tools': (tool,)},
        'force_gain': {'gain': 0.08 * s * sign(rng), 'pads': one},
        'force_drift': {'rate_N_min': tuple(0.25 * s * direction(rng) * drifting),
                        'bias_N': tuple(0.25 * s * direction(rng) * (not drifting)), 'pads': one},
        'clock_offset': {'stream': stream, 'delay_ms': 20 * s * sign(rng)},
    }


def material(rng, body, s):
    """Values of the terms of the tissue's law at size s."""
    toward = sign(rng)
    lump = lump_place(rng, body)
    return {
        'stiffness_scale': {'factor': float(np.exp(0.4 * s * toward))},
        'compressibility': {'factor': float(np.exp(-0.7 * s))},
        'stiffness_gradient': {'gradient_per_m': tuple(5.6 * s * direction(rng))},
        'skin_layer': {'ratio': float(1 + 2 * s), 'thickness_mm': float(rng.uniform(1.5, 3))},
        'inclusion': {'centre_mm': mm(lump), 'radius_mm': float(rng.uniform(7, 12)),
                      'ratio': float(np.exp(1.5 * s * (toward if s < 1.2 else 1)))},
        'strain_stiffening': {'ratio': 2.0 * s},
        'anisotropy': {'ratio': s, 'azimuth_deg': float(rng.uniform(-90, 90)),
                       'elevation_deg': float(rng.uniform(-60, 60))},
        'viscoelasticity': {'g1': 0.2 * s, 'tau1_s': float(3 * np.exp(rng.normal(0, 0.4))),
                            'g2': 0.1 * s, 'tau2_s': float(30 * np.exp(rng.normal(0, 0.3)))},
        'stress_softening': {'damage': 0.25 * s,
                             'energy_Pa': float(50 * np.exp(rng.normal(0, 0.5)))},
        'stiffness_drift': {'rate_per_min': 0.1 * s * toward, 'onset_s': when(rng)},
        'swelling_drift': {'rate_per_min': 0.01 * s * toward, 'onset_s': when(rng)},
    }


def lump_place(rng, body):
    """Centre [m] of a lump: inside, and within some 25 mm of a pad, where tissue is strained."""
    while True:
        r, azimuth = 0.75 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        ball = np.array([[r * np.cos(azimuth), r * np.sin(azimuth), rng.uniform(0.25, 0.7)]])
        x = body.dome.place(ball)[0]
        near = min(np.linalg.norm(x - p.centre) for p in body.pads)
        if np.linalg.norm(ball) < 0.82 and near < 0.03:
            return x


def boundary(rng, body, s):
    """Values of the terms of shape, boundary and contact at size s."""
    up = body.dome.place(on_surface(rng, body)[None])[0]
    touch = body.dome.place(on_surface(rng, body)[None])[0]
    bump = body.dome.place(on_surface(rng, body)[None])[0]
    turn = rng.uniform(0, 2 * np.pi)
    base = 0.35 * np.array(body.dome.radii) * [np.cos(turn), np.sin(turn)]
    tilt = rng.uniform(0, 2 * np.pi)
    return {
        'reference_shape': {'height': 0.03 * s * sign(rng), 'width': 0.03 * s * sign(rng) * 0.5,
                            'bump_height_mm': 2 * s * sign(rng), 'bump_centre_mm': mm(bump),
                            'bump_radius_mm': float(rng.uniform(14, 24))},
        'gravity': {'added_m_s2': tuple(2.5 * s * direction(rng))},
        'pad_misplacement': {'up_mm': 2 * s * np.sin(tilt), 'side_mm': 2 * s * np.cos(tilt),
                             'tilt_up_deg': float(rng.normal(0, s)),
                             'tilt_side_deg': float(rng.normal(0, s)),
                             'pads': some_pad(rng, body)},
        'obstacle': {'gap_mm': float(rng.uniform(0.02, 0.15)), 'centre_mm': mm(up),
                     'radius_mm': float(8 + 10 * s)},
        'base_debond': {'radius_mm': 22 * s**0.5, 'centre_mm': mm([*base, 0.0])},
        'base_compliance': {'normal_kPa_mm': 1.0 / s,
                            'tangential_kPa_mm': float(rng.uniform(0.35, 1)) / s},
        'external_force': {'force_N': tuple(0.5 * s * pointing_in(rng, body, touch)),
                           'centre_mm': mm(touch), 'radius_mm': float(rng.uniform(7, 13)),
                           'onset_s': when(rng), 'duration_s': float(rng.uniform(1.5, 5))},
        'breathing': {'amplitude_mm': 0.4 * s, 'frequency_Hz': float(rng.uniform(0.18, 0.32)),
                      'phase_deg': float(rng.uniform(-180, 180)),
                      'direction': tuple(tilted_up(rng))},
    }


def pointing_in(rng, body, x):
    """Unit vector (3,) roughly from x towards the middle of the body."""
    v = np.array([0, 0, 0.3 * body.dome.height]) - x
    v = v / np.linalg.norm(v) + 0.3 * rng.normal(size=3)
    return v / np.linalg.norm(v)


def tilted_up(rng):
    """Unit vector (3,) near the normal of the base."""
    v = np.array([0, 0, 1]) + 0.25 * rng.normal(size=3)
    return v / np.linalg.norm(v)


def mounting(rng, body, s):
    """Values of what joined later at size s: families draw all they have, so it has its own."""
    return {'axis_crosstalk': {'onward': tuple(0.05 * s * direction(rng)),
                               'backward': tuple(0.05 * s * direction(rng)),
                               'pads': some_pad(rng, body)}}


FAMILIES = {'actuation': actuation, 'sensing': sensing, 'material': material,
            'boundary': boundary, 'mounting': mounting}


def draw_effect(rng, name, body):
    """Effect of the catalogue with random parameters.

    Raises KeyError for a name that no family has.
    """
    size = draw_size(rng)
    for family in FAMILIES.values():
        values = family(rng, body, size)
        if name in values:
            break
    values = {k: tidy(v) for k, v in values[name].items()}
    return Effect(name, values, size, place_of(name, values, body), values.get('onset_s'))


def tidy(value):
    """Numpy numbers as plain ones, so that they print and hash alike everywhere."""
    if isinstance(value, tuple):
        return tuple(tidy(v) for v in value)
    return float(value) if isinstance(value, np.floating) else value


def place_of(name, values, body):
    """Where an effect sits (3,) [m], or None."""
    if name == 'reference_shape':
        return tuple(1e-3 * np.array(values['bump_centre_mm']))
    if 'centre_mm' in values and name not in ('optical_scale', 'em_distortion'):
        return tuple(1e-3 * np.array(values['centre_mm']))
    held = values.get('actuators') or values.get('pads')
    if held:
        return tuple(next(p.centre for p in body.pads if p.name == held[0]))
    if name == 'marker_slip':
        return tuple(body.points[values['marker']].tolist())
    return None
