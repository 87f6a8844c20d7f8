"""How often the diagnosis is right: every term planted at its typical size and at a tenth, nulls.

What is planted, where and with which nuisances: `diagnosis_cases`. Every answer is kept as a line
of answers.jsonl as it comes, so that a study that was ended goes on where it was, and is scored
from there. What counts:

- right: the verdict names what was planted and nothing else. class: it says 'equivalent', and one
  option is what was planted and every other is known not to differ from it (CONFOUNDED). wide: an
  option is what was planted, but there are others that theory could tell from it.
- wrong: a claim of something that is not there, also beside what is. abstained: 'unexplained'
  without a wrong cause. silent: nothing is missing. failed: no answer.
- A modulus is no cause but recalibrated: for stiffness_scale, silence with the modulus within
  TOLERANCE of its departure is right. Damping does nothing to a quasi-static body: silence is.
- A mesh at fault (discretisation) is no wrong claim: model and patient have different meshes.
- An oracle has the right cause and the model's mesh: what it leaves held out, in noise floors, is
  what the diagnosis leaves where nothing is planted, in the median of the nulls.

`python -m arm_brachy.experiments.diagnosis_study [FOLDER]` makes the recordings that
FOLDER lacks, diagnoses those without an answer, prints the table and writes
FOLDER/diagnosis-terms.json. After a change of the detector, delete FOLDER/answers.jsonl.
"""

import json
import sys
import time
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.stats import binomtest

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import config_dir, run_dir, share_dir
from arm_brachy.core.quantity import quantities
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.diagnose import diagnose
from arm_brachy.diagnosis.diagnosis import Provenance
from arm_brachy.diagnosis.evidence import evidence_of
from arm_brachy.evaluation.result import Result, Target, cell_text, commit_of, machine_description
from arm_brachy.experiments import diagnosis_cases
from arm_brachy.experiments.diagnosis_cases import hasty_pool
from arm_brachy.registry import TERMS, by_name

NAME = 'diagnosis-terms'
SCENE = config_dir() / 'scenes' / 'breast.yaml'
MESH = 'discretisation'
INERT = ('damping',)            # without effect on a quasi-static body
RECALIBRATED = 'stiffness_scale'
TOLERANCE = 0.2                 # of a parameter, and of the held-out error over an oracle's
NEAR, SOON = 10e-3, 0.5         # m, s: a right place (half a pad) and a right onset
FOUND = ('right', 'class')
# Causes that some recordings cannot tell apart: MISMATCH theorems and `invisible_when`.
CONFOUNDED = tuple(frozenset(pair) for pair in (
    ('actuator_gain', 'actuator_compliance'), ('actuator_lag', 'clock_offset'),      # T8
    ('reference_shape', 'optical_scale'), ('swelling_drift', 'optical_scale'),       # T9
    ('reference_shape', 'gravity'), ('force_gain', 'stiffness_scale'),               # T10, T4
    ('inclusion', 'external_force'), ('inclusion', 'obstacle'),                      # T6
    ('stiffness_gradient', 'force_gain'), ('stiffness_gradient', 'anisotropy'),
    ('actuator_gain', 'lost_steps'), ('marker_slip', 'lost_steps'),
    ('stress_softening', 'strain_stiffening'), ('force_drift', 'stiffness_drift')))
# What of two parameters is known together only (T7 and `invisible_when`), from fields in SI.
PRODUCTS = {
    'inclusion': lambda f: f['radius'] ** 3 * (f['ratio'] - 1.0) / (3.0 + 2.0 * f['ratio']),
    'skin_layer': lambda f: (f['ratio'] - 1.0) * f['thickness'],
}


# ---- one answer

def explanations(answer):
    """Sets of causes of which an answer says that one holds; the mesh is left out.

    answer : diagnosis.Diagnosis as JSON. No cause at all is one empty set.
    """
    options = {}
    for cause in answer['causes']:
        options.setdefault(cause['option'], set()).add(cause['term'])
    always = options.pop(0, set())
    return [frozenset((always | one) - {MESH}) for one in options.values()] or [
        frozenset(always - {MESH})]


def outcome(answer, label):
    """What an answer is worth, in one of the words of the head of this file.

    label : of the case (`diagnosis_cases.labels`)
    """
    if 'error' in answer:
        return 'failed'
    planted = set() if label['term'] in (None, *INERT) else {label['term']}
    said = explanations(answer)
    if answer['verdict'] == 'unexplained':
        return 'abstained' if all(one <= planted for one in said) else 'wrong'
    if not any(said):
        return 'right' if planted == {RECALIBRATED} and _modulus(answer, label).get(
            'parameter_right') else 'silent'
    if planted not in said:
        return 'wrong'
    others = [one for one in said if one != planted]
    if not others:
        return 'right'
    alike = all(len(one) == 1 and one | planted in CONFOUNDED for one in others)
    return 'class' if alike else 'wide'


