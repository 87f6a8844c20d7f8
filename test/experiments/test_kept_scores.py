"""Scores that are kept: valid while what made them is, and only what made them."""

from dataclasses import dataclass

import numpy as np
import pytest

from arm_brachy.experiments import kept_scores


@dataclass(frozen=True)
class Two:
    """a, b : arrays"""

    a: np.ndarray
    b: np.ndarray


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of four modules: one imports two by a detour, the fourth stands apart."""
    folder = tmp_path / 'arm_brachy'
    (folder / 'deep').mkdir(parents=True)
    for name, text in (('top', 'from arm_brachy.deep import mid\n'), ('apart', 'import numpy\n'),
                       ('deep/__init__', ''), ('deep/mid', 'from arm_brachy.deep.low import X\n'),
                       ('deep/low', 'X = 1\n')):
        (folder / f'{name}.py').write_text(text)
    monkeypatch.setattr(kept_scores, 'PACKAGE', folder)
    return folder


def test_a_module_stands_on_all_that_it_imports(package):
    names = [path.relative_to(package).as_posix() for path in kept_scores.sources(
        'arm_brachy.top')]
    assert names == ['deep/__init__.py', 'deep/low.py', 'deep/mid.py', 'top.py']


def test_the_key_changes_with_what_is_imported_and_with_data_beside_it(package):
    def key(more=1):
        kept_scores._behind.cache_clear()   # as in a new process
        return kept_scores.key(['arm_brachy.top'], more)

    before = key()
    assert key() == before != key(2)
    (package / 'apart.py').write_text('import scipy\n')
    assert key() == before
    (package / 'deep' / 'low.py').write_text('X = 2\n')
    changed = key()
    (package / 'deep' / 'weights.npz').write_bytes(b'1')
    assert len({before, changed, key()}) == 3


def test_estimators_do_not_stand_on_each_other():
    kf, ours = (kept_scores.sources(f'arm_brachy.estimation.{name}')
                for name in ('kf_admm', 'map'))
    assert 'map_update.py' in {path.name for path in ours} - {path.name for path in kf}
    assert {'kf_admm.py', 'newton.py'} <= {path.name for path in kf}


def test_what_is_kept_comes_back_to_the_bit(tmp_path):
    path = tmp_path / 'new' / 'one.npz'
    assert kept_scores.read(path, Two) is None
    scores = Two(np.array([1.0, np.nan, 1 / 3]), np.arange(4.0).reshape(2, 2))
    kept_scores.write(path, scores)
    back = kept_scores.read(path, Two)
    np.testing.assert_array_equal(back.a, scores.a)
    np.testing.assert_array_equal(back.b, scores.b)
    assert [one.name for one in path.parent.iterdir()] == ['one.npz']
