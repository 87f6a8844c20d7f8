"""Other laws of the effects in the sensors; functions as in `sensing`.

Shares and times that no value names are own choices, such that the effect peaks about where the
registry's does.
"""
import zlib

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.prove.generator.actuation import chosen
from arm_brachy.prove.generator.form import Form
from arm_brachy.prove.generator.other_actuation import two_goes

MINUTE = 60.0


def settled(t, time):
    """Share (t,) of what settles with time constant `time` [s] from t = 0 on."""
    return 1 - np.exp(-np.maximum(t, 0) / time)


def gone(t):
    """Share (t,) of the recording that is over."""
    return (t - t[0]) / (t[-1] - t[0])


def random_of(*values):
    """Random numbers that an effect's values decide: same values, same numbers."""
    return np.random.default_rng(zlib.crc32(np.hstack(values).tobytes()))


def creeping(streams, v, time=1.5):
    """A marker creeps on wet glue from the onset on, and comes to rest."""
    move(streams['optical'], v, settled(streams['optical'].true - v['onset_s'], time))


def in_two_goes(streams, v, pause=3.0):
    """A marker slips half the way at the onset, the other half `pause` [s] later."""
    move(streams['optical'], v, two_goes(streams['optical'].true, v['onset_s'], pause))


def move(optical, v, share):
    """Shift the marker by a share (t,) of its offset."""
    optical.values[:, v['marker']] += share[:, None] * np.array(v['offset_mm']) * 1e-3


def depth_most(streams, v, across=0.75, depth=1.75):
    """Cameras that look down: height is scaled more than what lies across the view."""
    stretch(streams['optical'], v, lambda arm: np.array([across, across, depth]))


def lens(streams, v, field=0.07):
    """A lens bends space: the scale grows with the square of the distance.

    field : where it is the registry's [m], about where markers on pads and base are
    """
    stretch(streams['optical'], v, lambda arm: (arm**2).sum(-1, keepdims=True) / field**2)


def stretch(optical, v, factor):
    """Scale positions by `factor` of their arms (..., 3) times the scale."""
    arm = optical.values - np.array(v['centre_mm']) * 1e-3
    optical.values = optical.values + v['scale'] * factor(arm) * arm


def iron_aside(streams, v, away=0.2):
    """Iron on one side, `away` [m] along x: stretch and rotation rise by the inverse cube."""
    em = streams['em']
    arm = em.values - np.array(v['centre_mm']) * 1e-3
    near = (away / np.linalg.norm(arm - [away, 0, 0], axis=-1, keepdims=True))**3
    em.values = em.values + near * bent(arm, v, np.ones(3)) + shifted(em, v, lambda d: d)


def plate_below(streams, v, across=0.6, upwards=1.75, reach=0.0015, usual=0.003):
    """A plate below stretches mostly upwards; metal on pads saturates within `reach` [m].

    usual : travel [m] at which the pads shift as much as in the registry
    """
    em = streams['em']
    arm = em.values - np.array(v['centre_mm']) * 1e-3
    error = bent(arm, v, np.array([across, across, upwards]))
    # Above a plate that is large an error fades with height alone.
    fade = np.exp(-np.abs(arm[..., 2:]) / (v['extent_mm'] * 1e-3))
    em.values = em.values + error * fade + shifted(
        em, v, lambda d: usual * np.expm1(-d / reach) / np.expm1(-usual / reach))


def bent(arm, v, axes):
    """Linear error (t, k, 3) of arms (t, k, 3); axes (3,): share of the stretch along each."""
    return (v['gradient_mm_per_mm'] * axes * arm
            + np.cross(np.array(v['rotation_mm_per_mm']), arm))


def shifted(em, v, law):
    """Shift (t, 1, 3) of all targets by a law of the travel of metal on pads."""
    moved = em.travel if v['pad'] < 0 else em.travel[:, [v['pad']]]
    travel = np.abs(moved).sum(1)
    return (law(travel)[:, None] * np.array(v['pad_coupling_mm_per_mm']))[:, None]


def settling(streams, v, time=20.0):
    """Targets are off ever more, until the electronics are warm."""
    em = streams['em']
    share = settled(em.true, time)
    em.values[:, chosen(em.names, v['tools'])] += (
        share[:, None] * np.array(v['offset_mm']) * 1e-3)[:, None]


def turning(streams, v, turn=60.0):
    """An offset that turns evenly, with its sensor: by `turn` [degrees] over the recording."""
    em = streams['em']
    offset = np.array(v['offset_mm']) * 1e-3
    axis = np.cross(offset, np.eye(3)[np.argmin(np.abs(offset))])
    axis = axis / np.linalg.norm(axis)
    angle = np.deg2rad(turn) * (gone(em.true) - 0.5)
    turned = Rotation.from_rotvec(angle[:, None] * axis).apply(offset)
    em.values[:, chosen(em.names, v['tools'])] += turned[:, None]


def gain_with_load(streams, v):
    """Sensitivity is right for small loads, and wrong by the gain at the largest of the run."""
    forces = streams['forces']
    which = chosen(forces.names, v['pads'])
    forces.values[:, which] *= 1 + v['gain'] * load(forces.values[:, which])


def gain_of_one_axis(streams, v):
    """One bridge is wrong: that of the axis that carries most."""
    forces = streams['forces']
    for i in np.flatnonzero(chosen(forces.names, v['pads'])):
        forces.values[:, i, strongest(forces.values[:, i])] *= 1 + v['gain']


