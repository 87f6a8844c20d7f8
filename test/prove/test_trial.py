"""Test of prove/trial.py with a made-up generator and detector: stages, seals, failures."""

import json
import shutil
import sys
from dataclasses import replace
from importlib import import_module

import pytest

from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.prove import making, plan, seal, trial
from arm_brachy.prove.folder import TrialFolder, read_json, write_json
from arm_brachy.prove.workers import Workers

SOURCE = 'made_up_source'
# Says what the data say; SPOIL is what it does instead where a backlash is planted.
DETECTOR = """
import json, pathlib, sys, time
bag = pathlib.Path(sys.argv[1])
data = json.loads((bag / 'data.json').read_text())
causes = [{'term': name, 'option': 0, 'probability': 1.0, 'parameters': {}}
          for name in data['label'] if name != 'strange_thing']
verdict = 'named' if causes else 'unexplained' if data['label'] else 'nothing_missing'
answer = {'verdict': verdict, 'sentence': 'So.', 'causes': causes, 'where': [], 'when': [],
          'alternatives': [], 'recalibrated': {}, 'next_experiment': None,
          'chance_of_what_is_left': None, 'bags': sys.argv.index('--scene') - 1}
SPOIL
pathlib.Path('answer.json').write_text(json.dumps(answer))
"""


def detector(spoil='pass'):
    code = DETECTOR.replace('SPOIL', f'if data["label"] == ["backlash"]:\n    {spoil}')
    return (sys.executable, '-P', '-c', code)


SETUP = trial.Setup(cases=5, modes=('absolute',), beacon='drawn', workers=Workers(1), limit=20.0,
                    detector=detector())


@pytest.fixture(scope='module')
def ended(tmp_path_factory):
    """Folder of a trial that went through to its end; to be looked at, and copied to change."""
    folder = tmp_path_factory.mktemp('ended')
    trial.run(SETUP, folder, SOURCE)
    return folder


@pytest.fixture
def copied(ended, tmp_path):
    return shutil.copytree(ended, tmp_path / 'copied')


def test_a_trial_goes_from_draw_to_opened_truth(tmp_path):
    setup = replace(SETUP, modes=('absolute', 'null'), workers=Workers(2))
    jobs, truths, records = trial.run(setup, tmp_path, SOURCE)
    assert [job.name for job in jobs] == [f'case_{i:03d}' for i in range(5)]
    assert len(records) == 10
    assert all(record['status'] == 'answered' for record in records.values())
    for (_, case), record in records.items():
        known = truths[case]['labels'] if truths[case]['in_catalogue'] else []
        assert [cause['term'] for cause in record['answer']['causes']] == known
    assert trial.frozen(TrialFolder(tmp_path))
    assert read_json(tmp_path / 'opened.json')['wishes'] == {
        kind: list(names) for kind, names in import_module(SOURCE).WISHES.items()}


def test_a_case_that_cannot_be_made_is_drawn_again_and_says_so(tmp_path):
    jobs, truths, _ = trial.run(replace(SETUP, modes=('absolute', 'null')), tmp_path, SOURCE)
    assert [job.attempt for job in jobs] == [0, 2, 0, 0, 0]
    assert [truth['attempt'] for truth in truths.values()] == [0, 2, 0, 0, 0]
    assert {job.body_attempt for job in jobs} == {1}    # of the only body
    assert jobs[0].body_rng().random() != replace(jobs[0], body_attempt=0).body_rng().random()
    drawn = [replace(jobs[1], attempt=k).rng().uniform(0.2, 2.0) for k in range(3)]
    assert len(set(drawn)) == 3
    given = read_json(tmp_path / 'recordings' / 'case_001' / 'bag' / 'data.json')
    assert given['size'] == drawn[2]


def test_what_cannot_be_decided_is_asked_again_with_what_decides_it(tmp_path, monkeypatch):
    monkeypatch.setattr(plan, 'SHARES', {plan.CONFOUNDED: 1})
    _, truths, records = trial.run(replace(SETUP, cases=1), tmp_path, SOURCE)
    assert {key: one['answer']['bags'] for key, one in records.items()} == {
        ('absolute', 'case_000'): 1, ('supplied', 'case_000'): 2}
    assert truths['case_000']['kind'] == plan.CONFOUNDED
    assert 'True' in (tmp_path / 'made.txt').read_text().splitlines()[-1]
    other = trial.run(replace(SETUP, cases=1, modes=('null',)), tmp_path / 'null', SOURCE)[2]
    assert [mode for mode, _ in other] == ['null']


def test_nothing_can_be_made(tmp_path, monkeypatch):
    monkeypatch.setattr(making, 'ATTEMPTS', 2)
    begun = trial.begin(SETUP, TrialFolder(tmp_path))
    job = plan.draw(1, 5, {})[1]
    (tmp_path / 'cache').mkdir()
    job = replace(job, body_attempt=making.prepare_body(SOURCE, job, TrialFolder(tmp_path)))
    with pytest.raises(ArmBrachyError, match='case_001 .* none of 2 .* since no state'):
        making.make_case(SOURCE, job, TrialFolder(tmp_path),
                         TrialFolder(tmp_path).sealed(begun['key'], job.name), ('absolute',))
    assert not (tmp_path / 'recordings').exists()


