"""Named random streams: everything random follows from the scenario's seed and a name."""

import zlib

import numpy as np


def stream(seed, name):
    """Return the random generator that belongs to `name` under `seed`.

    seed : int, the scenario's
    name : str, e.g. 'em_tracker/target_1'; two names never share a sequence
    Returns numpy.random.Generator (PCG64). Adding a device leaves the others' draws as they were.
    """
    return np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(name.encode())]))
