"""Another laboratory's soft dome, pushed by four discs, against the model of its own scene file.

Nothing is tuned: mesh, material and pads are theirs, markers and EM sensors are registered rigidly
over the rest before the first push. The numbers say what the model misses. Their mesh is coarse on
purpose and their simulator's elements are linear; how much of the misfit that is shows in the
equilibria of the same mesh with linear and with quadratic elements.
"""

import tempfile
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np

from arm_brachy import cell as cells
from arm_brachy.core.paths import share_dir
from arm_brachy.evaluate import comparisons
from arm_brachy.evaluation import regimes
from arm_brachy.evaluation.residual_report import floor_of, to_result, write_residual_report
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.evaluation.style import BAND, INK, MM, OURS, Plate, colour, new_figure, styled
from arm_brachy.experiments import recordings
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.offline import Prediction, load_run, predict, with_scene
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.scene_import import import_scene
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import embed, interpolate, load_mesh, quadratic_mesh
from arm_brachy.tissue.simulator import TissueSimulator

NAME = 'dome-rig'
SET = 'dome_rig'
SETTLING = 0.3      # s of a hold that are left out of its mean


@dataclass(frozen=True)
class Replay:
    """One recording: name, RunData, Prediction, and stream name -> ResidualData."""

    name: str
    run: object
    predicted: Prediction
    streams: dict


def imported(source, scratch):
    """Import their scene and recordings from folder `source` into folder `scratch`.

    Returns (path of the scene, name -> path of the bag).
    """
    files = import_scene(source / 'scene.yaml', scratch / 'dome', name='dome')
    bags = {name: scratch / f'dome_{name}' for name in files['maps']}
    for name, columns in files['maps'].items():
        import_csv(columns, bags[name])
    return Path(files['scene']), bags


def reproduce(out_dir):
    """Import, replay in process and evaluate every recording; write JSON, PNG, pages to `out_dir`.

    Returns evaluation.result.Result: rows per recording, stream, marker or pad, and regime; then
    rows per hold, measured beside the model with linear and quadratic elements. No goals are set.
    Raises InputError if the recordings are absent.
    """
    source, out_dir = recordings.folder(SET), Path(out_dir)
    with tempfile.TemporaryDirectory() as scratch:
        files = import_scene(source / 'scene.yaml', Path(scratch) / 'scene', name=SET)
        cell = load_cell(files['scenario'])
        with process_pool(len(files['maps'])) as pool:
            replays = list(pool.map(_replay, files['maps'], repeat(files['scenario']),
                                    files['maps'].values(),
                                    [Path(scratch) / name for name in files['maps']]))
        held = _hold_rows(cell.model, replays)
    rows = [({'recording': replay.name, 'stream': stream} | row) for replay in replays
            for stream, data in replay.streams.items() for row in to_result(data).rows]
    rows.sort(key=lambda row: 'pad' in row)
    result = Result(NAME, cell.scenario.seed, commit_of(share_dir()), str(machine_description()),
                    (*rows, *held))
    result.to_json(out_dir / f'{NAME}.json')
    figure(replays).save(out_dir / f'{NAME}.png')
    for replay in replays:
        for stream, data in replay.streams.items():
            write_residual_report(data, out_dir / f'{replay.name}_{stream}.html')
    return result


def _replay(name, scenario, column_map, bag):
    cell = load_cell(scenario)
    import_csv(column_map, bag)
    run = with_scene(load_run(bag), cell.scene)
    predicted = predict(cell, run.encoder.t[-1], run.encoder)
    return Replay(name, run, predicted, comparisons(run, cell, predicted))


def _hold_rows(scene, replays):
    """Every hold's equilibrium with both elements, beside the data."""
    given = load_mesh(scene.mesh.file, scene.mesh.unit)
    models = (('linear', Equilibria(scene, given)),
              ('quadratic', Equilibria(scene, quadratic_mesh(given))))
    rows = []
    for replay in replays:
        for regime in regimes.pad_regimes(replay.run.encoder):
            if regime.name == regimes.HOLD and regime.t_end - regime.t_start > 2.0 * SETTLING:
                rows += _one_hold(replay, regime, models)
    return rows


