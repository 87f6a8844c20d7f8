"""What to do where no push of the pads would tell two causes apart.

What is known of single terms is in their own specification (`invisible_when`); here is only what
to do about pairs for which it is not said there. Test: diagnosis/test_next_experiment.py
"""

from arm_brachy.diagnosis.results.formatting import listed, spoken
from arm_brachy.registry import by_name

RULER = 'look at a ruler, or another known length, with the optical tracker'
WEIGHT = 'hang a known weight on the force sensors'
TURNED = 'record the body in a second orientation as well'
AGAIN = 'make the same recording again, since what happened once will not happen again'
# Pairs of terms that equal each other whatever is pushed, or one term that equals itself in
# another channel -> what ties one of them down.
REMEDIES = {
    frozenset(('optical_scale', 'reference_shape')): RULER,
    frozenset(('optical_scale', 'swelling_drift')): RULER,
    frozenset(('force_gain', 'stiffness_scale')): WEIGHT,
    frozenset(('force_gain',)): WEIGHT,
    frozenset(('force_drift', 'stiffness_drift')): WEIGHT,
    frozenset(('reference_shape', 'gravity')): TURNED,
    frozenset(('gravity', 'stiffness_gradient')): TURNED,
}
ONCE = ('external_force', 'lost_steps', 'marker_slip')    # happen at a time, not with a push


def passes(term):
    """True for terms whose effect sets in at some time of a recording, and not in the next."""
    return term in ONCE


def advice(pairs):
    """Sentences on pairs (a, b) of explanations, 'a + b' if of several terms."""
    remedies = {_remedy(a.split(' + '), b.split(' + ')) for a, b in pairs} - {''}
    if remedies:
        line = listed(sorted(remedies))
        return f'{line[0].upper()}{line[1:]}.'
    names = dict.fromkeys(t for pair in pairs for name in pair for t in name.split(' + '))
    told = listed([f'{spoken(a)} and {spoken(b)}' if a != b else
                   f'{spoken(a)} here and {spoken(a)} there' for a, b in pairs])
    return ' '.join([f'No push of these pads is expected to tell {told} apart.', *(
        f'What hides {spoken(t)}: {by_name(t).spec.invisible_when}.' for t in names
        if by_name(t).spec.invisible_when)])


def _remedy(one, other):
    """What to do about two explanations, each of several terms; '' if nothing is known.

    Two of the same terms are those in other channels.
    """
    if one == other:
        return REMEDIES.get(frozenset(one), '')
    mine, its = set(one) - set(other), set(other) - set(one)
    for a in mine:
        for b in its:
            if frozenset((a, b)) in REMEDIES:
                return REMEDIES[frozenset((a, b))]
    return AGAIN if any(map(passes, mine)) != any(map(passes, its)) else ''
