"""Test of prove/seal.py: what is published fixes what is opened, and tells nothing of it."""

import hashlib

import pytest

from arm_brachy.prove import seal

CASES = [{'labels': [name], 'size': 0.1 * i} for i, name in enumerate('abcdefg')]
SALTS = [seal.keyed('secret', f'salt/{i}') for i in range(len(CASES))]
LEAVES = [seal.commitment(*pair) for pair in zip(SALTS, CASES, strict=True)]


def test_canonical_text_does_not_depend_on_the_order_of_keys():
    assert seal.canonical({'b': 1, 'a': [1.5, None]}) == seal.canonical({'a': [1.5, None], 'b': 1})
    assert seal.canonical({'b': 1, 'a': 'ä'}) == b'{"a":"\\u00e4","b":1}'
    with pytest.raises(ValueError, match='Out of range'):
        seal.canonical({'a': float('nan')})


def test_a_tree_of_two_is_the_hash_written_out():
    by_hand = hashlib.sha256(b'\x01' + b''.join(map(bytes.fromhex, LEAVES[:2]))).hexdigest()
    assert seal.root(LEAVES[:2]) == by_hand


@pytest.mark.parametrize('count', [1, 2, 3, 5, 7])
def test_every_case_proves_that_it_was_published(count):
    top = seal.root(LEAVES[:count])
    for i in range(count):
        path = seal.proof(LEAVES[:count], i)
        assert seal.holds(SALTS[i], CASES[i], path, top)
        assert len(path) <= 3


def test_a_case_that_was_changed_is_caught():
    top, path = seal.root(LEAVES), seal.proof(LEAVES, 4)
    assert not seal.holds(SALTS[4], {**CASES[4], 'size': 0.41}, path, top)
    assert not seal.holds(SALTS[3], CASES[4], path, top)
    assert not seal.holds(SALTS[4], CASES[4], seal.proof(LEAVES, 5), top)
    assert not seal.holds(SALTS[4], CASES[4], path, seal.root(LEAVES[:6]))


def test_an_inner_node_is_no_leaf():
    """A tree of two leaves must not pass for one leaf."""
    assert seal.root([seal.root(LEAVES[:2])]) != seal.root(LEAVES[:3])
    inner = bytes.fromhex(LEAVES[0]) + bytes.fromhex(LEAVES[1])
    assert hashlib.sha256(b'\x00' + inner).hexdigest() != seal.root(LEAVES[:2])


def test_the_same_truth_under_another_salt_looks_different():
    assert seal.commitment(SALTS[0], CASES[0]) != seal.commitment(SALTS[1], CASES[0])


def test_the_seed_follows_from_commit_and_beacon():
    assert seal.seed_of('abc', 'x') == seal.seed_of('abc', 'x')
    assert len({seal.seed_of(*pair) for pair in (('abc', 'x'), ('abd', 'x'), ('abc', 'y'))}) == 3


def test_a_program_that_was_changed_has_another_hash(tmp_path):
    (tmp_path / 'a.py').write_text('x = 1\n')
    before = seal.program_hash(tmp_path)
    (tmp_path / 'notes.txt').write_text('no program')
    assert seal.program_hash(tmp_path) == before
    (tmp_path / 'a.py').write_text('x = 2\n')
    assert seal.program_hash(tmp_path) != before
