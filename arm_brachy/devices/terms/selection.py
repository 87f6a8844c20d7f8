"""Which rows of a bank or a stream a term acts on."""

import numpy as np

from arm_brachy.core.errors import ConfigError


def chosen_actuators(indices, n, term):
    """Return a mask (n,), True for the actuators that a term acts on.

    indices : into the bank of n; empty means all;  term : its name, for messages
    Raises ConfigError if the bank has no such actuator.
    """
    if any(not 0 <= i < n for i in indices):
        raise ConfigError(f'{term}: actuators = {list(indices)}; must be indices 0 to {n - 1}')
    return np.isin(np.arange(n), indices) if indices else np.ones(n, dtype=bool)


def chosen_names(chosen, names, key):
    """Return a mask (k,), True for the rows of a stream that a term acts on.

    chosen : names; empty means all;  names : k names of the stream
    key : term and parameter, for messages ('force_gain: pads')
    Raises ConfigError if the stream has no such name.
    """
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        raise ConfigError(f'{key} = {list(chosen)}; {", ".join(unknown)} must be among '
                          f'{", ".join(names)}')
    return np.array([not chosen or name in chosen for name in names], dtype=bool)
