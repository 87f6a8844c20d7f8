"""What `arm-brachy evaluate` does with a bag: numbers, tables, pages."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.assess import assess, to_result
from arm_brachy.evaluation.report import write_report
from arm_brachy.evaluation.residual_report import to_result as residual_result
from arm_brachy.evaluation.residual_report import write_residual_report
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.evaluation.timeseries import ResidualData
from arm_brachy.offline import load_run, model_points, recorded_cell, with_scene


def evaluate_bag(bag, folder, *, command=''):
    """Evaluate a recording; which pages are written depends on what it holds.

    bag : path;  folder : receives report.html, report_optical.html, report_em.html, result.json
    Returns (results, pages): evaluation.result.Result each, paths of the pages.
    Raises RecordingError if there is nothing to evaluate.
    """
    folder = Path(folder)
    with tempfile.TemporaryDirectory() as scratch:
        cell = recorded_cell(bag, scratch)
        run = replace(with_scene(load_run(bag), cell.scene), command=command)
        predicted = model_points(bag)
    results, pages = [], []
    if run.tasks or predicted is None:
        numbers = assess(run)
        results.append(to_result(run, numbers))
        pages.append(write_report(run, numbers, folder / 'report.html'))
    for stream, data in _residuals(run, cell, predicted):
        results.append(residual_result(data))
        pages.append(write_residual_report(data, folder / f'report_{stream}.html'))
    if not results:
        raise RecordingError(f'{bag}: neither tasks nor a model to compare with; replay it first: '
                             f'arm-brachy replay {bag} --scenario FILE')
    for result, page in zip(results, pages, strict=True):
        result.to_json(Path(page).with_suffix('.json'))
    return results, pages


def _residuals(run, cell, predicted):
    """Yield (stream name, ResidualData) for every stream of points that the model predicts too."""
    if predicted is None:
        return
    names, tt, points = predicted
    about = f'{run.name} against scene {cell.scene.name} on mesh {Path(cell.model.mesh.file).name}'
    if run.optical is not None:
        seen = np.where(run.optical.visible[..., None], run.optical.points, np.nan)
        yield 'optical', _paired(run, cell, names, tt, points, run.optical.ids, run.optical.t,
                                 seen, f'Optical markers of {about}')
    for tool, samples in run.em.items():
        series = samples.tracked()
        if tool in names and len(series):
            yield f'em_{tool}', _paired(run, cell, names, tt, points, (tool,), series.t,
                                        series.values[:, None], f'EM sensor {tool} of {about}')


def _paired(run, cell, names, tt, points, wanted, t, measured, statement):
    """Pair measured points (n, k, 3) at t with predictions, interpolated linearly in time."""
    kept = [i for i, n in enumerate(wanted) if n in names]
    index = [names.index(wanted[i]) for i in kept]
    flat = points[:, index].reshape(len(tt), -1)
    predicted = np.stack([np.interp(t, tt, c, left=np.nan, right=np.nan) for c in flat.T], axis=1)
    rest = {m.name: m.position for m in (*cell.scene.markers, *cell.scene.targets)}
    used = tuple(wanted[i] for i in kept)
    return ResidualData(
        run.name, t, used, measured[:, kept], predicted.reshape(len(t), len(kept), 3),
        np.array([rest[n] for n in used]), statement=statement, scenario=run.scenario,
        seed=cell.scenario.seed, commit=commit_of(share_dir()),
        machine=str(machine_description()), command=run.command)
