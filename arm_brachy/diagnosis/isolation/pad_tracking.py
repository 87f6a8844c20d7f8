"""Marker on a pad minus encoder: what actuator, transmission and clocks do, without any tissue.

Along the push direction r = y - u, y the marker's travel and u the encoder's. A gain g gives g u,
a compliance c gives -c F, play of width w the play operator less u, a delay D of the marker's
stamps -D du/dt, lost steps or a slipped marker a step. What follows the place beyond that
(`positioning_error`) is taken out before anything else is asked.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from arm_brachy.diagnosis.isolation.positioning_error import Course, course_of
from arm_brachy.diagnosis.signals.regressors import (
    drift_columns,
    history_columns,
    play,
    slope,
)
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.change_points import steps
from arm_brachy.diagnosis.statistics.change_retest import steadfast
from arm_brachy.diagnosis.statistics.gls import regress
from arm_brachy.diagnosis.statistics.noise_process import residual_colour
from arm_brachy.diagnosis.statistics.subset_selection import choose

GAIN, COMPLIANCE, PLAY, DELAY, OFFSET = 'gain', 'compliance', 'play', 'delay', 'offset'
START = 'start'          # of the play
POSITIVE = (COMPLIANCE, PLAY)   # nothing pushes back harder than it is pushed
WIDEST_PLAY = 0.5        # of the pad's travel
CLOSE = 1e-3             # of the play's width and start, when their search stops
NUDGE = 0.05             # of the play, over which its slope by the start is taken
STARTS = np.linspace(0.0, 1.0, 5)   # shares of its play that a pad may begin with
REACH = 0.01             # s, over which the encoder's slope is taken
FEWEST = 50              # samples of a marker or force
SAMPLES = 4              # of a force for each column of the pads' past that it is regressed on
ALONG_Z = 0.999          # cosine
PASSES = 3               # over what is not linear: delay, width of the play, steps
LATE = 3.0               # standard deviations of a delay by which the encoder is shifted
# Of an effect, rms: a pad that yields need not do so in proportion. Guides rub, springs stiffen,
# and force sensors have a clock and a scale of their own.
YIELDING = 0.1


@dataclass(frozen=True)
class PadTravel:
    """What the marker of one pad says of its actuator.

    pad, marker : names;  moved : [m] largest travel
    causes : cause -> (value, sd), SI, only those that the data ask for
    all : the same with every cause fitted at once, those that matter and those that do not
    rivals : chosen cause -> causes that would do as well in its place
    steps : change_points.Step each, size (3,) [m] in `frame`
    gain : (value, sd) of a gain beside what was chosen, in the place of a compliance: several pads
        together may show a scale that none of them does alone
    stiffness : [N/m] of what pushes back, 0 where that was not measured
    tilt, tilt_sd : (2,) slope of the motion across over that along the push
    frame : (3, 3) push direction, up and side, rows, world frame, see `push_frame`
    course : Course that was taken out, None where the pad goes as evenly as can be told
    start : (value, sd) share of its play that is taken up at the beginning; (0, 0) = as after a
        retraction, which the data do not gainsay
    """

    pad: str
    marker: str
    moved: float
    causes: dict
    all: dict
    rivals: dict
    steps: tuple
    gain: tuple
    stiffness: float
    tilt: np.ndarray
    tilt_sd: np.ndarray
    frame: np.ndarray
    course: Course | None = None
    start: tuple = (0.0, 0.0)


def pad_travels(evidence, noise, touch, *, alarm, even=2e-5):
    """PadTravel of every marker on a pad that moved; a tuple.

    evidence : Evidence, optical positions in the world frame;  noise : noise.Noise of that stream
    touch : [m] less travel counts as none;  alarm : probability of a false step per marker
    even : [m] rms by which a sound actuator may err from place to place
    Test: diagnosis/structural/test_pad_travel.py
    """
    optical, encoder = evidence.get(OPTICAL), evidence.get(ENCODER)
    if optical is None or encoder is None:
        return ()
    found = []
    for i, pad in enumerate(encoder.names):
        seen = encoder.valid[:, i]
        travel = encoder.t[seen], encoder.values[seen, i, 0]
        if np.ptp(travel[1]) > touch:
            found += [_one(evidence, noise, pad, int(k), travel, (touch, alarm, even))
                      for k in optical.on(pad)]
    return tuple(one for one in found if one is not None)


def _one(evidence, noise, pad, k, travel, limits):
    optical, (touch, alarm, even) = evidence.get(OPTICAL), limits
    inside = (optical.t >= travel[0][0]) & (optical.t <= travel[0][-1])
    t, valid = optical.t[inside], optical.valid[inside, k]
    if valid.sum() < FEWEST:
        return None
    axis = evidence.directions[evidence.pads.index(pad)]
    frame = push_frame(axis)
    moved = (optical.values[inside, k] - optical.rest[k]) @ frame.T
    force = _push_back(evidence, pad, axis, touch)
    known = noise.colour, np.hypot(noise.sd[k].mean(), _as_white(evidence, pad))
    one = _explained(t, moved, valid, travel, force, known, alarm)
    course = _course(t, one, valid, touch)
    loud = evidence.get(ENCODER).path_error(0.0)[evidence.get(ENCODER).names.index(pad)]
    if course is None or course.chance > alarm or course.rms <= np.hypot(even, loud):
        course = None
    else:
        moved[:, 0] -= course.error(one.causes[GAIN])
        one = _explained(t, moved, valid, travel, force, known, alarm)
    choice = _chosen(t, one, valid)
    tilt, tilt_sd = regress(t, one.y[:, 1:], one.fixed | {GAIN: one.causes[GAIN]}, valid,
                            one.colour, one.sd[1:]).of(GAIN)
    everything = {c: tuple(float(x[0]) for x in one.full.of(c)) for c in one.causes}
    return PadTravel(pad, optical.names[k], float(np.ptp(travel[1])),
                     _with_delay(choice.estimates, everything, one.delay),
                     _with_delay(everything, everything, one.delay), choice.rivals, one.steps,
                     _gain(t, one, choice, valid), _stiffness(travel, force), tilt, tilt_sd, frame,
                     course, _start(t, one, choice, valid))


def _as_white(evidence, pad):
    """[m] noise of markers that comes to as much in a stand as the encoders' leaves there."""
    optical, encoder = evidence.get(OPTICAL), evidence.get(ENCODER)
    if encoder.taken is None:
        return 0.0
    return encoder.taken[encoder.names.index(pad)] * np.sqrt(encoder.period / optical.period)


