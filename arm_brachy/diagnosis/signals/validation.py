"""What no diagnosis can be made of, refused in one line: units, wrong scene, wrong clocks."""

from itertools import combinations

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE
from arm_brachy.evaluation.regimes import TOUCH
from arm_brachy.recording.rigid import fit_rigid

OUT_OF_SCALE = 30.0     # between any honest misfit and the 1000 of a wrong unit
FAINT = 300.0           # times less force than a punch: no tissue is so soft by mistake
STILLEST = 2e-5         # m, less than the noise of any EM tracker (0.5 mm; 0.1 mm at best)
FELT = 0.3              # N that any load cell for it shows
SHARED = 0.5            # of the shorter stream that must lie within the other's time
LENGTHS = {'10': 10.0, '0.1': 0.1, '100': 100.0, '0.01': 0.01, '25.4': 25.4}
MISSHAPEN = 0.15        # of the markers' rms distance from their middle, left by a rigid fit
FEWEST_READ = 10        # samples of all encoders at one time
LEAST_TRAVEL = 0.02     # of the radius of a pad
LEAST_MOTION = 5.0      # standard deviations, of a body without pads
SHORTEST, LONGEST = 0.5, 43200.0    # s, of a recording: 60 s in milliseconds are 17 h
RAREST = 5.0            # s between the samples of the fastest stream
MEDIAN_CHI2 = 0.4549    # of a squared standard normal


def refuse_twice(evidences):
    """Raise RecordingError if two loading.Evidence are one recording: every value is the same.

    It would count twice, or be tested on what it was fitted to.
    """
    for (i, one), (j, other) in combinations(enumerate(evidences, start=1), 2):
        if one.streams.keys() == other.streams.keys() and all(
                np.array_equal(stream.values, other.streams[kind].values, equal_nan=True)
                for kind, stream in one.streams.items()):
            raise RecordingError(
                f'{other.name}: recordings {i} and {j} of {len(evidences)} hold the same values '
                f'in every stream; each must be given once, as fitted, held out or null: leave '
                'one out')


def refuse_empty(name, streams):
    """Raise RecordingError if no stream was recorded that a model could be held against."""
    if not set(streams) - {ENCODER}:
        raise RecordingError(f'{name}: holds no forces, markers or EM tools that live; record '
                             'actuators/state and at least one of optical/markers, em/.../pose, '
                             'force/.../wrench')


def refuse_lost_encoders(name, streams):
    """Raise RecordingError if there are hardly any times at which every encoder was read."""
    encoder = streams.get(ENCODER)
    if encoder is None:
        return
    together = int(encoder.valid.all(axis=1).sum())
    if together < FEWEST_READ:
        worst = encoder.names[int(np.argmin(encoder.valid.sum(axis=0)))]
        raise RecordingError(
            f'{name}: the travel of all pads together is known at {together} times, at least '
            f'{FEWEST_READ} are needed; least is known of {worst}: mend the import of the '
            'encoders')


def refuse_wrong_time(name, streams):
    """Raise RecordingError if stamps are in no seconds: too long, too short, or hardly any sample.

    streams : Stream each. A push protocol takes minutes; what settles by itself takes seconds.
    """
    streams = [s for s in streams if len(s.t) > 1]
    if not streams:
        return
    span = max(s.t[-1] - s.t[0] for s in streams)
    period = min(s.period for s in streams)
    if SHORTEST <= span <= LONGEST and period <= RAREST:
        return
    raise RecordingError(
        f'{name}: lasts {span:.3g} s with a sample every {period:.3g} s at best; must be '
        f'{SHORTEST:g} s to {LONGEST / 3600.0:g} h with one every {RAREST:g} s at least: mend the '
        'unit of time in the import, or cut the recording')


def refuse_wrong_units(name, streams, scene):
    """Raise RecordingError if a stream is out of scale with the scene by more than 30 times.

    Compared are: travel with the pads' stroke, the spread (or distance from the origin) of
    positions with that in the scene, and forces with what a rigid punch of the pad's radius needs
    on an elastic half space, F = 2 r E q / (1 - nu^2) (Sneddon 1965, Int J Eng Sci 3:47).
    """
    for kind in (OPTICAL, EM):
        if kind in streams:
            _check_positions(name, streams[kind], scene)
    if ENCODER in streams and EM in streams:
        _check_still(name, streams[EM], streams[ENCODER])
    if ENCODER in streams and scene.pads:
        stroke = max(pad.stroke for pad in scene.pads)
        travel = float(np.nanmax(np.abs(streams[ENCODER].values)))
        if stroke > 0.0 and travel > OUT_OF_SCALE * stroke:
            raise RecordingError(
                f'{name}: the encoders reach {travel:.3g} m, the pads of scene {scene.name} have '
                f'a stroke of {stroke:.3g} m; must be alike: give the unit that the file is in, '
                'by `unit` of the encoders in the column map')
        if FORCE in streams:
            _check_forces(name, streams[FORCE], travel, scene)


