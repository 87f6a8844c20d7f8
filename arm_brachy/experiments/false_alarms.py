"""Findings in recordings in which nothing is wrong: how often, of which kind.

Recordings of formulas (`formula_recordings`), no tissue solver; noise of several sizes and
memories, sampling of 5 to 100 Hz, dropouts, 20 and 120 s; in half of them the tissue is none that
the regressors of the diagnosis can say. The stage without a tissue model looks at each. Answers
are kept, so that a study that was ended goes on where it was.
Test: experiments/test_false_alarms.py
"""

import json
import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from arm_brachy.core.paths import share_dir
from arm_brachy.core.random import stream
from arm_brachy.diagnosis.isolation.isolate import structure_of
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments.formula_recordings import (
    Ideal,
    Lasting,
    Sensor,
    make_scene,
    pushes,
    record,
)
from arm_brachy.experiments.parallel import process_pool

NAME = 'false-alarms'
SEED = 1
RECORDINGS = 500
GOAL = 1e-3              # of the recordings, false causes of one kind
IDEAL, LASTING = 'ideal', 'lasting'
LONG = 0.1               # of the recordings that last 120 s
SHORT_S, LONG_S = 20.0, 120.0
MARKERS = 5              # on the tissue
SIZES = {'optical': (2e-5, 2e-4), 'em': (5e-5, 4e-4), 'force': (0.01, 0.06)}   # m, m, N
RATES = {'optical': (5.0, 100.0), 'em': (5.0, 50.0), 'force': (5.0, 100.0)}    # Hz
ENCODER = Sensor(50.0, 0.0, 0.0, 1.0, 0.0)
SHARES = (0.0, 0.2, 1.0 / 3.0, 0.6)
MEMORIES = (0.05, 2.0)   # s
DROPOUTS = (0.0, 0.03, 0.1)
MISLED, SLOW_EM = 0.2, Sensor(40.0, 3e-4, 1.0 / 3.0, 0.8, 0.0)   # of them, an EM tracker's noise
# what is looked for, each a row whether it was found or not
KINDS = ('clock of optical', 'clock of em', 'clock of force', 'zero of force', 'drift of force',
         'play', 'gain', 'compliance', 'tilt of a push', 'lost steps', 'slip', 'rhythm',
         'scale', 'offset of em', 'gain of force', 'no term')
OF_TERMS = {'backlash': 'play', 'actuator_gain': 'gain', 'actuator_compliance': 'compliance',
            'pad_misplacement': 'tilt of a push', 'lost_steps': 'lost steps',
            'marker_slip': 'slip', 'breathing': 'rhythm', 'optical_scale': 'scale',
            'em_offset': 'offset of em', 'em_distortion': 'offset of em',
            'force_gain': 'gain of force', None: 'no term'}


@dataclass(frozen=True)
class Case:
    """One recording, and how it was made."""

    run: object
    scene: object
    sensors: dict
    tissue_name: str
    path: tuple


def drawn(number, tissue=None):
    """The Case of a number. tissue : IDEAL or LASTING;  None = in turn"""
    rng = stream(SEED, f'{NAME}/{number}')
    name = tissue or (IDEAL, LASTING)[number % 2]
    scene = make_scene(MARKERS)
    path = pushes(rng, LONG_S if rng.random() < LONG else SHORT_S)
    sensors = {kind: sensor(rng, kind) for kind in SIZES}
    if rng.random() < MISLED:
        sensors['em'] = SLOW_EM
    body = Ideal() if name == IDEAL else Lasting.drawn(
        rng, len(scene.markers) + len(scene.targets), len(scene.pads))
    return Case(record(rng, scene, body, path, sensors | {'encoder': ENCODER}), scene, sensors,
                name, path)


def sensor(rng, kind):
    """A formula_recordings.Sensor of a kind of SIZES, drawn."""
    rate, noise, memory = (float(np.exp(rng.uniform(*np.log(ends))))
                           for ends in (RATES[kind], SIZES[kind], MEMORIES))
    return Sensor(rate, noise, float(rng.choice(SHARES)), memory, float(rng.choice(DROPOUTS)))


def structure(case):
    """isolate.Structure of a Case."""
    return structure_of(prepare(evidence_of(case.run, case.scene)))


def told(finding):
    """True if a Finding is told as a cause: at once, or with its rivals as a class where the
    model names none of them.
    """
    return finding.term is not None and finding.sure


def kind_of(finding):
    """The kind of a Finding, one of KINDS, or its term."""
    if finding.term == 'clock_offset':
        return f'clock of {finding.stream}'
    if finding.term == 'force_drift':
        return 'zero of force' if finding.parameter == 'bias' else 'drift of force'
    return OF_TERMS.get(finding.term, finding.term)


def looked_at(number):
    """What was found in the recording of a number, as JSON can keep it."""
    case = drawn(number)
    found = [one for one in structure(case).findings if one.term or one.nameless]
    return {'number': number, 'tissue': case.tissue_name,
            'found': [[kind_of(one), told(one), round(float(one.z), 2)] for one in found]}


def reproduce(out_dir, recordings=RECORDINGS):
    """Return the Result: recordings in which each kind was told as a cause, or found at all.

    out_dir : keeps answers in NAME-answers.jsonl, one a line
    """
    kept = out_dir / f'{NAME}-answers.jsonl'
    known = {}
    if kept.is_file():
        lines = kept.read_text(encoding='utf-8').splitlines()
        known = {one['number']: one for one in map(json.loads, lines)}
    lacking = [number for number in range(recordings) if number not in known]
    with kept.open('a', encoding='utf-8') as file, process_pool(max(len(lacking), 1)) as pool:
        for one in pool.map(looked_at, lacking):
            known[one['number']] = one
            file.write(json.dumps(one) + '\n')
            file.flush()
            print(f'{NAME}: {one["number"]}', file=sys.stderr, flush=True)
    rows = counted([known[number] for number in range(recordings)])
    worst = max(rows, key=lambda row: row['causes'])
    share = worst['causes'] / recordings
    return Result(NAME, SEED, commit_of(share_dir()), machine_description(), rows, (
        Target(f'recordings with a false cause of one kind, most: {worst["kind"]}', share, '',
               f'<= {GOAL:g}', share <= GOAL),))


def counted(answers):
    """A row per kind: recordings with a false cause of it, with the 95 % interval of Clopper and
    Pearson, and with anything of it, candidates and notes included.
    """
    causes, any_ = Counter(), Counter()
    for one in answers:
        causes.update({kind for kind, cause, _ in one['found'] if cause})
        any_.update({kind for kind, _, _ in one['found']})
    rows = []
    for kind in dict.fromkeys((*KINDS, *any_)):
        low, high = binomtest(causes[kind], len(answers)).proportion_ci()
        rows.append({'kind': kind, 'recordings': len(answers), 'causes': causes[kind],
                     'low_percent': round(100.0 * low, 2), 'high_percent': round(100.0 * high, 2),
                     'found_at_all': any_[kind]})
    return tuple(rows)
