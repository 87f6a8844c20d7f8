"""Effects in the tissue and at its boundary: each takes a model and gives the planted one.

Every function: model; body; values by the catalogue's names; modulus: true over labelled. Models
keep the labelled modulus and forces are scaled afterwards, so what has an absolute size of its
own (weight, springs, a finger) is divided by it.
"""
from dataclasses import replace

import numpy as np

from arm_brachy.prove.generator import loads
from arm_brachy.prove.generator.body import COARSE
from arm_brachy.prove.generator.layer import make_layer
from arm_brachy.prove.generator.mesh import normalised
from arm_brachy.prove.generator.mismount import moved_pad, moved_patch, to_ball


def scaled(model, factor):
    """Model with all moduli times `factor`, a number or (m, q)."""
    t = model.tissue
    return replace(model, tissue=replace(
        t, mu=factor * t.mu, kappa=factor * t.kappa, stiffening=factor * t.stiffening,
        cubic=factor * t.cubic, fibre_modulus=factor * t.fibre_modulus))


def loaded(model, load):
    """Model with one more load."""
    return replace(model, loads=(*model.loads, load))


def stiffness_scale(model, body, v, modulus):
    """Modulus off."""
    return scaled(model, v['factor'])


def compressibility(model, body, v, modulus):
    """Bulk modulus off."""
    return replace(model, tissue=replace(model.tissue, kappa=v['factor'] * model.tissue.kappa))


def stiffness_gradient(model, body, v, modulus):
    """Logarithm of the modulus linear in place."""
    x, volume = model.grid.points, model.grid.slopes[1]
    centroid = (x * volume[..., None]).sum((0, 1)) / volume.sum()
    return scaled(model, np.exp((x - centroid) @ np.array(v['gradient_per_m'])))


def inclusion(model, body, v, modulus):
    """Sphere of another modulus: the points nearest to its centre that fill its volume."""
    distance = np.linalg.norm(model.grid.points - np.array(v['centre_mm']) * 1e-3, axis=2)
    volume = model.grid.slopes[1]
    order = np.argsort(distance, axis=None)
    filled = np.cumsum(volume.ravel()[order])
    count = np.searchsorted(filled, 4 / 3 * np.pi * (v['radius_mm'] * 1e-3)**3)
    factor = np.ones(volume.size)
    factor[order[:count]] = v['ratio']
    return scaled(model, factor.reshape(volume.shape))


def skin_layer(model, body, v, modulus):
    """Stiffer layer under the surface."""
    excess = (v['ratio'] - 1) * model.tissue.mu.mean()
    return loaded(model, make_layer(model.grid, v['thickness_mm'] * 1e-3, excess))


def strain_stiffening(model, body, v, modulus):
    """Second constant of Yeoh's law."""
    tissue = replace(model.tissue, stiffening=v['ratio'] * model.tissue.mu)
    return replace(model, tissue=tissue)


def anisotropy(model, body, v, modulus):
    """One family of fibres."""
    return fibred(model, fibre_of(v), v['ratio'])


def fibre_of(v):
    """Unit vector (3,) along the fibres."""
    a, e = np.deg2rad([v['azimuth_deg'], v['elevation_deg']])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def fibred(model, fibre, ratio):
    """Model with fibres along `fibre` (3,) or (m, q, 3), of `ratio` times the shear modulus."""
    fibre = np.broadcast_to(fibre, model.tissue.fibre.shape).copy()
    return replace(model, tissue=replace(
        model.tissue, fibre=fibre, fibre_modulus=ratio * model.tissue.mu))


def gravity(model, body, v, modulus):
    """Weight that the label does not know of."""
    added = np.array(v['added_m_s2']) / modulus
    return loaded(model, loads.weight(model.grid, body.density, added))


def reference_shape(model, body, v, modulus):
    """Stress-free shape stretched, with a bump; what is glued to the skin goes with it."""
    return reshaped(model, reshaping(model.grid, v))


