"""Channels that go silent: gaps in what was seen, values that no longer change."""

import numpy as np

from arm_brachy.diagnosis.results.finding import ALARM, CERTAIN, Finding
from arm_brachy.diagnosis.signals.stream import ENCODER, UNITS
from arm_brachy.diagnosis.signals.unobserved_motion import inside

LONGEST_GAP = 5.0      # s without a value, while the stream goes on
LEAST_SEEN = 0.5       # of the samples
LEAST_REPEATS = 5
EDGE = 0.1             # s by which streams begin and end apart
LEAST_REST = 25        # samples of a stand that tell how often values repeat in it


def gap_findings(prepared):
    """Findings about channels that were not seen for long, or often, or that froze.

    Encoders stand still rightly and are left out of the search for frozen values.
    Test: diagnosis/structural/test_rest.py
    """
    found, streams = [], prepared.evidence.streams
    span = (min(s.t[0] for s in streams.values()), max(s.t[-1] for s in streams.values()))
    stands = () if prepared.motion is None else prepared.motion.stills()
    for kind, stream in streams.items():
        found += _silence(stream, span)
        for name in dict.fromkeys(stream.names):    # a sensor's axes are seen together
            k = stream.names.index(name)
            found += _gaps(stream, k, name, () if kind == ENCODER else prepared.evidence.blind)
            if kind != ENCODER:
                found += _frozen(stream, k, name, stands)
    return tuple(found)


def _silence(stream, span):
    """A whole stream that begins late, ends early or pauses; span : (start, end) of the others."""
    edges = np.concatenate([[span[0]], stream.t, [span[1]]])
    worst = int(np.argmax(np.diff(edges)))
    t0, t1 = float(edges[worst]), float(edges[worst + 1])
    if t1 - t0 <= LONGEST_GAP:
        return []
    return [Finding(stream.kind, '', None, '', t1 - t0, 's', 0.0, CERTAIN, t0, t1,
                    f'Nothing of {stream.kind} was recorded from {t0:.1f} to {t1:.1f} s.')]


def _gaps(stream, k, name, blind):
    """Findings that a channel was not seen for long, or often, apart from spans (start, end)."""
    seen = stream.t[stream.valid[:, k]]
    share = len(seen) / max(int((~inside(stream.t, blind)).sum()), 1)
    edges = np.concatenate([[stream.t[0]], seen, [stream.t[-1]]])
    steps = np.diff(edges)
    for start, end in blind:
        steps -= np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], start), 0.0, None)
    worst = int(np.argmax(steps))
    if steps[worst] <= LONGEST_GAP and share >= LEAST_SEEN:
        return []
    return [Finding(stream.kind, name, None, '', float(steps[worst]), 's', 0.0, CERTAIN,
                    float(edges[worst]), float(edges[worst + 1]),
                    f'{name} ({stream.kind}) was seen in {100.0 * share:.0f} % of the samples; '
                    f'its longest gap is {steps[worst]:.1f} s.')]


def _frozen(stream, k, name, stands):
    """Runs of one value that are too long for how often this channel repeats itself by chance.

    stands : (t_start, t_end, pushed) [s] in which the pads stand: what is digitised coarsely, or
        has no noise, repeats itself there, above all in the middle of a count
    """
    rows = np.flatnonzero(stream.valid[:, k])
    if len(rows) < 10 * LEAST_REPEATS:
        return []
    same = (np.diff(stream.values[rows, k], axis=0) == 0.0).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        return []
    worst = int(np.argmax(ends - starts))
    length = int(ends[worst] - starts[worst])
    other = np.ones(len(same), dtype=bool)
    other[starts[worst]:ends[worst]] = False
    usual = _usual(same, other, stream.t[rows[1:]], stands)
    if length < LEAST_REPEATS or len(rows) * usual ** length > ALARM:
        return []
    first, last = rows[starts[worst]], rows[ends[worst]]
    t0, t1 = float(stream.t[first]), float(stream.t[last])
    stood = any(start - EDGE <= t0 and t1 <= end + EDGE for start, end, _ in stands)
    if stood and _all_held(stream, first, last):
        return []
    return [Finding(stream.kind, name, None, '', t1 - t0, 's', 0.0, CERTAIN, t0, t1,
                    f'{name} ({stream.kind}) does not change for {t1 - t0:.2f} s, from {t0:.2f} s '
                    f'on: its last value in {UNITS[stream.kind]} was held.', onset=(t0, t0))]


def _all_held(stream, first, last):
    """True if each of several channels keeps its value from one row to another: no noise at all.
    """
    seen = stream.values[first:last + 1][:, stream.valid[first:last + 1].any(axis=0)]
    return seen.shape[1] > 1 and not np.any(np.nanmax(seen, axis=0) > np.nanmin(seen, axis=0))


def _usual(same, other, t, stands):
    """Largest share of repeats (same, (n,)) among the `other` samples: all, and of every stand."""
    standing = [(t > start) & (t <= end) & other for start, end, _ in stands]
    shares = [(same[some].sum() + 1.0) / (some.sum() + 1.0)
              for some in (other, *standing) if some is other or some.sum() >= LEAST_REST]
    return max(shares)
