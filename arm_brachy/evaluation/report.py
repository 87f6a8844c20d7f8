"""The report of a run: one HTML page that says first whether the goals were met."""

import numpy as np

from arm_brachy.evaluation import body_view, estimate_figures, figures, procedure_figures
from arm_brachy.evaluation.page import (
    Cell,
    Column,
    Fact,
    Grid,
    Verdict,
    number,
    pictures,
    provenance,
    write_page,
)
from arm_brachy.evaluation.procedure_metrics import procedure_row
from arm_brachy.evaluation.replay import run_film
from arm_brachy.evaluation.result import cell_text
from arm_brachy.viewing.page import film_block

MM = 1e3
FILM_FRAMES, LEAST_FRAMES = 300, 2    # a page of one to three MB

TASK_COLUMNS = (
    Column('Task', numeric=False), Column('Loop', numeric=False), Column('Duration', 's'),
    Column('ITAE, EM', 'mm·s²'), Column('ITAE, truth', 'mm·s²'),
    Column('Steady-state error, truth', 'mm'), Column('Steady-state error, EM', 'mm'),
    Column('Overshoot', 'mm (% of step)'), Column('Rise time', 's'),
    Column('Settling time', 's'), Column('Pad travel', 'mm'), Column('Peak force', 'N'))

MOVE_COLUMNS = (
    Column('Move', numeric=False), Column('Duration', 's'), Column('Deepest push', 'mm'),
    Column('Pad travel', 'mm'), Column('Peak force', 'N'), Column('Made', numeric=False))

PROCEDURE_COLUMNS = (Column('Procedure', numeric=False), Column('Value'))
PROCEDURE_UNITS = {'percent': '%', 'mm': 'mm', 's': 's', 'N': 'N', 'Nm': 'N m', 'rad': 'rad'}

ESTIMATE_COLUMNS = (
    Column('Estimator', numeric=False), Column('Target', numeric=False), Column('Estimates'),
    Column('Available', '% of time'), Column('Mean error', 'mm'), Column('95 % within', 'mm'),
    Column('Largest', 'mm'), Column('Claimed sd', 'mm'), Column('95 % ellipsoid holds', '%'))

TOPIC_COLUMNS = (
    Column('Topic', numeric=False), Column('Type', numeric=False), Column('Recorded', 'messages'),
    Column('Lost', 'messages'), Column('Rate', 'Hz'), Column('Jitter', 'ms'),
    Column('Longest gap', 'ms'))

GOAL_COLUMNS = (Column('Goal', numeric=False), Column('Required', numeric=False),
                Column('Reached'), Column('Met', numeric=False))

OUTCOME_COLUMNS = (Column('Node', numeric=False), Column('Outcome', numeric=False),
                   Column('Times'), Column('Last message', numeric=False))


def write_report(run, numbers, out_html):
    """Write the report of `run` (timeseries.RunData) with its `numbers` (assess.RunMetrics).

    out_html : path of the page, which needs no other file;  Returns the path.
    """
    return write_page(
        'report.html.j2', out_html, title=f'{run.name}: report', kind='arm_brachy run report',
        heading=run.name, verdict=_verdict(run, numbers), facts=_facts(numbers),
        procedure=_procedure_grid(numbers), tasks=_task_grid(numbers),
        moves=_move_grid(run, numbers),
        estimates=_estimate_grid(run, numbers), plates=pictures(plates(run, numbers)),
        goals=_goal_grid(numbers.targets), topics=_topic_grid(run, numbers),
        outcomes=_outcome_grid(run.outcomes), provenance=provenance(run), command=run.command,
        scenario=run.scenario, **_film(run))


def _film(run):
    """The run as a film, and what its layers are; empty where too little was recorded."""
    film = run_film(run, FILM_FRAMES)
    if len(film) < LEAST_FRAMES:
        return {'film': '', 'film_note': ''}
    return {'film': film_block('film', film.text()), 'film_note': (
        'Layers that begin with "true" are the simulated plant, which no sensor of the cell sees; '
        'all others are what the cell measured, estimated or wanted.' if run.truth else
        'All layers are what was measured, estimated or wanted.')}


