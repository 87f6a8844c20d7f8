"""The command: what it refuses is told in one line and costs nothing."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from arm_brachy.cli import diagnose as command
from arm_brachy.cli import main
from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis import bags as loading
from arm_brachy.diagnosis.bags import LoadedBags
from arm_brachy.diagnosis.results.cause import Cause
from arm_brachy.diagnosis.settings import Calibration

SCENE = str(config_dir() / 'scenes' / 'breast.yaml')
LOADED = str(config_dir() / 'scenes' / 'silicone_beam_load52.yaml')
BEAM = str(config_dir() / 'scenes' / 'silicone_beam.yaml')


def said(*words):
    answer = CliRunner().invoke(main, ['diagnose', *map(str, words)])
    return answer.exit_code, answer.stderr.strip()


@pytest.mark.parametrize(('words', 'told'), [
    (('no_such_bag', '--scene', SCENE), 'no_such_bag: no such bag'),
    (('no_such_bag', '--scene', 'no_such.yaml'), 'no_such.yaml: no such file'),
    (('no_such_bag',), "Missing option '--scene'"),
    (('--scene', SCENE), "Missing argument 'BAG...'"),
    (('bag', '--scene', SCENE, '--seed', '-1'), "'--seed': -1 is not in the range x>=0"),
    (('bag', '--scene', SCENE, '--calibration', 'no.yaml'), 'no.yaml: no such file'),
    (('bag', '--scene', SCENE, '--calibration', SCENE), "unknown key 'name'"),
    (('bag', '--scene', BEAM, '--calibration', 'any.yaml'), 'which has no pads'),
    (('bag', '--scene', BEAM, '--scene-of', 'hung.yaml'), 'must be BAG=FILE'),
    (('bag', '--scene', BEAM, '--scene-of', f'other={LOADED}'), 'one of bag, written the same'),
    (('bag', '--scene', BEAM, *2 * ('--scene-of', f'bag={LOADED}')), 'each BAG once'),
    (('bag', '--scene', BEAM, '--scene-of', 'bag=no.yaml'), 'no.yaml: no such file'),
])
def test_bad_input_is_one_line(words, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, line = said(*words)
    assert code == 2 and told in line and len(line.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_several_scenes_are_for_bodies_without_pads():
    breast = load_scene(SCENE)
    one, other = (SimpleNamespace(name=kind, streams={kind: None}, scene=replace(
        breast, name=kind)) for kind in ('bare', 'hung'))
    with pytest.raises(InputError, match='scenes bare and hung; must be of one scene'):
        command.stages.diagnose((one, other), None)


def test_every_bag_is_read_with_its_own_scene(monkeypatch):
    read = []

    def stop(*_):
        raise InputError('that is all')
    monkeypatch.setattr(loading, 'zero_of', lambda bags: None)
    monkeypatch.setattr(loading, 'load_evidence', lambda bags, scenes, zero: read.extend(
        zip(bags, [scene.name for scene in scenes], strict=True)) or [])
    monkeypatch.setattr(loading, 'told_apart', stop)
    CliRunner().invoke(main, ['diagnose', 'bare', 'hung', '--hold-out', 'hung_2', '--scene', BEAM,
                              '--scene-of', f'hung={LOADED}', '--scene-of', f'hung_2={LOADED}'])
    assert read == [('bare', 'silicone_beam'), ('hung', 'silicone_beam_load52'),
                    ('hung_2', 'silicone_beam_load52')]


@pytest.mark.parametrize(('causes', 'shown'), [
    ((), 'two'),        # most loads
    ((Cause('point_mass', scenes=('one',)),), 'one'),
    ((Cause('point_mass', scenes=('one',)), Cause('damping')), 'one'),
    ((Cause('point_mass', scenes=('one', 'two')),), 'two')])
def test_the_corrected_scene_is_one_in_which_what_was_found_acts(causes, shown):
    scenes = [SimpleNamespace(name=name, loads=loads) for name, loads in (
        ('bare', ()), ('one', ('a',)), ('two', ('a', 'b')))]
    found = SimpleNamespace(likeliest=lambda: causes)
    assert scenes[command._shows_most(found, scenes)].name == shown


def test_what_the_laboratory_says_of_itself_reaches_the_diagnosis(tmp_path, monkeypatch):
    """In its units; what it does not say is taken for granted."""
    given = {}

    def stop(*_, calibration, **__):
        given['calibration'] = calibration
        raise InputError('that is all')
    monkeypatch.setattr(command.stages, 'diagnose', stop)
    monkeypatch.setattr(command, 'load_bags', lambda *_, **__: LoadedBags(
        (SimpleNamespace(name='one'),)))
    file = tmp_path / 'calibration.yaml'
    file.write_text('clock_ms: 5\nplacement_mm: 0.8\n', encoding='utf-8')
    said('bag', '--scene', SCENE, '--out', tmp_path / 'out', '--calibration', file)
    assert given['calibration'] == Calibration(clock=5e-3, placement=0.8e-3)
    assert not (tmp_path / 'out').exists()
    said('bag', '--scene', SCENE, '--out', tmp_path / 'out')
    assert given['calibration'] is None


def test_help_and_pages_say_how_long_it_takes_as_the_trial_measured():
    """Medians and maxima of the trial's answers, and whole minutes around them in words."""
    page = (share_dir() / 'docs/reference/limits.md').read_text(encoding='utf-8')
    rows = json.loads((share_dir() / 'results/trials/3e10884/result.json').read_text(
        encoding='utf-8'))['rows']
    help_ = ' '.join(CliRunner().invoke(main, ['diagnose', '--help']).output.split())
    for mode, said, words in (
            ('absolute', '{:.0f} s of wall clock (median of {}, at most {:.0f} s)', '1 to 7'),
            ('null', '{0:.0f} s (at most {2:.0f} s) with a null', '--null 2 to 17')):
        seconds = [row['seconds'] for row in rows if row.get('mode') == mode]
        text = said.format(np.median(seconds), len(seconds), max(seconds))
        assert text in ' '.join(page.split())
        low, high = (60.0 * int(word) for word in words.split()[-3::2])
        assert low - 5.0 <= min(seconds) and max(seconds) <= high
        assert f'{words} minutes' in help_