def _check_positions(name, stream, scene):
    """Compare spreads; of a single point only its distance from the origin, and only upwards."""
    middle = np.nanmedian(stream.values, axis=0)
    measured, expected = _spread(middle), _spread(stream.rest)
    if expected > 0.0:
        wrong = not expected / OUT_OF_SCALE <= measured <= expected * OUT_OF_SCALE
    else:
        measured, expected = float(np.linalg.norm(middle, axis=1).max()), _reach(scene)
        wrong = measured > OUT_OF_SCALE * expected
    if wrong:
        raise RecordingError(
            f'{name}: {stream.kind} positions span {measured:.3g} m, in scene {scene.name} '
            f'{expected:.3g} m; must be alike: give the unit that the file is in, by `unit` of '
            f'{stream.kind} in the column map, or that of the scene')


def _check_still(name, stream, encoder):
    """A tool whose place varies by less than any tracker's noise is in another unit."""
    travel = float(np.nanmax(np.ptp(encoder.values[encoder.valid.all(axis=1), :, 0], axis=0),
                             initial=0.0))
    moved = float(np.nanmax(np.nanmax(stream.values, axis=0) - np.nanmin(stream.values, axis=0)))
    if 0.0 < moved < min(travel / FAINT, STILLEST):
        raise RecordingError(
            f'{name}: EM tools stay within {1e3 * moved:.2g} mm, noise and all, while pads travel '
            f'{1e3 * travel:.3g} mm; must be alike: give the unit that the file is in, by `unit` '
            'of em in the column map')


def _spread(points):
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _reach(scene):
    """Largest distance from the origin of anything in the scene [m]."""
    points = [pad.centre for pad in scene.pads]
    points += [item.position for item in (*scene.markers, *scene.targets)]
    return float(np.linalg.norm(np.array(points), axis=1).max())


def _check_forces(name, stream, travel, scene):
    radius = max(pad.radius for pad in scene.pads)
    punch = 2.0 * radius * scene.material.E * travel / (1.0 - scene.material.nu ** 2)
    largest = float(np.nanmax(np.abs(stream.values)))
    if largest > OUT_OF_SCALE * max(punch, 1.0):
        raise RecordingError(
            f'{name}: forces reach {largest:.3g} N, where pushing {1e3 * travel:.3g} mm into '
            f'scene {scene.name} takes about {punch:.3g} N; forces must be in newtons: mend the '
            'unit of the import')
    if 0.0 < largest < punch / FAINT and punch > FELT:
        raise RecordingError(
            f'{name}: forces reach {largest:.3g} N only, where pushing {1e3 * travel:.3g} mm into '
            f'scene {scene.name} takes about {punch:.3g} N; must be in newtons, of cells that '
            'feel the tissue: mend the unit of the import, or leave these forces out')


def refuse_apart_in_time(name, streams):
    """Raise RecordingError if a stream shares less than half of the shorter one's time."""
    first = streams.get(ENCODER) or next(iter(streams.values()))
    for stream in streams.values():
        shared = min(first.t[-1], stream.t[-1]) - max(first.t[0], stream.t[0])
        shorter = min(first.t[-1] - first.t[0], stream.t[-1] - stream.t[0])
        if stream is not first and shared < SHARED * shorter:
            raise RecordingError(
                f'{name}: {first.kind} runs from {first.t[0]:.6g} to {first.t[-1]:.6g} s, '
                f'{stream.kind} from {stream.t[0]:.6g} to {stream.t[-1]:.6g} s; they must '
                'overlap: bring both on one clock before the import')