def test_a_truth_that_was_changed_after_it_was_published_is_caught(copied):
    trial.verify(TrialFolder(copied))
    opened = read_json(copied / 'opened.json')
    opened['cases']['case_002']['truth']['labels'] = ['obstacle']
    write_json(copied / 'opened.json', opened)
    with pytest.raises(ArmBrachyError, match='case_002 is not what was published'):
        trial.verify(TrialFolder(copied))


def test_an_answer_that_was_changed_after_it_was_published_is_caught(copied):
    path = copied / 'answers' / 'absolute' / 'case_001.json'
    write_json(path, {**read_json(path), 'seconds': 0.0})
    with pytest.raises(ArmBrachyError, match='the answer to absolute/case_001'):
        trial.run(SETUP, copied, SOURCE)


@pytest.mark.parametrize(('spoil', 'status'), [
    ('sys.exit(3)', 'crashed'), ('time.sleep(60)', 'timed out'),
    ('answer["x"] = float("nan")', 'crashed'), *(
        pytest.param(spoil, 'crashed', marks=pytest.mark.validate) for spoil in (
            'raise RuntimeError', 'answer = ["no", "object"]'))])
def test_crashes_and_time_outs_are_kept_and_not_tried_again(tmp_path, spoil, status):
    setup = replace(SETUP, limit=4.0, detector=detector(spoil))
    _, truths, records = trial.run(setup, tmp_path, SOURCE)
    spoiled = [one for (_, case), one in records.items() if truths[case]['labels'] == ['backlash']]
    assert spoiled
    assert {one['status'] for one in spoiled} == {status}
    assert {one['answer'] for one in spoiled} == {None}
    _, _, again = trial.run(setup, tmp_path, SOURCE)
    assert again == records


def test_a_trial_that_was_interrupted_goes_on_where_it_was(tmp_path):
    def stop(stage, done, of):
        if stage == 'answering' and done == 2:
            raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        trial.run(replace(SETUP, workers=Workers(1)), tmp_path, SOURCE, stop)
    held = sorted((tmp_path / 'answers' / 'absolute').glob('*.json'))
    texts = [path.read_text() for path in held]
    assert len(held) in (2, 3)      # the next may have ended before it could be called off
    made = (tmp_path / 'made.txt').read_text()
    _, _, records = trial.run(SETUP, tmp_path, SOURCE)
    assert len(records) == 5
    assert [path.read_text() for path in held] == texts
    assert (tmp_path / 'made.txt').read_text() == made


def test_a_folder_goes_on_with_what_it_was_begun_with_or_not_at_all(tmp_path):
    trial.begin(SETUP, TrialFolder(tmp_path))
    with pytest.raises(InputError, match='begun with cases 5, not 6'):
        trial.begin(replace(SETUP, cases=6), TrialFolder(tmp_path))
    with pytest.raises(InputError, match='begun with beacon'):
        trial.begin(replace(SETUP, beacon='another'), TrialFolder(tmp_path))
    begun = trial.begin(replace(SETUP, beacon=''), TrialFolder(tmp_path))
    assert begun['beacon'] == 'drawn'


def test_a_trial_is_made_by_one_program_and_says_if_the_detector_changed(tmp_path):
    trial.begin(SETUP, TrialFolder(tmp_path))
    begun = read_json(tmp_path / 'secret.json')
    write_json(tmp_path / 'secret.json', {**begun, 'program': 'another'})
    with pytest.raises(InputError, match='the program was changed'):
        trial.run(SETUP, tmp_path, SOURCE)
    write_json(tmp_path / 'secret.json', begun)
    trial.run(SETUP, tmp_path, SOURCE)
    published = read_json(tmp_path / 'published.json')
    write_json(tmp_path / 'published.json', {**published, 'program': 'another'})
    assert not trial.frozen(TrialFolder(tmp_path))


def test_the_same_beacon_and_commit_give_the_same_cases():
    wishes = {'single': ('a', 'b', 'c')}
    one, two, three = (plan.draw(seal.seed_of('commit', beacon), 40, wishes)
                       for beacon in ('x', 'x', 'y'))
    assert one == two
    assert one != three
    assert one[7].rng().random() == two[7].rng().random()
    assert one[7].rng().random() != one[8].rng().random()


def test_case_numbers_tell_nothing_of_kinds():
    kinds = [job.kind for job in plan.draw(seal.seed_of('commit', 'x'), 540, {})]
    assert {kind: kinds.count(kind) for kind in plan.SHARES} == plan.SHARES
    nulls = [i for i, kind in enumerate(kinds) if kind == 'null']
    # the mean number of 120 of 540 at random: 269.5 +- 12.6
    assert abs(sum(nulls) / len(nulls) - 269.5) < 4 * 12.6


@pytest.mark.parametrize('cases', [1, 7, 60, 541])
def test_every_number_of_cases_is_shared_out_whole(cases):
    assert sum(plan.counts(cases).values()) == cases


def test_what_the_detector_is_given_says_neither_kind_nor_date(ended):
    given = [*(ended / 'recordings').iterdir()]
    assert len({path.stat().st_mtime for path in given}) == 1
    files = {tuple(sorted(str(p.relative_to(one)) for p in one.rglob('*'))) for one in given}
    assert len(files) == 1
    published = json.dumps(read_json(ended / 'published.json'))
    assert 'backlash' not in published
    assert 'beacon' not in published
