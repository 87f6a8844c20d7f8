"""Test of `arm-brachy prove` on a made-up generator and detector."""

import functools
import json

import pytest
from test_trial import detector

from arm_brachy.cli import main
from arm_brachy.cli import prove as command
from arm_brachy.prove import trial


def run(*words):
    with pytest.raises(SystemExit) as ended:
        main(['prove', *map(str, words)])
    return ended.value.code


@pytest.fixture
def made_up(monkeypatch):
    monkeypatch.setattr(command, 'SOURCE', 'made_up_source')
    monkeypatch.setattr(command, 'SIGNALS', 'made_up_signals')
    monkeypatch.setattr(trial, 'Setup', functools.partial(trial.Setup, detector=detector()))


def test_a_trial_runs_from_the_command_line_and_goes_on(made_up, tmp_path, capsys):
    words = ('--cases', 6, '--beacon', 'x', '--mode', 'absolute', '--workers', 2, '--out',
             tmp_path / 'trial', '--json', tmp_path / 'result.json')
    assert run(*words) == 1
    shown = capsys.readouterr()
    assert 'top-1, all singles' in shown.out
    missed = shown.err.partition('goals missed: ')[2]
    assert 'error of parameters, median' in missed      # the made-up detector tells no numbers
    assert 'top-1' not in missed
    rows = json.loads((tmp_path / 'result.json').read_text())['rows']
    singles = [row for row in rows if row.get('kind') == 'single']
    assert singles
    assert all(row['outcome'] == 'right' for row in singles)
    # Which cases are drawn follows from the commit: in some, a rival comes within 5 sd.
    apart = [row['detectability_sd'] if row['separation_sd'] is None else row['separation_sd']
             for row in singles]
    assert all(row['identifiable'] == (min(row['detectability_sd'], sd) >= 5.0)
               for row, sd in zip(singles, apart, strict=True))
    made = (tmp_path / 'trial' / 'made.txt').read_text()
    assert run(*words) == 1
    assert (tmp_path / 'trial' / 'made.txt').read_text() == made


@pytest.mark.parametrize(('words', 'said'), [
    (('--cases', 0), '0 is not in the range'), (('--mode', 'all'), "'all' is not one of"),
    (('--limit-s', 0), '0.0 is not in the range')])
def test_bad_input_is_told_in_one_line(words, said, capsys):
    assert run(*words) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1


def test_a_folder_of_another_trial_is_refused(made_up, tmp_path, capsys):
    words = ('--beacon', 'x', '--mode', 'absolute', '--workers', 1, '--out', tmp_path / 'trial')
    assert run('--cases', 1, *words) < 2
    capsys.readouterr()
    assert run('--cases', 2, *words) == 2
    error = capsys.readouterr().err
    assert 'begun with cases 1, not 2' in error