def refuse_other_shape(name, streams, scene):
    """Raise RecordingError if the markers at rest are not those of the scene, wherever they lie.

    A rigid fit of three markers or more, over the frames in which no pad pushes, may leave at most
    15 % of the markers' spread. Scenes without pads are compared at their first frames, with the
    tissue free to hang.
    """
    stream = streams.get(OPTICAL)
    if stream is None:
        return
    frames = _unpushed(streams)
    if frames is None:
        stream = stream.channels(np.setdiff1d(np.arange(len(stream.names)), stream.on(TISSUE)))
        frames = slice(None, 10)
    seen = stream.valid[_frames(stream, frames)].any(axis=0)
    if seen.sum() < 3:
        return
    stream = stream.channels(np.flatnonzero(seen))
    found = np.nanmedian(stream.values[_frames(stream, frames)], axis=0)
    refuse_misshapen(name, stream.names, found, stream.rest, scene)


def refuse_misshapen(name, names, found, wanted, scene):
    """Raise RecordingError if markers have not the shape that they should, wherever they lie.

    names : (k,);  found, wanted : (k, 3) [m], at least three. If it is only that two names are
    exchanged, whichever, they are named.
    """
    size, misfit = _spread(wanted), _misfit(found, wanted)
    if misfit is None or misfit <= MISSHAPEN * size:
        return
    for words, ratio in LENGTHS.items():
        if (left := _misfit(found * ratio, wanted)) is not None and left <= MISSHAPEN * size:
            raise RecordingError(f'{name}: the markers fit scene {scene.name} only with all '
                                 f'lengths times {words}; mend the unit of the import')
    pairs = {pair: _misfit(_exchanged(found, *pair), wanted)
             for pair in combinations(range(len(names)), 2)}
    pairs = {pair: left for pair, left in pairs.items() if left is not None}
    if pairs and min(pairs.values()) < MISSHAPEN * size:
        one, two = min(pairs, key=pairs.get)
        raise RecordingError(f'{name}: the markers fit scene {scene.name} only with the names '
                             f'of {names[one]} and {names[two]} exchanged; mend the import')
    one, two = (int(i) for i in np.argsort(-fit_rigid(found, wanted).residual)[:2])
    raise RecordingError(
        f'{name}: at rest the markers miss those of scene {scene.name} by {1e3 * misfit:.3g} '
        f'mm rms after the best rigid fit, {100.0 * misfit / size:.0f} % of their spread, at '
        f'most {100.0 * MISSHAPEN:.0f} % is a deformation; most at {names[one]} and {names[two]}: '
        'give the scene it was made with')


def _misfit(found, wanted):
    """[m] rms left by the best rigid fit; None where it leaves a rotation open (on one line)."""
    try:
        return float(np.sqrt(np.mean(fit_rigid(found, wanted).residual ** 2)))
    except RecordingError:
        return None


def _exchanged(points, one, two):
    out = points.copy()
    out[[one, two]] = points[[two, one]]
    return out


def _unpushed(streams):
    """(t_start, t_end) of the first time without a push; None if there was none."""
    if ENCODER not in streams:
        return None
    encoder = streams[ENCODER]
    pushed = (np.nan_to_num(encoder.values[..., 0]) > TOUCH).any(axis=1)
    if pushed[0]:
        return None
    end = int(np.argmax(pushed)) if pushed.any() else len(pushed) - 1
    return encoder.t[0], encoder.t[max(end - 1, 0)]


def _frames(stream, span):
    if isinstance(span, slice):
        return span
    return (stream.t >= span[0]) & (stream.t <= span[1])


def refuse_too_little_motion(name, streams, scene):
    """Raise RecordingError if no pad moved by 2 % of its radius, or without pads no marker."""
    if scene.pads:
        encoder = streams[ENCODER]
        travel = float(np.ptp(encoder.values[encoder.valid.all(axis=1), :, 0], axis=0).max())
        least = LEAST_TRAVEL * max(pad.radius for pad in scene.pads)
        if travel < least:
            raise RecordingError(
                f'{name}: no pad travels more than {1e3 * travel:.3g} mm; a diagnosis needs at '
                f'least {1e3 * least:.2g} mm: push further (or mend the unit of the import)')
        return
    stream = streams.get(OPTICAL) or streams[EM]
    steps = np.diff(stream.values, axis=0)
    noise = np.sqrt(np.nanmedian(steps ** 2, axis=0) / (2.0 * MEDIAN_CHI2))
    if not np.any(np.nanstd(stream.values, axis=0) > LEAST_MOTION * noise):
        raise RecordingError(f'{name}: nothing moves beyond the noise of {stream.kind}; a '
                             'diagnosis needs a load that changes')
