"""The JSON form, the console table, and where a result says it comes from."""

import io
import json
import subprocess

import numpy as np
import pytest
from rich.console import Console

from arm_brachy.evaluation import result
from arm_brachy.evaluation.result import Result, Target

RESULT = Result('table', 3, 'abc1234', 'a machine',
                ({'name': 'a [bold]', 'error_mm': np.float64(0.25), 'n': np.int64(4)},
                 {'name': 'b', 'error_mm': np.nan, 'ok': np.bool_(True)}),
                (Target('error', 0.25, 'mm', '< 0.3', True),
                 Target('lost', 2, '1', '= 0', False), Target('x', np.inf, 's', '< 1', None)))


def test_json_has_one_form(tmp_path):
    path = tmp_path / 'r.json'
    text = RESULT.to_json(path)
    assert path.read_text(encoding='utf-8') == text
    body = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert list(body) == ['name', 'seed', 'commit', 'machine', 'rows', 'targets']
    assert body['rows'][0] == {'name': 'a [bold]', 'error_mm': 0.25, 'n': 4}
    assert body['rows'][1] == {'name': 'b', 'error_mm': None, 'ok': True}
    assert body['targets'][2]['value'] is None
    assert [t['met'] for t in body['targets']] == [True, False, None]


def test_one_missed_target_is_enough():
    assert not RESULT.met
    assert Result('r', 0, '', '', (), (RESULT.targets[0], RESULT.targets[2])).met


def test_table_shows_every_column_literally():
    console = Console(file=io.StringIO(), width=120)
    RESULT.table(console)
    text = console.file.getvalue()
    for expected in ('error_mm', 'a [bold]', '0.25', '< 0.3', 'seed 3', 'abc1234', 'a machine'):
        assert expected in text


def test_cells():
    cells = [result.cell_text(v) for v in (None, np.nan, True, 1.23456, 7, 'x')]
    assert cells == ['-', '-', 'yes', '1.235', '7', 'x']


def test_commit_of_a_repository_and_of_none(tmp_path, monkeypatch):
    monkeypatch.setenv('GIT_CEILING_DIRECTORIES', str(tmp_path.parent))
    if result.resources.files('arm_brachy').joinpath(result.COMMIT_FILE).is_file():
        pytest.skip('an installed copy answers with its recorded commit')
    assert result.commit_of(tmp_path) == 'unknown'
    git = ['git', '-C', str(tmp_path), '-c', 'user.name=t', '-c', 'user.email=t@example.org']
    subprocess.run([*git, 'init', '-q'], check=True)
    assert result.commit_of(tmp_path) == 'unknown'
    subprocess.run([*git, 'commit', '-q', '--allow-empty', '-m', 'first'], check=True)
    head = subprocess.run([*git, 'rev-parse', 'HEAD'], check=True, capture_output=True, text=True)
    assert head.stdout.startswith(result.commit_of(tmp_path))


def test_machine_is_described_in_one_line():
    text = result.machine_description()
    assert 'core' in text
    assert 'Python 3.' in text
    assert '\n' not in text
