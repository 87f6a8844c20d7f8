"""The `World` of a case: fine response of the body, and differences for its effects.

These are of two solutions on a coarser mesh, but for loads on a spot.
"""
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.prove.generator.actuation import ACTUATION
from arm_brachy.prove.generator.body import COARSE, SOLVERS
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.forms import act_of
from arm_brachy.prove.generator.history import integrate, law_of
from arm_brachy.prove.generator.other_boundary import OTHER_MOTION, OTHER_MOUNTED
from arm_brachy.prove.generator.probe import Probes, locate
from arm_brachy.prove.generator.protocol import RATE, set_points
from arm_brachy.prove.generator.response import Response, solve_response
from arm_brachy.prove.generator.solver import Model
from arm_brachy.prove.generator.strange import STRANGE_TIMED, STRANGE_TOUCH
from arm_brachy.prove.generator.tissue import (
    KINKED,
    STATIC,
    TIMED,
    base_motion,
    met,
    misplaced,
    stiffness_drift,
)
from arm_brachy.prove.generator.world import Change, World

MOUNTED = {'pad_misplacement': misplaced, 'reference_shape': met}
DRIFTS = {'stiffness_drift': stiffness_drift}
# What acts on a spot some elements wide is solved on the body's own mesh: the coarse one has some
# eight faces under it.
LOCAL = ('external_force',)


def build_world(case, cache):
    """World of `case`; responses of the unplanted body are kept in folder `cache`."""
    body = case.body
    fine = body.response(SOLVERS[body.solver], cache)
    drifts = [act_of(e, DRIFTS)(e.values) for e in case.effects if e.name in DRIFTS]
    motions = [OTHER_MOTION.get(e.form, base_motion)(e.values) for e in case.effects
               if e.name == 'breathing']
    pads = body.pads
    for effect in case.effects:
        if effect.name in MOUNTED:   # the markers on pads go with them
            pads = mounted(effect)(body, pads, effect.values)
    gaps = [STRANGE_TOUCH[e.name](e.values, [p.name for p in body.pads], fine.strokes)
            for e in case.effects if e.name in STRANGE_TOUCH]
    return World(
        body, fine, case.nuisances.modulus, tuple(changes(case, cache)),
        stiffen=lambda t: np.prod([np.ones_like(t), *(d(t) for d in drifts)], axis=0),
        base=lambda t: sum((m(t) for m in motions), np.zeros((len(t), 3))),
        touch=lambda t, y: gaps[0](t, y) if gaps else y, pads=pads)


def mounted(effect):
    """The function of body, pads and values that puts the pads where `effect` has them."""
    own = MOUNTED[effect.name]
    return own if effect.form == REGISTRY else OTHER_MOUNTED[effect.name][effect.form]


@dataclass(frozen=True)
class Planted:
    """Body with all its static effects: model, probes, states, and its difference."""

    model: Model
    probes: Probes
    response: Response
    states: list
    changes: tuple


def plant(case, cache):
    """`Planted` of `case`, without effects that come and go."""
    body = case.body
    static = [e for e in case.effects if e.name in STATIC]
    local = any(e.name in LOCAL for e in case.effects)
    options = SOLVERS[body.solver] if local else COARSE
    plain, states = body.response(options, cache, with_states=True)
    model = body.model(body.grid(options))
    for effect in static:
        model = act_of(effect, STATIC)(model, body, effect.values, case.nuisances.modulus)
    probes = locate(body.points, model.grid.mesh.nodes, model.grid.mesh.tets)
    if not static:
        return Planted(model, probes, plain, states, ())
    response, states = solve_response(model, probes, body.pairs, guess=states)
    kinked = any(e.name in KINKED for e in static)
    always = Change(response.less(plain, kinked=kinked), lambda t, y: np.ones(len(t)))
    return Planted(model, probes, response, states, (always,))


def changes(case, cache):
    """A `Change` for all static effects together, then one for every timed one on top."""
    timed = [e for e in case.effects if e.name in TIMED or e.name in STRANGE_TIMED]
    if not timed and not any(e.name in STATIC for e in case.effects):
        return
    planted = plant(case, cache)
    yield from planted.changes
    for effect in timed:
        make = act_of(effect, {**TIMED, **STRANGE_TIMED})
        model, weight = make(planted.model, case.body, effect.values, case.nuisances.modulus)
        response, _ = solve_response(model, planted.probes, case.body.pairs,
                                     guess=planted.states)
        yield Change(response.less(planted.response, kinked=False), weight)


@dataclass(frozen=True)
class Run:
    """What happens in a recording, until time `shown` [s], and in the held-out one after it.

    t (t,) [s] fine clock; u, y (t, p) travel of motors and pads [m]; world, in this run.
    """

    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    shown: float
    world: World


def play(case, cache):
    """`Run` of `case`; solutions of the unplanted body are kept in folder `cache`."""
    world = build_world(case, cache)
    first, u = set_points(case.protocol, world.response.strokes)
    then, more = set_points(case.heldout, world.response.strokes)
    t = np.r_[first, first[-1] + 1 / RATE + then]
    u = np.vstack([u, more])
    y = pad_travel(case, world, t, u)
    world = with_memory(case, world.along(t, y), cache, t, y)
    return Run(t, u, y, float(first[-1]), world)


def with_memory(case, world, cache, t, y):
    """`world` with what tissue that remembers adds when the pads go by y (t, p) at times t (t,).

    The tissue is fresh at t = 0.  Without such an effect, `world` as it is.
    """
    law = law_of(case.effects, case.nuisances.modulus)
    if law is None:
        return world
    planted = plant(case, cache)
    trace = integrate(planted.model, planted.probes, planted.states, case.body.pairs, law, t,
                      world.touch(t, y))
    return replace(world, changes=(*world.changes, trace))


def pad_travel(case, world, t, u):
    """Travel (t, p) [m] of the pads at motor travel u (t, p) on the fine clock t (t,)."""
    names = [pad.name for pad in case.body.pads]
    y = case.nuisances.travel(u)
    for effect in case.effects:
        if effect.name in ACTUATION:
            act = act_of(effect, ACTUATION)
            y = act(t, y, names, effect.values, coarse_push(world, t))
    return y


def coarse_push(world, t, every=10):
    """Function of travel (t, p) that gives the force against the pads (t, p) [N].

    Forces are computed at every tenth instant, 10 ms apart, and interpolated.
    """
    def push_back(y):
        force = world.push_back(t[::every], y[::every])
        return np.column_stack([np.interp(t, t[::every], f) for f in force.T])
    return push_back
