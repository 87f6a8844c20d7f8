"""Writes the generated parts of README and docs/: nodes, messages, terms, results/.

`python -m arm_brachy.experiments.readme` rewrites what stands between `<!-- NAME: ... -->` and
`<!-- end -->`; a test holds them to it.
Test: experiments/test_readme.py
"""

import json
import re

import numpy as np

from arm_brachy import graph, registry
from arm_brachy.core.paths import share_dir
from arm_brachy.experiments import (
    blind_trials,
    diagnosis_laboratories,
    diagnosis_totals,
    laboratory,
    reference_tables,
)
from arm_brachy.experiments.dome_faults import study as dome_faults
from arm_brachy.experiments.gel_block import study as gel_block
from arm_brachy.experiments.half_cylinder import study as half_cylinder

DOCUMENTS = ('README.md', 'results/trials/README.md',
             *(f'docs/reference/{name}.md' for name in ('nodes', 'messages', 'terms')),
             *(f'docs/results/{name}.md' for name in ('blind_trial', 'planted_terms',
                                                      'laboratories', 'thesis', 'solvers',
                                                      'estimators', 'procedures')))
# Column of results/chapter-6.json, what it is, its goal, and how many digits are shown.
PROCEDURE_FIGURES = (
    ('tip_in_plane_percent', 'tip within 0.5 mm of the image plane [% of the insertion]', '95', 1),
    ('out_of_plane_rms_mm', 'distance of the tip from the image plane, RMS [mm]', '', 2),
    ('tip_to_target_mm', 'tip to target at the dwell [mm]', '1.56', 2),
    ('tip_to_target_across_mm', 'of it across the needle [mm]', '', 2),
    ('seed_to_target_mm', 'a seed left there to the target, both at rest [mm]', '', 2),
    ('frames_found_percent', 'images in which the tip is found [%]', '95', 1),
    ('localisation_rms_mm', 'tip in the image, RMS error [mm]', '0.5', 2),
    ('true_force_rms_N', 'true contact force, RMS error [N]', '0.1', 3),
    ('force_rms_N', 'the same as measured [N]', '', 3),
    ('true_force_steady_N', 'true contact force, mean error at the end of the dwell [N]', '',
     3),
    ('force_steady_N', 'the same as measured [N]', '0.01', 4),
    ('true_force_peak_error_N', 'true contact force, largest error [N]', '', 2),
    ('force_peak_error_N', 'the same as measured [N]', '', 2),
    ('true_force_overshoot_N',
     'true contact force, overshoot of its goal until the probe retracts [N]', '0.3', 2),
    ('force_overshoot_N', 'the same as measured [N]', '', 2),
    ('target_to_goal_mm', 'target off its planned place, across the needle [mm]', '', 2),
    ('off_plan_end_mm', 'tip off its planned path at the end, at equal depth [mm]', '', 2),
    ('turns', 'turns of the needle by the reader of the overlay', '', 1),
    ('torque_mean_Nm', 'joint torques, mean norm [N m]', '', 1),
    ('joint_travel_rad', 'way of the joints [rad]', '', 2),
    ('insertion_s', 'duration of the insertion [s]', '', 1),
    ('insertion_length_mm', 'way of the needle under the image [mm]', '', 1))
MARKERS = 19        # of the optical tracker in the headline: all that the thesis places
SECTION = re.compile(r'(<!-- (\w+): [^>]*-->\n).*?(<!-- end -->)', re.DOTALL)


def rendered(text, results):
    """Return the text of a document with every generated section made anew.

    results : folder with the JSON files of `arm-brachy reproduce` and `arm-brachy run`
    """
    return SECTION.sub(lambda m: m[1] + '\n' + BUILDERS[m[2]](results) + '\n\n' + m[3], text)


def _nodes(results):
    return graph.documentation_table()


def _terms(results):
    lines = ['| term | kind | what is added | what its law leaves open |', '|---|---|---|---|']
    for term in registry.TERMS:
        s = term.spec
        lines.append(f'| `{s.name}` | {s.kind.value} | {s.summary} | {s.leaves_open} |')
    return '\n'.join(lines)


def _single_faults(results):
    lines = ['| fault | recordings | it alone is told | nothing | something else |',
             '|---|---|---|---|---|']
    for row in _load(results, 'single-faults')['rows']:
        other = f'{row["something_else"]}: {row["what_else"]}' if row['what_else'] else '0'
        lines.append(f'| {row["fault"]} | {row["recordings"]} | {row["fault_alone"]} '
                     f'| {row["nothing"]} | {other} |')
    return '\n'.join(lines)


