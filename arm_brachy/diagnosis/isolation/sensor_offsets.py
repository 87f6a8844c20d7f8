"""Rest against the scene: zero and scale of the trackers, markers with exchanged names."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arm_brachy.diagnosis.isolation.pad_tracking import push_frame
from arm_brachy.diagnosis.results.finding import Finding, sigma, threshold
from arm_brachy.diagnosis.signals.stream import BASE, EM, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.subset_selection import INDISTINCT
from arm_brachy.tissue.contact_poses import ridden, tilted

CENTRE = np.zeros(3)    # of the distortion, by convention the scene origin
EXCHANGED = 5.0         # placements by which an exchange must bring two markers nearer


@dataclass(frozen=True)
class Scale:
    """Apparent over true length minus one: value, sd, and between which markers."""

    value: float
    sd: float
    markers: tuple


def base_scale(prepared):
    """Scale of the optical tracker from the distances between base markers; None below two.

    A similarity fit (Umeyama 1991, IEEE PAMI 13:376) of their mean positions; its error is that of
    their places on the base, as the calibration declares it.
    """
    stream, _ = prepared.on(OPTICAL, BASE)
    if stream is None or len(stream.names) < 2:
        return None
    found = np.nanmean(stream.values, axis=0)
    x, y = stream.rest - stream.rest.mean(axis=0), found - found.mean(axis=0)
    size = float(np.sum(x ** 2))
    # the rotation was taken out by the registration; what is left of it enters in second order
    scale = float(np.sum(x * y)) / size - 1.0
    return Scale(scale, float(prepared.calibration.placement / np.sqrt(size)), stream.names)


def em_findings(prepared):
    """Findings about the EM tracker at rest: a common shift, or a linear distortion.

    Needs a time before the first push. With three tools or more a shift and a stretch about the
    scene origin can be told apart; with fewer they are rivals.
    Test: diagnosis/structural/test_rest.py
    """
    em, registration = prepared.evidence.get(EM), prepared.registration
    span = registration.span if registration is not None else None
    if em is None or span is None or prepared.motion is None:
        return ()
    part = em.between(*span)
    count = part.valid.sum(axis=0)
    if not (count >= 10).any():
        return ()
    seen = np.flatnonzero(count >= 10)
    off = np.nanmean(part.values[:, seen], axis=0) - em.rest[seen]
    noise = np.sqrt(prepared.noise[EM].mean_variance(count)[seen])
    return _em_offset(prepared, em, seen, off, noise, span)


def _em_offset(prepared, em, seen, off, noise, span):
    zero = prepared.calibration.em_registration
    shift, sd = off.mean(axis=0), np.sqrt(np.sum(noise ** 2, axis=0)) / len(off)
    z = sigma(shift, sd, zero)
    if z <= threshold(1, 3):
        return ()
    weight = 1.0 / (noise ** 2 + zero ** 2)
    arm = em.rest[seen] - CENTRE
    power = float(np.sum(weight * arm ** 2))
    gradient = float(np.sum(weight * arm * off)) / power
    left_shift = float(np.sum(weight * (off - shift) ** 2))
    left_stretch = float(np.sum(weight * (off - gradient * arm) ** 2))
    if left_stretch + INDISTINCT < left_shift:
        return (Finding(EM, '', 'em_distortion', 'gradient', gradient, '1', power ** -0.5,
                        gradient * power ** 0.5, *span,
                        f'At rest the EM positions are stretched by {100.0 * gradient:.1f} % '
                        'about the origin.', rivals=('reference_shape',),
                        parameters={'gradient': gradient}),)
    # one tool, or several that are not off alike: a field that turns, or bends about another
    # centre, may be that as well
    one_or_apart = len(off) == 1 or np.sqrt(left_shift) > threshold(1, 3 * (len(off) - 1))
    alike = one_or_apart or left_stretch < left_shift + INDISTINCT
    rivals = ('reference_shape',) + (('em_distortion',) if alike else ())
    names = ', '.join(em.names[i] for i in seen)
    return (Finding(EM, '', 'em_offset', 'offset', shift, 'm', sd, z, *span,
                    f'At rest the EM positions of {names} are off by '
                    f'{1e3 * np.linalg.norm(shift):.2f} mm.', rivals=rivals,
                    parameters={'offset': tuple(shift)}, slack=zero),)


def exchanged_findings(prepared):
    """Findings about pairs of tissue markers that fit the scene with their names exchanged."""
    stream, _ = prepared.on(OPTICAL, TISSUE)
    registration = prepared.registration
    if stream is None or registration.span is None or not registration.on:
        return ()
    part = stream.between(*registration.span)
    seen = np.flatnonzero(part.valid.any(axis=0))
    rest = {i: np.nanmean(part.values[:, i], axis=0) for i in seen}
    placement, out = prepared.calibration.placement, []
    for i, j in combinations(seen, 2):
        straight = np.hypot(*(np.linalg.norm(rest[k] - stream.rest[k]) for k in (i, j)))
        crossed = np.hypot(np.linalg.norm(rest[i] - stream.rest[j]),
                           np.linalg.norm(rest[j] - stream.rest[i]))
        gain = float(straight - crossed) / placement
        if gain > EXCHANGED and crossed < EXCHANGED * placement:
            out.append(Finding(
                OPTICAL, stream.names[i], None, '', float(straight), 'm', float(placement), gain,
                float(stream.t[0]), float(stream.t[-1]),
                f'{stream.names[i]} and {stream.names[j]} have exchanged names: at rest each sits '
                'where the scene has the other.'))
    return tuple(out)


def pad_place_findings(prepared, tilts):
    """Findings about pads that at rest sit beside their place in the scene, and their markers.

    tilts : pad -> (up, side) [rad] by which its push was seen to go another way

    Along the push a marker may be off because the pad touches elsewhere, which is no fault. Of one
    marker on a pad nothing tells whether it is the pad or the marker that sits elsewhere; of
    several that are off alike it is the pad, of several that are not each that is off. What swings
    with a push that is tilted is no place of its own.
    """
    evidence, registration = prepared.evidence, prepared.registration
    if registration is None or registration.span is None or not registration.on:
        return ()
    out = []
    for pad, direction in zip(evidence.scene.pads, evidence.directions, strict=True):
        out += _places_on(prepared, pad.name, push_frame(direction),
                          _swing(pad, direction, tilts.get(pad.name)))
    return tuple(out)


def _swing(pad, direction, tilt):
    """Function from points (3,) on a scene's pad to how far they go [m] as it is tilted.

    direction : (3,) of its push;  tilt : (up, side) [rad], None = not
    """
    if tilt is None:
        return np.zeros_like
    before, after = ((np.array(pad.centre), way) for way in (direction, tilted(direction, *tilt)))
    return lambda point: ridden(point, before, after) - point


def _places_on(prepared, pad, frame, swing):
    """Findings about one pad and the markers on it; swing : as of `_swing`."""
    optical, placement = prepared.evidence.get(OPTICAL), prepared.calibration.placement
    limit = threshold(len(prepared.evidence.pads), 2)
    off = {optical.names[k]: _less(frame @ (prepared.registration.rest[k] - optical.rest[k]),
                                   frame @ swing(optical.rest[k])) for k in optical.on(pad)}
    off = {name: way for name, way in off.items() if np.isfinite(way).all()}
    odd = {name: z for name, way in off.items()
           if (z := sigma(way[1:], 0.0, placement)) > limit}
    if not odd:
        return []
    middle = np.mean(list(off.values()), axis=0)
    if any(sigma(way[1:] - middle[1:], 0.0, placement) > limit for way in off.values()):
        return [_marker_aside(prepared, name, frame.T @ off[name], z) for name, z in odd.items()]
    lead = max(odd, key=odd.get)
    several = len(off) > 1
    return [Finding(
        OPTICAL, lead, 'pad_misplacement', 'up', float(middle[1]), 'm',
        placement / np.sqrt(len(off)), odd[lead], *prepared.registration.span,
        f'At rest the {"markers" if several else "marker"} on {pad} '
        f'{"sit" if several else "sits"} {1e3 * np.hypot(*middle[1:]):.1f} mm beside '
        f'{"their places" if several else "its place: pad or marker"}.',
        rivals=() if several else ('marker_slip',), parameters={
            'up': float(middle[1]), 'side': float(middle[2]), 'pads': (pad,)})]


def _less(off, swung):
    """How far (3,) [m] a marker is off its place, less its swing, if that has it nearer.

    Of a stage that is mounted askew with a pad that is not, no marker swings.
    """
    return min(off, off - swung, key=lambda way: np.linalg.norm(way[1:]))


def _marker_aside(prepared, name, off, z):
    """That one of several markers on a pad sits off [m] (3,) its place, the others do not."""
    start = float(prepared.registration.span[0])
    return Finding(OPTICAL, name, 'marker_slip', 'offset', off, 'm',
                   prepared.calibration.placement, z, *prepared.registration.span,
                   f'At rest {name} sits {1e3 * np.linalg.norm(off):.1f} mm off its place, other '
                   'markers on its pad do not.',
                   parameters={'marker': name, 'onset': start, 'offset': tuple(map(float, off))})