def _modulus(answer, label):
    """Parameter columns from the recalibrated modulus; {} if there is none."""
    told = answer['recalibrated'].get('E_kPa')
    if told is None:
        return {}
    given = load_scene(SCENE).material.E / 1e3
    true = given * label['fields']['factor']
    return _worth(abs(told['value'] - true) / abs(true - given),
                  _holds(told['interval_90'], np.array([true])))


def _worth(error, holds):
    return {'parameter_error_percent': 100.0 * float(error),
            'parameter_right': bool(error <= TOLERANCE), 'interval_holds': holds}


def score(label, line):
    """One row of the table, flat, from a label and a line of answers.jsonl; None = not said."""
    answer = line['answer']
    row = {'case': label['name'], 'term': label['term'] or '-', 'size': label['size'],
           'outcome': outcome(answer, label), 'verdict': answer.get('verdict', 'none'),
           'said': _said(answer), 'place_right': None, 'place_error_mm': None,
           'onset_right': None, 'onset_error_s': None, 'parameter_right': None,
           'parameter_error_percent': None, 'interval_holds': None,
           'error_over_floor': _over_floor(answer), 'cpu_s': line['cpu_s'],
           'plant': label['plant']}
    cause = _cause(answer, label['term'])
    if cause is not None:
        return row | _place(answer, label) | _onset(answer, cause, label) | _parameter(
            cause, label)
    recalibrated = row['outcome'] == 'right' and label['term'] == RECALIBRATED
    return row | _modulus(answer, label) if recalibrated else row


def _said(answer):
    if 'error' in answer:
        return answer['error']
    return ' | '.join(' + '.join(sorted(one)) for one in explanations(answer) if one)


def _cause(answer, term):
    return next((c for c in answer.get('causes', ()) if c['term'] == term), None)


def _over_floor(answer):
    """Largest of the streams' held-out errors over their noise floors."""
    ratios = []
    for fit in answer.get('fit', ()):
        reached = fit['with_the_causes']
        reached = fit['recalibrated'] if reached is None else reached
        if reached is not None and fit['noise_floor']:
            ratios.append(reached / fit['noise_floor'])
    return max(ratios, default=None)


def _place(answer, label):
    """Whether the pad, actuator, marker, stream or centre is the one planted; first place said."""
    where = next((p for p in answer['where'] if p.get('term') == label['term']), {})
    wanted = _channel(label['place'])
    if 'centre' in label['place']:
        if 'position_m' not in where:
            return {'place_right': False}
        away = float(np.linalg.norm(np.subtract(where['position_m'], label['place']['centre'])))
        return {'place_right': away <= NEAR, 'place_error_mm': 1e3 * away}
    if wanted is None:
        return {}
    told = ' '.join(where.get(key, '') for key in ('stream', 'channel', 'actuator', 'boundary'))
    return {'place_right': wanted in told.split()}


def _channel(place):
    """Name of what a planted term is in, None where it is in the whole body or stream."""
    if 'actuators' in place:
        return load_scene(SCENE).pads[place['actuators'][0]].name
    if 'pads' in place:
        return place['pads'][0]
    return place.get('marker') or place.get('stream')


def _parameter(cause, label):
    """Error relative to the departure from 'off', and whether every interval holds the truth."""
    infos = quantities(by_name(label['term']))
    true = {name: _edge(infos[name], value) for name, value in label['parameters'].items()}
    told = {name: cause['parameters'].get(infos[name].key(name)) for name in true}
    if None in told.values():
        return {'parameter_right': False, 'interval_holds': False}
    holds = all(_holds(told[name]['interval_90'], true[name]) for name in true)
    if label['term'] in PRODUCTS:
        product = PRODUCTS[label['term']]
        found = product({**label['fields'], **_scalars(cause, infos)})
        return _worth(abs(found / product(label['fields']) - 1.0), holds)
    return _worth(max(_departure(infos[name], told[name]['value'], true[name])
                      for name in true), holds)


def _edge(info, value):
    return np.atleast_1d(np.asarray(value, dtype=float) / info.scale)


def _scalars(cause, infos):
    """Fields of a cause's scalar parameters, SI."""
    keys = {info.key(name): name for name, info in infos.items() if not info.shape}
    return {keys[key]: infos[keys[key]].to_si(one['value'])
            for key, one in cause['parameters'].items() if key in keys}


def _departure(info, found, true):
    off = info.neutral if info.neutral is not None and np.isfinite(info.neutral) else 0.0
    return float(np.linalg.norm(np.atleast_1d(found) - true) / np.linalg.norm(true - off))