def _headline(results):
    """What a visitor asks first, a figure each, with the page that has the rest."""
    errors = {loop: max(r[f'{loop}_error_mm'] for r in _load(results, 'table-3.1')['rows'])
              for loop in ('closed', 'open')}
    right = sum(r['right'] for study in (gel_block, half_cylinder, dome_faults)
                for r in _load(results, study.NAME)['rows'])
    planned = len(gel_block.CASES) + len(half_cylinder.CASES) + len(dome_faults.FAULTS)
    seconds = {name: min(r['cpu_s'] for r in _timed(results)
                         if (r['solver'], r['mesh'], r['element']) == (name, 'small', 'quadratic'))
               for name in ('arm_brachy', 'FElupe + PARDISO')}
    inside = {r['estimator']: r['mean_error_mm'] for r in _judged(results)
              if r['markers'] in (0, MARKERS)}
    procedures = [r for r in _load(results, 'chapter-6')['rows'] if r['run_as'] == r['scenario']]
    in_plane, stopped = ([r[key] for r in procedures]
                         for key in ('tip_in_plane_percent', 'tip_to_target_mm'))
    rows = (
        ('Does the closed loop reach its goals? Largest steady-state error of 15 tasks',
         f'{errors["closed"]:.3f} mm; without feedback {errors["open"]:.2f} mm',
         '[thesis](docs/results/thesis.md)'),
        (f'How well are targets inside located from {MARKERS} surface markers? Mean error of five '
         'targets',
         f'{inside["map"]:.2f} mm; KF-ADMM {inside["kf_admm"]:.2f} mm, graph network '
         f'{inside["graph_vae"]:.2f} mm, model alone {inside["open_loop"]:.2f} mm',
         '[estimators](docs/results/estimators.md)'),
        ('Does the ultrasound probe stay on the needle tip? Share of the insertion with the tip '
         'within 0.5 mm of the image plane',
         f'{np.median(in_plane):.1f} % (median of {len(procedures)} insertions, '
         f'{min(in_plane):.1f} to {max(in_plane):.1f} %)',
         '[needle and probe](docs/results/procedures.md)'),
        ('How far from the target does the needle stop? Mean distance during the dwell',
         f'{np.median(stopped):.2f} mm (median, {min(stopped):.2f} to {max(stopped):.2f} mm)',
         '[needle and probe](docs/results/procedures.md)'),
        ('Is the verdict right for three phantoms simulated by independent code? Cases',
         f'{right} of {planned}',
         '[independent recordings](docs/results/laboratories.md)'),
        ('How fast is the tissue? CPU time of a 10 mm push, quadratic tetrahedra',
         f'{seconds["arm_brachy"]:.2f} s; FElupe with PARDISO '
         f'{seconds["FElupe + PARDISO"]:.2f} s', '[solver benchmark](docs/results/solvers.md)'))
    return '\n'.join(['| question | figure | details |', '|---|---|---|',
                      *('| ' + ' | '.join(row) + ' |' for row in rows)])


def _results(results):
    lines = ['| what | published | here | command |', '|---|---|---|---|']
    for row in (*_cell_rows(results), *_thesis_rows(results), *_recording_rows(results)):
        lines.append('| ' + ' | '.join(row) + ' |')
    return '\n'.join(lines)


def _load(results, name):
    return json.loads((results / f'{name}.json').read_text(encoding='utf-8'))


def _cell_rows(results):
    rows = _load(results, 'target_1')['rows']
    worst = max(r['steady_state_error_truth_mm'] for r in rows)
    yield ('target 1, three tasks through the graph: largest steady-state error', '"minimal"',
           f'{worst:.3f} mm', '`arm-brachy run config/scenarios/target_1.yaml`')


def _thesis_rows(results):
    rows = _load(results, 'table-3.1')['rows']
    command = '`reproduce table-3.1`'
    for loop in ('open', 'closed'):
        yield (f'Table 3.1, 15 rows: ITAE, {loop} loop', _span(rows, f'thesis_{loop}_itae_mm_s2'),
               _span(rows, f'{loop}_itae_mm_s2') + ' mm s²', command)
    yield ('Table 3.1: steady-state error, open loop',
           _span(rows, 'thesis_open_error_mm', 2) + ' mm', _span(rows, 'open_error_mm', 2) + ' mm',
           command)
    yield ('Table 3.1: steady-state error, closed loop', '"minimal"',
           _span(rows, 'closed_error_mm', 3) + ' mm', command)
    targets = _load(results, 'figure-3.2')['targets']
    shares = [f'{t["value"]:.0f} %' for t in targets]
    missed = ' and '.join(str(i + 1) for i, t in enumerate(targets[:3]) if not t['met'])
    yield ('Figure 3.2: area where four pads beat three, tasks 1, 2, 3', 'the majority',
           f'{", ".join(shares[:3])}; all {shares[3]}'
           + (f': **not reproduced** for task {missed}' if missed else ''),
           '`reproduce figure-3.2`')
    errors = [f'{t["value"]:.2f}' for t in _load(results, 'model-verification')['targets']]
    yield ('model against plant, pushes of 5, 10, 15 mm: mean target error', 'not printed',
           ', '.join(errors) + ' mm', '`reproduce model-verification`')


