"""Findings in recordings in which one thing is wrong: is that told, and nothing else?

Recordings of formulas as in `false_alarms`, with one fault each that wears, slips or drifts in
a laboratory. What is told before any model of the tissue is compared must be the fault or
nothing: a second cause of the same event is wrong. Test: experiments/test_single_faults.py
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from arm_brachy.core.paths import share_dir
from arm_brachy.core.random import stream
from arm_brachy.diagnosis.signals.regressors import play as lagging
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.timeseries import Series
from arm_brachy.experiments.false_alarms import (
    ENCODER,
    MARKERS,
    SIZES,
    SLOW_EM,
    Case,
    kind_of,
    sensor,
    structure,
    told,
)
from arm_brachy.experiments.formula_recordings import (
    RADIUS,
    TICK,
    Lasting,
    make_scene,
    pushes,
    record,
)
from arm_brachy.experiments.parallel import process_pool

NAME = 'single-faults'
SEED = 2
DRAWS = 20
WRONG = 0.05             # of the draws of all faults, those in which something else is told
DURATION = 60.0          # s
PAD = 0                  # that is at fault
PLAY, LOST, LAG, YIELD = 0.32e-3, 0.88e-3, 0.013, 1.0 / 2100.0      # m, m, s, m/N
SIDE_BY_SIDE = (0.0, 0.0, 0.5, 3.5)     # of the play's width, on average one
DRIFT = 0.07 / 60.0      # N/s
PRESSED, PRESSES, REACH = 1.5e-3, (5.0, 5.0), 0.02      # m, s each, m
BEHIND = 'lag or clocks'  # the encoders are early or the pads lag: alike in these recordings
IDLE = 1.0               # s before and after which a pad that loses steps is at rest


def same(t, q, force):
    """Where pads are whose encoders count right."""
    return q


def play(t, q, force):
    """One pad with play, from the middle of its gap."""
    return _of_one(q, lagging(q[:, PAD], PLAY, 0.5))


def rounded_play(t, q, force):
    """Play whose corners friction rounds: several beside each other (Prandtl and Ishlinskii)."""
    beside = [lagging(q[:, PAD], share * PLAY) for share in SIDE_BY_SIDE]
    return _of_one(q, np.mean(beside, axis=0))


def closed_play(t, q, force):
    """Play through which the tissue pushes the pad back at once: it lies on the flank behind."""
    return _of_one(q, np.maximum(q[:, PAD] - PLAY, np.minimum(q[:, PAD], 0.0)))


def lost_steps(t, q, force):
    """One pad stands short from an instant on at which it rests."""
    window = round(IDLE / TICK)
    still = np.abs(np.diff(q[:, PAD], prepend=q[0, PAD])) < 1e-9
    calm = np.convolve(still, np.ones(2 * window + 1), 'same') > 2 * window
    late = np.flatnonzero(calm & (t > 0.3 * t[-1]))
    at = t[late[0]] if len(late) else 0.5 * t[-1]
    return _of_one(q, q[:, PAD] - LOST * (t >= at))


def lag(t, q, force):
    """Every pad follows its encoder late; exact for travel that is linear between ticks."""
    keep = np.exp(-TICK / LAG)
    share = (1.0 - keep) * LAG / TICK
    return lfilter([1.0 - share, share - keep], [1.0, -keep], q, axis=0)


def yielding(t, q, force):
    """One pad yields to the force on it."""
    y = q
    for _ in range(40):     # the tissue is ten times as soft: contracts
        y = _of_one(q, q[:, PAD] - YIELD * force(y)[:, PAD])
    return y


def _of_one(q, y):
    out = q.copy()
    out[:, PAD] = y
    return out


def drifting(rng, run, scene):
    """The zero of one force sensor drifts, aside as well as along."""
    way = rng.standard_normal(3)
    error = np.zeros_like(run.force.values)
    error[:, PAD] = DRIFT * run.force.t[:, None] * way / np.linalg.norm(way)
    return replace(run, force=Series(run.force.t, run.force.values + error))


def pressed(rng, run, scene):
    """Something presses on the surface twice, for five seconds each."""
    on = [k for k, m in enumerate(scene.markers) if m.body == 'tissue']
    rest = np.array([m.position for m in scene.markers])
    middle = rest[on[int(rng.integers(len(on)))]]
    share = np.exp(-np.sum((rest[on] - middle)**2, axis=1) / REACH**2)
    t, down = run.optical.t, np.zeros(len(run.optical.t))
    for begin, lasts in zip(np.array([0.3, 0.65]) * t[-1], PRESSES, strict=True):
        down += np.interp(t - begin, [0.0, 0.3, lasts - 0.3, lasts], [0.0, 1.0, 1.0, 0.0])
    points = run.optical.points.copy()
    points[:, on] -= PRESSED * down[:, None, None] * share[:, None] * (middle / RADIUS)
    return replace(run, optical=replace(run.optical, points=points))


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    name : of the row;  right : kinds, as of `kind`, that say so, none = nothing to tell
    goes : (t, counted (m, p), travel -> forces (m, p)) -> where the pads are (m, p) [m]
    spoil : (rng, RunData, Scene) -> RunData;  em : formula_recordings.Sensor, None = as drawn
    """

    name: str
    right: tuple = ()
    goes: Callable = same
    spoil: Callable = lambda rng, run, scene: run
    em: object = None


