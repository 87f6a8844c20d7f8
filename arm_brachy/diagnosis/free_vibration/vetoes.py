"""The last doors of a claim about a released body: full fits of its rivals, the motion itself.

Responses take causes for alike that full fits tell apart. Rows that stand for a recording may be
explained while the motion is not: by a hand, a frame and a modulus each as far off as is barely
possible. Then the cause is at best one of several.
Test: diagnosis/test_free_doors.py
"""

from dataclasses import replace

from arm_brachy.diagnosis.settings import Rules

MISSED = 10.0   # times the noise floor; own choice: of silicone beams hands leave 3 to 6 times
# Where twice the noise is left, a cause has to predict better than the scene as it was given, by
# so much; own choice: of silicone beams right claims do by 7 % and more, one in a scene with three
# quarters of the Earth's gravity did by 2 %.
BETTER, LOUD = 0.95, 2.0


def told_apart(decision, full):
    """Return a judge.Decision without equals that fit worse in full, by odds of 50.

    full : full_fits.FreeFullFits. Equals that were weighed have been told by their full fits.
    """
    if not decision.equals:
        return decision
    kept = tuple(one for one in decision.equals
                 if one.weighed or full.lead(decision.accepted, one) < Rules().rival)
    return replace(decision, equals=kept, verdict='equivalent' if kept else 'named')


def stood_back(decision, errors):
    """Return a judge.Decision that claims nothing that leaves ten times the noise, or hardly less
    than the scene as given where that is more than noise.

    errors : Candidate -> parts.StreamFit of every recording that it is tested on
    """
    one = decision.accepted
    if one is None or not any(map(_misses, errors(one))):
        return decision
    return replace(decision, verdict='unexplained', accepted=None, equals=(), nearest=one)


def _misses(fit):
    """True if a parts.StreamFit leaves so much that its cause explains nothing."""
    return fit.named > MISSED * fit.noise_floor or (
        fit.named > max(BETTER * fit.as_given, LOUD * fit.noise_floor))
