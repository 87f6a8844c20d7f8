"""The registry of what `arm-brachy reproduce` knows."""

import inspect

from arm_brachy.experiments.catalogue import EXPERIMENTS


def test_every_experiment_is_called_with_a_folder():
    assert {'table-3.1', 'figure-3.2', 'model-verification'} <= EXPERIMENTS.keys()
    for name, reproduce in EXPERIMENTS.items():
        first, *others = inspect.signature(reproduce).parameters.values()
        assert first.name == 'out_dir', name
        assert all(p.default is not p.empty for p in others), name
        assert reproduce.__doc__
