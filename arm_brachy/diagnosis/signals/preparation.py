"""What every look at a recording needs: the streams, how the pads moved, the noise, the frame."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.loading import Evidence
from arm_brachy.diagnosis.signals.motion import Motion, motion_of
from arm_brachy.diagnosis.signals.noise import noise_of
from arm_brachy.diagnosis.signals.registration import Registration, register
from arm_brachy.diagnosis.signals.stream import ENCODER, OPTICAL
from arm_brachy.diagnosis.signals.wiring import refuse_miswired


@dataclass(frozen=True)
class Prepared:
    """One recording, ready to be looked at.

    evidence : Evidence with optical positions in the world frame
    motion : Motion, None without pads
    noise : kind -> noise.Noise; that of markers, which a tracker sees worse in depth, in the world
        frame as well
    registration : Registration, None without optical markers
    calibration : what counts as no fault
    """

    evidence: Evidence
    motion: Motion | None
    noise: dict
    registration: Registration | None
    calibration: Calibration

    @property
    def travel(self):
        """(t (m,) [s], q (m, p) [m]) of the pads by their encoders."""
        encoder = self.evidence.get(ENCODER)
        seen = encoder.valid.all(axis=1)
        return encoder.t[seen], encoder.values[seen, :, 0]

    def on(self, kind, *bodies):
        """(Stream, Noise) of the channels of a kind that sit on `bodies`; (None, None) if none."""
        stream = self.evidence.get(kind)
        index = [] if stream is None else stream.on(*bodies)
        if not len(index):
            return None, None
        return (stream.channels(index),
                replace(self.noise[kind], sd=self.noise[kind].sd[index]))


def prepare(evidence, devices=None, calibration=None, noise=None):
    """Prepared from an Evidence.

    devices : kind -> devices.*Params for the data-sheet noise, None = defaults
    calibration : finding.Calibration, None = its defaults
    noise : kind -> noise.Noise that is known from more than this recording, None = from it alone
    Markers in a frame that nothing tells are left out with a note. Raises RecordingError if
    nothing else was recorded, or if signs or names of pads are mixed up (`wiring`).
    """
    calibration = calibration or Calibration()
    noise = noise_of(evidence, devices) if noise is None else noise
    found = register(evidence, calibration.placement)
    if found is not None and not found.known:
        evidence, found = _without_markers(evidence), None
    if found is not None:
        optical = evidence.get(OPTICAL)
        moved = replace(optical, values=found.apply(optical.values))
        evidence = replace(evidence, streams={**evidence.streams, OPTICAL: moved})
        noise = {**noise, OPTICAL: noise[OPTICAL].turned(found.R)}
    motion = motion_of(evidence)
    if motion is not None:
        refuse_miswired(evidence.name, evidence, motion.touch)
    return Prepared(evidence, motion, noise, found, calibration)


def _without_markers(evidence):
    """The Evidence without the optical stream, whose frame is not known."""
    why = ('the optical markers are not where the scene has them, and fewer than three on base '
           'and pads tell where the tracker stands')
    streams = {kind: one for kind, one in evidence.streams.items() if kind != OPTICAL}
    if not set(streams) - {ENCODER}:
        raise RecordingError(f'{evidence.name}: {why}; register the tracker to the frame of the '
                             'scene at the import, or record three such markers')
    return replace(evidence, streams=streams,
                   notes=(*evidence.notes, f'{why[0].upper()}{why[1:]}: they are left out.'))


def rigid_motion(rest, moved, seen):
    """Small rigid motion of k points, frame by frame, by least squares.

    rest : (k, 3) [m];  moved : (n, k, 3) [m] displacements;  seen : (n, k)
    Returns (motion (n, 6) [m]: translation of the middle, and rotation vector times the lever;
    left (n, k, 3) [m]; lever [m] rms distance from the middle). With fewer than three points the
    rotation is zero; frames in which a point was not seen are NaN in `motion`. Valid to
    rotations of some degrees.
    """
    arm = rest - rest.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum(arm ** 2, axis=1)))), 1e-9)
    blocks = []
    for x, y, z in arm / lever:
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        blocks.append(np.hstack([np.eye(3), turn if len(rest) >= 3 else np.zeros((3, 3))]))
    A = np.vstack(blocks)
    motion = np.where(seen, 0.0, np.nan).sum(axis=1)[:, None] + np.einsum(
        'ij,nj->ni', np.linalg.pinv(A), np.nan_to_num(moved).reshape(len(moved), -1))
    left = moved - (motion @ A.T).reshape(moved.shape)
    return motion, left, lever
