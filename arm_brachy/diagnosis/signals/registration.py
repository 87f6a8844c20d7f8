"""Where the optical tracker's frame lies in the world, from markers that no load moves."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.signals.stream import BASE, ENCODER, OPTICAL
from arm_brachy.recording.rigid import RigidFit, fit_rigid

FIRST = 0.2     # s at the beginning that count as rest for a body without pads
FEWEST = 4      # markers that stay in a fit from which others are left out
FOREIGN = 30.0  # placements by which markers that cannot be fitted show another frame than W
ODD = 5.0       # placements off the fit to the others: misplaced, not just glued by hand


@dataclass(frozen=True)
class Registration:
    """X_WM of the optical tracker at rest.

    R : (3, 3), p : (3,) [m]: tracker to world;  rest : (k, 3) [m] mean of every marker of the
        stream at rest, world frame, NaN where it was not seen then
    residual : (k,) [m] distance of these from the scene;  on : names it was fitted to, () = none
    span : (t_start, t_end) [s] that counted as rest, None if pads pushed from the start
    known : False if nothing could be fitted and the markers are not where the scene has them
    """

    R: np.ndarray
    p: np.ndarray
    rest: np.ndarray
    residual: np.ndarray
    on: tuple
    span: tuple | None
    known: bool = True

    def apply(self, points):
        """Take points (..., 3) from the tracker's frame to the world."""
        return points @ self.R.T + self.p


def register(evidence, placement):
    """Registration of the optical stream of an Evidence; None without one.

    placement : [m] standard deviation per axis of a marker's place on base or pad
    Fitted to the markers on base and pads (those on one pad by their middle) if there are three or
    more at rest, for these the scene knows better than those on tissue, without any that is far
    off; else to all. A recording that begins with a push is fitted to its base markers alone.
    Where these are too few, base and pads are fitted wherever the encoders say that they are.
    """
    optical = evidence.get(OPTICAL)
    if optical is None:
        return None
    span = rest_span(evidence)
    part = optical if span is None else optical.between(*span)
    seen = part.valid.any(axis=0)
    rest = np.full(optical.rest.shape, np.nan)
    rest[seen] = np.nanmean(part.values[:, seen], axis=0)
    hard = (BASE,) if span is None else (BASE, *evidence.pads)
    for index in (optical.on(*hard), np.arange(len(seen)) if span is not None else []):
        bodies = _bodies(optical, [i for i in index if seen[i]], evidence.pads)
        index, fit = _sound_fit(rest, optical.rest, bodies, placement)
        if fit is not None:
            break
    else:
        index, fit = _fit_along_the_way(evidence, optical, placement)
    known = fit is not None or _at_home(evidence, optical, placement)
    if fit is None:
        index, fit = [], RigidFit(np.eye(3), np.zeros(3), np.zeros(0))
    rest = fit.apply(rest)
    return Registration(fit.R, fit.p, rest, np.linalg.norm(rest - optical.rest, axis=1),
                        tuple(optical.names[i] for i in index), span, known)


def _fit_along_the_way(evidence, optical, placement):
    """As `_sound_fit` to base and pads, means over all times at which each was seen."""
    if evidence.get(ENCODER) is None:
        return [], None
    found = np.nanmean(optical.values, axis=0)
    wanted = np.nanmean(_carried(evidence, optical), axis=0)
    bodies = _bodies(optical, optical.on(BASE, *evidence.pads), evidence.pads)
    return _sound_fit(found, wanted, bodies, placement)


def _bodies(optical, index, pads):
    """Arrays of channels that are off together if at all: those on one pad, every other alone."""
    owner = {i: optical.bodies[i] if optical.bodies[i] in pads else i for i in index}
    return [np.array([i for i in index if owner[i] == one]) for one in dict.fromkeys(
        owner.values())]


def _at_home(evidence, optical, placement):
    """True if most markers are near their places in the scene, without any fit; of a body without
    pads, that may hang anywhere, always.
    """
    if evidence.get(ENCODER) is None:
        return True
    off = np.linalg.norm(optical.values - _carried(evidence, optical), axis=2)
    return bool(np.median(np.nanmedian(off, axis=0)) <= FOREIGN * placement)


def _carried(evidence, optical):
    """(n, k, 3) [m] places in the scene, those on pads with the encoders; NaN where not seen."""
    places = np.where(optical.valid[..., None], optical.rest, np.nan)
    encoder = evidence.get(ENCODER)
    q = encoder.at(optical.t)[..., 0]
    for i, pad in enumerate(encoder.names):
        way = np.outer(q[:, i], evidence.directions[evidence.pads.index(pad)])
        places[:, optical.on(pad)] += way[:, None]
    return places


def _sound_fit(found, wanted, bodies, placement):
    """(indices kept, RigidFit or None); the body that fits worst is left out while it is odd.

    bodies : arrays of markers; the middle of each counts, so that no pad has several votes
    """
    found, wanted = (np.array([points[body].mean(axis=0) for body in bodies]).reshape(-1, 3)
                     for points in (found, wanted))
    kept, fit = np.arange(len(bodies)), _fit(found, wanted)
    while fit is not None and len(kept) > FEWEST:
        worst = kept[int(np.argmax(fit.residual))]
        rest = kept[kept != worst]
        better = _fit(found[rest], wanted[rest])
        if better is None or np.linalg.norm(better.apply(found[worst]) - wanted[worst]) < (
                ODD * placement):
            break
        kept, fit = rest, better
    return [i for k in kept for i in bodies[k]], fit


def rest_span(evidence):
    """(t_start, t_end) [s] before the first push; None if the recording begins with one."""
    motion = motion_of(evidence)
    if motion is None:
        start = evidence.span[0]
        return start, start + FIRST
    stills = motion.stills()
    if stills and not stills[0][2] and stills[0][0] == motion.t[0]:
        return stills[0][:2]
    return None


def _fit(found, wanted):
    if len(found) < 3:
        return None
    try:
        return fit_rigid(found, wanted)
    except RecordingError:   # on one line
        return None
