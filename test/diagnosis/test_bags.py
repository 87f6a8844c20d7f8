"""The front door for scripts: every recording reaches its place, with its scene, on one clock."""

from types import SimpleNamespace

import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis import bags as door
from arm_brachy.diagnosis.bags import diagnose_bags
from arm_brachy.diagnosis.settings import Calibration

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
