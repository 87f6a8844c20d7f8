"""Other laws of the tissue itself; functions as in `tissue`, and of memory as in `history`.

Numbers that no value of the catalogue gives are our own choice.
"""
from dataclasses import replace

import numpy as np

from arm_brachy.prove.generator.form import Form
from arm_brachy.prove.generator.layer import make_layer
from arm_brachy.prove.generator.memory import FROM_A_THRESHOLD, RATIONAL, Law
from arm_brachy.prove.generator.tissue import (
    fibre_of,
    fibred,
    grown,
    loaded,
    scaled,
    stiffness_drift,
    swelling_drift,
    swollen,
)

LEVELS_OFF = 60.0   # s, after which what drifts has gone 63 % of its way
SETS_IN = 20.0      # s, in which a drift comes to its rate


def inward(model, body):
    """How far inside the integration points (m, q) are: 1 in the middle of the base, 0 outside."""
    x = model.grid.points / [*body.dome.radii, body.dome.height]
    return 1 - np.linalg.norm(x, axis=2)


def inner_half(model, body):
    """The half of the body's volume that is farthest inside (m, q), bool."""
    depth, volume = inward(model, body), model.grid.slopes[1]
    order = np.argsort(-depth, axis=None)
    inside = np.zeros(volume.size, bool)
    inside[order] = np.cumsum(volume.ravel()[order]) < 0.5 * volume.sum()
    return inside.reshape(volume.shape)


def height(model):
    """Height of the integration points (m, q) over that of the middle of the volume, -1 to 1."""
    z, volume = model.grid.points[..., 2], model.grid.slopes[1]
    middle = (z * volume).sum() / volume.sum()
    return (z - middle) / max(z.max() - middle, middle)


def shear_alone(model, body, v, modulus):
    """The shear modulus is off, and the bulk modulus is not."""
    stiffer = scaled(model, v['factor'])
    return replace(stiffer, tissue=replace(stiffer.tissue, kappa=model.tissue.kappa))


def more_below(model, body, v, modulus):
    """The modulus is off by more near the base, by less near the top, and by that on average."""
    return scaled(model, v['factor']**(1 - 0.4 * height(model)))


def bulk_graded(model, body, v, modulus):
    """The bulk modulus is off by more near the base than near the top."""
    bulk = v['factor']**(1 - 0.6 * height(model))
    return replace(model, tissue=replace(model.tissue, kappa=bulk * model.tissue.kappa))


def bulk_inside(model, body, v, modulus):
    """The bulk modulus is off in the inner half of the body alone, by more."""
    bulk = np.where(inner_half(model, body), v['factor']**2, 1.0)
    return replace(model, tissue=replace(model.tissue, kappa=bulk * model.tissue.kappa))


def along_gradient(model, v):
    """Distance (m, q) from the centroid along the gradient [m], and the gradient's size [1/m]."""
    x, volume = model.grid.points, model.grid.slopes[1]
    centroid = (x * volume[..., None]).sum((0, 1)) / volume.sum()
    g = np.array(v['gradient_per_m'])
    size = np.linalg.norm(g)
    return (x - centroid) @ (g / size), size


def two_layers(model, body, v, modulus, edge=0.006):
    """Two halves, each even, with an edge [m] between them."""
    s, g = along_gradient(model, v)
    # The least-squares slope of tanh(s / edge) over the body gives a step the gradient's size.
    step, volume = np.tanh(s / edge), model.grid.slopes[1]
    slope = (volume * s * step).sum() / (volume * s**2).sum()
    return scaled(model, np.exp(g / slope * step))


def linear_modulus(model, body, v, modulus):
    """The modulus itself is linear in place, not its logarithm."""
    s, g = along_gradient(model, v)
    return scaled(model, np.maximum(1 + g * s, 0.2))


def uneven_skin(model, body, v, modulus):
    """A skin that is by 40 % thicker on one flank, and thinner across from there."""
    def thickness(x):
        return v['thickness_mm'] * 1e-3 * (1 + 0.4 * np.cos(np.arctan2(x[..., 1], x[..., 0])))
    return loaded(model, make_layer(model.grid, thickness,
                                    (v['ratio'] - 1) * model.tissue.mu.mean()))


def skin_thick_on_top(model, body, v, modulus):
    """A skin that thickens from the base, 0.6 of what is said, to the top, 1.4 of it."""
    def thickness(x):
        return v['thickness_mm'] * 1e-3 * (0.6 + 0.8 * x[..., 2] / body.dome.height)
    return loaded(model, make_layer(model.grid, thickness,
                                    (v['ratio'] - 1) * model.tissue.mu.mean()))


def ellipsoid(model, body, v, modulus, axes=(1.4, 0.9, 1 / (1.4 * 0.9))):
    """An ellipsoid of the sphere's volume, its longest axis across the body."""
    arm = (model.grid.points - np.array(v['centre_mm']) * 1e-3) / np.array(axes)
    inside = np.linalg.norm(arm, axis=2) < v['radius_mm'] * 1e-3
    return scaled(model, np.where(inside, v['ratio'], 1.0))


def soft_edge(model, body, v, modulus, spread=1.64):
    """A lump that fades: the logarithm of its ratio is a biweight of the sphere's integral."""
    r = np.linalg.norm(model.grid.points - np.array(v['centre_mm']) * 1e-3, axis=2)
    share = np.clip(1 - (r / (spread * v['radius_mm'] * 1e-3))**2, 0, 1)**2
    return scaled(model, v['ratio']**share)


