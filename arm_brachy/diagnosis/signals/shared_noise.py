"""One cell's sensors are the same in all its recordings: the longest idle tells how noise lasts.

Test: diagnosis/structural/test_rests.py
"""

from arm_brachy.diagnosis.signals.noise import noise_of

SAME_RATE = 0.1     # of the period between samples, for noise to be alike


def shared_noise(evidences, events=None):
    """Noise of every stream of every Evidence of one cell: tuple of kind -> noise.Noise.

    events : for each, as `noise_of`, None = none
    How loud each channel is from sample to sample its own recording says; the colour is that of
    the recording with the longest idle at the same rate, since how long noise lasts takes long to
    see.
    """
    events = events or [()] * len(evidences)
    own = [noise_of(one, events=its) for one, its in zip(evidences, events, strict=True)]
    if len(own) == 1:
        return tuple(own)
    return tuple(noise_of(one, None, {kind: _best(mine, [other[kind] for other in own
                                                         if kind in other])
                                      for kind, mine in noise.items()}, its)
                 for one, noise, its in zip(evidences, own, events, strict=True))


def _best(noise, others):
    """The Colour of that one of `others` (a Noise itself among them) that is idle the longest."""
    alike = [one for one in others if one.source == 'idle'
             and abs(one.period - noise.period) <= SAME_RATE * noise.period]
    return max(alike, key=lambda one: one.idle).colour if alike else noise.colour