def reshaped(model, true):
    """Model whose stress-free shape has its points (n, 3) where the function `true` has them."""
    return replace(model, grid=replace(model.grid, moved=true(model.grid.nodes)))


def reshaping(grid, v, kernel=loads.biweight, stretch=None):
    """Where points (n, 3) of a body of `grid` are in its true shape, a function.

    A bump goes along the normal of the surface under it, on the average.
    kernel : its profile, of points, centre, radius;  stretch : points (n, 3) -> what the body is
    wider and higher by there (n, 3), even everywhere by default
    """
    centre, radius = np.array(v['bump_centre_mm']) * 1e-3, v['bump_radius_mm'] * 1e-3
    x, area, _ = grid.face_points(grid.mesh.surface)
    out = np.einsum('fq,fqi->i', kernel(x, centre, radius), area)
    out = out / np.linalg.norm(out)

    def true(x):
        bump = kernel(x, centre, radius) * (1 - np.maximum(1 - x[:, 2] / radius, 0)**2)
        wider = [v['width'], v['width'], v['height']] if stretch is None else stretch(x)
        return x + x * wider + (v['bump_height_mm'] * 1e-3 * bump)[:, None] * out

    return true


def met(body, pads, v, shape=reshaping):
    """The pads, each advanced or drawn back along its push to where the surface has gone."""
    true, out = shape(body.grid(COARSE), v), []
    for pad in pads:
        here, d = np.array([pad.centre]), np.array(pad.direction)
        n = body.dome.normal(normalised(to_ball(body.dome, here)))[0]
        centre = here[0] + d * ((true(here)[0] - here[0]) @ n) / (d @ n)
        out.append(replace(pad, centre=tuple(centre.tolist())))
    return tuple(out)


def pad_misplacement(model, body, v, modulus):
    """One pad beside its place."""
    return with_pads(model, body, misplaced(body, model.pads, v))


def with_pads(model, body, pads):
    """Model with its pads at the places of `pads`, the mesh under them as well."""
    grid = model.grid
    for i, (pad, there) in enumerate(zip(model.pads, pads, strict=True)):
        if there is not pad:
            grid = replace(grid, mesh=moved_patch(grid.mesh, body.dome, i, pad, there))
    return replace(model, pads=pads, grid=grid)


def misplaced(body, pads, v):
    """The pads, those that the values name beside their places."""
    return tuple(moved_pad(body.dome, pad, v) if pad.name in v['pads'] else pad for pad in pads)


def free_base(model):
    """Which nodes of the base may move (n,)."""
    free = np.zeros(len(model.grid.nodes), bool)
    free[model.grid.mesh.base_nodes] = True
    return free


def base_compliance(model, body, v, modulus):
    """Winkler foundation."""
    return on_springs(model, v, modulus)


def on_springs(model, v, modulus, factor=None):
    """Model on a Winkler foundation; factor: as `loads.springs` takes it."""
    k = [v[name] * 1e6 / modulus for name in ('normal_kPa_mm', 'tangential_kPa_mm')]
    return replace(loaded(model, loads.springs(model.grid, *k, factor)),
                   released=free_base(model))


def base_debond(model, body, v, modulus):
    """Disc of the base without glue."""
    centre, radius = np.array(v['centre_mm']) * 1e-3, v['radius_mm'] * 1e-3
    return unglued(model, body, lambda x, area: ((x - centre)**2).sum(-1) < radius**2)


def unglued(model, body, loose, stiff=1e4):
    """Model whose base is glued but where it is `loose`, see `loads.loose_base`.

    stiff : springs of the glue over Young's modulus [1/m]
    """
    load = loads.loose_base(model.grid, loose, stiff * body.modulus)
    return replace(loaded(model, load), released=free_base(model))


