"""What to record next, of a decision that left causes open."""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.estimation.fit import sizes_of
from arm_brachy.diagnosis.experiment_design.design import next_experiment
from arm_brachy.diagnosis.experiment_design.prediction import Option, Whitened
from arm_brachy.diagnosis.likelihood.nuisances import nuisances
from arm_brachy.diagnosis.likelihood.tolerances import joined, tolerances
from arm_brachy.diagnosis.results.parts import NextExperiment
from arm_brachy.diagnosis.selection.marker_placement import apart_in, named_apart
from arm_brachy.diagnosis.signals.stream import ENCODER

OTHER_PUSH = ('Push with another pad as well: what a lump does follows the strain about it, what '
              'a load does that came with this push does not.')


def asked(assembly, decision, ensemble, calibration=None):
    """statements.NextExperiment that tells the causes of a class apart; None where there is none.

    What may be a load that comes with a push is asked for another push.

    ensemble : discretisation.Ensemble;  calibration : finding.Calibration
    """
    if decision.unproven is not None:
        return NextExperiment(instruction=OTHER_PUSH)
    if not decision.equals:
        return None
    open_ = (decision.accepted, *decision.equals)
    options = tuple(Option(' + '.join(c.causes), *_of(assembly, c)) for c in open_)
    columns = tuple(np.hstack([e.columns for e in c.explanations]) for c in open_)
    first = assembly.matched[0]
    noise = {kind: one for m in reversed(assembly.matched)     # what any of them has is at hand
             for kind, one in m.recorded.prepared.noise.items()}

    def beside(baseline):
        every = joined(nuisances(baseline, calibration, several=True),
                       tolerances(baseline, calibration), ensemble.along(baseline))
        return named_apart(every, apart_in(first))

    try:
        return next_experiment(
            first.baseline.model.specimen, first.baseline.model.terms, options, noise,
            tuple(kind for kind in noise if kind != ENCODER), nuisance_columns=beside,
            at_hand=Whitened(assembly.problem.U, assembly.names, columns))
    except NotConverged as error:
        return NextExperiment(instruction='Push each pad alone, at two speeds and to two depths; '
                              f'what would tell them apart best was not found: {error}.')


def _of(assembly, candidate):
    """(Hypotheses, amplitudes (p,) in typical sizes) of a judge.Candidate."""
    hypotheses, amplitudes = sizes_of(assembly, candidate)
    return hypotheses, np.concatenate(amplitudes)
