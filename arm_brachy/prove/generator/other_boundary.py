"""Other laws of shape, weight, boundary and what presses; functions as in `tissue`.

Numbers that no value of the catalogue gives are our own choice.
"""
import numpy as np

from arm_brachy.prove.generator import loads
from arm_brachy.prove.generator.form import Form
from arm_brachy.prove.generator.mismount import moved_pad
from arm_brachy.prove.generator.other_tissue import height, inner_half
from arm_brachy.prove.generator.tissue import (
    breath,
    breath_vector,
    external_force,
    loaded,
    met,
    misplaced,
    obstacle,
    on_moved_base,
    on_springs,
    reshaped,
    reshaping,
    unglued,
    with_pads,
)


def heavy_inside(model, body, v, modulus):
    """The inner half of the body is a third denser than the outer."""
    density = body.density * np.where(inner_half(model, body), 8 / 7, 6 / 7)
    return loaded(model, loads.weight(model.grid, density, np.array(v['added_m_s2']) / modulus))


def heavy_below(model, body, v, modulus):
    """Density falls from the base to the top, at most by a fifth of its mean from that."""
    density = body.density * (1 - 0.2 * height(model))
    return loaded(model, loads.weight(model.grid, density, np.array(v['added_m_s2']) / modulus))


def flat_bump(grid, v):
    """The bump is a plateau: as wide as the registry's at half its height."""
    def plateau(x, centre, radius):
        r2 = ((x - centre)**2).sum(-1) / (0.54 * radius)**2
        return 1 / (1 + r2**3)
    return reshaping(grid, v, kernel=plateau)


def barrel(grid, v):
    """The body is wider, or narrower, in its middle, and not at its base and top."""
    top = grid.nodes[:, 2].max()

    def stretch(x):
        share = np.clip(x[:, 2] / top, 0, 1)
        wide = 6 * v['width'] * share * (1 - share)
        return np.column_stack([wide, wide, np.full(len(x), v['height'])])
    return reshaping(grid, v, stretch=stretch)


def shape_of(shape):
    """The function of a model that gives it the true shape by `shape`."""
    return lambda model, body, v, modulus: reshaped(model, shape(model.grid, v))


def aside_alone(body, pads, v):
    """A pad beside its place that is not turned."""
    return misplaced(body, pads, {**v, 'tilt_up_deg': 0.0, 'tilt_side_deg': 0.0})


def bent_frame(body, pads, v):
    """The neighbour of a pad that is beside its place is so too, by a third."""
    less = {k: v[k] / 3 for k in ('up_mm', 'side_mm', 'tilt_up_deg', 'tilt_side_deg')}
    names = [pad.name for pad in pads]
    near = names[(names.index(v['pads'][0]) + 1) % len(names)]
    return tuple(moved_pad(body.dome, pad, less) if pad.name == near else pad
                 for pad in misplaced(body, pads, v))


def mounted(places):
    """The function of a model that puts its pads where `places` has them."""
    return lambda model, body, v, modulus: with_pads(model, body, places(body, model.pads, v))


def one_side_softer(model, body, v, modulus):
    """A foundation that is stiffer towards x by a half, and softer across from there."""
    return on_springs(model, v, modulus, lambda x: 1 + 0.5 * x[..., 0] / body.dome.radii[0])


def soft_in_the_middle(model, body, v, modulus):
    """A plate that bends: softer in the middle, 0.6, than at the rim, 1.4."""
    radii = np.array(body.dome.radii)
    return on_springs(model, v, modulus,
                      lambda x: 0.6 + 0.8 * ((x[..., :2] / radii)**2).sum(-1))


def long_debond(model, body, v, modulus, longer=1.5):
    """An ellipse of the disc's area without glue, longer along x."""
    centre, radius = np.array(v['centre_mm']) * 1e-3, v['radius_mm'] * 1e-3

    def loose(x, area):
        arm = (x - centre) / [longer * radius, radius / longer, 1.0]
        return (arm[..., :2]**2).sum(-1) < 1
    return unglued(model, body, loose)


def peeled(model, body, v, modulus):
    """The base has peeled from its rim inwards, at the side of the disc, by half its area.

    At the rim glue bears more than in the middle: all of the area would be felt too much.
    """
    out = np.array(v['centre_mm'])[:2]
    out = out / np.linalg.norm(out)

    def loose(x, area):
        along = (x[..., :2] @ out).ravel()
        order = np.argsort(-along)
        gone = np.zeros(along.size, bool)
        gone[order] = np.cumsum(area.ravel()[order]) < np.pi / 2 * (v['radius_mm'] * 1e-3)**2
        return gone.reshape(area.shape)
    return unglued(model, body, loose)