def _holds(interval, true):
    """True if true (c,) lies in [low, high]; an end that is null is open."""
    low, high = (np.array([fill if v is None else v for v in np.atleast_1d(
        np.asarray(end, dtype=object))], dtype=float)
        for end, fill in zip(interval, (-np.inf, np.inf), strict=True))
    return bool(np.all((low <= true) & (true <= high)))


def _onset(answer, cause, label):
    """Middle of the onset's interval minus the onset, from `when` or from the parameter."""
    if 'onset' not in label['place']:
        return {}
    told = [np.mean(i['onset_s']) for i in answer['when']
            if i.get('term') == label['term'] and None not in i.get('onset_s', (None,))]
    if not told and 'onset_s' in cause['parameters']:
        told = [cause['parameters']['onset_s']['value']]
    if not told:
        return {'onset_right': False}
    error = float(told[0] - label['place']['onset'])
    return {'onset_right': abs(error) <= SOON, 'onset_error_s': error}


# ---- all of them

def absolute(evidences, scene, *, seed):
    """The diagnosis that is judged: recordings and the path of their scene, no null recording."""
    source = Provenance(NAME, seed, commit_of(share_dir()), str(machine_description()),
                        str(scene), ())
    return diagnose(evidences, source).diagnosis


def answer_all(folder, index, detector=absolute, scene=SCENE, seed=diagnosis_cases.SEED):
    """Diagnose every case of `index` in `folder` that answers.jsonl lacks; returns all lines.

    detector : called as `absolute` is, in processes of its own: a function of a module
    A line is {'name', 'cpu_s', 'answer'}; an answer that failed is {'error': text}. A bug in the
    detector ends the study; what was answered until then is kept.
    """
    path = Path(folder) / 'answers.jsonl'
    lines = _read(path)
    jobs = [label for label in index if label['name'] not in lines]
    with hasty_pool(len(jobs)) as pool, path.open('a', encoding='utf-8') as file:
        waiting = [pool.submit(answer_one, Path(folder) / label['file'], detector, scene, seed)
                   for label in jobs]
        for future in as_completed(waiting):
            line = future.result()
            lines[line['name']] = line
            print(json.dumps(line), file=file, flush=True)
            print(f'{NAME}: {len(lines)} of {len(index)}: {line["name"]}, '
                  f'{line["cpu_s"]:.1f} CPU s', file=sys.stderr, flush=True)
    return lines


def answer_one(file, detector, scene, seed):
    """Diagnose one recording alone, in absolute mode; returns its line."""
    start = time.process_time()
    try:
        evidence = evidence_of(diagnosis_cases.load(file), load_scene(scene))
        answer = json.loads(detector((evidence,), scene, seed=seed).to_json())
    except ArmBrachyError as error:
        answer = {'error': str(error)}
    return {'name': file.stem, 'cpu_s': time.process_time() - start, 'answer': answer}


def _read(path):
    """Name -> line; a line that an interruption cut short is left out."""
    lines = {}
    if path.is_file():
        whole = path.read_text(encoding='utf-8')
        kept = whole[:whole.rfind('\n') + 1]
        path.write_text(kept, encoding='utf-8')
        lines = {line['name']: line for line in map(json.loads, kept.splitlines())}
    return lines


def rows_of(index, lines):
    """Rows of all cases that have an answer, order of the index."""
    rows = [score(label, lines[label['name']]) for label in index if label['name'] in lines]
    nulls = [row['error_over_floor'] for row in rows
             if row['term'] == '-' and row['error_over_floor'] is not None]
    for row in rows:
        known = nulls and row['error_over_floor'] is not None
        row['error_over_oracle'] = (
            row['error_over_floor'] / float(np.median(nulls)) if known else None)
    return tuple(rows)


COUNTED = (
    ('named or provable class, typical size', lambda row: row['outcome'] in FOUND),
    ('wrong claims, typical size', lambda row: row['outcome'] == 'wrong'),
    ('named or provable class, a tenth', lambda row: row['outcome'] in FOUND),
    ('wrong claims, a tenth', lambda row: row['outcome'] == 'wrong'),
    ('false alarms, nothing planted', lambda row: row['outcome'] != 'silent'),
    ('right place (10 mm), of those found', lambda row: row['place_right']),
    ('right onset (0.5 s), of those found', lambda row: row['onset_right']),
    ('parameter within 20 %, of those found', lambda row: row['parameter_right']),
    ('parameter in its 90 % interval, of those found', lambda row: row['interval_holds']),
    ("held-out error within 20 % of an oracle's, of those found",
     lambda row: row['error_over_oracle'] <= 1.0 + TOLERANCE))
# The most that is allowed of each, or all of them, or no goal.
GOALS = ('all', 0, None, 0, 1, 'all', 'all', 'all', None, 'all')


