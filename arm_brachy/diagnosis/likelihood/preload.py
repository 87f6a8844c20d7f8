"""Pads that press tissue where their encoders say zero, and tissue that changes meanwhile.

The nuisance `touch` has a pad off its zero press as the model without the terms answers. Where
tissue softens or stiffens in the course of a recording, what it presses with at rest does as well:
0.3 mm too deep is 0.1 to 0.2 N, of which softening takes a third. And pushes that are deeper than
the encoder says soften more.
Test: diagnosis/forward/test_preload.py
"""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.model.force_rates import same_fields
from arm_brachy.diagnosis.model.forward import STAGES, STATICS, ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.memory_trajectory import Alongside
from arm_brachy.diagnosis.model.sensitivities import rebuilt
from arm_brachy.diagnosis.model.trajectory import evolve
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.newton import StaticSolver


def preload(data, terms, touch):
    """Return columns (N, p): what `terms` change of the answer to each pad `touch` [m] off zero.

    data : fit_model.Data with its baseline;  terms : of a hypothesis, at about their sizes
    The pad has been there since before the recording: what relaxes has relaxed. Memories follow
    motions that are off by what it moves at rest. Nothing where what never changed meets one
    body all along, as beside relaxation, nor where no tangent leads there (supports, contact):
    recordings of one body have as many columns, whatever happens in each.
    Raises NotConverged where a state is not found, InvertedElement as terms do.
    """
    plain, terms = data.baseline, (*data.terms, *terms)
    model = ForwardModel(data.specimen, terms, options=STATICS,
                         alike=Alongside(plain.trajectory, plain.model.body.mesh.nodes))
    if rebuilt(plain.model.body, model.body) or not _changes(model, plain):
        return np.zeros((len(data.observables.rows), len(model.body.pads)))
    changed, columns = Baseline(model, data.encoder, data.t, lasting=True), []
    for moved in touch * np.eye(len(model.body.pads)):
        change = _change(plain, changed, moved, _motion(plain.model, moved))
        columns.append({kind: np.stack([one[kind] for one in change]) for kind in STAGES})
    return data.observables.whiten(
        {kind: np.stack([one[kind] for one in columns], axis=3) for kind in STAGES})


def _changes(model, plain):
    """True if a ForwardModel answers to what never changed otherwise in a state of a Baseline."""
    fresh = StepFields.of(model.body)
    return any(not same_fields(fields, fresh) for fields in evolve(
        model.body, model.body_terms, plain.trajectory, plain.at, lasting=True))


def _change(plain, changed, moved, motion):
    """n dicts kind -> (c, 3): by how much more a Baseline changes than a plain one does.

    moved : (p,) [m], of the pads;  motion : (nodes, 3) [m] by them
    """
    out, still = [], np.zeros_like(motion)
    forces = changed.solver.assembler.forces
    for i, fields in enumerate(changed.lasting_fields(motion)):
        rate = forces(changed.x(i), fields) - changed.forces[i]
        more = changed.split(changed.sensitivity(i).change(still, rate))
        new, old = changed.pads_moved(i, moved), plain.pads_moved(i, moved)
        out.append({kind: new[kind] + more[kind] - old[kind] for kind in STAGES})
    return out


def _motion(model, moved):
    """Motion (nodes, 3) [m] by pads moved by (p,) [m] from rest."""
    solver, rest = StaticSolver(model.body), model.body.mesh.nodes
    found = solver.follow(rest, solver.held_positions(moved[:, None] * model.directions))
    if not found.outcome.ok:
        raise NotConverged(f'no state with pads {1e3 * np.abs(moved).max():g} mm off their zeros')
    return found.x - rest
