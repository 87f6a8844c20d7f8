"""One cell's sensors are the same in all its recordings: the longest idle tells how noise lasts.

Test: diagnosis/structural/test_rests.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.noise import noise_of

SAME_RATE = 0.1     # of the period between samples, for noise to be alike


def shared_noise(evidences, devices=None):
    """Noise of every stream of every Evidence of one cell: tuple of kind -> noise.Noise.

    devices : as `noise_of`
    How loud each channel is from sample to sample its own recording says; the colour is that of
    the recording with the longest idle at the same rate, since how long noise lasts takes long to
    see.
    """
    own = [noise_of(one, devices) for one in evidences]
    return tuple({kind: _coloured(one, [other[kind] for other in own if kind in other])
                  for kind, one in noise.items()} for noise in own)


def _coloured(noise, others):
    """The Noise with the colour of that one of `others` (itself among them) idle the longest."""
    alike = [one for one in others if one.source == 'idle'
             and abs(one.period - noise.period) <= SAME_RATE * noise.period]
    if noise.source != 'idle' or not alike:
        return noise
    best = max(alike, key=lambda one: one.idle).colour
    before, after = (1.0 - colour.correlation(noise.period) for colour in (noise.colour, best))
    return replace(noise, sd=noise.sd * np.sqrt(before / after), colour=best)
