"""One recording as the diagnosis sees it: what a real cell would have published, nothing else."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.cell import pad_directions
from arm_brachy.core.errors import RecordingError
from arm_brachy.core.scene import Scene
from arm_brachy.diagnosis.signals import validation
from arm_brachy.diagnosis.signals.clock_alignment import on_one_clock
from arm_brachy.diagnosis.signals.encoder_smoothing import steadied
from arm_brachy.diagnosis.signals.force_axes import along_pushes, measured_axes
from arm_brachy.diagnosis.signals.outliers import fastest, without_spikes
from arm_brachy.diagnosis.signals.repeated_readings import once
from arm_brachy.diagnosis.signals.saturation import unsaturated
from arm_brachy.diagnosis.signals.stream import (
    EM,
    ENCODER,
    FORCE,
    OPTICAL,
    TISSUE,
    Stream,
    thinned,
)
from arm_brachy.diagnosis.signals.timestamps import from_zero, in_order, session_zero, together
from arm_brachy.diagnosis.signals.unobserved_motion import without_blind
from arm_brachy.offline import load_run, with_scene
from arm_brachy.recording.reader import CellBag

RATE = 100.0        # Hz: pads move in tenths of a second, soft bodies ring below 10 Hz
SAMPLES = 300_000   # per stream over all recordings together: 220 MB for thirty markers
FEWEST = 10         # samples of a channel, with fewer it says nothing
BASE_WRENCH = 'base'  # force/base/wrench: a balance under the base plate


@dataclass(frozen=True)
class Evidence:
    """The measured streams of one recording beside the scene that it claims to show.

    name : of the recording;  scene : core.scene.Scene
    directions : (p, 3) unit push directions of its pads, order of the scene
    streams : kind -> Stream; encoders and forces have a channel per pad that was measured
    base_force : Stream of one channel [N], what the base plate feels; None = not measured
    notes : sentences on what was left out, averaged or replaced
    late : kind -> [s] by which stamps were too late and are set back, `clock_alignment`
    blind : (t_start, t_end) [s] each, in which only the encoders were left, `unobserved_motion`
    """

    name: str
    scene: Scene
    directions: np.ndarray
    streams: dict
    base_force: Stream | None = None
    notes: tuple = ()
    late: dict = field(default_factory=dict)
    blind: tuple = ()

    @property
    def pads(self):
        """Names of the pads, order of the scene."""
        return tuple(pad.name for pad in self.scene.pads)

    def get(self, kind):
        """The Stream of one kind, or None."""
        return self.streams.get(kind)

    @property
    def span(self):
        """First and last time [s] at which every stream was there."""
        return (max(s.t[0] for s in self.streams.values()),
                min(s.t[-1] for s in self.streams.values()))


def zero_of(bags):
    """Time [s] from which bags (paths) count together, None = each from its own: `session_zero`.

    Raises RecordingError.
    """
    spans = []
    for bag in bags:
        with CellBag(bag) as reader:
            spans.append(tuple(1e-9 * t for t in reader.span_ns))
    return session_zero(spans)


def load_evidence(bags, scene, zero=None):
    """Read bags (paths) one after another; returns a tuple of Evidence.

    scene : core.scene.Scene of all, or a sequence with that of each
    zero : `zero_of` all bags of a session
    Memory is bounded by SAMPLES, shared out among the recordings: many or long ones are averaged
    to a lower rate, which their notes say. Raises RecordingError.
    """
    bags = list(bags)
    scenes = [scene] * len(bags) if isinstance(scene, Scene) else scene
    return tuple(evidence_of(load_run(bag, measured=True), one, samples=SAMPLES // len(bags),
                             zero=zero) for bag, one in zip(bags, scenes, strict=True))


def told_apart(evidences, bags):
    """The Evidence of each bag (path), those of one name with the end of its path; a tuple.

    Repeats of a scenario have its name, and results are kept and shown by the name of a recording.
    """
    common = Counter(one.name for one in evidences)
    ends = _ends([Path(bag).resolve() for bag in bags])
    return tuple(replace(one, name=f'{one.name} ({end})') if common[one.name] > 1 else one
                 for one, end in zip(evidences, ends, strict=True))


def _ends(paths):
    """The last parts of paths that differ, as few as tell all of them apart."""
    for number in range(1, max(len(path.parts) for path in paths) + 1):
        ends = ['/'.join(path.parts[-number:]) for path in paths]
        if len(set(ends)) == len(paths):
            break
    return ends


def evidence_of(run, scene, *, samples=SAMPLES, zero=None):
    """What RunData `run` shows of `scene` (core.scene.Scene), checked.

    samples : largest number per stream; longer streams, and those faster than RATE, are averaged
    zero : [s] from which times are counted, `zero_of`; None = see `timestamps.from_zero`
    Uses encoders, pad forces, optical markers and EM tools; the truth that a simulated recording
    also holds is never touched. Markers and tools that the scene does not know, or that were
    hardly ever seen, are left out with a note, as are single readings far off. Stamps that are
    dates count from the first one. What was seen while nobody knows where the pads were is left
    out with a note as well.
    Raises RecordingError if nothing can be made of it: actuators, markers or shape of another
    scene, units wrong, streams that do not overlap in time, nothing moved.
    Test: diagnosis/structural/test_evidence.py
    """
    notes = [f'Channels without ROS 2 messages were left out: {", ".join(run.left_out)}.'
             ] if run.left_out else []
    base = _base_force(run)
    _note_strange_sensors(run, scene, notes)
    run = with_scene(run, scene)
    found = [_encoder(run), _force(run, scene, notes), _optical(run, scene, notes),
             _em(run, scene, notes), base]
    found = [None if s is None else once(together(in_order(s, run.name, notes), notes), notes)
             for s in found]
    found = [s if s is None or s.kind != FORCE else unsaturated(s, notes) for s in found]
    speed = fastest(found[0])
    found = [s if s is None or s.kind == ENCODER else without_spikes(
        s, 0.0 if s.kind == FORCE else speed, notes).seen() for s in found]
    if any(s is not None for s in found):
        found = from_zero(found, notes, zero)
        validation.refuse_wrong_time(run.name, [s for s in found if s is not None])
    *found, base = (None if s is None else _fit_in(s, samples, notes) for s in found)
    streams = {s.kind: s for s in found if s is not None}
    validation.refuse_empty(run.name, streams)
    validation.refuse_lost_encoders(run.name, streams)
    validation.refuse_wrong_units(run.name, streams, scene)
    if scene.pads and ENCODER not in streams:
        streams[ENCODER] = _travel_from_markers(run.name, streams, scene, notes)
        validation.refuse_lost_encoders(run.name, streams)
    if ENCODER in streams:
        streams[ENCODER] = steadied(streams[ENCODER], notes)
    validation.refuse_apart_in_time(run.name, streams)
    validation.refuse_other_shape(run.name, streams, scene)
    validation.refuse_too_little_motion(run.name, streams, scene)
    return without_blind(on_one_clock(
        Evidence(run.name, scene, pad_directions(scene), streams, base, tuple(notes))))


def _note_strange_sensors(run, scene, notes):
    known = {BASE_WRENCH, *(pad.name for pad in scene.pads)}
    strange = [name for name in run.force_pads if name not in known]
    if strange:
        notes.append('force sensors that the scene has no pad for were left out: '
                     f'{", ".join(strange)}.')


def _encoder(run):
    if run.encoder is None or not run.encoder_pads:
        return None
    values = np.array(run.encoder.values, dtype=float)[..., None]
    return Stream(ENCODER, run.encoder.t, run.encoder_pads, values,
                  np.isfinite(values).all(axis=2), run.encoder_pads,
                  np.zeros((len(run.encoder_pads), 1)))


def _force(run, scene, notes):
    if run.force is None or not run.force_pads:
        return None
    values = measured_axes(np.array(run.force.values, dtype=float))
    stream = Stream(FORCE, run.force.t, run.force_pads, values, np.isfinite(values).all(axis=2),
                    run.force_pads, np.zeros((len(run.force_pads), 3)))
    pushes = dict(zip((pad.name for pad in scene.pads), pad_directions(scene), strict=True))
    return along_pushes(_seen(stream, 'force on', notes), pushes, notes)


def _base_force(run):
    if run.force is None or BASE_WRENCH not in run.force_pads:
        return None
    values = np.array(run.force.values, dtype=float)[:, [run.force_pads.index(BASE_WRENCH)]]
    return Stream(FORCE, run.force.t, (BASE_WRENCH,), values, np.isfinite(values).all(axis=2),
                  (BASE_WRENCH,), np.zeros((1, 3)))


def _optical(run, scene, notes):
    if run.optical is None or not len(run.optical.t):
        return None
    markers = {m.name: m for m in scene.markers}
    kept = _known('optical markers', run.name, run.optical.ids, tuple(markers), scene, notes)
    values = np.where(run.optical.visible[:, kept, None], run.optical.points[:, kept], np.nan)
    names = tuple(run.optical.ids[i] for i in kept)
    stream = Stream(OPTICAL, run.optical.t, names, values, np.isfinite(values).all(axis=2),
                    tuple(markers[n].body for n in names),
                    np.array([markers[n].position for n in names]))
    return _seen(stream, 'marker', notes)


def _em(run, scene, notes):
    """All tools on one time axis; a tool that another's frame did not hold is not valid there."""
    tracked = {tool: samples.tracked() for tool, samples in run.em.items()}
    if not any(len(series) for series in tracked.values()):
        return None
    targets = {target.name: target for target in scene.targets}
    kept = _known('EM tools', run.name, tuple(tracked), tuple(targets), scene, notes)
    names = tuple(tuple(tracked)[i] for i in kept)
    t = np.unique(np.concatenate([tracked[name].t for name in names]))
    values = np.full((len(t), len(names), 3), np.nan)
    for i, name in enumerate(names):
        values[np.searchsorted(t, tracked[name].t), i] = tracked[name].values
    stream = Stream(EM, t, names, values, np.isfinite(values).all(axis=2), (TISSUE,) * len(names),
                    np.array([targets[name].position for name in names]))
    return _seen(stream, 'EM tool', notes)


