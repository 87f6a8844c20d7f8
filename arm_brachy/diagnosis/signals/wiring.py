"""Mistakes of an import that would pass for physics: signs, units, exchanged pads, clocks far off.

A marker on a pad follows its encoder along the push, the force on a pad opposes its push. Where
all pads do the opposite, or two do as the other should, no actuator is worn and nothing slipped:
it is refused with what is to be mended. Pads that only ever moved together are not told apart.
Test: diagnosis/structural/test_wiring.py
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.signals.delay import WIDEST
from arm_brachy.diagnosis.signals.regressors import moving
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE, OPTICAL

FEWEST = 50         # samples of a channel
FOLLOWS, IGNORES = 0.5, 0.2     # of its variance that a travel explains, more or less
LESS = 0.5          # of what the travel of another pad explains: two forces on a cylinder 0.3 and
                    # 0.4 when exchanged, 2.4 and more before
MOVES = 0.5         # of a pad's travel, that its marker goes at least if it is there
BACKWARDS = -0.5    # travel of a marker on a pad over that by the encoder
UNITS = {'a tenth': 0.1, 'a hundredth': 0.01, 'a thousandth': 1e-3, 'ten times': 10.0,
         'a hundred times': 100.0, 'a thousand times': 1000.0, '25.4 times': 25.4,
         '1/25.4': 1.0 / 25.4}
NEAR = 0.15         # of a ratio of units, that gains of sound actuators may be off
SURE = 0.8          # of its variance that its own travel explains, for one pad to be told alone
APART = 0.02        # of the variance of a travel that no other travel explains, to tell them apart
GOES, RESTS = 0.6, 0.3      # slopes by two travels at once: with the one, not with the other


@dataclass(frozen=True)
class _Channel:
    """What sits on a pad beside the travel of every pad that pushes, one at a time.

    shares : pad -> part of its variance that is in proportion to that travel
    slope : of its component along the push, by the travel of its own pad
    slopes : pad -> the same by all travels at once, {} where these are not told apart
    far : True if it goes about as far as its pad, whenever
    """

    shares: dict
    slope: float
    slopes: dict
    far: bool


def refuse_miswired(name, evidence, touch):
    """Raise RecordingError if encoders, forces or markers on pads are of other signs or pads.

    evidence : Evidence with encoders, optical positions in the world frame
    touch : [m] pads that never push further tell nothing
    """
    optical, force = (_channels(evidence, kind, touch) for kind in (OPTICAL, FORCE))
    for what, channels in (('marker', optical), ('force', force)):
        for one, two in combinations(channels, 2):
            if (_takes(channels, one, two) and _takes(channels, two, one)) or (
                    _follows(channels, one, two, what) and _follows(channels, two, one, what)):
                raise RecordingError(
                    f'{name}: the {what} on {one} goes with the encoder of {two}, and the other '
                    'way round: two pads are exchanged; mend the names at the import')
    lost = [pad for pad, one in optical.items() if one.far and max(one.shares.values()) < IGNORES]
    if len(lost) > 1 and len(lost) == len(optical):
        raise RecordingError(
            f'{name}: markers on {", ".join(lost)} move, but not with their encoders, nor up to '
            f'{WIDEST:g} s before or after: bring both on one clock before the import')
    back = _wrong(optical, lambda slope: slope < BACKWARDS)
    if back:
        raise RecordingError(
            f'{name}: markers on {", ".join(back)} move against their encoders; travel must '
            'grow as a pad is pushed in: mend the sign of the encoders at the import')
    for words, ratio in UNITS.items():
        if _all_own(optical, lambda slope, ratio=ratio: abs(slope / ratio - 1.0) < NEAR):
            raise RecordingError(
                f'{name}: markers on {", ".join(optical)} go {words} as far as their encoders '
                'say; must be about as far: mend the unit of the encoders, or that of the '
                'markers, at the import')
    pulls = _wrong(force, lambda slope: slope > 0.0)
    if pulls:
        raise RecordingError(
            f'{name}: the forces on {", ".join(pulls)} pull where the pads are pushed in; must be '
            'those of the tissue on the tool: mend `sign` at the import')


def _takes(channels, one, two):
    """True if what sits on pad `one` goes with the travel of `two` rather than with its own."""
    shares = channels[one].shares
    return shares[one] < LESS * shares[two] and shares[two] > FOLLOWS


def _follows(channels, one, two, what):
    """True if, of the travels of all pads at once, it is that of `two` with which it goes.

    A marker goes as far as its pad. A force that pulls where its pad pushes, and more by the
    travel of the other one, is that of the other one, from the other side.
    """
    slopes = channels[one].slopes
    if not slopes:
        return False
    own, other = slopes[one], slopes[two]
    if what == 'marker':
        return abs(other) > GOES and abs(own) < RESTS
    return channels[one].slope > 0.0 and abs(other) > abs(own)


def _wrong(channels, wrong):
    """Pads whose channel has a slope that is wrong: all of them, or some that leave no doubt."""
    if _all_own(channels, wrong):
        return tuple(channels)
    return tuple(pad for pad, one in channels.items()
                 if one.shares[pad] > SURE and wrong(one.slope)
                 and wrong(one.slopes.get(pad, one.slope)))


def _all_own(channels, wrong):
    """True if every channel follows its own pad, with a slope that is wrong."""
    return bool(channels) and all(one.shares[pad] > IGNORES and wrong(one.slope)
                                  for pad, one in channels.items())


def _channels(evidence, kind, touch):
    """Pad -> _Channel of the first of a kind that sits on it; of pads that push."""
    encoder, stream, out = evidence.get(ENCODER), evidence.get(kind), {}
    if stream is None:
        return out
    q = encoder.at(stream.t)[..., 0]
    pushed = {encoder.names[i]: q[:, i] for i in moving(encoder.values[..., 0], touch)}
    for pad, travel in pushed.items():
        for channel in stream.on(pad)[:1]:
            rows = stream.valid[:, channel] & np.isfinite(q).all(axis=1)
            values = stream.vectors[rows, channel]
            if len(values) < FEWEST:
                continue
            fits = {other: _fit(x[rows], values) for other, x in pushed.items()}
            way = evidence.directions[evidence.pads.index(pad)]
            out[pad] = _Channel({other: share for other, (share, _) in fits.items()},
                                float(fits[pad][1] @ way),
                                _slopes({p: x[rows] for p, x in pushed.items()}, values @ way),
                                bool(np.linalg.norm(
                                    np.ptp(values, axis=0)) > MOVES * np.ptp(travel[rows])))
    return out


def _fit(x, values):
    """(share of the variance of values (n, 3) in proportion to x (n,), slopes (3,))."""
    x, values = x - x.mean(), values - values.mean(axis=0)
    slope = x @ values / max(x @ x, 1e-300)
    return float(x @ x * slope @ slope / max(np.sum(values**2), 1e-300)), slope


def _slopes(travels, along):
    """pad -> slope of `along` (n,) by all travels (n,) at once; {} if these are not apart."""
    X = np.column_stack([x - x.mean() for x in travels.values()])
    for i in range(X.shape[1]):
        rest = np.delete(X, i, axis=1)
        left = X[:, i] - rest @ np.linalg.lstsq(rest, X[:, i], rcond=None)[0]
        if not left @ left > APART * (X[:, i] @ X[:, i]):
            return {}
    slopes = np.linalg.lstsq(X, along - along.mean(), rcond=None)[0]
    return dict(zip(travels, slopes.tolist(), strict=True))