def _gain(t, one, choice, valid):
    """(value, sd) of a gain beside what a Choice has, without compliance."""
    beside = {name: one.causes[name] for name in choice.estimates if name != COMPLIANCE}
    return regress(t, one.y[:, :1], one.fixed | beside | {GAIN: one.causes[GAIN]}, valid,
                   one.colour, one.sd[:1]).of(GAIN)


def _start(t, one, choice, valid):
    """(value, sd) of where in its play the pad begins, beside what a Choice has."""
    if PLAY not in choice.estimates or one.play.start == 0.0:
        return 0.0, 0.0
    chosen = {name: one.causes[name] for name in choice.estimates}
    column = choice.estimates[PLAY][0] * one.play.by_start
    found = regress(t, one.y[:, :1], one.fixed | chosen | {START: column}, valid, one.colour,
                    one.sd[:1])
    return one.play.start, found.of(START)[1]


def _stiffness(travel, force):
    """Force over travel [N/m]; 0 without forces."""
    return 0.0 if force is None else float(np.ptp(force[1]) / np.ptp(travel[1]))


def _chosen(t, one, valid):
    """choice.Choice of the causes of an _Explained.

    A gain and a yield are each other's rivals too where what tells them apart is less than
    YIELDING of what they do, however far apart the noise has them.
    """
    found = choose(t, one.y[:, :1], one.fixed, one.causes, valid, one.colour, one.sd[:1],
                   positive=POSITIVE)
    if COMPLIANCE not in one.causes or len({GAIN, COMPLIANCE} & set(found.estimates)) != 1:
        return found
    name, other = (GAIN, COMPLIANCE) if GAIN in found.estimates else (COMPLIANCE, GAIN)
    if other in found.rivals[name] or not _alike(one, name, other, found.estimates, valid):
        return found
    return replace(found, rivals={**found.rivals, name: (*found.rivals[name], other)})