def totals(rows):
    """What counts, over all cases: rows with the share and its 95 % interval (Wilson).

    The interval takes cases for independent, which nulls that share a plant run are not quite.
    """
    def kind(size):
        return [r for r in rows if r['size'] == size and r['term'] not in ('-', *INERT)]

    typical, tenth = kind(1.0), kind(0.1)
    nulls = [r for r in rows if r['term'] in ('-', *INERT)]
    found = [r for r in typical if r['outcome'] in FOUND]
    chosen = (typical, typical, tenth, tenth, nulls, *(
        [row for row in found if row[key] is not None] for key in
        ('place_right', 'onset_right', 'parameter_right', 'interval_holds', 'error_over_oracle')))
    return tuple(_share(what, [row for row in some if counts(row)], some)
                 for (what, counts), some in zip(COUNTED, chosen, strict=True))


def _share(what, true, chosen):
    interval = binomtest(len(true), len(chosen)).proportion_ci(method='wilson') if chosen else None
    low, high = (interval.low, interval.high) if chosen else (np.nan, np.nan)
    return {'what': what, 'count': len(true), 'of': len(chosen),
            'low_percent': 100.0 * float(low), 'high_percent': 100.0 * float(high)}


def result(index, lines, seed=diagnosis_cases.SEED):
    """The Result: a row for every case, the totals, and the goals that were set."""
    rows = rows_of(index, lines)
    sums = totals(rows)
    targets = tuple(_goal(total, limit, len(rows) == len(index))
                    for total, limit in zip(sums, GOALS, strict=True) if limit is not None)
    return Result(NAME, seed, commit_of(share_dir()), str(machine_description()), (*rows, *sums),
                  targets)


def _goal(total, limit, whole):
    """Target of a total, open if there is nothing to count or `whole` is False.

    limit : 'all' or the most allowed;  whole : every case was judged
    """
    least = limit == 'all'
    bound = total['of'] if least else limit
    met = total['count'] >= bound if least else total['count'] <= bound
    return Target(total['what'], total['count'], '1', f'{">=" if least else "<="} {bound}',
                  met if whole and total['of'] else None)


def markdown(result):
    """The table of the README from the JSON of a result: a line per term, then the totals."""
    rows = [row for row in result['rows'] if 'case' in row]
    lines = ['| term | typical size | place / mm | onset / s | parameter / % | in its interval | '
             'error / oracle | a tenth |', '|---|---|---|---|---|---|---|---|']
    for cls in TERMS:
        by_size = {row['size']: row for row in rows if row['term'] == cls.spec.name}
        if by_size:
            lines.append(_line(cls.spec.name, by_size.get(1.0), by_size.get(0.1)))
    lines += ['', '| over all | count | of | 95 % interval of the share |', '|---|---|---|---|']
    lines += [f'| {t["what"]} | {t["count"]} | {t["of"]} | {_percents(t)} |'
              for t in result['rows'] if 'what' in t]
    return '\n'.join(lines)


def _percents(total):
    low, high = total['low_percent'], total['high_percent']
    return '-' if low is None else f'{low:.0f} to {high:.0f} %'


def _line(term, typical, tenth):
    cells = [f'`{term}`', _words(typical)]
    if typical is None:
        cells += ['-'] * 5
    else:
        place = typical['place_error_mm']
        cells += [cell_text(typical['place_right'] if place is None else round(place, 1)),
                  *(_rounded(typical[key], digits) for key, digits in (
                      ('onset_error_s', 2), ('parameter_error_percent', 0))),
                  cell_text(typical['interval_holds']), _rounded(typical['error_over_oracle'], 2)]
    return '| ' + ' | '.join((*cells, _words(tenth))) + ' |'


def _words(row):
    if row is None:
        return '-'
    plain = row['outcome'] in ('right', 'silent', 'failed')
    return row['outcome'] if plain or not row['said'] else (
        f'{row["outcome"]}: {row["said"].replace("|", "or")}')


def _rounded(value, digits):
    return '-' if value is None else f'{value:.{digits}f}'


def reproduce(out_dir, folder=None, detector=absolute):
    """Make, diagnose and score every case; what `folder` holds already is kept.

    out_dir : receives diagnosis-terms.json;  folder : of recordings and answers, default
        diagnosis-terms/ among the runs;  detector : see `answer_all`
    Returns Result.
    """
    folder = run_dir() / NAME if folder is None else Path(folder)
    index = diagnosis_cases.make(folder)
    found = result(index, answer_all(folder, index, detector))
    found.to_json(Path(out_dir) / f'{NAME}.json')
    return found


if __name__ == '__main__':
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else run_dir() / NAME
    reproduce(place, place).table(Console())