def exponential(model, body, v, modulus):
    """Demiray's exponential of the registry's curvature at rest, to third order.

    mu/(2b) (exp(b I) - 1) = mu/2 I + mu b/4 I^2 + mu b^2/12 I^3 + ..., I = Ib - 3, b = 4 ratio
    (Demiray 1972, J Biomech 5:309).
    """
    mu = model.tissue.mu
    return replace(model, tissue=replace(model.tissue, stiffening=v['ratio'] * mu,
                                         cubic=4 / 3 * v['ratio']**2 * mu))


def late(model, body, v, modulus, equal=0.08):
    """Yeoh's third term instead of the second: as large as that where Ib - 3 is `equal`."""
    cubic = v['ratio'] / equal * model.tissue.mu
    return replace(model, tissue=replace(model.tissue, cubic=cubic))


def along_the_skin(model, body, v, modulus):
    """Fibres that follow the shape: what of their direction lies in shells about the middle."""
    a, x = fibre_of(v), model.grid.points / np.array([*body.dome.radii, body.dome.height])**2
    n = x / np.linalg.norm(x, axis=2, keepdims=True)
    # Where the direction is nearly along the normal it is kept: there is no other to take.
    flat = a - 0.9 * (n @ a)[..., None] * n
    return fibred(model, flat / np.linalg.norm(flat, axis=2, keepdims=True), v['ratio'])


def twisted(model, body, v, modulus):
    """Fibres whose azimuth turns by 30 degrees either way from the base to the top."""
    a, turn = fibre_of(v), np.deg2rad(30.0) * height(model)
    c, s = np.cos(turn), np.sin(turn)
    fibre = np.stack([c * a[0] - s * a[1], s * a[0] + c * a[1], a[2] + 0 * c], axis=-1)
    return fibred(model, fibre, v['ratio'])


def swells_less_and_less(model, body, v, modulus, span=100.0):
    """Swelling that levels off."""
    steady, _ = swelling_drift(model, body, v, modulus, span)
    return steady, lambda t, y: grown(v, levelling(t - v['onset_s'])) / grown(v, span)


def shell_dries(model, body, v, modulus, span=100.0):
    """The outer half of the body swells or shrinks, by twice as much, and the inner does not."""
    stretch = np.where(inner_half(model, body), 0.0, 2 * grown(v, span))
    return swollen(model, stretch), lambda t, y: grown(v, t - v['onset_s']) / grown(v, span)


def levelling(seconds):
    """Seconds (t,) past an onset at which a steady drift is where one that levels off is."""
    return LEVELS_OFF * (1 - np.exp(-np.maximum(seconds, 0) / LEVELS_OFF))


def sets_less_and_less(v):
    """A drift of the stiffness that levels off."""
    steady = stiffness_drift(v)
    return lambda t: steady(v['onset_s'] + levelling(t - v['onset_s']))


def sets_in(v):
    """A drift of the stiffness that comes to its rate in `SETS_IN` seconds."""
    steady = stiffness_drift(v)

    def factor(t):
        gone = np.maximum(t - v['onset_s'], 0)
        lost = np.where(gone < SETS_IN, gone - gone**2 / (2 * SETS_IN), SETS_IN / 2)
        return steady(v['onset_s'] + gone - lost)
    return factor


def one_time(v):
    """One relaxation of both shares, at the mean of the logarithms of their times."""
    g = np.array([v['g1'], v['g2']])
    mean = np.exp(g @ np.log([v['tau1_s'], v['tau2_s']]) / g.sum())
    return Law((float(g.sum()),), (float(mean),))


def many_times(v):
    """Four relaxations: each of the two is spread over a third of its time and three times it."""
    g, tau = (v['g1'], v['g2']), (v['tau1_s'], v['tau2_s'])
    return Law(tuple(share / 2 for share in g for _ in range(2)),
               tuple(time * by for time in tau for by in (1 / 3, 3.0)))


def rational_softening(v):
    """Damage D x / (1 + x)."""
    return Law(damage=v['damage'], energy=v['energy_Pa'], softening=RATIONAL)


def softening_from_a_threshold(v):
    """No damage before a third of its energy."""
    return Law(damage=v['damage'], energy=v['energy_Pa'], softening=FROM_A_THRESHOLD)


OTHER_TISSUE = {
    'stiffness_scale': {'shear_alone': Form(shear_alone, same=('factor',)),
                        'more_below': Form(more_below)},
    'compressibility': {'graded': Form(bulk_graded), 'inside': Form(bulk_inside)},
    'stiffness_gradient': {'two_layers': Form(two_layers),
                           'linear_modulus': Form(linear_modulus)},
    'skin_layer': {'uneven': Form(uneven_skin), 'thick_on_top': Form(skin_thick_on_top)},
    'inclusion': {'ellipsoid': Form(ellipsoid, same=('centre_mm', 'radius_mm', 'ratio')),
                  'soft_edge': Form(soft_edge, same=('centre_mm',))},
    'strain_stiffening': {'exponential': Form(exponential), 'late': Form(late)},
    'anisotropy': {'along_the_skin': Form(along_the_skin), 'twisted': Form(twisted)},
    # A steady drift that resembles one that levels off most begins before it.
    'swelling_drift': {'levels_off': Form(swells_less_and_less),
                       'shell': Form(shell_dries, same=('onset_s',))},
    'stiffness_drift': {'levels_off': Form(sets_less_and_less),
                        'sets_in': Form(sets_in)},
}
OTHER_MEMORY = {
    'viscoelasticity': {'one_time': Form(one_time), 'many_times': Form(many_times)},
    'stress_softening': {'rational': Form(rational_softening),
                         'from_a_threshold': Form(softening_from_a_threshold)},
}