def _alike(one, name, other, estimates, valid):
    """True if the column `other` can stand for `name`, of the sign that it has, but for YIELDING.

    one : _Explained;  estimates : of what was chosen. Beside everything else that is fitted.
    """
    beside = [*one.fixed.values(), *(one.causes[n] for n in estimates if n != name)]
    columns = np.stack([*beside, one.causes[name], one.causes[other]], axis=1)[valid]
    Q = np.linalg.qr(columns[:, :-2] / np.maximum(np.abs(columns[:, :-2]).max(axis=0), 1e-300))[0]
    mine, its = (columns[:, -2:] - Q @ (Q.T @ columns[:, -2:])).T
    share = (mine @ its) / (its @ its)
    return (share * estimates[name][0] * (1.0 if other in POSITIVE else 0.0) >= 0.0
            and np.linalg.norm(mine - share * its) < YIELDING * np.linalg.norm(mine))


def _course(t, one, valid, touch):
    """Course of an _Explained; gain and compliance follow the place as well and are left to it."""
    kept = set(_chosen(t, one, valid).estimates) - {GAIN, COMPLIANCE}
    others = one.fixed | {name: column for name, column in one.causes.items() if name in kept}
    rivals = {name: column for name, column in one.causes.items() if name not in kept}
    return course_of(t, one.y[:, :1], one.causes[GAIN], others, rivals, valid, one.colour,
                     one.sd[:1], away=touch)


@dataclass(frozen=True)
class _Explained:
    """y : (n, 3) motion less the encoder's;  fixed, causes : name -> column (n,);  full : Fit

    colour, sd : of what is left;  steps : change_points.Step each
    delay : [s] by which the encoder is shifted;  play : _Play
    """

    y: np.ndarray
    fixed: dict
    causes: dict
    full: object
    colour: object
    sd: np.ndarray
    steps: tuple
    delay: float
    play: object


@dataclass(frozen=True)
class _Play:
    """Play that fits best. column : (n,) per unit width;  start : share of it taken up at first

    by_start : (n,) derivative of the column by start
    """

    column: np.ndarray
    start: float
    by_start: np.ndarray


def _explained(t, moved, valid, travel, force, known, alarm):
    """_Explained motion (n, 3) [m] of a marker in the frame of its push.

    known : (colour, standard deviation) of the noise at rest
    """
    delay, jumps, colour, sd = 0.0, (), known[0], np.full(3, known[1])
    for again in reversed(range(PASSES)):
        then = t - delay
        y = moved - np.outer(np.interp(then, *travel), [1.0, 0.0, 0.0])
        fixed = {OFFSET: np.ones_like(t)} | drift_columns(t) | {
            f'step {j}': (t >= jump.t).astype(float) for j, jump in enumerate(jumps)}
        causes = _causes(then, travel, force)
        lost = _play(t, then, y[:, :1], (fixed, causes), valid, travel, (colour, sd[:1]))
        causes |= {PLAY: lost.column}
        full = regress(t, y, fixed | causes, valid, colour, sd)
        colour, sd = residual_colour(t, full.residual, valid, *known)
        slow = np.stack(list((drift_columns(t) | causes).values()), axis=1)
        jumps = steps(t, y, valid, colour, sd, slow, alarm=alarm)
        jumps = steadfast(jumps, t, y, valid, np.full(3, known[1]), slow, alarm=alarm)
        late, error = (float(x[0]) for x in full.of(DELAY))
        if again and abs(late) > LATE * error:
            delay += late
    return _Explained(y, fixed, causes, full, colour, sd, jumps, delay, lost)


def _with_delay(estimates, everything, delay):
    """Add the delay that the encoder was already shifted by."""
    if delay == 0.0:
        return estimates
    value, sd = estimates.get(DELAY, (0.0, everything[DELAY][1]))
    return estimates | {DELAY: (delay + value, sd)}


