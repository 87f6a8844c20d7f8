"""What a recording says before any model of the tissue: actuators, clocks, trackers, base, forces.

Everything here holds for any body. Estimates (clocks, play, registration) are handed on to the
model even where they are within calibration and no fault.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from arm_brachy.diagnosis.isolation.actuators import actuator_findings, played
from arm_brachy.diagnosis.isolation.base_motion import base_findings
from arm_brachy.diagnosis.isolation.clocks import believed, clock_findings, clocks_of
from arm_brachy.diagnosis.isolation.consequences import share_followed
from arm_brachy.diagnosis.isolation.dropouts import gap_findings
from arm_brachy.diagnosis.isolation.events import event_findings, events_of, takes_over
from arm_brachy.diagnosis.isolation.force_balance import balance_findings
from arm_brachy.diagnosis.isolation.force_bias import force_findings
from arm_brachy.diagnosis.isolation.pad_rotation import one_each
from arm_brachy.diagnosis.isolation.pad_tracking import pad_travels
from arm_brachy.diagnosis.isolation.periodic import rhythm_findings, swinging
from arm_brachy.diagnosis.isolation.sensor_offsets import (
    em_findings,
    exchanged_findings,
    pad_place_findings,
)
from arm_brachy.diagnosis.isolation.steps import Jump, jumps
from arm_brachy.diagnosis.results.finding import ALARM, sigma
from arm_brachy.diagnosis.results.finding_merge import merge
from arm_brachy.diagnosis.signals.stream import ENCODER, OPTICAL
from arm_brachy.diagnosis.statistics.change_points import joined


@dataclass(frozen=True)
class Structure:
    """What was found in one recording without a tissue model.

    findings : Finding each, faults only, largest z first
    pads : pad_tracking.PadTravel of every moving pad with a marker
    clocks : kind of stream -> delay.Lateness against the encoders
    turning : names of the pads that turn as they go, which their markers show
    rhythm : [Hz] in which base or tissue move, however little; 0 = in none that is seen
    """

    findings: tuple
    pads: tuple
    clocks: dict
    turning: tuple = ()
    rhythm: float = 0.0

    def late(self, kind):
        """Delay [s] of a stream's stamps against the encoders; 0 where it could not be told."""
        return self.clocks[kind].value if kind in self.clocks else 0.0


def structure_of(prepared):
    """Structure of one preparation.Prepared recording.

    Test: diagnosis/structural/test_structural.py
    """
    found = [*gap_findings(prepared), *exchanged_findings(prepared), *em_findings(prepared),
             *balance_findings(prepared)]
    pads, clocks, events, turning, swings = (), {}, (), {}, None
    if prepared.motion is not None:
        tests = channels(prepared)
        if prepared.registration is not None:
            pads = pad_travels(prepared.evidence, prepared.noise[OPTICAL],
                               prepared.motion.touch, alarm=ALARM / tests,
                               even=max(prepared.calibration.play,
                                        prepared.noise[OPTICAL].rounding))
        frames = {one.marker: one.frame for one in pads}
        pads, at_pads = _themselves(prepared, pads)
        pads, turning = one_each(prepared, pads)
        found += turning.values()
        travel = played(prepared, pads)
        clocks = clocks_of(prepared, pads, travel)
        found += clock_findings(prepared, clocks)
        clocks = believed(clocks, prepared.calibration.clock)
        found += actuator_findings(prepared, pads)
        late = {kind: one.value for kind, one in clocks.items()}
        every = (*at_pads, *jumps(prepared, travel, late, alarm=ALARM / tests))
        events = events_of(every, tests)
        found += event_findings(prepared, events, frames,
                                partial(share_followed, prepared, travel, late))
        times = [event.t for event in events]
        found += force_findings(prepared, times)
        swings = swinging(prepared, travel, late.get(OPTICAL, 0.0), times)
    if swings is not None:
        found += rhythm_findings(swings, prepared.calibration.restless)
    found += base_findings(prepared, events)
    found += pad_place_findings(prepared, _tilts(found))
    merged = merge(found, prepared.evidence.pads, [one.pad for one in pads])
    return Structure(tuple(sorted(merged, key=lambda f: -f.z)), pads, clocks, tuple(turning),
                     0.0 if swings is None else swings.rhythm.frequency)


def _tilts(found):
    """Pad -> (up, side) [rad] of the Findings that its push goes another way."""
    return {pad: (one.parameters['tilt_up'], one.parameters['tilt_side'])
            for one in found if one.parameter == 'tilt_up' for pad in one.parameters['pads']}


def channels(prepared):
    """Number of channels that are searched for jumps."""
    return sum(len(s.names) for kind, s in prepared.evidence.streams.items() if kind != ENCODER)


def _themselves(prepared, pads):
    """(the PadTravels of markers that stay themselves, Jumps of all of them).

    One that takes over another one's place, see `events`, says nothing of its pad: it jumps there.
    """
    found = {one.marker: _pad_jumps(prepared, one) for one in pads}
    gone = {marker: tuple(jump for jump in its if takes_over(prepared.evidence.get(OPTICAL), jump))
            for marker, its in found.items()}
    return (tuple(one for one in pads if not gone[one.marker]),
            tuple(jump for marker, its in found.items() for jump in gone[marker] or its))


def _pad_jumps(prepared, one):
    """Steps of the marker of a PadTravel as Jumps, in the world frame."""
    slack = np.hypot(prepared.noise[OPTICAL].rounding, prepared.calibration.slip)
    return tuple(Jump(OPTICAL, one.marker, one.pad, _in_world(step, one.frame),
                      sigma(step.size, step.sd, slack)) for step in joined(one.steps))


def _in_world(step, frame):
    size = frame.T @ step.size
    return type(step)(step.t, step.low, step.high, size, step.sd, step.statistic, step.chance)
