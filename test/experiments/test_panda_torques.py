"""Torques of a made-up run come back; the measured run meets its goals where it is present."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.experiments import panda_torques, recordings
from arm_brachy.robot.friction import joint_friction
from arm_brachy.robot.rigid_body import Arm

AMPLITUDE, PULSE = 0.3, 2.0   # rad, rad/s: well below the filter's 5 Hz


def swing(t):
    phase = PULSE * t[:, None] + np.arange(7)
    centre = np.array([0.0, -0.3, 0.2, -1.8, 0.0, 1.7, 0.3])
    return (centre + AMPLITUDE * np.sin(phase), AMPLITUDE * PULSE * np.cos(phase),
            -AMPLITUDE * PULSE**2 * np.sin(phase))


def write(path, t, **changed):
    q, dq, ddq = swing(t)
    arm = Arm.panda()
    tau = np.array([arm.torque(*s) for s in zip(q, dq, ddq, strict=True)]) + joint_friction(dq)
    np.savez(path, **({'t_s': t, 'q_rad': q, 'dq_rad_s': dq, 'tau_Nm': tau} | changed))


def test_torques_of_a_known_motion_come_back_through_jitter_and_lost_packets(tmp_path):
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 6.0, 1e-3)
    t = (t + rng.uniform(-2e-4, 2e-4, len(t)))[rng.uniform(size=len(t)) > 0.02]
    write(tmp_path / 'run.npz', t)
    run = panda_torques.predict(tmp_path / 'run.npz')
    inside = (run.t > 0.5) & (run.t < run.t[-1] - 0.5)   # away from the filter's ends
    error = np.abs(run.predicted - run.measured)[inside].max(axis=0)
    assert np.all(error < 0.02 * np.abs(run.measured).max(axis=0) + 0.02)


@pytest.mark.parametrize('changed, named', [
    ({'q_rad': np.zeros((3, 7))}, 'q_rad has shape (3, 7)'),
    ({'t_s': np.zeros(100)}, 't_s does not increase'),
])
def test_a_file_of_another_form_is_refused_by_name(tmp_path, changed, named):
    write(tmp_path / 'run.npz', np.arange(100) * 1e-3, **changed)
    with pytest.raises(InputError) as error:
        panda_torques.predict(tmp_path / 'run.npz')
    assert named in str(error.value)


def test_the_measured_run_is_predicted_within_the_goals(tmp_path):
    try:
        recordings.folder(panda_torques.SET)
    except InputError as absent:
        pytest.skip(str(absent))
    result = panda_torques.reproduce(tmp_path)
    assert len(result.targets) >= 7 and result.met
