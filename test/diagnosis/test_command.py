"""The command: what it refuses is told in one line and costs nothing."""

import pytest
from click.testing import CliRunner

from arm_brachy.cli import main
from arm_brachy.core.paths import config_dir

SCENE = str(config_dir() / 'scenes' / 'breast.yaml')


def said(*words):
    answer = CliRunner().invoke(main, ['diagnose', *map(str, words)])
    return answer.exit_code, answer.stderr.strip()


@pytest.mark.parametrize(('words', 'told'), [
    (('no_such_bag', '--scene', SCENE), 'no_such_bag: no such bag'),
    (('no_such_bag', '--scene', 'no_such.yaml'), 'no_such.yaml: no such file'),
    (('no_such_bag',), "Missing option '--scene'"),
    (('--scene', SCENE), "Missing argument 'BAG...'"),
    (('bag', '--scene', SCENE, '--seed', '-1'), "'--seed': -1 is not in the range x>=0"),
])
def test_bad_input_is_one_line(words, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, line = said(*words)
    assert code == 2 and told in line and len(line.splitlines()) == 1
    assert not list(tmp_path.iterdir())
