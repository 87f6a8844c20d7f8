"""Streams of a laboratory as topics of a bag: what `import csv` and `import bag` write alike.

Every function takes arrays in SI and gives (topics with their types, records in order of time).
A record is (time [ns], topic, sequence, CDR bytes). What was not measured is NaN: a marker that is
not visible, a tool without a pose, a wrench or actuator left out.
Test: recording/test_import_csv.py
"""

import functools
import heapq
from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.sampling import sampling
from arm_brachy.recording.writer import BagWriter

SECOND = 10**9
APART = 2.0     # s between begins, or ends, of streams that were started by hand together
_encoder = functools.cache(encode.Encoder)    # reads message definitions, which do not change


@dataclass
class LabStreams:
    """What will be written. report : topic -> sampling;  notes : sentences for whoever imports

    parts : (begin and end [ns], topics with their types, records) of every stream
    """

    encoder: encode.Encoder = field(default_factory=_encoder)
    parts: list = field(default_factory=list)
    report: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    def add_encoders(self, t_ns, frame, names, position):
        """Actuator positions (n, k) [m] -> actuators/state."""
        topic = '/actuators/state'
        self.report[topic] = sampling(t_ns, np.isnan(position))

        def records(shift):
            for k, t in enumerate((t_ns + shift).tolist()):
                known = np.flatnonzero(np.isfinite(position[k]))
                if len(known):
                    yield t, topic, k, self.encoder.joint_state(
                        t, frame, [names[i] for i in known], position[k, known])
        self._add(t_ns, [(topic, encode.JOINT_STATE)], records)

    def add_forces(self, t_ns, frame, names, force):
        """Forces (n, k, 3) [N] on the tool -> force/<pad>/wrench."""
        topics = [f'/force/{name}/wrench' for name in names]
        known = np.isfinite(force).all(axis=2)
        for i, topic in enumerate(topics):
            self.report[topic] = sampling(t_ns, ~known[:, i:i + 1])

        def records(shift):
            for k, t in enumerate((t_ns + shift).tolist()):
                for i in np.flatnonzero(known[k]):
                    yield t, topics[i], k, self.encoder.wrench(t, frame, force[k, i])
        self._add(t_ns, [(topic, encode.WRENCH) for topic in topics], records)

    def add_optical(self, t_ns, frame, names, points, frames):
        """Markers (n, k, 3) [m] with frame numbers (n,) -> optical/markers."""
        topic = '/optical/markers'
        self.report[topic] = sampling(t_ns, np.isnan(points).any(axis=2))

        def records(shift):
            for k, t in enumerate((t_ns + shift).tolist()):
                yield t, topic, k, self.encoder.optical_frame(t, frame, int(frames[k]), names,
                                                              points[k])
        self._add(t_ns, [(topic, encode.OPTICAL)], records)

    def add_tools(self, t_ns, frame, names, points, frames, *, turns=None, quality=None):
        """Tools (n, k, 3) [m], turns (n, k, 4) x y z w, quality (n, k) -> em/<tool>/pose, status.
        """
        if turns is None:
            turns = np.broadcast_to(encode.IDENTITY, (*points.shape[:2], 4))
        if quality is None:
            quality = np.full(points.shape[:2], encode.NOT_MEASURED)
        known = np.isfinite(points).all(axis=2) & np.isfinite(turns).all(axis=2)
        topics = []
        for i, name in enumerate(names):
            self.report[f'/em/{name}/pose'] = sampling(t_ns, ~known[:, i:i + 1])
            topics += [(f'/em/{name}/pose', encode.POSE),
                       (f'/em/{name}/status', encode.TOOL_STATUS)]

        def records(shift):
            for k, t in enumerate((t_ns + shift).tolist()):
                for i, name in enumerate(names):
                    if known[k, i]:
                        yield t, f'/em/{name}/pose', k, self.encoder.pose(
                            t, frame, points[k, i], turns[k, i])
                    yield t, f'/em/{name}/status', k, self.encoder.tool_status(
                        t, frame, name, int(frames[k]), known[k, i], quality[k, i])
        self._add(t_ns, topics, records)

    def _add(self, t_ns, topics, records):
        """Keep a stream. Raises RecordingError where another has a topic of it already."""
        held = {name for _, some, _ in self.parts for name, _ in some}
        twice = [name for name, _ in topics if name in held]
        if twice:
            raise RecordingError(f'two sections of the map give {twice[0].strip("/")}; must be '
                                 'one: put their names into one section, or leave one out')
        self.parts.append(((int(t_ns[0]), int(t_ns[-1])), topics, records))

    def write(self, out_dir, info, attachments):
        """Write the bag; returns (BagWriter's directory, messages by topic).

        Where a time is negative, all are shifted by whole seconds, which a note says: a bag counts
        from zero. A note says where streams begin or end more than APART from each other.
        Raises RecordingError if one shares no time with the first.
        """
        self._compare_clocks()
        first = min(start for (start, _), _, _ in self.parts)
        shift = -(first // SECOND) * SECOND if first < 0 else 0
        if shift:
            self.notes.append(
                f'The recording begins at {first / SECOND:g} s: its times are shifted by '
                f'{shift // SECOND} s, as a bag begins at zero or later. Recordings of one clock '
                'keep their order with one `start_s` for all.')
        with BagWriter(out_dir, provenance=info, attachments=attachments) as bag:
            for _, topics, _ in self.parts:
                for topic, type_name in topics:
                    bag.add_topic(topic, type_name,
                                  definition=self.encoder.definitions[type_name])
            merged = heapq.merge(*(records(shift) for _, _, records in self.parts),
                                 key=lambda record: record[0])
            for t, topic, sequence, data in merged:
                bag.write(topic, data, t, sequence=sequence)
        return str(bag.directory), bag.counts

    def _compare_clocks(self):
        """Note, or refuse, streams whose clocks may be off."""
        stamps = np.array([span for span, _, _ in self.parts])      # [ns], may be since 1970
        spans = (stamps - stamps.min()) / SECOND
        names = [_called(topics) for _, topics, _ in self.parts]
        said = 'after the first sample, ' + ', '.join(
            f'{name} {begin:.6g} to {end:.6g} s'
            for name, (begin, end) in zip(names, spans, strict=True))
        shared = np.minimum(spans[:, 1], spans[0, 1]) - np.maximum(spans[:, 0], spans[0, 0])
        for k in np.flatnonzero(shared < 0.0):
            raise RecordingError(
                f'{names[0]} and {names[k]} share no time: {said}; must overlap: bring both on '
                'one clock (`clock_offset_ms` of a section of a column map), or leave one out')
        if np.ptp(spans, axis=0).max() > APART:
            common = max(0.0, spans[:, 1].min() - spans[:, 0].max())
            self.notes.append(
                f'Streams begin or end more than {APART:g} s apart: {said}; {common:.3g} s are '
                'common to all. That is right if a device was started late or stopped early. If '
                'a clock is off, bring it to the others (`clock_offset_ms` in a column map).')


def _called(topics):
    """A stream by its first topic: 'em/lump/pose and 2 more'."""
    names = [name.strip('/') for name, _ in topics if not name.endswith('/status')]
    return names[0] + (f' and {len(names) - 1} more' if len(names) > 1 else '')
