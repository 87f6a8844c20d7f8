"""Pads off their zeros in a body that a strong cause has made another.

The nuisance `touch` has a pad that is off its zero move tissue and forces as the model without the
causes answers. The body that was found answers otherwise, by as large a part of that as it does to
pushes: half a millimetre off in tissue three times as compressible puts markers 0.04 mm elsewhere
at rest, which ten trackers' readings show.
Test: diagnosis/forward/test_preload.py
"""

import numpy as np

from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.model.forward import STAGES, STATICS, ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, posterior, stacked
from arm_brachy.tissue.contact_pads import touches

MATTERS = 0.5       # log density that the change may be worth, from which on it is asked for


def matters(data, residual, which, touch):
    """True if what pads off their zeros do may be otherwise, beside what was found, by MATTERS.

    data : fit_model.Data of each recording, with baselines;  residual : of each, (N,) as found
    which : of each, (k,) True for the columns of its U that are pads off zero by `touch` [m]
    By its share of the effect: how far the pads are off to how far they push.
    """
    U, left = stacked(data), np.concatenate(residual)
    effect = np.concatenate([one.residual(one.baseline.shown) for one in data]) - left
    off = touch * np.abs(posterior(U, left).mean)[:sum(np.sum(one.own) for one in data)]
    off *= np.concatenate([some[one.own] for one, some in zip(data, which, strict=True)])
    share = off.max(initial=0.0) / max(np.abs(one.encoder.q).max() for one in data)
    return 0.5 * Beside(U).square(effect) * share**2 >= MATTERS


def otherwise(data, terms, touch):
    """Return columns (N, p): what terms change of the answer to each pad `touch` [m] off zero.

    data : fit_model.Data with its baseline;  terms : as found, of all hypotheses
    Zero beside terms with memory (`preload` has what these change, nothing has what a cause
    without memory beside them does), of pads that come loose (`loose_pad_offset`) and where no
    term is in the body. Raises NotConverged where a state is not found.
    """
    terms = data.present(terms)
    model = ForwardModel(data.specimen, (*data.terms, *terms), options=STATICS)
    plain, moves = data.baseline, touch * np.eye(len(model.body.pads))
    if (not any(term.stage is Stage.BODY for term in terms) or model.remembers
            or touches(model.body).any()):
        return np.zeros((len(data.observables.rows), len(moves)))
    found = Baseline(model, data.encoder, data.t)
    changes = [[_less(found.pads_moved(i, moved), plain.pads_moved(i, moved))
                for i in range(len(data.t))] for moved in moves]
    return data.observables.whiten({kind: np.stack(
        [np.stack([one[kind] for one in change]) for change in changes], axis=3)
        for kind in STAGES})


def _less(one, other):
    return {kind: one[kind] - other[kind] for kind in STAGES}
