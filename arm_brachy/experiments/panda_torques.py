"""Measured joint torques of a Panda on an excitation trajectory, against our model of it.

No parameter is fitted here: inertias and friction are the published ones. Accelerations are not
measured; they are derived from filtered velocities as the publication does.
Source of data and method: Gaz et al., IEEE RA-L 4(4):4147, 2019. Every .npz file of the folder is
one run with t_s (n,), q_rad, dq_rad_s, tau_Nm (n, 7), without payload.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.style import INK, OURS, Plate, new_figure, styled
from arm_brachy.experiments import recordings
from arm_brachy.robot.friction import joint_friction
from arm_brachy.robot.panda_parameters import JOINTS
from arm_brachy.robot.rigid_body import Arm

NAME = 'panda-torques'
SET = 'panda_torques'
COLUMNS = {'q_rad': 'joint angles', 'dq_rad_s': 'joint velocities', 'tau_Nm': 'joint torques'}
RATE = 1000.0       # Hz of the robot's controller
CUTOFF, ORDER = 5.0, 4   # Hz; zero-phase Butterworth, Gaz et al. sec. IV
GOALS = (0.45, 0.75, 0.40, 0.55, 0.20, 0.17, 0.10)   # N m
# Mean over ten validation runs of the publication, as root mean square. N m.
PUBLISHED = tuple(np.sqrt([0.407, 1.028, 0.595, 0.423, 0.175, 0.040, 0.027]))


@dataclass(frozen=True)
class TorqueRun:
    """One run. t : (n,) [s];  measured, predicted : (n, 7) [N m]."""

    name: str
    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray

    @property
    def rms(self):
        """(7,) [N m] root mean square of predicted - measured."""
        return np.sqrt(np.mean((self.predicted - self.measured) ** 2, axis=0))


def reproduce(out_dir):
    """Predict the torques of every run; write JSON and PNG into `out_dir`.

    Returns evaluation.result.Result: a row and a goal per run and joint. Raises InputError if the
    recordings are absent or not of the form above.
    """
    runs = [predict(path) for path in sorted(recordings.folder(SET).glob('*.npz'))]
    if not runs:
        raise InputError(f'{recordings.folder(SET)}: no .npz file; must hold one run at least')
    rows = tuple(row for run in runs for row in _rows(run))
    targets = tuple(
        Target(f'{run.name}, joint {j + 1}, RMS', float(run.rms[j]), 'N m', f'<= {goal:g}',
               bool(run.rms[j] <= goal)) for run in runs for j, goal in enumerate(GOALS))
    result = Result(NAME, None, commit_of(share_dir()), str(machine_description()), rows, targets)
    result.to_json(Path(out_dir) / f'{NAME}.json')
    figure(runs[0]).save(Path(out_dir) / f'{NAME}.png')
    return result


def predict(path):
    """Return the TorqueRun of a file. Raises InputError naming what the file lacks."""
    t, columns = _read(path)
    # The receiver's stamps jitter and packets are lost: back onto the controller's own clock.
    clock = np.arange(t[0], t[-1], 1.0 / RATE)
    q, dq, measured = (np.column_stack([np.interp(clock, t, c) for c in columns[name].T])
                       for name in COLUMNS)
    dq = filtfilt(*butter(ORDER, CUTOFF, fs=RATE), dq, axis=0)
    ddq = np.gradient(dq, 1.0 / RATE, axis=0)
    arm = Arm.panda()
    predicted = np.array([arm.torque(*state) for state in zip(q, dq, ddq, strict=True)])
    return TorqueRun(path.stem, clock - clock[0], measured, predicted + joint_friction(dq))


def _read(path):
    with np.load(path) as file:
        for name in ('t_s', *COLUMNS):
            if name not in file:
                raise InputError(f'{path}: has no {name}; must hold t_s, {", ".join(COLUMNS)}')
        t = file['t_s'].astype(float)
        columns = {name: file[name].astype(float) for name in COLUMNS}
    for name, values in columns.items():
        if values.shape != (len(t), JOINTS):
            raise InputError(f'{path}: {name} has shape {values.shape}; must be '
                             f'({len(t)}, {JOINTS}) as t_s has {len(t)} samples')
    if np.any(np.diff(t) <= 0.0):
        raise InputError(f'{path}: t_s does not increase at sample '
                         f'{int(np.argmax(np.diff(t) <= 0.0)) + 1}; must be in order of time')
    return t, columns


def _rows(run):
    mean = np.mean(run.predicted - run.measured, axis=0)
    for j in range(JOINTS):
        yield {'run': run.name, 'joint': j + 1, 'rms_Nm': float(run.rms[j]),
               'mean_error_Nm': float(mean[j]),
               'measured_rms_Nm': float(np.sqrt(np.mean(run.measured[:, j] ** 2))),
               'published_rms_Nm': float(PUBLISHED[j])}


@styled
def figure(run):
    """Measured and predicted torque of each joint over time."""
    sheet = new_figure(7.2, 8.4)
    axes = sheet.subplots(JOINTS, 1, sharex=True)
    for j, axis in enumerate(axes):
        axis.plot(run.t, run.measured[:, j], color=INK, lw=0.6, label='measured')
        axis.plot(run.t, run.predicted[:, j], color=OURS, lw=1.0,
                  label='model, published parameters')
        axis.set_ylabel(f'joint {j + 1}\nN m')
        axis.set_title(f'RMS error {run.rms[j]:.2f} N m', fontsize=8, loc='right', pad=1)
    axes[-1].set_xlabel('time / s')
    axes[0].legend(loc='lower center', bbox_to_anchor=(0.35, 0.98), ncols=2)
    return Plate(NAME, sheet, 'Panda: measured and predicted joint torques.')
