"""Commitments: what was drawn is fixed before the detector runs and can be checked after it.

A leaf is SHA256(salt || canonical JSON); the salt keeps anybody from guessing the truth from its
hash. The root of the Merkle tree over the leaves stands for all of them. Leaves and nodes are
hashed with different first bytes, so that no node passes for a leaf (RFC 6962, section 2.1).
Test: prove/test_seal.py
"""

import hashlib
import hmac
import json
from pathlib import Path

import arm_brachy

LEAF, NODE = b'\x00', b'\x01'


def canonical(value):
    """A value as the one JSON text it has: sorted keys, no spaces, ASCII; bytes.

    Raises ValueError for NaN and infinity, which JSON does not have, TypeError for what it cannot
    hold at all.
    """
    return json.dumps(value, sort_keys=True, separators=(',', ':'), allow_nan=False).encode()


def seed_of(commit, beacon):
    """Seed of the cases (int): SHA256(commit || beacon), the beacon drawn after the commit."""
    return int.from_bytes(hashlib.sha256(f'{commit}{beacon}'.encode()).digest(), 'big')


def keyed(key, what):
    """32 bytes as hex that follow from a secret `key` (text) and a name; nothing leads back."""
    return hmac.new(key.encode(), what.encode(), hashlib.sha256).hexdigest()


def commitment(salt, value):
    """Hash (hex) that fixes `value` and tells nothing of it; salt : hex, as from `keyed`."""
    return hashlib.sha256(LEAF + bytes.fromhex(salt) + canonical(value)).hexdigest()


def root(leaves):
    """Merkle root (hex) of leaves (hex), in order; an odd one out rises unchanged."""
    return _levels(leaves)[-1][0]


def proof(leaves, i):
    """What shows that leaf i belongs to the root: ('left' or 'right', hash) from leaf to root."""
    path = []
    for level in _levels(leaves)[:-1]:
        beside = i ^ 1
        if beside < len(level):
            path.append(('left' if beside < i else 'right', level[beside]))
        i //= 2
    return path


def holds(salt, value, path, top):
    """True if `value` under `salt` is the one that the root `top` was published for."""
    found = commitment(salt, value)
    for side, other in path:
        found = _node(other, found) if side == 'left' else _node(found, other)
    return hmac.compare_digest(found, top)


def program():
    """`program_hash` of the arm_brachy that runs."""
    return program_hash(Path(arm_brachy.__file__).parent)


def program_hash(folder):
    """SHA256 (hex) of all Python files and page templates under `folder`, names included."""
    total = hashlib.sha256()
    files = [path for kind in ('*.py', '*.j2') for path in Path(folder).rglob(kind)]
    for path in sorted(files):
        total.update(f'{path.relative_to(folder)}\0'.encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _levels(leaves):
    if not leaves:
        raise ValueError('no leaves; a root stands for at least one')
    levels = [list(leaves)]
    while len(levels[-1]) > 1:
        level = levels[-1]
        pairs = [_node(*level[k:k + 2]) if k + 1 < len(level) else level[k]
                 for k in range(0, len(level), 2)]
        levels.append(pairs)
    return levels


def _node(left, right):
    return hashlib.sha256(NODE + bytes.fromhex(left) + bytes.fromhex(right)).hexdigest()