def plates(run, numbers):
    """The figures of the report that the data allow, as style.Plate in order."""
    drawn = [] if run.procedure is None else procedure_figures.plates(run)
    for first in range(0, len(run.tasks), figures.COLUMNS):
        chunk = run.tasks[first:first + figures.COLUMNS]
        drawn.append(figures.time_response(run, chunk, numbers.goals.steady_state_error))
    drawn += [estimate_figures.estimate(run, name, target)
              for name, target in _shown_estimates(run, numbers)]
    if run.moves and run.encoder is not None:
        drawn.append(figures.pad_travel(run))
    if not (run.tasks or run.moves) and run.optical is not None and len(run.optical.t):
        drawn.append(figures.marker_travel(run))
    if numbers.deformation is not None:
        drawn.append(body_view.body(run, numbers.deformed_at))
    if run.force is not None and run.force.values.size:
        drawn.append(figures.pad_forces(run))
    if np.isfinite(run.span()).all():
        drawn.append(figures.streams(run, numbers.streams))
    return drawn


def _shown_estimates(run, numbers):
    """(estimator, target) of the figures: the targets of the tasks, without tasks the first."""
    asked = dict.fromkeys(task.target for task in run.tasks) or list(run.reference)[:1]
    return [(n.estimator, n.target) for n in numbers.estimates if n.target in asked]


def _verdict(run, numbers):
    missed = [goal for goal in numbers.targets if goal.met is False]
    unknown = [goal for goal in numbers.targets if goal.met is None]
    detail = _what_ran(run)
    if not numbers.targets:
        return Verdict('open', 'No goals were set for this run.', detail)
    if missed:
        worst = '; '.join(f'{goal.name} {_value(goal.value)}{_unit(goal)} '
                          f'(required {goal.goal})' for goal in missed[:3])
        more = f'; and {len(missed) - 3} more' if len(missed) > 3 else ''
        return Verdict('bad', f'{len(missed)} of {len(numbers.targets)} goals missed: '
                              f'{worst}{more}.', detail)
    if unknown:
        return Verdict('open', f'{len(unknown)} of {len(numbers.targets)} goals cannot be judged '
                               f'from this recording, the others are met.', detail)
    if len(numbers.targets) == 1:
        return Verdict('good', f'The only goal is met: {numbers.targets[0].name} '
                               f'{numbers.targets[0].goal}.', detail)
    return Verdict('good', f'All {len(numbers.targets)} goals met.', detail)


def _value(value):
    return number(value, 3) if isinstance(value, float) else cell_text(value)


def _unit(goal):
    return '' if goal.unit in ('', '1') else f' {goal.unit}'


def _what_ran(run):
    first, last = run.span()
    if run.procedure is not None:
        p = run.procedure
        lasting = p.steps[-1][0] - p.steps[0][0]
        hole = p.plan.get('hole', '').replace(' ', ', ')
        where = f' through hole {hole}' if hole else ''
        why = f' Why it failed: {p.message}.' if p.message else ''
        return (f'Procedure on {p.target}{where}: {p.strategy} strategy, {p.control} control, '
                f'{"with" if p.overlay else "without"} overlay; {lasting:.1f} s.{why}')
    modes = sorted({task.mode.replace('_', ' ') for task in run.tasks})
    targets = sorted({task.target for task in run.tasks})
    lasted = f'{last - first:.1f} s recorded' if np.isfinite(last - first) else 'nothing recorded'
    if run.moves:
        return f'{len(run.moves)} prescribed move{"s" if len(run.moves) > 1 else ""}; {lasted}.'
    if not run.tasks:
        return f'No task was set; {lasted}.'
    plural = 's' if len(run.tasks) > 1 else ''
    heard = '' if run.feedback == 'em' else (
        f' over {run.feedback}_estimator, without a sensor in the tissue')
    return (f'{len(run.tasks)} task{plural} on {", ".join(targets)}, {" and ".join(modes)}'
            f'{heard}; {lasted}.')