def _known(what, name, given, wanted, scene, notes):
    """Indices of the names that the scene knows. Raises RecordingError if it knows none."""
    kept = [i for i, one in enumerate(given) if one in wanted]
    if not kept:
        raise RecordingError(
            f'{name}: has the {what} {", ".join(given) or "none"}; scene {scene.name} knows '
            f'{", ".join(wanted) or "none"}; give the scene it was made with, or name them alike')
    strange = [one for one in given if one not in wanted]
    if strange:
        notes.append(f'{what} that the scene does not know were left out: {", ".join(strange)}.')
    return kept


def _seen(stream, what, notes):
    """Channels that were seen often enough and are alive, frames that hold any; None if none."""
    kept = []
    for k, (name, count) in enumerate(zip(stream.names, stream.valid.sum(axis=0), strict=True)):
        if count < FEWEST:
            often = 'never seen' if count == 0 else f'seen {count} times only'
            notes.append(f'{what} {name} was {often} and is left out.')
        elif not np.ptp(stream.values[stream.valid[:, k], k], axis=0).any():
            notes.append(f'{what} {name} never changes, not even by noise, and is left out.')
        else:
            kept.append(k)
    if not kept:
        return None
    return stream.channels(kept).seen()


def _fit_in(stream, samples, notes):
    span = stream.t[-1] - stream.t[0]
    period = max(1.0 / RATE, span / samples)
    if len(stream.t) <= samples and period < 1.5 * stream.period or span == 0.0:
        return stream
    notes.append(f'{stream.kind} has {1.0 / stream.period:.3g} samples a second in all; they were '
                 f'averaged to {1.0 / period:.3g}.')
    return thinned(stream, period)