def load(forces):
    """Size (t, k, 1) of forces (t, k, 3), over the largest of each pad."""
    size = np.linalg.norm(forces, axis=-1, keepdims=True)
    return size / np.maximum(size.max(axis=0), 1e-9)


def strongest(force):
    """The axis that carries most of a force (t, 3)."""
    return int((force**2).mean(axis=0).argmax())


def rocking(streams, v):
    """A sensor on a soft post turns under load: it shows the same forces in a turned frame."""
    forces = streams['forces']
    for i in np.flatnonzero(chosen(forces.names, v['pads'])):
        force = forces.values[:, [i]]
        turn = load(force)[:, 0] * askew(force[:, 0], matrix(v))
        forces.values[:, i] = Rotation.from_rotvec(turn).apply(force[:, 0])


def askew(force, shares):
    """Rotation vector (3,) that takes the largest of forces (t, 3) aside as the shares would.

    By as much as they add to it in all, though what they add along it no turn can.
    """
    along = force[(force**2).sum(axis=1).argmax()]
    along = along / np.linalg.norm(along)
    shown = shares @ along
    axis = np.cross(along, shown)
    return np.linalg.norm(shown) * axis / max(np.linalg.norm(axis), 1e-12)


def talk_with_load(streams, v):
    """Axes talk only under load: the shares are those at the largest load of the run."""
    forces = streams['forces']
    which = chosen(forces.names, v['pads'])
    force = forces.values[:, which]
    forces.values[:, which] = force + load(force) * (force @ matrix(v).T)


def talk_at_once(streams, v, bend=2.5):
    """Axes talk at small loads already, and hardly more at larger ones: something gives way."""
    forces = streams['forces']
    which = chosen(forces.names, v['pads'])
    force = forces.values[:, which]
    share = np.maximum(load(force), 1e-9)
    more = np.expm1(-bend * share) / np.expm1(-bend) / share
    forces.values[:, which] = force + more * (force @ matrix(v).T)


def matrix(v):
    """Shares (3, 3) without diagonal: rows what is shown, columns what acts."""
    out = np.zeros((3, 3))
    for axis in range(3):
        out[(axis + 1) % 3, axis] = v['onward'][axis]
        out[(axis + 2) % 3, axis] = v['backward'][axis]
    return out


def warming(streams, v, time=20.0):
    """The zero settles: after a minute it is all of a bias, and what a rate comes to by then."""
    share = settled(streams['forces'].true, time) / settled(MINUTE, time)
    add(streams['forces'], v, share[:, None] * after_a_minute(v))


def wandering(streams, v, size=0.2, longest=600):
    """On top of the registry's law the zero walks at random, and passes it again after a minute.

    size : rms of the walk in the first minute, over the error at its end;  longest : [s]
    """
    forces = streams['forces']
    seconds = np.arange(longest + 1.0)
    rng = random_of(v['rate_N_min'], v['bias_N'])
    walk = np.r_[0, np.cumsum(rng.normal(size=longest))]
    walk = walk - seconds / MINUTE * walk[int(MINUTE)]
    walk = size * walk / np.sqrt((walk[:int(MINUTE)]**2).mean())
    even = np.array(v['bias_N']) + forces.true[:, None] * np.array(v['rate_N_min']) / MINUTE
    add(forces, v, even + np.interp(forces.true, seconds, walk)[:, None] * after_a_minute(v))


def after_a_minute(v):
    """Error (3,) [N] of the registry's law after a minute."""
    return np.array(v['bias_N']) + np.array(v['rate_N_min'])


def add(forces, v, error):
    """Add an error (t, 3) [N] to the forces on the pads that have it."""
    forces.values[:, chosen(forces.names, v['pads'])] += error[:, None]


def drifting(streams, v):
    """A clock that runs wrong: stamps late by half the delay at first, by 1.5 of it at the end."""
    stream = streams[v['stream']]
    stream.stamps = stream.stamps + v['delay_ms'] * 1e-3 * (0.5 + gone(stream.true))


def jittered(streams, v, jitter=0.3, apart=1e-4):
    """Every sample waits for its stamp, the delay give or take `jitter` of it, in its turn.

    apart : stamps are at least so far apart [s]
    """
    stream = streams[v['stream']]
    share = 1 + random_of(v['delay_ms']).uniform(-jitter, jitter, len(stream.true))
    spaced = apart * np.arange(len(stream.true))
    late = stream.stamps + v['delay_ms'] * 1e-3 * share
    stream.stamps = np.maximum.accumulate(late - spaced) + spaced


OTHER_SENSING = {
    # They begin at the onset, but a step that resembles them most is later.
    'marker_slip': {'creeping': Form(creeping, same=('offset_mm',)),
                    'in_two_goes': Form(in_two_goes, same=('offset_mm',))},
    'optical_scale': {'depth_most': Form(depth_most), 'lens': Form(lens)},
    'em_distortion': {'iron_aside': Form(iron_aside), 'plate_below': Form(plate_below)},
    'em_offset': {'settling': Form(settling), 'turning': Form(turning, same=('offset_mm',))},
    'force_gain': {'gain_with_load': Form(gain_with_load),
                   'gain_of_one_axis': Form(gain_of_one_axis)},
    # A sensor that is turned for good is the registry's, to first order.
    'axis_crosstalk': {'rocking': Form(rocking), 'talk_with_load': Form(talk_with_load),
                       'talk_at_once': Form(talk_at_once)},
    'force_drift': {'warming': Form(warming), 'wandering': Form(wandering)},
    'clock_offset': {'drifting': Form(drifting),
                     'jittered': Form(jittered, same=('delay_ms',))},
}
