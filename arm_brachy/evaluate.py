"""What `arm-brachy evaluate` does with a bag: numbers, tables, pages."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_brachy import graph
from arm_brachy.core.errors import RecordingError
from arm_brachy.core.paths import share_dir
from arm_brachy.diagnosis.signals.force_axes import measured_axes, reading_axis
from arm_brachy.estimation.registration import RegistrationFailed, register
from arm_brachy.evaluation import regimes
from arm_brachy.evaluation.assess import assess, estimates_to_result, to_result
from arm_brachy.evaluation.report import write_report
from arm_brachy.evaluation.residual_report import to_result as residual_result
from arm_brachy.evaluation.residual_report import write_residual_report
from arm_brachy.evaluation.residuals import noise_floor
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.evaluation.stream_figures import shown_streams
from arm_brachy.evaluation.stream_report import write_stream_report
from arm_brachy.evaluation.timeseries import ResidualData, Series
from arm_brachy.offline import load_run, recorded_cell, recorded_prediction, with_cell
from arm_brachy.recording.reader import CellBag
from arm_brachy.recording.rigid import fit_rigid

MM = 1e3
AT_FIRST = 1.0   # s, over which an EM sensor's place is averaged to register it


def evaluate_bag(bag, folder, *, command=''):
    """Evaluate a recording; which pages are written depends on what it holds.

    bag : path;  folder : receives report.html where there were tasks, and where a model ran
        report_optical.html, report_em.html, report_force.html; beside each page its numbers
        as JSON, those of estimators in report_estimates.json; of a recording without a scenario,
        such as an import, report_streams.html, what it holds
    Returns (results, pages): evaluation.result.Result each, paths of the pages.
    Raises RecordingError if there is nothing to evaluate.
    """
    folder = Path(folder)
    if not _has_scenario(bag):
        return _streams_of(bag, folder, command)
    with tempfile.TemporaryDirectory() as scratch:
        cell = recorded_cell(bag, scratch)
        run = with_em_registered(replace(with_cell(load_run(bag), cell), command=command))
        predicted = recorded_prediction(bag)
    results, pages = {}, []
    if predicted is None or _operated(run):
        numbers = assess(run)
        results['report'] = to_result(run, numbers)
        if numbers.estimates:
            results['report_estimates'] = estimates_to_result(run, numbers)
        pages.append(write_report(run, numbers, folder / 'report.html'))
    for stream, data in comparisons(run, cell, predicted).items():
        results[f'report_{stream}'] = residual_result(data)
        pages.append(write_residual_report(data, folder / f'report_{stream}.html'))
    if run.departures:
        results['report_departures'] = _departures(run)
    if not results:
        raise RecordingError(f'{bag}: neither tasks nor a model to compare with; replay it first: '
                             f'arm-brachy replay {bag} --scenario FILE')
    for name, result in results.items():
        result.to_json(folder / f'{name}.json')
    return list(results.values()), pages


def with_em_registered(run):
    """RunData with EM sensors brought to the estimates' frame, where there is no truth.

    Landmarks are the sensors over the first second in which they and the first estimator speak,
    before pads move in a well-made recording: a rigid registration with three sensors that are not
    on one line, else a shift by their mean. Without estimates, EM or such a second unchanged.
    """
    if run.truth or not run.em or not run.estimates:
        return run
    said = next(iter(run.estimates.values()))
    tracked = {tool: samples.tracked() for tool, samples in run.em.items() if tool in said}
    first = max([series.t[0] for series in (*tracked.values(), *said.values()) if len(series.t)],
                default=np.nan)
    places = {}
    for tool, series in tracked.items():
        pair = series.between(first, first + AT_FIRST), said[tool].between(first, first + AT_FIRST)
        if all(len(one.t) for one in pair):
            places[tool] = pair[0].values.mean(axis=0), pair[1].points.mean(axis=0)
    if not places:
        return run
    p_M, p_W = (np.array(side) for side in zip(*places.values(), strict=True))
    try:
        move = register(tuple(places), p_M, p_W, np.ones(len(places))).apply
    except RegistrationFailed:
        shift = (p_W - p_M).mean(axis=0)

        def move(points):
            return points + shift
    return replace(run, em_registered={tool: Series(series.t, move(series.values))
                                       for tool, series in tracked.items() if tool in places})


def _has_scenario(bag):
    with CellBag(bag) as reader:
        return 'scenario.yaml' in reader.attachments()


def _streams_of(bag, folder, command):
    """Results and pages of a recording that nobody said anything of."""
    run = replace(load_run(bag), command=command)
    if not shown_streams(run):
        raise RecordingError(f'{bag}: holds no encoders, markers, EM tools or forces, and no '
                             'scenario; must be a recording of the cell or of an import')
    result, page = write_stream_report(run, folder / 'report_streams.html')
    result.to_json(folder / 'report_streams.json')
    return [result], [page]


def _departures(run):
    """The Result of what the mismatch monitor found, one row each, in order of time."""
    rows = tuple({'found_s': t, 'departure': said} for t, said in run.departures)
    return Result(f'{run.name}: departures from the model, by mismatch_monitor', run.seed,
                  commit_of(share_dir()), str(machine_description()), rows)


def _operated(run):
    """True where someone set goals or tried to: the replay of an import has no operator."""
    return any(record.topic.lstrip('/') == graph.TASK.name for record in run.topics)


@dataclass(frozen=True)
class _Stream:
    """One kind of measurement: t (n,) [s], k names, values (n, k, 3), NaN where missing."""

    title: str
    t: np.ndarray
    names: tuple
    values: np.ndarray
    kind: str = 'position'


def comparisons(run, cell, predicted):
    """Set every stream of a recording beside what a model says of it.

    run : RunData, `offline.with_scene`;  cell : scenario.Cell
    predicted : offline.Prediction or None
    Returns stream name ('optical', 'em', 'force') -> ResidualData. Predictions are interpolated
    linearly to the times of measurement. Where encoders tell when the body was unloaded, markers
    and EM sensors are registered to the model over the stretches of rest before the first load:
    a rigid fit for three points or more, a shift for fewer. Nothing else is fitted. What load
    cells of one axis read is compared along the push of their pads alone.
    """
    if predicted is None:
        return {}
    streams = {'optical': _optical(run), 'em': _em(run), 'force': _force(run)}
    return {name: replace(data, departures=tuple(
                one for one in run.departures if one[1].startswith(f'{name} ')))
            for name, stream in streams.items() if stream is not None
            for data in [_paired(run, cell, predicted, stream)] if data is not None}


def _optical(run):
    if run.optical is None:
        return None
    seen = np.where(run.optical.visible[..., None], run.optical.points, np.nan)
    return _Stream('Optical markers', run.optical.t, run.optical.ids, seen)


def _em(run):
    """All tools on one time axis."""
    tracked = {tool: samples.tracked() for tool, samples in run.em.items()}
    tracked = {tool: series for tool, series in tracked.items() if len(series)}
    if not tracked:
        return None
    t = np.unique(np.concatenate([series.t for series in tracked.values()]))
    values = np.full((len(t), len(tracked), 3), np.nan)
    for i, series in enumerate(tracked.values()):
        values[np.searchsorted(t, series.t), i] = series.values
    return _Stream('EM sensors', t, tuple(tracked), values)


def _force(run):
    if run.force is None or not run.force_pads:
        return None
    return _Stream('Pad forces', run.force.t, run.force_pads, run.force.values, 'force')


def _paired(run, cell, predicted, stream):
    names, values = ((predicted.pads, predicted.force) if stream.kind == 'force' else
                     (predicted.names, predicted.points))
    kept = [i for i, name in enumerate(stream.names) if name in names]
    if not kept:
        return None
    used = tuple(stream.names[i] for i in kept)
    model = _at(stream.t, predicted.t, values[:, [names.index(name) for name in used]])
    measured, left, said = stream.values[:, kept], None, ''
    if stream.kind == 'force':
        measured, model, said = _as_cells_read(measured, model, used, run.pads)
    marked = _regimes(run, cell, stream.t, measured)
    if stream.kind == 'position' and run.pads and run.encoder is not None:
        measured, left, said = _registered(stream.t, measured, model, marked)
    rest = {m.name: m.position for m in (*cell.scene.markers, *cell.scene.targets)}
    where = Path(cell.model.mesh.file).name
    statement = (f'{stream.title} of {run.name} against scene {cell.scene.name}, mesh {where}, '
                 f'E = {cell.model.material.E * 1e-3:g} kPa, nu = {cell.model.material.nu:g}. '
                 f'{said}No parameter was fitted.')
    return ResidualData(
        run.name, stream.t, used, measured, model,
        np.array([rest.get(name, (0.0, 0.0, 0.0)) for name in used]), statement=statement,
        scenario=run.scenario, seed=cell.scenario.seed, commit=commit_of(share_dir()),
        machine=str(machine_description()), command=run.command, registration=left,
        regimes=marked, tissue=predicted.tissue, kind=stream.kind)


def _as_cells_read(measured, model, names, pads):
    """Force (n, k, 3) measured and of the model, on load cells of one axis along the push alone.

    Also says so, '' if there are none.
    """
    measured, model, single = measured.copy(), model.copy(), []
    pushes = {pad.name: pad.direction for pad in pads}
    for k, name in enumerate(names):
        read, push = measured_axes(measured[:, [k]])[:, 0], pushes.get(name)
        seen = np.isfinite(read).all(axis=1)
        axis = None if push is None else reading_axis(read[seen], push)
        if axis is not None:
            single.append(name)
            measured[:, k], model[:, k] = np.outer(read @ axis, push), np.outer(
                model[:, k] @ push, push)
    said = (f'The cells of {", ".join(single)} have one axis: forces are compared along their '
            'push. ') if single else ''
    return measured, model, said


def _at(t, tt, values):
    """Values (m, k, 3) at tt, interpolated to t; NaN outside."""
    flat = values.reshape(len(tt), -1).T
    columns = [np.interp(t, tt, column, left=np.nan, right=np.nan) for column in flat]
    return np.stack(columns, axis=1).reshape(len(t), *values.shape[1:])


def _regimes(run, cell, t, measured):
    if cell.scenario.release is not None:
        return regimes.release_regimes(t, measured, cell.scenario.release, noise_floor(measured))
    if run.encoder is not None and run.encoder.values.shape[1]:
        return regimes.pad_regimes(run.encoder)
    return ()


def _registered(t, measured, model, marked):
    """Register at first rest: (n, k, 3) moved, what is left per point (k,) [m], in words.

    Unchanged, None and '' if the recording does not begin at rest or nothing was seen there.
    """
    first = marked[0] if marked and marked[0].name == regimes.REST else None
    rows = np.zeros(len(t), dtype=bool) if first is None else (t < first.t_end)
    seen = np.isfinite(measured[rows] + model[rows]).all(axis=2)
    if not seen.any():
        return measured, None, ''
    known = seen.any(axis=0)
    at = [np.array([x[rows][seen[:, k], k].mean(axis=0) for k in np.flatnonzero(known)])
          for x in (measured, model)]
    left = np.full(measured.shape[1], np.nan)
    if known.sum() >= 3:
        fit = fit_rigid(*at)
        moved, left[known] = fit.apply(measured), fit.residual
        angle = np.degrees(np.arccos(np.clip((np.trace(fit.R) - 1.0) / 2.0, -1.0, 1.0)))
        turn = f', turned by {angle:.2f} deg'
    else:
        shift = (at[1] - at[0]).mean(axis=0)
        moved, turn = measured + shift, ''
        left[known] = np.linalg.norm(at[0] + shift - at[1], axis=1)
    shifted = np.nanmax(np.linalg.norm((moved - measured)[rows], axis=2)) * MM
    return moved, left, (f'Registered over the first {first.t_end - first.t_start:.1f} s of rest: '
                         f'points moved by up to {shifted:.2f} mm{turn}. ')