def _travel_from_markers(name, streams, scene, notes):
    """The pads' travel from the markers on them, where no encoder was recorded."""
    optical = streams.get(OPTICAL)
    carried = {} if optical is None else {pad.name: optical.on(pad.name) for pad in scene.pads}
    missing = [pad.name for pad in scene.pads if not len(carried.get(pad.name, ()))]
    if missing:
        raise RecordingError(
            f'{name}: holds neither encoders nor a marker on {", ".join(missing)}; nothing says '
            'how far the pads of the scene were pushed; record actuators/state')
    pads = tuple(carried)
    positions = _in_the_scenes_frame(optical, notes)
    values = np.empty((len(optical.t), len(pads), 1))
    for i, (pad, direction) in enumerate(zip(pads, pad_directions(scene), strict=True)):
        moved = np.where(optical.valid[..., None], positions - optical.rest, np.nan)
        along = moved[:, carried[pad]] @ direction
        count = np.isfinite(along).sum(axis=1)
        values[:, i, 0] = np.where(count > 0, np.nansum(along, axis=1) / np.maximum(count, 1),
                                   np.nan)
    notes.append('No encoders were recorded: the travel of the pads is taken from their markers.')
    return Stream(ENCODER, optical.t, pads, values, np.isfinite(values).all(axis=2), pads,
                  np.zeros((len(pads), 1)))


def _in_the_scenes_frame(optical, notes):
    """Positions (n, k, 3) [m] by a rigid fit of the first frames, in which pads are at home.

    A tracker stands anywhere: neither its origin nor its axes are those of the scene.
    """
    valid = optical.valid[:FEWEST]
    seen = valid.any(axis=0)
    if seen.sum() < 3:
        notes.append('Fewer than three markers are seen at first: the frame of the tracker is '
                     'taken for that of the scene.')
        return optical.values
    sums = np.where(valid[..., None], optical.values[:FEWEST], 0.0).sum(axis=0)
    first = sums / np.maximum(valid.sum(axis=0), 1)[:, None]
    there, here = first[seen].mean(axis=0), optical.rest[seen].mean(axis=0)
    turn, _ = Rotation.align_vectors(optical.rest[seen] - here, first[seen] - there)
    return (optical.values - there) @ turn.as_matrix().T + here