def _recording_rows(results):
    rows = _load(results, 'silicone-beam')['rows']
    for load, word in (('gravity', 'own weight'), ('load52', 'with 52 g')):
        free = [r for r in rows if r.get('regime') == 'free vibration' and r['damping'] == 'fitted'
                and r['marker'] == 'Tip-1' and load in r['recording']]
        for what, key, unit in (('ringing', 'frequency', 'Hz'), ('sag', 'sag_z', 'mm')):
            yield (f'silicone beam, {word}, E and nu as published: {what}',
                   f'{_mean(free, f"{key}_measured_{unit}"):.1f} {unit} measured',
                   f'{_mean(free, f"{key}_model_{unit}"):.1f} {unit}', '`reproduce silicone-beam`')
    holds = [r for r in _load(results, 'dome-rig')['rows'] if 'hold_s' in r]
    ratios = [np.mean([r['force_measured_N'] / r[f'force_{element}_N'] for r in holds])
              for element in ('quadratic', 'linear')]
    yield ('dome rig, mesh as given: measured over predicted pad force in holds',
           '1 would be right', f'{ratios[0]:.2f} (linear elements: {ratios[1]:.2f})',
           '`reproduce dome-rig`')


def _solvers(results):
    lines = ['| solver | mesh | element | CPU s | iterations | off by / um | wrong by / mm | '
             'wrong by, reaction / % |', '|---|---|---|---|---|---|---|---|']
    rows = _timed(results)
    for key in dict.fromkeys((r['solver'], r['mesh'], r['element']) for r in rows):
        best = min((r for r in rows if (r['solver'], r['mesh'], r['element']) == key),
                   key=lambda r: r['cpu_s'])
        figures = (('cpu_s', '.3g'), ('iterations', 'd'), ('error_um', '.2g'),
                   ('quadratic_far_mm', '.2f'), ('reaction_error_percent', '+.0f'))
        lines.append('| ' + ' | '.join((*key, *(_number(best[name], form)
                                                for name, form in figures))) + ' |')
    return '\n'.join(lines)


def _timed(results):
    return [r for r in _load(results, 'bench-solvers')['rows'] if r.get('cpu_s') is not None]


def _diagnosis(results):
    return diagnosis_totals.markdown(_load(results, diagnosis_totals.NAME))


def _laboratories(results):
    return diagnosis_laboratories.markdown(_load(results, diagnosis_laboratories.NAME))


def _dome_faults(results):
    return dome_faults.markdown(_load(results, dome_faults.NAME))


def _gel_block(results):
    return laboratory.markdown(_load(results, gel_block.NAME))


def _half_cylinder(results):
    return laboratory.markdown(_load(results, half_cylinder.NAME))


def _judged(results):
    """Rows of Table 4.1, one for each estimator and number of markers, without those by plant."""
    return [r for r in _load(results, 'table-4.1')['rows'] if 'below_open_loop_percent' in r]


def _estimators(results):
    lines = ['| estimator | markers | mean error [mm] | at 20 mm pushes [mm] | thesis [mm] | '
             'below open loop [%] | in 95 % ellipsoid [%] | its 95 % interval | '
             'CPU time of a step [ms] |', '|---|---|---|---|---|---|---|---|---|']
    for r in _judged(results):
        held = r['in_95_ellipsoid_percent']
        values = (f'`{r["estimator"]}`', str(r['markers'] or '-'), f'{r["mean_error_mm"]:.3f}',
                  f'{r["mean_at_20_mm_pushes_mm"]:.2f}', _number(r['thesis_mean_error_mm'], 'g'),
                  f'{r["below_open_loop_percent"]:.0f}', _number(held, '.1f'),
                  '-' if held is None else f'{r["interval_low_percent"]:.1f} to '
                                           f'{r["interval_high_percent"]:.1f}',
                  f'{r["cpu_ms"]:.1f}')
        lines.append('| ' + ' | '.join(values) + ' |')
    return '\n'.join(lines)