def _facts(numbers):
    facts = []
    if numbers.procedure is not None:
        of = numbers.procedure
        facts += [Fact('Insertion with the tip in the image plane', number(100 * of.in_plane, 1),
                       '% (within 0.5 mm)'),
                  Fact('Tip to target at the dwell', number(of.miss * MM, 2), 'mm'),
                  Fact('Contact force, rms error', number(of.force_rms, 3), 'N'),
                  Fact('Contact force, overshoot', number(of.force_overshoot, 3), 'N')]
    if numbers.tasks:
        errors = [task.steady_state_error for task in numbers.tasks]
        source = ', '.join(sorted({task.response_from for task in numbers.tasks}))
        itae = float(np.median([task.itae_em for task in numbers.tasks]))
        facts.append(Fact(f'Worst steady-state error ({source})', number(max(errors) * MM, 3),
                          'mm'))
        if np.isfinite(itae):
            facts.append(Fact('Median ITAE (EM)', number(itae * MM, 1), 'mm·s²'))
    for name in dict.fromkeys(n.estimator for n in numbers.estimates):
        errors = [n.mean for n in numbers.estimates if n.estimator == name]
        facts.append(Fact(f'Mean error of {name}_estimator', number(np.mean(errors) * MM, 3),
                          'mm'))
    if numbers.deformation is not None:
        shape = numbers.deformation
        facts += [Fact('Largest tissue displacement', number(shape.max_displacement * MM),
                       f'mm (mean {number(shape.mean_displacement * MM)})'),
                  Fact('Largest principal stretch', number(shape.max_stretch, 3))]
    if numbers.streams:
        count = sum(q.count for q in numbers.streams.values())
        lost = f'{numbers.lost} lost' if _any_counted(numbers) else 'losses not counted'
        facts.append(Fact('Messages recorded', f'{count:,}'.replace(',', ' '), lost))
    if np.isfinite(numbers.real_time_factor):
        facts.append(Fact('Speed', number(numbers.real_time_factor), '× real time'))
    return facts


def _any_counted(numbers):
    return any(q.lost is not None for q in numbers.streams.values())


def _task_grid(numbers):
    limit = numbers.goals.steady_state_error
    note = (f'ITAE (3.30) and errors on the controlled axes. Steady-state error: mean distance '
            f'from the goal over the last {numbers.goals.window:g} s; measured by EM it contains '
            f"the tracker's noise. Settling: time after which the distance stays within "
            f'{limit * MM:g} mm. Overshoot is negative where the goal was not reached. Overshoot, '
            f'rise and settling from {_source(numbers.tasks)}. Pad travel: summed over the '
            f'pads. A dash: cannot be said.')
    return Grid(TASK_COLUMNS, tuple(_task_cells(task, limit) for task in numbers.tasks), note)


def _procedure_grid(numbers):
    if numbers.procedure is None:
        return Grid()
    rows = []
    for key, value in procedure_row(numbers.procedure).items():
        if key == 'why':    # a sentence, which the verdict has
            continue
        name, unit = _named(key)
        text = value if isinstance(value, str) else number(value, 3)
        rows.append((Cell(name), Cell(f'{text} {unit}'.strip())))
    return Grid(PROCEDURE_COLUMNS, tuple(rows), (
        'Of the true tip, over the insertion: distance from the image plane; tip found in the '
        'image less the true one; distance from the axis of the hole, and from the planned path '
        'where that is as deep, at the end. Tip to target, and target to its goal across the '
        'needle: means over the dwell. Seed to target: at rest, of a seed left at the tip at the '
        'end of the dwell. '
        'Force: by the sensor in every period of the controller, less its goal, once it has come '
        'within 0.3 N of it; true force: the same of what the tissue answers, from which '
        "the sensor's zero drifts away. Torque: mean norm over the joints that turn."))


def _named(key):
    """('tip to target', 'mm') of tip_to_target_mm."""
    for unit, shown in PROCEDURE_UNITS.items():
        if key.endswith(f'_{unit}'):
            return key.removesuffix(f'_{unit}').replace('_', ' '), shown
    return key.replace('_', ' '), ''