def obstacle(model, body, v, modulus, stiff=1e3, bend=0.0):
    """Wall beside the body.

    stiff : over Young's modulus [1/m];  bend : its curvature [1/m], as in `loads.wall`
    """
    centre = np.array(v['centre_mm']) * 1e-3
    out = surface_normal(model.grid, centre)
    return loaded(model, loads.wall(model.grid, centre, v['radius_mm'] * 1e-3, out,
                                    v['gap_mm'] * 1e-3, stiff * body.modulus, bend))


def surface_normal(grid, point):
    """Outward normal (3,) of the curved surface at the integration point nearest to `point`."""
    x, area, _ = grid.face_points(grid.mesh.surface)
    at = np.unravel_index(((x - point)**2).sum(2).argmin(), x.shape[:2])
    return area[at] / np.linalg.norm(area[at])


STATIC = {f.__name__: f for f in (
    stiffness_scale, compressibility, stiffness_gradient, inclusion, skin_layer,
    strain_stiffening, anisotropy, gravity, reference_shape, pad_misplacement, base_compliance,
    base_debond, obstacle)}
KINKED = ('obstacle', 'base_debond')


def external_force(model, body, v, modulus, kernel=loads.biweight):
    """Finger, while it presses."""
    load = loads.finger(model.grid, np.array(v['force_N']) / modulus,
                        np.array(v['centre_mm']) * 1e-3, v['radius_mm'] * 1e-3, kernel)
    end = v['onset_s'] + v['duration_s']
    return loaded(model, load), lambda t, y: ((t > v['onset_s']) & (t <= end)).astype(float)


def swelling_drift(model, body, v, modulus, span=100.0):
    """Swelling, as at `span` [s] past its onset; linear in it before that."""
    return (swollen(model, grown(v, span) * np.ones_like(model.tissue.swelling)),
            lambda t, y: grown(v, t - v['onset_s']) / grown(v, span))


def grown(v, seconds):
    """What a line of the body is longer by, over its length, `seconds` (t,) past the onset."""
    r = v['rate_per_min'] / 60 * np.maximum(seconds, 0)
    return r if v['rate_per_min'] >= 0 else 1 / (1 - r) - 1


def swollen(model, stretch):
    """Model whose lines are longer by `stretch` (m, q) of their length."""
    return replace(model, tissue=replace(model.tissue, swelling=1 + stretch))


def breath(v, t):
    """Displacement (t,) of the base by breathing, over its amplitude."""
    return np.sin(2 * np.pi * v['frequency_Hz'] * t + np.deg2rad(v['phase_deg']))


def breath_vector(v):
    """Displacement (3,) [m] of the base at its amplitude."""
    e = np.array(v['direction']) / np.linalg.norm(v['direction'])
    return v['amplitude_mm'] * 1e-3 * e


def base_motion(v):
    """Displacement (t, 3) [m] of the base by breathing, as a function of time."""
    return lambda t: breath(v, t)[:, None] * breath_vector(v)


def breathing(model, body, v, modulus):
    """Base pushed out to its amplitude."""
    return on_moved_base(model, lambda x: breath_vector(v)), lambda t, y: breath(v, t)


def on_moved_base(model, shift):
    """Model with its base, and what holds a body that is not clamped, moved by `shift`.

    shift : function of places (..., 3) [m] that gives displacements, (3,) or (..., 3) [m]
    """
    held = tuple(one.carried(shift) if isinstance(one, loads.Support) else one
                 for one in model.loads)
    nodes = model.grid.nodes[model.grid.mesh.base_nodes]
    return replace(model, shift=shift(nodes), loads=held)


TIMED = {f.__name__: f for f in (external_force, swelling_drift, breathing)}


def stiffness_drift(v):
    """Factor (t,) on all forces over time."""
    def factor(t):
        s = v['rate_per_min'] / 60 * np.maximum(t - v['onset_s'], 0)
        return 1 + s if v['rate_per_min'] >= 0 else 1 / (1 - s)
    return factor