def _feedback(results):
    rows = _load(results, 'estimate-feedback')['rows']
    lines = ['| feedback | mean error left [mm] | largest [mm] | tasks within 0.5 mm | '
             'error of the estimate [mm] | its claimed sd per axis [mm] | '
             'in 95 % ellipsoid [% of the time] |', '|---|---|---|---|---|---|---|']
    for name in dict.fromkeys(r['feedback'] for r in rows):
        own = [r for r in rows if r['feedback'] == name]
        left = np.array([r['error_mm'] for r in own])
        estimate = [f'{_mean(own, key):.{digits}f}' for key, digits in
                    (('estimate_error_mm', 2), ('claimed_sd_mm', 2), ('coverage_percent', 0))
                    ] if own[0]['coverage_percent'] is not None else ['-'] * 3
        lines.append(f'| `{name}` | {left.mean():.3f} | {left.max():.2f} | '
                     f'{(left < 0.5).sum()} of {len(left)} | ' + ' | '.join(estimate) + ' |')
    return '\n'.join(lines)


def _procedures(results):
    body = _load(results, 'chapter-6')
    scenarios = list(dict.fromkeys(r['scenario'] for r in body['rows']))
    of = {name: [r for r in body['rows'] if r['scenario'] == name] for name in scenarios}
    lines = ['| figure | goal | ' + ' | '.join(scenarios) + ' |', '|---' * (len(of) + 2) + '|',
             '| needles | | ' + ' | '.join(str(len(rows)) for rows in of.values()) + ' |']
    for key, name, goal, digits in PROCEDURE_FIGURES:
        lines.append(f'| {name} | {goal} | ' + ' | '.join(
            _mean_and_span(rows, key, digits) for rows in of.values()) + ' |')
    simulated = {f'{r["scenario"]}, needle {r["needle"]}' for r in body['rows']
                 if r['run_as'] == r['scenario']}
    goals = [(*t['name'].split(': ', 1), t) for t in body['targets']]
    goals = [one for one in goals if one[0] in simulated]
    missed = {}
    for place, what, target in goals:
        if not target['met']:
            missed.setdefault(what, []).append(f'{place} ({_said(target)})')
    met = sum(bool(target['met']) for *_, target in goals)
    lines += ['', f'{len(simulated)} runs were simulated; the others equal one of these, since '
              f'the reader turned no needle there. Goals met: {met} of {len(goals)}.'
              + (' Missed:' if missed else ''), '']
    lines += [f'- {what}: {"; ".join(places)}' for what, places in missed.items()]
    return '\n'.join(lines).rstrip()


def _mean_and_span(rows, key, digits):
    """Mean of a column, and its smallest and largest value in brackets where they differ."""
    values = [r[key] for r in rows]
    mean, low, high = (f'{v:.{digits}f}' for v in (np.mean(values), min(values), max(values)))
    return mean if low == high else f'{mean} ({low} to {high})'


def _said(target):
    value = target['value']
    return f'{value:.3g} {target["unit"]}' if isinstance(value, float) else f'{value}'


def _number(value, form):
    return '-' if value is None else f'{value:{form}}'


def _span(rows, key, digits=0):
    values = [r[key] for r in rows]
    return f'{min(values):.{digits}f} to {max(values):.{digits}f}'


def _mean(rows, key):
    return float(np.mean([r[key] for r in rows]))


BUILDERS = {'nodes': _nodes, 'terms': _terms, 'results': _results, 'solvers': _solvers,
            'diagnosis': _diagnosis, 'laboratories': _laboratories,
            'faults': _dome_faults, 'gel': _gel_block, 'cylinder': _half_cylinder,
            'trials': blind_trials.markdown, 'scores': blind_trials.scores,
            'baselines': blind_trials.baselines, 'rate': blind_trials.rate,
            'laws': blind_trials.laws, 'singles': _single_faults,
            'hides': blind_trials.hidden, 'alike': blind_trials.alike,
            'headline': _headline, 'estimators': _estimators, 'feedback': _feedback,
            'procedures': _procedures,
            'messages': reference_tables.messages}


def main():
    """Rewrite all of DOCUMENTS in place."""
    for name in DOCUMENTS:
        path = share_dir() / name
        text = path.read_text(encoding='utf-8')
        path.write_text(rendered(text, share_dir() / 'results'), encoding='utf-8')


if __name__ == '__main__':
    main()
