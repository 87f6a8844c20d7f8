"""From what the encoders saw to where the pads were, through the terms between the two.

Test: diagnosis/forward/test_forward.py
"""


import numpy as np

from arm_brachy.core.errors import ConfigError, NotConverged
from arm_brachy.core.term import Stage
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.registry import split

PASSES = 8          # of the fixed point between pad forces and yielding transmissions
CLOSE = 1e-7        # m, of the path: a thousandth of the noise of any tracker
REPEATS = 4         # of a sample under effort: terms that carry a force on from the step before
                    # then settle on that given, each time to some tenth of what was left




def transmitted(terms, encoder, effort=None):
    """Return the Path of the pads, given the Path of the encoders.

    terms : of any stage; those at the set point have acted before the encoders and change nothing
    effort : (m, p) [N] pushing back on the pads at the encoder's samples, None = none
    Every sample passes through every term, so that memory (play) sees each reversal. Holds for
    terms without a time of their own: a sample that is repeated changes nothing. Between samples
    the path is straight, which play is not: they have to be closer than its width.
    Raises ConfigError for a term between motor and encoder, which cannot be turned round.
    """
    by_stage = split(terms)
    if by_stage[Stage.ENCODER]:
        raise ConfigError(f'{by_stage[Stage.ENCODER][0].spec.name} acts on the encoder; the '
                          'motor cannot be found from what it shows; leave the term out')
    acting, q, t = by_stage[Stage.TRANSMISSION], encoder.q, encoder.t
    if not acting:
        return encoder
    repeats = 1 if effort is None else REPEATS
    effort = np.zeros_like(q) if effort is None else effort
    out, memories = np.empty_like(q), [term.memory(q[0]) for term in acting]
    before = np.diff(t, prepend=t[0] - 1.0)
    for i, u in enumerate(q):
        for j, term in enumerate(acting):
            for _ in range(repeats):
                y, memories[j] = term.step(memories[j], u, effort[i], t[i], before[i])
            u = y
        out[i] = u
    return Path(t, out)


def yields(terms, encoder):
    """True if the path of the pads depends on what pushes back on them."""
    if not split(terms)[Stage.TRANSMISSION]:
        return False
    free = transmitted(terms, encoder)
    pushed = transmitted(terms, encoder, np.ones_like(encoder.q))
    return not np.array_equal(free.q, pushed.q)


def balanced(terms, encoder, effort_of):
    """Return the Path of pads that yield to the forces which that path itself brings about.

    effort_of : Path -> (m, p) [N] at the encoder's samples
    Fixed point, pass by pass: contracts by compliance times stiffness of the tissue.
    Raises NotConverged if paths differ by more than 0.1 um after 8 passes.
    """
    path = transmitted(terms, encoder, effort_of(encoder))
    for _ in range(PASSES):
        new = transmitted(terms, encoder, effort_of(path))
        change = np.abs(new.q - path.q).max()
        path = new
        if change <= CLOSE:
            return path
    raise NotConverged(f'pads and the forces on them do not settle: the last of {PASSES} passes '
                       f'still moved a pad by {1e3 * change:.3g} mm; must be at most '
                       f'{1e3 * CLOSE:g} mm; lower the compliance')