def _one_hold(replay, regime, models):
    """One row per pad that pushes."""
    rest = _mean_over(replay, 0.0, regimes.pad_regimes(replay.run.encoder)[0].t_end)
    pushed = _mean_over(replay, regime.t_start + SETTLING, regime.t_end)
    q, moved, force = (b - a for a, b in zip(rest, pushed, strict=True))
    states = {name: model.at(q) for name, model in models}
    names = list(replay.streams['optical'].names)
    index = [names.index(name) for name in models[0][1].marker_names]
    rows = []
    for p in np.flatnonzero(q > regimes.TOUCH):
        axis = models[0][1].directions[p]
        row = {'recording': replay.name, 'hold_s': regime.t_start,
               'pad': replay.run.force_pads[p], 'push_mm': q[p] * MM,
               'force_measured_N': -float(force[p] @ axis)}
        row |= {f'force_{name}_N': -float(state[1][p] @ axis) for name, state in states.items()}
        row |= {f'motion_gain_{name}': _gain(moved[index], state[0])
                for name, state in states.items()}
        rows.append(row)
    return rows


def _mean_over(replay, start, stop):
    """Mean encoder (p,), marker positions (k, 3) and pad forces (p, 3) over [start, stop]."""
    optical, force = replay.streams['optical'], replay.streams['force']
    means = [replay.run.encoder.between(start, stop).values.mean(axis=0)]
    for data in (optical, force):
        rows = (data.t >= start) & (data.t <= stop)
        count = np.isfinite(data.measured[rows]).sum(axis=0)
        total = np.nansum(data.measured[rows], axis=0)
        means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    return means


def _gain(measured, predicted):
    """Least-squares factor from predicted to measured displacements (k, 3), unseen left out."""
    seen = np.isfinite(measured).all(axis=1)
    return float(np.sum(measured[seen] * predicted[seen]) / np.sum(predicted[seen] ** 2))


class Equilibria:
    """The body of a scene on a mesh, asked for its rest states under pushes."""

    def __init__(self, scene, mesh):
        """scene : core.scene.Scene;  mesh : TetMesh."""
        body = build_body(scene, mesh)
        markers = [m for m in scene.markers if m.body == 'tissue']
        self.marker_names = [m.name for m in markers]
        self.directions = cells.pad_directions(scene)
        self._rest = np.array([m.position for m in markers])
        self._riders = embed(mesh, self._rest, names=self.marker_names)
        self._simulator = TissueSimulator(body)

    def at(self, q):
        """Marker displacements (k, 3) [m] and pad forces (p, 3) [N] with pads at q (p,) [m]."""
        state = self._simulator.settle(self.directions * q[:, None])
        if not state.outcome.ok:
            return np.full_like(self._rest, np.nan), np.full_like(state.pad_force, np.nan)
        return interpolate(self._riders, state.x) - self._rest, state.pad_force


@styled
def figure(replays):
    """Residual of tissue markers and push-back on the pads over time, a column per recording.

    For who asks: does the model follow the tissue and return the forces that were measured?
    """
    sheet = new_figure(4.2 * len(replays), 6.0)
    axes = sheet.subplots(2, len(replays), sharex='col', sharey='row', squeeze=False)
    for column, replay in zip(axes.T, replays, strict=True):
        column[0].set_title(f'recording {replay.name}')
        _draw_residual(column[0], replay.streams['optical'])
        _draw_forces(column[1], replay)
    axes[0, 0].set_ylabel('residual of tissue markers, rms / mm')
    axes[1, 0].set_ylabel('push-back on the pads / N')
    sheet.supxlabel('time / s', fontsize=9)
    handles = [handle for row in axes for handle in row[0].get_legend_handles_labels()[0]]
    sheet.legend(handles=handles, loc='outside upper center', ncols=4)
    return Plate(NAME, sheet, 'Dome rig: what the model misses.')


def _draw_residual(axis, data):
    tissue = [k for k, name in enumerate(data.names) if name.startswith('m')]
    squared = np.sum((data.measured - data.predicted)[:, tissue] ** 2, axis=2)
    count = np.isfinite(squared).sum(axis=1)
    rms = np.sqrt(np.nansum(squared, axis=1) / np.maximum(count, 1))
    axis.plot(data.t, np.where(count > 0, rms, np.nan) * MM, color=OURS, lw=0.9,
              label='measured minus model')
    floor = np.sqrt(np.mean(floor_of(data)[tissue] ** 2)) * MM
    axis.axhline(floor, color=BAND, lw=1.2, label='noise floor')


def _draw_forces(axis, replay):
    data = replay.streams['force']
    directions = np.array([pad.direction for pad in replay.run.pads])
    for p in range(len(data.names)):
        axis.plot(data.t, -data.measured[:, p] @ directions[p], color=colour(p), lw=0.9)
        axis.plot(data.t, -data.predicted[:, p] @ directions[p], color=colour(p), lw=0.9, ls='--')
    axis.plot([], [], color=INK, lw=0.9, label='measured, a colour per pad')
    axis.plot([], [], color=INK, lw=0.9, ls='--', label='model')
