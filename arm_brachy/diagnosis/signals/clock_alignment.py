"""Streams whose clocks are far off, set back before anything is looked at.

Noise is taken where the pads stand, the tracker's frame where they are home, both by the encoders'
clock: a stream that is off by longer than a push shows its motion there. What is less is left to
`delay`, which see it to the millisecond.
Test: diagnosis/structural/test_clocks.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.signals.delay import FEWEST, PACE, WIDEST, Following, heard, series_of
from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.noise_process import MEDIAN_CHI2, Colour

FAR = 0.15          # s: less is no farther than a pad goes on in one direction
CLEARLY = 0.5       # of what no delay leaves unexplained, that the delay may leave at most
TOUCHED = 0.1       # change, by its logarithm, of what is left of a series that a delay matters to
FINE = 0.01         # s, to which a delay is told
SILENT = 1e-3       # of a channel's standard deviation that is taken for its noise at least


def on_one_clock(evidence):
    """The Evidence with streams that are far off the encoders' clock set back, `late` says by how
    much; the same if none is, or without pads.
    """
    motion = motion_of(evidence)
    if motion is None:
        return evidence
    encoder = evidence.get(ENCODER)
    seen = encoder.valid.all(axis=1)
    travel = encoder.t[seen], encoder.values[seen, :, 0]
    late = {}
    for kind in (OPTICAL, EM, FORCE):
        stream, rigid = _following(evidence, kind)
        delay = 0.0 if stream is None else far_off(stream, travel, motion.touch, memory=not rigid)
        if delay:
            late[kind] = delay
    streams = {kind: replace(stream, t=stream.t - late.get(kind, 0.0))
               for kind, stream in evidence.streams.items()}
    base = evidence.base_force
    if base is not None:
        base = replace(base, t=base.t - late.get(FORCE, 0.0))
    return replace(evidence, streams=streams, base_force=base, late=late)


def _following(evidence, kind):
    """(Stream of the channels that follow the pads, True if rigidly); (None, False) if none."""
    stream = evidence.get(kind)
    for bodies, rigid in ((evidence.pads, kind == OPTICAL), ((TISSUE,), False)):
        index = [] if stream is None else stream.on(*bodies)
        if len(index):
            return stream.channels(index), rigid
    return None, False


def far_off(stream, travel, touch, *, memory):
    """How late a Stream is [s], to FINE; 0 unless that is far and explains far more than none.

    travel, touch, memory : as `delay.lateness`. The noise is that from sample to sample. Every
    series counts by how many times less is left of it, and most have to agree: one marker that
    jumps far away leads nobody.
    """
    inside = heard(stream, travel)
    t, values, valid = stream.t[inside], stream.values[inside], stream.valid[inside]
    often = np.flatnonzero(valid.sum(axis=0) >= FEWEST)
    if not len(often):
        return 0.0
    series = series_of(t, values[:, often], valid[:, often], _noise(values[:, often]))
    following = Following(t, *series, Colour(), travel, touch, memory).thin()
    late = _best(following, PACE * np.arange(-round(WIDEST / PACE), round(WIDEST / PACE) + 1))
    if abs(late) < FAR:
        return 0.0
    late = _best(following, late + np.arange(-PACE, PACE + FINE, FINE))
    change = _log_left(following, late) - _log_left(following, 0.0)
    touched = change[np.abs(change) > TOUCHED]
    return late if len(touched) and np.median(touched) < np.log(CLEARLY) else 0.0


def _best(following, delays):
    """That of the delays [s] which leaves least, all series alike."""
    return float(min(delays, key=lambda late: np.sum(_log_left(following, late))))


def _log_left(following, late):
    return np.log(np.maximum(following.left(late), 1e-12))


def _noise(values):
    """(k, c) standard deviations from sample to sample, of values (n, k, c)."""
    steps = np.diff(values, axis=0)
    some = np.isfinite(steps).any(axis=0)
    noise = np.zeros(values.shape[1:])
    noise[some] = np.sqrt(np.nanmedian(steps[:, some]**2, axis=0) / (2.0 * MEDIAN_CHI2))
    return np.maximum(noise, np.maximum(SILENT * np.nanstd(values, axis=0), 1e-12))
