"""A sensor whose clock is off: every sample is true, but of another time than it says."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec


@dataclass(frozen=True)
class ClockOffset(SensingTerm):
    """The stamps of one stream are late or early by a constant, against the actuators' clock.

    Symbols: p(t) truth, y(t) what a sample stamped t shows, D `delay` [s]. Acquisition goes on at
    the same instants, so that values and noise are those of a run without the offset; only stamps
    are shifted. No sample is handed out before its stamp: D above the latency of the device (a
    stamp given on arrival, by a slow line) is its latency. With D < 0 samples that would be
    stamped before time zero are lost. Encoders set the time; encoders that are late are all other
    streams early. Holds for clocks that run at one rate; drift is left out.
    Test: devices/terms/test_clock_offset.py
    """

    stream: Literal['em', 'optical', 'force'] = 'optical'
    delay: float = quantity(
        20.0, 'ms', 'how late the stamps are; negative: early', low=-5000.0, high=5000.0,
        prior=('normal', 0.0, 20.0), typical=20.0,
        source='engineering judgement: stamped on arrival, two frames at 100 Hz after acquisition',
        neutral=0.0)

    spec: ClassVar[TermSpec] = TermSpec(
        name='clock_offset', kind=Kind.SENSING, stage=Stage.OPTICAL,
        summary='the stamps of one sensor are late or early',
        equation='y(t) = p(t - D)',
        source='definition; Olson 2010, A passive solution to the sensor synchronization problem, '
               'IROS',
        invisible_when='nothing moves; with a single stream besides the encoders it equals a dead '
                       'time of the actuators, as does one offset of all streams',
        leaves_open='a clock that runs fast or slow; a delay that differs from sample to sample')

    @property
    def stage(self):
        """The Stage of `stream`."""
        return Stage(self.stream)

    @property
    def lateness(self):
        """See SensingTerm."""
        return self.delay

    def distort(self, t, names, values, pads):
        """Return the values (k, 3) as they are: only the stamp is wrong."""
        return np.array(values, dtype=float)
