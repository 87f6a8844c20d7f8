"""Loose pads that stand back from the tissue, or press it, where their encoders say zero.

A bonded pad that is off its zero draws the tissue along at all times, as the nuisance `touch` of
the model has it; a loose one pushes less far, and what others bring towards it meets it later.
Test: diagnosis/forward/test_slip.py
"""

import numpy as np

from arm_brachy.diagnosis.model.forward import STAGES, ForwardModel
from arm_brachy.diagnosis.model.hypothesis import LOOSENING
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.pad_friction import NEAR
from arm_brachy.diagnosis.model.sensitivities import loosened_change
from arm_brachy.tissue.contact_pads import touches


def standing_back(data, terms, touch):
    """Return columns (N, g): whitened change by each loose pad standing back by `touch` [m].

    data : fit_model.Data;  terms : those of a hypothesis, at about their sizes
    A column for every pad that a term loosens; nothing in it beside terms with memory, which a
    fit refuses. Raises NotConverged where no state is found.
    """
    loose = [(term, i) for term in terms if term.spec.name in LOOSENING
             for i in np.flatnonzero(touches(term.prepare(data.specimen.body)))]
    columns = np.zeros((len(data.observables.rows), len(loose)))
    others = tuple(term for term in terms if term.spec.name not in LOOSENING)
    model = ForwardModel(data.specimen, (*data.terms, *others))
    if not loose or model.remembers or model.timed:
        return columns
    baseline = data.plain() if not others else Baseline(model, data.encoder, data.t)
    as_is = {id(term): loosened_change(baseline, term, NEAR) for term, _ in loose}
    for j, (term, i) in enumerate(loose):
        back = np.where(np.arange(len(data.specimen.pads)) == i, touch, 0.0)
        moved = loosened_change(baseline, term, NEAR, back)
        columns[:, j] = data.observables.whiten(
            {kind: (moved[kind] - as_is[id(term)][kind])[..., None] for kind in STAGES})[:, 0]
    return columns
