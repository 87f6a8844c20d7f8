"""Where files are found: beside the source, under an ament prefix, or nowhere."""

import sys

import pytest

from arm_brachy.core import paths
from arm_brachy.core.errors import InputError


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The module as if installed, with no package.xml above it and an empty Python prefix."""
    module = tmp_path / 'site-packages' / 'arm_brachy' / 'core' / 'paths.py'
    monkeypatch.setattr(paths, '__file__', str(module))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'python'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


def share_of(prefix):
    """Make share/arm_brachy with its package.xml under a prefix."""
    share = prefix / 'share' / 'arm_brachy'
    share.mkdir(parents=True)
    (share / 'package.xml').touch()
    return share


def test_the_source_tree_goes_before_an_installed_copy(tmp_path, monkeypatch):
    share_of(tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert paths.config_dir().parent == paths.launch_dir().parent
    assert not paths.config_dir().is_relative_to(tmp_path)


def test_the_first_ament_prefix_with_the_package_is_used(installed, monkeypatch):
    share = share_of(installed / 'overlay')
    share_of(installed / 'underlay')
    prefixes = ':'.join(str(installed / name) for name in ('other', 'overlay', 'underlay'))
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes)
    assert paths.config_dir() == share / 'config'
    assert paths.launch_dir() == share / 'launch_scripts'


def test_python_prefix_serves_where_there_is_no_ros(installed):
    share = share_of(installed / 'python')
    assert paths.share_dir() == share


def test_a_package_without_its_files_says_where_it_looked(installed):
    with pytest.raises(InputError, match=str(installed / 'python' / 'share')):
        paths.config_dir()


def test_runs_go_to_the_current_folder_unless_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('ARM_BRACHY_RUNS', raising=False)
    assert paths.run_dir() == tmp_path / 'runs'
    monkeypatch.setenv('ARM_BRACHY_RUNS', '/elsewhere')
    assert str(paths.run_dir()) == '/elsewhere'
