"""What is left open by laws that hold to some per cent: of tests, and of the numbers fitted.

What a law is wrong by is alike in all of a recording and averages out with no number of rows; from
channel to channel (a marker, a pad, each axis) it is taken as independent, and so is by how much
more it is wrong as each pad goes in: what sags by half a millimetre answers to a push by another
law's second order, not by ours. What markers on pads and base show is geometry, no law.
Test: diagnosis/forward/test_refit.py
"""

import numpy as np

from arm_brachy.diagnosis.model.pad_friction import ACCURACY
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, stacked

# Share of its effect that a term's own model may be wrong by, one standard deviation, where it is
# more than of any law. A pad elsewhere has other nodes for its outline: two meshes of the breast,
# pads 3 mm aside, effects on positions alike to 7 to 23 %, of those 1 to 8 % in size. What hangs
# on single nodes or points of quadrature was apart, beside its size, by 7 to 35 % (a loose base),
# 5 to 10 % (a wall), 5 to 14 % (a lump); of one mesh that over the root of 2
# (`reproduce node-errors`). A bump of another form than ours, a Gaussian or a cap, is met by it to
# 11 and 8 % (tissue/terms/test_reference_shape.py).
OWN = {'pad_slip': ACCURACY, 'pad_misplacement': 0.2, 'base_debond': 0.13, 'obstacle': 0.07,
       'inclusion': 0.07, 'reference_shape': 0.1}

# Share by which an effect may be too large or too small as a whole, in all channels alike. Two
# meshes of the breast with the pads' rims, 2000 and 2300 tetrahedra, differ by 0 to 3 % for a
# gradient, skin, weight, compressibility, a load and a base on springs; of one mesh that over the
# root of 2. More where nodes stand for an edge: 7, 88 and 16 % of markers where the base is loose
# by 14, 20 and 28 mm, 11 % at a wall, 17 % with a lump, 15 % of forces with a pad elsewhere
# (`reproduce node-errors`).
AS_A_WHOLE = 0.02
BY_NODES = {'base_debond': 0.25, 'obstacle': 0.1, 'inclusion': 0.1, 'pad_misplacement': 0.1}

# Of what a law has wrong, that may go with a past which its effect does not go with: of a
# relaxation by a third, in other elements, 1.1 % did, where the law is taken to hold to 5 %.
SPILL = 0.1


def law_of(hypotheses, law):
    """Share of an effect that a model of some hypothesis.Hypotheses may be wrong by.

    law : discrepancy.Accuracy.law, of any law
    """
    return max([law, *(OWN.get(one.name, 0.0) for one in hypotheses)])


def by_nodes(hypotheses):
    """Share by which the effect of some hypothesis.Hypotheses may be too large as a whole."""
    return max(BY_NODES.get(one.name, AS_A_WHOLE) for one in hypotheses)


def of_tissue(observables, specimen):
    """(N,) 1.0 for rows of Observables that follow a specimen.Specimen's tissue, 0.0 for others.

    Markers on pads and base are rigid with what moves them.
    """
    rigid = {name for name, on in zip(specimen.markers, specimen.carriers, strict=True)
             if on != TISSUE}
    return np.array([float(row.kind != OPTICAL or row.channel not in rigid)
                     for row in observables.rows])


def by_channel(observables, values):
    """Return columns (N, c): values (N,) split by channel and axis.

    observables : Observables of each recording, whose rows follow each other in N
    """
    keys = [(row.kind, row.channel, row.axis) for one in observables for row in one.rows]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    out = np.zeros((len(values), len(number)))
    out[np.arange(len(values)), [number[key] for key in keys]] = values
    return out


def law_errors(observables, pushes, sizes):
    """Return columns (N, c): errors of sizes (N,) that are steady, and that grow with every push.

    observables : Observables of each recording, whose rows follow each other in N
    pushes : (n, p) [m] of the pads at the states of each;  sizes : whitened, parts of N
    """
    deepest = np.max([np.abs(q).max(axis=0) for q in pushes], axis=0)
    grown = [np.concatenate([one.times(part, q[:, p] / deepest[p]) for one, part, q in
                             zip(observables, sizes, pushes, strict=True)])
             for p in np.flatnonzero(deepest)]
    return np.hstack([by_channel(observables, size)
                      for size in (np.concatenate(sizes), *grown)])


def past_errors(tests, size):
    """Return columns (N, m): what a law may have wrong of an effect's past.

    tests : (N, m) columns of `pooled_misfit_tests`;  size : (N,) whitened, what it has wrong in
    all Of each test as much as the size shows of it, and SPILL of all: how softening goes with the
    pushes before, or a drift with time, is a law as well. Tests that show the same share that:
    else what hundreds of them may have wrong together is more than the effect itself.
    """
    length = np.sqrt(np.maximum(np.sum(tests**2, axis=0), 1e-300))
    unit = (tests / length).astype(np.float32)      # a percent of an allowance is plenty
    alike = np.sum((unit.T @ unit)**2, axis=0)      # 1 of a test that shows what no other does
    wrong = np.hypot(tests.T @ size / length, SPILL * np.linalg.norm(size))
    return tests * (wrong / length / np.sqrt(np.maximum(alike, 1.0)))


def widened(found, data, factor, law, as_a_whole=0.0):
    """Return the covariance (k, k) of all free numbers, of effects known to `law`.

    found : map_fit.Refit;  data : fit_model.Data of its recordings, with their baselines
    factor : by which the modulus was scaled: forces by that are no effect of a cause
    law : share of an effect that the law may be wrong by, one standard deviation
    as_a_whole : share that it may be too large by in all channels alike, of `by_nodes`
    To first order: numbers move by what they would make of such errors in the data.
    """
    effect = []
    for one, residual in zip(data, found.residual, strict=True):
        shown = one.baseline.shown
        plain = one.residual({**shown, FORCE: factor * shown[FORCE]})
        effect.append((plain - residual) * of_tissue(one.observables, one.specimen))
    errors = law_errors([one.observables for one in data],
                        [one.baseline.path.at(one.baseline.t) for one in data],
                        [law * part for part in effect])
    errors = np.column_stack([errors, as_a_whole * np.concatenate(effect)])
    pulls = np.concatenate(found.columns).T @ Beside(stacked(data)).weighted(errors)
    moved = found.covariance @ pulls
    return found.covariance + moved @ moved.T