def round_obstacle(model, body, v, modulus):
    """A round thing, of 40 mm radius, in place of the flat wall."""
    return obstacle(model, body, v, modulus, bend=25.0)


def foam(model, body, v, modulus):
    """A wall that gives: as stiff as tissue that is 10 mm thick."""
    return obstacle(model, body, v, modulus, stiff=100.0)


def flat_punch(model, body, v, modulus):
    """A finger with a flat end: even pressure over half the area."""
    def kernel(x, centre, radius):
        return loads.disc(x, centre, 0.7 * radius)
    return external_force(model, body, v, modulus, kernel=kernel)


def rises_and_falls(model, body, v, modulus):
    """A finger that presses ever more and then less: half a sine."""
    pressed, _ = external_force(model, body, v, modulus)

    def course(t, y):
        share = np.clip((t - v['onset_s']) / v['duration_s'], 0, 1)
        return np.sin(np.pi * share)
    return pressed, course


def breath_that_pauses(v, t):
    """Breath over its amplitude (t,) that stays longest breathed out (Lujan et al. 1999)."""
    angle = np.pi * v['frequency_Hz'] * t + np.deg2rad(v['phase_deg']) / 2
    return 2 * np.sin(angle)**4 - 0.75


def pausing_motion(v):
    """Displacement (t, 3) [m] of the base by `breath_that_pauses`."""
    return lambda t: breath_that_pauses(v, t)[:, None] * breath_vector(v)


def pausing(model, body, v, modulus):
    """Base moved as in `breathing`, by `breath_that_pauses`."""
    return (on_moved_base(model, lambda x: breath_vector(v)),
            lambda t, y: breath_that_pauses(v, t))


def plate_at_rest(v):
    """What is on the plate beside the body does not move (t, 3) where the base bulges."""
    return lambda t: np.zeros((len(t), 3))


def bulging(model, body, v, modulus):
    """The base bulges with the breath: most in the middle, nothing at its rim."""
    radii = np.array(body.dome.radii)

    def shift(x):
        share = np.clip(1 - ((x[..., :2] / radii)**2).sum(-1), 0, 1)
        return share[..., None] * breath_vector(v)
    return on_moved_base(model, shift), lambda t, y: breath(v, t)


# Where markers on pads and on the base go in forms that move them: name -> form -> function.
OTHER_MOUNTED = {
    'reference_shape': {'plateau': lambda body, pads, v: met(body, pads, v, flat_bump),
                        'barrel': lambda body, pads, v: met(body, pads, v, barrel)},
    'pad_misplacement': {'aside_alone': aside_alone, 'bent_frame': bent_frame},
}
OTHER_MOTION = {'pausing': pausing_motion, 'bulging': plate_at_rest}
OTHER_BOUNDARY = {
    'gravity': {'heavy_inside': Form(heavy_inside, same=('added_m_s2',)),
                'heavy_below': Form(heavy_below, same=('added_m_s2',))},
    'reference_shape': {'plateau': Form(shape_of(flat_bump)), 'barrel': Form(shape_of(barrel))},
    'pad_misplacement': {
        'aside_alone': Form(mounted(aside_alone), same=('up_mm', 'side_mm', 'pads')),
        'bent_frame': Form(mounted(bent_frame), same=('pads',))},
    'base_compliance': {'one_side_softer': Form(one_side_softer),
                        'soft_in_the_middle': Form(soft_in_the_middle)},
    'base_debond': {'ellipse': Form(long_debond), 'peeled': Form(peeled)},
    'obstacle': {'round': Form(round_obstacle, same=('centre_mm',)),
                 'foam': Form(foam, same=('centre_mm',))},
    'external_force': {
        'flat_punch': Form(flat_punch, same=('force_N', 'centre_mm', 'onset_s', 'duration_s')),
        'rises_and_falls': Form(rises_and_falls, same=('centre_mm',))},
    'breathing': {'pausing': Form(pausing, same=('amplitude_mm', 'frequency_Hz')),
                  'bulging': Form(bulging, same=('frequency_Hz', 'phase_deg'))},
}
