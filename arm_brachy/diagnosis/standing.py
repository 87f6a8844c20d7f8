"""A strong claim has to show in the errors of what was held out.

It is made by responses and by what full fits gain over them, with an allowance for what a law has
wrong that grows with its effect. Where a full fit takes little off the error of every stream that
was held out, although evidence says that it should by much, one of the two is wrong, and the claim
is taken back: a lump under a pad stood in for a force sensor whose axes mix. Something is missing.
What the mesh is known to be wrong by, from a null recording say, is taken off: it may be more than
any cause.
Test: diagnosis/test_standing.py
"""

from dataclasses import replace

from arm_brachy.diagnosis.conclude import errors_of
from arm_brachy.diagnosis.decide import Decision
from arm_brachy.diagnosis.wording import listed, spoken

PLAIN = 0.03    # of all squares: what is gained of them on what was held out has to be seen
# Of the squares beyond noise, in the stream that gains most. Of twelve strong claims in opened
# trials and other laboratories ten were right, with 0.58 to 0.99, two wrong, with 0.30 and none.
SHARE = 0.4


def standing(judgement, ratio):
    """The judgement.Judgement, its claim taken back where it predicts little better.

    ratio : of the model's modulus to the scene's
    """
    decision, accepted = judgement.decision, judgement.decision.accepted
    if accepted is None or 2.0 * accepted.held_out < PLAIN * len(judgement.assembly.problem.r):
        return judgement
    fitted = judgement.fits.of(accepted)
    if fitted.refit is None:
        return judgement
    if any(map(_gains, errors_of(judgement.assembly, fitted, ratio, (), mesh=False))):
        return judgement
    back = Decision('unexplained', None, (), decision.ranked, decision.before, decision.before,
                    nearest=accepted)
    said = (f'{listed([spoken(cause) for cause in accepted.causes]).capitalize()} would explain '
            'most by first order, but fitted in full takes little off the error of any stream '
            'that was held out: it is not claimed.')
    return replace(judgement, decision=back, notes=(*judgement.notes, said))


def _gains(one):
    """True if what was found takes SHARE of what a statements.StreamFit has beyond noise."""
    beyond = one.recalibrated**2 - one.noise_floor**2
    return one.named is not None and one.recalibrated**2 - one.named**2 >= SHARE * beyond > 0.0