def _move_grid(run, numbers):
    note = ('Moves are prescribed, nothing is fed back. Deepest push: largest travel of any pad '
            'from home, by its encoder. Pad travel: summed over the pads. A move is made if every '
            'pad arrived. A dash: cannot be said.')
    return Grid(MOVE_COLUMNS, tuple(
        (Cell(move.name), Cell(number(move.duration, 1)),
         Cell(number(move.deepest * MM, 1)),
         Cell(number(move.pad_travel.sum() * MM if len(move.pad_travel) else np.nan, 1)),
         Cell(number(move.peak_force.max() if len(move.peak_force) else np.nan)),
         Cell('yes') if move.made else Cell(window.message or 'no', 'bad'))
        for move, window in zip(numbers.moves, run.moves, strict=True)), note)


def _estimate_grid(run, numbers):
    note = (f'Distance of estimate from {run.reference_name} at the same instant, over the whole '
            'run; of each estimator and target. Available: share of the time since its first '
            'estimate that it had one no older than half as much again as usual. Claimed sd: per '
            'axis, from the covariance. Errors of one run go together in time: the last column of '
            'a single run may be far from 95 % without saying that the covariance is wrong.')
    return Grid(ESTIMATE_COLUMNS, tuple(
        (Cell(n.estimator), Cell(n.target), Cell(str(n.count)), Cell(number(n.share * 100, 1)),
         Cell(number(n.mean * MM, 3)), Cell(number(n.p95 * MM, 3)),
         Cell(number(n.largest * MM, 3)), Cell(number(n.sd * MM, 3)),
         Cell(number(n.coverage * 100, 1))) for n in numbers.estimates), note)


def _source(tasks):
    return ' and '.join(sorted({task.response_from for task in tasks}))


def _task_cells(task, limit):
    def mood(value, source):
        if task.mode != 'closed_loop' or task.response_from != source:
            return ''
        return 'good' if value < limit else 'bad'

    truth, measured = task.steady_truth.mean_abs, task.steady_em.mean_abs
    travel = task.pad_travel.sum() if len(task.pad_travel) else np.nan
    force = task.peak_force.max() if len(task.peak_force) else np.nan
    texts = [
        (task.name, ''), (task.mode.replace('_loop', ''), ''), (number(task.duration, 1), ''),
        (number(task.itae_em * MM, 1), ''), (number(task.itae_truth * MM, 1), ''),
        (number(truth * MM, 3), mood(truth, 'truth')),
        (number(measured * MM, 3), mood(measured, 'EM')),
        (f'{number(task.overshoot.distance * MM, 3)} '
         f'({number(task.overshoot.fraction * 100, 1)})', ''),
        (number(task.rise_time), ''), (number(task.settling_time), ''),
        (number(travel * MM, 1), ''), (number(force), '')]
    return tuple(Cell(text, tone) for text, tone in texts)


def _goal_grid(targets):
    moods = {True: 'good', False: 'bad', None: 'open'}
    return Grid(GOAL_COLUMNS, tuple(
        (Cell(goal.name), Cell(f'{goal.goal}{_unit(goal)}'),
         Cell(f'{_value(goal.value)}{_unit(goal)}'),
         Cell('cannot be judged' if goal.met is None else cell_text(goal.met), moods[goal.met]))
        for goal in targets))


def _topic_grid(run, numbers):
    rows = []
    for record in run.topics:
        q = numbers.streams[record.topic]
        lost = Cell('not counted', 'open') if q.lost is None else Cell(
            str(q.lost), 'bad' if q.lost else '')
        rows.append((Cell(record.topic), Cell(record.kind), Cell(str(q.count)), lost,
                     Cell(number(q.rate, 1)), Cell(number(q.jitter * 1e3)),
                     Cell(number(q.longest_gap * 1e3, 1))))
    return Grid(TOPIC_COLUMNS, tuple(rows), (
        "Lost: messages published, by the publishers' sequence counters, less those recorded. "
        'Rate, jitter (standard deviation of the interval) and longest gap from header stamps; '
        'for topics that speak only now and then they mean little.'))


def _outcome_grid(outcomes):
    return Grid(OUTCOME_COLUMNS, tuple(
        (Cell(o.node), Cell(o.outcome, '' if o.outcome == 'OK' else 'open'), Cell(str(o.count)),
         Cell(o.message)) for o in outcomes))