FAULTS = (
    Fault('play of 0.32 mm, from the middle of its gap', ('play',), goes=play),
    Fault('the same play with rounded corners', ('play',), goes=rounded_play),
    Fault('the same play, which the tissue keeps closed', ('play',), goes=closed_play),
    Fault('lost steps of 0.88 mm, the pad idle', ('lost steps',), goes=lost_steps),
    Fault('every pad 13 ms behind its encoder', (BEHIND,), goes=lag),
    Fault('a pad that yields, 2.1 N/mm', ('compliance', 'gain'), goes=yielding),
    Fault('something presses on the surface twice, 5 s each', spoil=pressed),
    Fault('a force sensor that drifts by 0.07 N/min', ('drift of force', 'zero of force'),
          spoil=drifting),
    Fault('no fault; EM noise 0.3 mm, a third with a memory of 0.8 s', em=SLOW_EM),
)


def drawn(fault, number):
    """The Case of a Fault and a number."""
    rng = stream(SEED, f'{NAME}/{fault.name}/{number}')
    scene = make_scene(MARKERS)
    t, encoder = pushes(rng, DURATION)
    body = Lasting.drawn(rng, len(scene.markers) + len(scene.targets), len(scene.pads))
    q = fault.goes(t, encoder, body.pushed_back)
    sensors = {kind: sensor(rng, kind) for kind in SIZES} | {'encoder': ENCODER}
    if fault.em is not None:
        sensors['em'] = fault.em
    run = record(rng, scene, body, (t, q), sensors, encoder)
    return Case(fault.spoil(rng, run, scene), scene, sensors, 'lasting', (t, q))


def looked_at(fault_number):
    """Kinds that are told as causes in a recording, sorted.

    fault_number : (number in FAULTS, number of the draw)
    """
    fault, number = fault_number
    case = drawn(FAULTS[fault], number)
    return sorted({kind(one) for one in structure(case).findings if told(one)})


def kind(finding):
    """The kind of a Finding as in `false_alarms`; BEHIND if a lag of the pads may be it."""
    return BEHIND if 'actuator_lag' in (finding.term, *finding.rivals) else kind_of(finding)


def reproduce(out_dir, draws=DRAWS):
    """Return the Result: a row for each Fault, of what was told in its draws."""
    jobs = [(fault, number) for fault in range(len(FAULTS)) for number in range(draws)]
    with process_pool(len(jobs)) as pool:
        found = dict(zip(jobs, pool.map(looked_at, jobs), strict=True))
    rows = tuple(counted(fault, [found[i, number] for number in range(draws)])
                 for i, fault in enumerate(FAULTS))
    wrong = sum(row['something_else'] for row in rows) / len(jobs)
    return Result(NAME, SEED, commit_of(share_dir()), machine_description(), rows, (
        Target('recordings in which something else is told', wrong, '', f'<= {WRONG:g}',
               wrong <= WRONG),))


def counted(fault, answers):
    """The row of a Fault: how many answers, lists of kinds, tell it, nothing, something else."""
    right = [set(one) for one in answers if one and set(one) <= set(fault.right)]
    other = [set(one) for one in answers if set(one) - set(fault.right)]
    kinds = Counter(kind for one in other for kind in one - set(fault.right))
    return {'fault': fault.name, 'recordings': len(answers), 'fault_alone': len(right),
            'nothing': sum(not one for one in answers), 'something_else': len(other),
            'what_else': ', '.join(f'{kind} {n}' for kind, n in sorted(kinds.items()))}
