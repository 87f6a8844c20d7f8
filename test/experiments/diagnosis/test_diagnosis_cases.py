"""The folder of the study's recordings: what is there stays, what is lacking is made."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.experiments import diagnosis_cases as cases
from arm_brachy.experiments.diagnosis_plan import plan
from arm_brachy.experiments.diagnosis_recordings import observe

PLAN = plan()


def test_a_recording_holds_no_truth_and_survives_the_disk(motion, tmp_path):
    run = observe(PLAN[1], motion)
    assert not run.truth and run.pad_displacement is None and run.scenario == '' and run.seed == 0
    cases.store(tmp_path / 'one.npz', run)
    back = cases.load(tmp_path / 'one.npz')
    assert back.name == 'one' and back.encoder_pads == run.encoder_pads
    assert back.optical.ids == run.optical.ids and back.force_pads == run.force_pads
    assert back.optical.points == pytest.approx(run.optical.points, abs=1e-8, nan_ok=True)
    assert np.array_equal(back.optical.visible, run.optical.visible)
    assert np.array_equal(back.em['target_1'].t, run.em['target_1'].t)
    assert back.force.values == pytest.approx(run.force.values, abs=1e-6)


def test_making_goes_on_where_it_was(motion, tmp_path, monkeypatch):
    few, runs = (PLAN[0], PLAN[1], replace(PLAN[2], plant=PLAN[0].plant)), []
    monkeypatch.setattr(cases, 'process_pool', ThreadPoolExecutor)
    monkeypatch.setattr(cases, 'plan', lambda seed: few)
    monkeypatch.setattr(cases, 'move', lambda plant: runs.append(plant.name) or motion)
    index = cases.make(tmp_path)
    assert sorted(runs) == ['null_00', 'null_01']     # two threads take turns as they like
    assert json.loads((tmp_path / 'index.json').read_text()) == json.loads(json.dumps(index))
    before = (tmp_path / 'case_000.npz').read_bytes()
    (tmp_path / 'case_002.npz').unlink()
    cases.make(tmp_path)
    assert len(runs) == 2 and (tmp_path / 'case_002.npz').is_file()
    assert (tmp_path / 'case_000.npz').read_bytes() == before
    monkeypatch.setattr(cases, 'plan', lambda seed: (replace(few[0], seed=1), *few[1:]))
    with pytest.raises(InputError, match='lists other cases'):
        cases.make(tmp_path)


def test_a_part_is_made_and_listed_alone(motion, tmp_path, monkeypatch):
    monkeypatch.setattr(cases, 'process_pool', ThreadPoolExecutor)
    monkeypatch.setattr(cases, 'plan', lambda seed: PLAN[:4])
    monkeypatch.setattr(cases, 'move', lambda plant: motion)

    def there():
        listed = json.loads((tmp_path / 'index.json').read_text())
        made = sorted(path.stem for path in tmp_path.glob('*.npz'))
        assert [one['name'] for one in listed] == made
        return made

    index = cases.make(tmp_path, only=slice(2, 3))
    assert [one['name'] for one in index] == [case.name for case in PLAN[:4]]
    assert there() == ['case_002']
    cases.make(tmp_path, only=slice(0, 2))
    assert there() == ['case_000', 'case_001', 'case_002']
    cases.make(tmp_path)
    assert json.loads((tmp_path / 'index.json').read_text()) == json.loads(json.dumps(index))
