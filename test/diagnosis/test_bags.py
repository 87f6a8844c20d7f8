"""The front door for scripts: every recording reaches its place, with its scene, on one clock."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis import bags as door
from arm_brachy.diagnosis.bags import diagnose_bags
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.recording import encode
from arm_brachy.recording.writer import BagWriter

SCENE = config_dir() / 'scenes' / 'breast.yaml'
BEAM = config_dir() / 'scenes' / 'silicone_beam.yaml'


@pytest.fixture
def asked(monkeypatch):
    """What the pipeline is asked, keyword by keyword; recordings are their paths and scenes."""
    said = {}

    def diagnose(fitted, provenance, **more):
        said.update(more, fitted=fitted, provenance=provenance)
        return 'answer'
    monkeypatch.setattr(door, 'zero_of', lambda bags: said.setdefault('session', tuple(bags)))
    monkeypatch.setattr(door, 'load_evidence', lambda bags, scenes, zero: [
        SimpleNamespace(name=str(bag), scene=scene.name, zero=zero)
        for bag, scene in zip(bags, scenes, strict=True)])
    monkeypatch.setattr(door, 'told_apart', lambda loaded, bags: tuple(loaded))
    monkeypatch.setattr(door, 'diagnose', diagnose)
    return said


def test_every_recording_reaches_its_place_on_one_count_of_time(asked):
    assert diagnose_bags(['a', 'b'], SCENE, null=['n'], hold_out=['h', 'i'], seed=5) == 'answer'
    names = {part: [one.name for one in asked[part]] for part in ('fitted', 'null', 'held_out')}
    assert names == {'fitted': ['a', 'b'], 'null': ['n'], 'held_out': ['h', 'i']}
    every = [one for part in names for one in asked[part]]
    assert {one.zero for one in every} == {asked['session']}
    assert set(asked['session']) == {'a', 'b', 'n', 'h', 'i'}
    assert asked['provenance'].name == '2 recordings' and asked['provenance'].seed == 5
    assert asked['calibration'] is None


def test_a_scene_of_its_own_and_a_calibration_file_are_read(asked, tmp_path):
    file = tmp_path / 'calibration.yaml'
    file.write_text('clock_ms: 5\n', encoding='utf-8')
    diagnose_bags(['a', 'b'], load_scene(SCENE), scenes={'b': BEAM}, calibration=file)
    assert [one.scene for one in asked['fitted']] == ['breast', 'silicone_beam']
    assert asked['calibration'] == Calibration(clock=5e-3)
    assert asked['provenance'].command == (
        f"diagnose_bags(['a', 'b'], 'breast', calibration='{file}', scenes={{'b': '{BEAM}'}})")


def test_the_answer_says_how_to_get_it_again(asked):
    diagnose_bags(['a'], SCENE, null=['n'], seed=5)
    assert asked['provenance'].scene == str(SCENE)
    assert asked['provenance'].command == (
        f"diagnose_bags(['a'], '{SCENE}', null=['n'], seed=5)")


def test_a_scene_that_is_not_there_is_said_in_one_line(asked, tmp_path):
    with pytest.raises(ConfigError, match=r'nowhere\.yaml') as said:
        diagnose_bags(['a'], tmp_path / 'nowhere.yaml')
    assert '\n' not in str(said.value)


def pushed_bag(folder, scene, namespace):
    """Pad 1 pushes 5 mm in 4 s; every marker follows, the less the further it is from the pad."""
    pads, names = [p.name for p in scene.pads], [m.name for m in scene.markers]
    at = np.array([m.position for m in scene.markers])
    near = np.exp(-np.linalg.norm(at - scene.pads[0].centre, axis=1) / 0.03)
    encoder = encode.Encoder()
    with BagWriter(folder, provenance={'name': 'pushed'}) as bag:
        bag.add_topic(f'{namespace}/optical/markers', encode.OPTICAL)
        bag.add_topic(f'{namespace}/actuators/state', encode.JOINT_STATE)
        for k in range(200):
            t, q = k * 20_000_000, np.zeros(len(pads))
            q[0] = 5e-3 * np.sin(np.pi * k / 200) ** 2
            bag.write(f'{namespace}/optical/markers', encoder.optical_frame(
                t, 'cell_base', k, names,
                at + q[0] * np.outer(near, scene.pads[0].direction)), t, sequence=k)
            bag.write(f'{namespace}/actuators/state', encoder.joint_state(
                t, 'cell_base', pads, list(q)), t, sequence=k)
    return folder


def test_a_cell_in_a_namespace_is_diagnosed_as_one_at_the_root(tmp_path):
    """The same streams, number for number."""
    scene = load_scene(SCENE)
    bags = [pushed_bag(tmp_path / name, scene, namespace)
            for name, namespace in (('root', ''), ('inside', '/wing/left'))]
    (root,), (inside,) = (door.load_bags([bag], lambda bag: scene).fitted for bag in bags)
    assert root.name == inside.name and set(root.streams) == set(inside.streams) != set()
    for kind, stream in root.streams.items():
        other = inside.streams[kind]
        assert stream.names == other.names
        assert np.array_equal(stream.t, other.t)
        assert np.array_equal(stream.values, other.values, equal_nan=True)
    moved = inside.get('encoder').values[..., 0]
    assert 4e-3 < moved.max() <= 5e-3


def test_two_cells_in_one_bag_are_refused_by_their_names(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        for name in ('/left', '/right'):
            bag.add_topic(f'{name}/optical/markers', encode.OPTICAL)
            bag.write(f'{name}/optical/markers', encode.Encoder().optical_frame(
                0, 'cell_base', 0, ('a',), np.zeros((1, 3))), 0)
    with pytest.raises(RecordingError, match='holds 2 cells, /left, /right'):
        diagnose_bags([tmp_path / 'bag'], SCENE)