def push_frame(axis):
    """Rotation (3, 3) whose rows are the unit push direction `axis` (3,), the unit vector across
    it nearest to world z (to x for a push along z), and the product of the two.
    """
    up = np.eye(3)[2 if abs(axis[2]) < ALONG_Z else 0]
    up = up - (up @ axis) * axis
    up = up / np.linalg.norm(up)
    return np.stack([axis, up, np.cross(axis, up)])


def _push_back(evidence, pad, axis, touch):
    """(t, force [N]) pushing back on a pad along its axis; None if it was not measured.

    Without what does not follow the pads: a yield multiplies the sensor's noise, which would make
    any gain the better explanation (instrumental variables: Fuller 1987, Measurement Error Models,
    sec. 1.4). Of few samples as it was read.
    """
    force, encoder = evidence.get(FORCE), evidence.get(ENCODER)
    if force is None or pad not in force.names:
        return None
    j = force.names.index(pad)
    seen = force.valid[:, j]
    push = -force.vectors[seen, j] @ axis
    if seen.sum() < FEWEST or np.ptp(push) == 0.0:
        return None
    known = encoder.valid.all(axis=1)
    travel = encoder.t[known], encoder.values[known, :, 0]
    past = history_columns(force.t[seen], travel, touch)
    X = np.stack([np.ones(len(push)), *drift_columns(force.t[seen]).values(), *past.values()],
                 axis=1)
    if len(push) < SAMPLES * X.shape[1]:
        return force.t[seen], push
    return force.t[seen], X @ np.linalg.lstsq(X, push, rcond=1e-8)[0]


def _causes(then, travel, force):
    columns = {GAIN: np.interp(then, *travel), DELAY: -slope(then, *travel, REACH)}
    if force is not None:
        columns[COMPLIANCE] = -np.interp(then, *force)
    return columns


def _play(t, then, y, columns, valid, travel, noise):
    """The _Play that fits y (n, 1) best beside columns, (fixed, causes).

    What recorded nothing before may begin anywhere in its gap. That is one number more, which has
    to bring as much as the Bayesian information criterion asks for (`subset_selection.choose`).
    """
    columns = columns[0] | columns[1]
    X = np.stack(list(columns.values()), axis=1)[valid]
    Q = np.linalg.qr(X / np.maximum(np.abs(X).max(axis=0), 1e-300))[0]
    left = y[valid, 0] - Q @ (Q.T @ y[valid, 0])
    widest = WIDEST_PLAY * float(np.ptp(travel[1]))

    def column(width, start):
        return np.interp(then, travel[0], play(travel[1], width, start) - travel[1]) / width

    def misfit(log_width, start):
        width = np.exp(log_width)
        c = column(width, start)[valid]
        c = c - Q @ (Q.T @ c)
        return float(np.sum((left - width * c) ** 2))

    def chi2(width, start):
        return float(regress(t, y, columns | {PLAY: column(width, start)}, valid, *noise).chi2[0])

    homed, inside = _fitted_play(misfit, widest, (0.0,)), _fitted_play(misfit, widest, STARTS)
    fall = chi2(*homed) - chi2(*inside) if inside[1] > 0.0 else 0.0
    width, start = inside if fall > np.log(valid.sum()) else homed
    low, high = max(start - NUDGE, 0.0), min(start + NUDGE, 1.0)
    return _Play(column(width, start), start,
                 (column(width, high) - column(width, low)) / (high - low))


def _fitted_play(misfit, widest, starts):
    """(width, start) of least `misfit`, from a grid of widths up to `widest` and of starts."""
    grid = np.log(np.geomspace(1e-3 * widest, widest, 13))
    tried = [[misfit(g, start) for start in starts] for g in grid]
    best, first = np.unravel_index(np.argmin(tried), np.shape(tried))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    if len(starts) == 1:
        found = minimize_scalar(misfit, bounds=bounds, args=(starts[0],), method='bounded')
        return float(np.exp(found.x)), starts[0]
    ends = starts[max(first - 1, 0)], starts[min(first + 1, len(starts) - 1)]
    log_width, start = minimize(
        lambda x: misfit(*x), (grid[best], starts[first]), method='Nelder-Mead',
        bounds=(bounds, ends), options={'xatol': CLOSE, 'fatol': np.inf}).x
    return float(np.exp(log_width)), float(start)
