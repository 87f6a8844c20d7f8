"""Test of prove/sandbox.py and landlock.py: what a detector can reach, and how it may end."""

import sys
import time

import pytest

from arm_brachy.prove import landlock, sandbox

confined = pytest.mark.skipif(not landlock.version(), reason='this kernel has no Landlock')


def python(code, folder, limit=60.0, **more):
    return sandbox.run([sys.executable, '-P', '-c', code], folder, limit=limit, **more)


@confined
def test_a_detector_that_opens_the_truth_fails(tmp_path):
    truth = tmp_path / 'sealed' / 'truth.json'
    truth.parent.mkdir()
    truth.write_text('backlash')
    ended = python(f'print(open({str(truth)!r}).read())', tmp_path / 'work')
    assert ended.status == sandbox.CRASHED
    assert 'PermissionError' in ended.words
    assert ended.confined


@confined
def test_a_detector_cannot_list_what_lies_beside_its_folder(tmp_path):
    ended = python(f'import os; os.listdir({str(tmp_path)!r})', tmp_path / 'work')
    assert ended.status == sandbox.CRASHED


@confined
def test_a_detector_cannot_change_what_it_was_given(tmp_path):
    given = tmp_path / 'given'
    given.mkdir()
    (given / 'bag').write_text('data')
    assert python(f'open({str(given / "bag")!r}).read()', tmp_path / 'a',
                  readable=[given]).status == sandbox.ANSWERED
    ended = python(f'open({str(given / "bag")!r}, "w")', tmp_path / 'b', readable=[given])
    assert ended.status == sandbox.CRASHED
    assert (given / 'bag').read_text() == 'data'


@confined
def test_what_a_detector_starts_is_confined_too(tmp_path):
    (tmp_path / 'truth').write_text('backlash')
    code = f'import subprocess; subprocess.run(["cat", {str(tmp_path / "truth")!r}], check=True)'
    assert python(code, tmp_path / 'work').status == sandbox.CRASHED


@confined
@pytest.mark.skipif(landlock.version() < 4, reason='this Landlock knows no network')
def test_a_detector_cannot_ask_the_network(tmp_path):
    code = 'import socket; socket.create_connection(("127.0.0.1", 9), 1)'
    ended = python(code, tmp_path / 'work')
    assert 'PermissionError' in ended.words


def test_a_detector_writes_in_its_own_folder_and_where_it_may(tmp_path):
    (tmp_path / 'compiled').mkdir()
    ended = python('import os, pathlib; pathlib.Path("answer").write_text("x");'
                   'pathlib.Path(os.environ["NUMBA_CACHE_DIR"], "y").write_text("y")',
                   tmp_path / 'work', writable=[tmp_path / 'compiled'])
    assert ended.status == sandbox.ANSWERED, ended.words
    assert (tmp_path / 'work' / 'answer').read_text() == 'x'
    assert (tmp_path / 'compiled' / 'y').is_file()


def test_the_whole_program_starts_inside(tmp_path):
    code = 'from arm_brachy.cli import diagnose'
    ended = python(code, tmp_path / 'work')
    assert ended.status == sandbox.ANSWERED, ended.words


def test_a_detector_that_takes_too_long_is_ended_with_its_children(tmp_path):
    code = ('import subprocess, sys; '
            'subprocess.Popen([sys.executable, "-c", "import time, pathlib; time.sleep(3);'
            'pathlib.Path(\'late\').write_text(\'x\')"]).wait()')
    start = time.monotonic()
    ended = python(code, tmp_path / 'work', limit=1.0)
    assert ended.status == sandbox.SLOW
    assert time.monotonic() - start < 3.0
    time.sleep(3.0)
    assert not (tmp_path / 'work' / 'late').exists()


def test_the_environment_of_the_caller_stays_outside(tmp_path, monkeypatch):
    monkeypatch.setenv('TRUTH', 'backlash')
    code = 'import os, sys; sys.exit("TRUTH" in os.environ or os.environ["HOME"] != os.getcwd())'
    assert python(code, tmp_path / 'work').status == sandbox.ANSWERED
