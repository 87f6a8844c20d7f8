"""The modulus by the forces in a few holds, before anything is linearised at it."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.signals.stream import FORCE, components

HOLDS = 2       # states of every pad that are solved for
LEAST = 3.0     # standard deviations of a force for it to count
CLOSE = 0.02    # of the modulus: nearer, responses at the given one are as good


def modulus_ratio(recorded, specimen):
    """Measured over modelled force in each pad's deepest holds of a Recorded; 1 where none tells.

    Of all pads together, by least squares: a modulus scales forces alone as long as nothing hangs
    by its weight, where they count from those at rest; what single pads have besides is left.
    """
    states = recorded.states
    force = states.streams.get(FORCE)
    if force is None:
        return 1.0
    deep = _deepest_holds(states)
    if not len(deep):
        return 1.0
    home = int(np.abs(states.q).sum(axis=1).argmin())
    every = np.union1d(deep, home)
    found = ForwardModel(specimen).predict(recorded.path, states.t[every])
    index = [specimen.pads.index(name) for name in force.names]
    measured, model = force.values[every], components(found.force[:, index], force.along)
    if any(specimen.scene.gravity):
        measured, model = (one - one[every == home] for one in (measured, model))
    chosen = np.isin(every, deep)
    measured, model = measured[chosen], model[chosen]
    weight = np.where(np.isfinite(measured) & np.isfinite(model), 1.0 / force.variance[deep], 0.0)
    power = float(np.sum(weight * np.nan_to_num(model)**2))
    if power < LEAST**2:
        return 1.0
    return float(np.sum(weight * np.nan_to_num(model) * np.nan_to_num(measured)) / power)


def _deepest_holds(states):
    """Indices of HOLDS states at rest for every pad that is pushed: where it is deepest."""
    still = np.flatnonzero(states.labels.direction == 0)
    depths = [q for q in states.q[still].T if q.max(initial=0.0) > 0.0]
    return np.unique(np.concatenate([still[:0], *(still[np.argsort(-q)][:HOLDS]
                                                  for q in depths)]))


def scaled(scene, ratio):
    """core.scene.Scene with its modulus times `ratio`; the scene itself where that is near 1."""
    if abs(ratio - 1.0) < CLOSE or not ratio > 0.0:
        return scene
    return replace(scene, material=replace(scene.material, E=ratio * scene.material.E))
