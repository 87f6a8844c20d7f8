"""A strong claim has to show in the errors of what was held out, in those that a reader sees.

It is made by responses and by what full fits gain over them. Where a full fit predicts no stream
better that was held out, although evidence says that it should by much, one of the two is wrong,
and the claim is taken back: a lump under a pad stood in for a force sensor whose axes mix.
Test: diagnosis/test_standing.py
"""

from dataclasses import replace

from arm_brachy.diagnosis.conclude import errors_of
from arm_brachy.diagnosis.decide import Decision, Rules
from arm_brachy.diagnosis.wording import listed, spoken

PLAIN = 0.03    # of all squares: what is gained of them on what was held out has to be seen


def standing(judgement, ratio):
    """The judgement.Judgement, its claim taken back where it predicts nothing better.

    ratio : of the model's modulus to the scene's
    """
    decision, accepted = judgement.decision, judgement.decision.accepted
    if accepted is None or 2.0 * accepted.held_out < PLAIN * len(judgement.assembly.problem.r):
        return judgement
    fitted = judgement.fits.of(accepted)
    if fitted.refit is None or _improves(errors_of(judgement.assembly, fitted, ratio, ())):
        return judgement
    left = decision.before.chance < Rules().alarm
    back = Decision('unexplained' if left else 'nothing_missing', None, (), decision.ranked,
                    decision.before, decision.before, nearest=accepted if left else None)
    said = (f'{listed([spoken(cause) for cause in accepted.causes]).capitalize()} would explain '
            'most by first order, but fitted in full predicts no stream better that was held out: '
            'it is not claimed.')
    return replace(judgement, decision=back, notes=(*judgement.notes, said))


def _improves(errors):
    """True if a statements.StreamFit has a smaller error with what was found."""
    return any(one.named is not None and one.named < one.recalibrated for one in errors)
