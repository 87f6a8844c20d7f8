"""The loader of the liver's sequences: what it refuses; the inside, where the files are."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.experiments import liver, recordings


def test_absent_recordings_are_named(tmp_path, monkeypatch):
    monkeypatch.setenv(recordings.VARIABLE, str(tmp_path))
    with pytest.raises(InputError, match='liver: no such folder'):
        liver.reproduce(tmp_path)
    with pytest.raises(InputError, match='no mesh_remeshed.npz'):
        liver.load_organ(tmp_path, 'linear')


def test_a_file_of_another_form_is_refused(tmp_path):
    with pytest.raises(InputError, match='law unknown'):
        liver.load_sequence(tmp_path / 'viscous_s1.npz')
    np.savez(tmp_path / 'linear_s9.npz', points_m=np.zeros((4, 3)))
    with pytest.raises(InputError, match='cannot be read'):
        liver.load_sequence(tmp_path / 'linear_s9.npz')
    np.savez(tmp_path / 'linear_s9.npz', points_m=np.zeros((4, 3)), points_per_frame=[2, 3],
             true_frames=[], true_positions_m=np.zeros((0, 1, 3)), true_force_N=np.zeros((2, 3)))
    with pytest.raises(InputError, match='says 5'):
        liver.load_sequence(tmp_path / 'linear_s9.npz')


def test_first_frame_of_the_linear_sequence():
    try:
        folder = recordings.folder(liver.SET)
    except InputError as absent:
        pytest.skip(str(absent))
    whole = liver.load_sequence(folder / 'linear_s1.npz')
    one = liver.Sequence(whole.name, whole.law, whole.clouds[:1], whole.frames[:1],
                         whole.positions[:1], whole.force[:1])
    row = liver.follow(liver.load_organ(folder, 'linear'), one)
    # at rest the inner nodes are 4.0 mm from where they are
    assert row['inner_mean_mm'] < 0.25 * 4.0
