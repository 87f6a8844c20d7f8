"""Motion capture files (C3D) -> bags, registered to a scene."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from arm_brachy.core.errors import RecordingError
from arm_brachy.core.quantity import quantity
from arm_brachy.recording import encode
from arm_brachy.recording.c3d_file import doubled, read_file
from arm_brachy.recording.c3d_gaps import hide_gaps
from arm_brachy.recording.rigid import fit_rigid
from arm_brachy.recording.sampling import sampling
from arm_brachy.recording.writer import BagWriter

TOPIC = '/optical/markers'
LENGTH_UNITS = {'m': 1.0, 'mm': 1e-3}


@dataclass(frozen=True)
class Registration:
    """Fit the tracker's frame to the scene's by markers that rest at their reference positions.

    markers : our names; each must be a marker of the scene;  start, stop : the rest, from the
        first frame of the file
    """

    markers: tuple[str, ...]
    start: float = quantity(0.0, 's', 'begin of the rest', low=0.0)
    stop: float = quantity(0.2, 's', 'end of the rest', low=0.0)


@dataclass(frozen=True)
class Trigger:
    """Find the moment something is let go: a marker has left its rest by `distance`.

    The rest is the mean over `rest` from the first frame; the moment is the last frame before the
    distance grew past the threshold for good (`hold` in a row).
    """

    marker: str
    distance: float = quantity(1.0, 'mm', 'how far from rest', low=0.01)
    rest: float = quantity(0.2, 's', 'duration of the rest', low=0.01)
    hold: float = quantity(0.03, 's', 'how long beyond', low=0.0)


@dataclass(frozen=True)
class C3dImport:
    """What to make of a C3D file.

    names : our marker name -> label in the file; left empty, every labelled point as it is named
    unit : of the points; 'file' takes what the file says (POINT:UNITS)
    registration, trigger : see there; absent = tracker frame kept, nothing detected
    start, stop : part to keep, from the file's first frame, or from the trigger if there is one
        (negative start = before it); the bag's time 0 is `start`
    """

    names: dict[str, str] = field(default_factory=dict)
    unit: Literal['file', 'm', 'mm'] = 'file'
    frame: str = 'world'
    registration: Registration | None = None
    trigger: Trigger | None = None
    start: float = quantity(..., 's', 'begin of the part to keep')
    stop: float = quantity(..., 's', 'end of the part to keep')


@dataclass(frozen=True)
class Capture:
    """Points of one file. points : (n, k, 3) [m], NaN = gap;  rate [Hz];  first : frame number.

    notes : what a person should know of how the file was read
    """

    names: tuple
    points: np.ndarray
    rate: float
    first: int
    notes: tuple = ()


def import_c3d(files, out_dir, options, scene=None, *, attachments=None):
    """Convert each C3D file to a bag `out_dir/<stem>`.

    options : C3dImport;  scene : core.scene.Scene with the reference positions, needed only for a
    registration;  attachments : file name -> text kept in every bag
    Returns a dict: bags, one dict per file: source, bag, frames, rate_Hz, unit, missing_values,
    longest_gap_s, notes, registration_mm (marker -> distance left), rest_spread_mm (marker -> rms
    about its mean during the rest), trigger_s (in the bag's time), messages.
    Raises RecordingError naming the file.
    """
    if not files:
        raise RecordingError('no C3D file was named')
    return {'bags': [_import_one(Path(f), Path(out_dir), options, scene, attachments or {})
                     for f in files]}


def read_c3d(path, names=None, unit='file'):
    """Read the points of a C3D file as Capture; NaN where a point was not seen.

    names : our name -> label, None or empty = the labels;  unit : 'file', 'm' or 'mm'
    Not seen are a negative residual, NaN, and numbers that no camera gives (`c3d_gaps`); outputs
    of a body model are no points and are left out. What was left out is in the notes.
    Raises RecordingError if the file is no C3D, contradicts itself, lacks a label, has one twice,
    or names no known unit.
    """
    file = read_file(path)
    notes = list(file.notes)
    keys = names or _markers(file, notes)
    _refuse_labels(path, file, keys)
    index = [file.labels.index(label) for label in keys.values()]
    scale = _scale(path, file, unit)
    points, hidden = hide_gaps(file.values[:, index] * scale, tuple(keys),
                               file.resolution * scale)
    return Capture(tuple(keys), points, file.rate, file.first, (*notes, *hidden))


def _markers(file, notes):
    """Name -> label of every labelled point that is none of a model's outputs; a note on those."""
    outputs = [label for label in file.labels if label in file.model_outputs]
    if outputs:
        groups = sorted({file.model_outputs[label] for label in outputs})
        notes.append(f'{len(outputs)} outputs of a body model left out (POINT:'
                     f'{", POINT:".join(groups)}): {", ".join(outputs)}')
    return {label: label for label in file.labels if label and label not in outputs}


def _refuse_labels(path, file, keys):
    known = [label for label in file.labels if label]
    absent = [label for label in keys.values() if label not in known]
    if absent:
        raise RecordingError(f'{path}: no marker labelled {absent[0]!r}; the file has: '
                             f'{", ".join(known) or "none"}')
    if not keys:
        raise RecordingError(f'{path}: holds no labelled marker')
    twice = [label for label in doubled(file.labels) if label in keys.values()]
    if twice:
        raise RecordingError(f'{path}: {file.labels.count(twice[0])} points are labelled '
                             f'{twice[0]!r}; every label must be there once: rename them, or name '
                             'the points to read in the options (`names`)')
    outputs = [label for label in keys.values() if label in file.model_outputs]
    if outputs:
        raise RecordingError(f'{path}: {outputs[0]!r} is an output of a body model (POINT:'
                             f'{file.model_outputs[outputs[0]]}); must be a marker')


def _scale(path, file, unit):
    unit = file.unit if unit == 'file' else unit
    if unit not in LENGTH_UNITS:
        raise RecordingError(f'{path}: unit {unit!r}; must be m or mm: set `unit` in the options')
    return LENGTH_UNITS[unit]


def _import_one(path, out_dir, options, scene, attachments):
    capture = read_c3d(path, options.names, options.unit)
    report = {'source': str(path), 'rate_Hz': capture.rate, 'notes': list(capture.notes)}
    points = capture.points
    if options.registration is not None:
        points = _register(path, capture, options.registration, scene, report)
    released = None
    if options.trigger is not None:
        released = find_release(path, capture, options.trigger)
    kept = _part(path, capture, options, released)
    t_ns = np.rint((np.arange(kept.start, kept.stop) - kept.start) / capture.rate * 1e9)
    t_ns = t_ns.astype(np.int64)
    if released is not None:
        report['trigger_s'] = (released - kept.start) / capture.rate
    missing = np.isnan(points[kept]).any(axis=2)
    measured = sampling(t_ns, missing)
    report |= {'frames': len(t_ns), 'missing_values': measured['missing_values'],
               'longest_gap_s': measured['longest_gap_s']}
    info = {'name': path.stem, 'source': path.name}
    if released is not None:
        info['trigger_s'] = report['trigger_s']
    encoder = encode.Encoder()
    with BagWriter(out_dir / path.stem, provenance=info, attachments=attachments) as bag:
        bag.add_topic(TOPIC, encode.OPTICAL, definition=encoder.definitions[encode.OPTICAL])
        for k, t in enumerate(t_ns.tolist()):
            number = capture.first + kept.start + k
            data = encoder.optical_frame(t, options.frame, number, capture.names,
                                         points[kept.start + k])
            bag.write(TOPIC, data, t, sequence=k)
    return report | {'bag': str(bag.directory), 'messages': bag.counts}


def _register(path, capture, registration, scene, report):
    """Points (n, k, 3) in the scene's frame; writes the residuals into the report."""
    if scene is None:
        raise RecordingError(f'{path}: a registration needs a scene with the reference positions')
    reference = {m.name: m.position for m in scene.markers}
    _require_names(path, 'scene', registration.markers, reference)
    _require_names(path, 'capture', registration.markers, capture.names)
    index = [capture.names.index(name) for name in registration.markers]
    rows = _rows(path, capture, registration.start, registration.stop)
    rest = capture.points[rows][:, index]
    seen = np.isfinite(rest).all(axis=2).any(axis=0)
    if not seen.all():
        hidden = registration.markers[int(np.argmin(seen))]
        raise RecordingError(f'{path}: marker {hidden!r} is never seen during the rest; choose '
                             'another marker or interval')
    mean = np.nanmean(rest, axis=0)
    fit = fit_rigid(mean, [reference[name] for name in registration.markers])
    spread = np.sqrt(np.nanmean(np.sum((rest - mean) ** 2, axis=2), axis=0))
    names = registration.markers
    report['registration_mm'] = dict(zip(names, (fit.residual * 1e3).tolist(), strict=True))
    report['rest_spread_mm'] = dict(zip(names, (spread * 1e3).tolist(), strict=True))
    return fit.apply(capture.points)


def find_release(path, capture, trigger):
    """Return the index of the last frame before a marker leaves its rest for good.

    Raises RecordingError if the marker is absent, unseen at rest, or never leaves.
    """
    _require_names(path, 'capture', [trigger.marker], capture.names)
    points = capture.points[:, capture.names.index(trigger.marker)]
    rest = points[_rows(path, capture, 0.0, trigger.rest)]
    if not np.isfinite(rest).any():
        raise RecordingError(f'{path}: marker {trigger.marker!r} is not seen during the first '
                             f'{trigger.rest:g} s; choose another')
    away = np.linalg.norm(points - np.nanmean(rest, axis=0), axis=1) > trigger.distance
    length = max(1, round(trigger.hold * capture.rate))
    runs = np.lib.stride_tricks.sliding_window_view(away, length).all(axis=1)
    if not runs.any():
        raise RecordingError(f'{path}: marker {trigger.marker!r} never leaves its rest by '
                             f'{trigger.distance * 1e3:g} mm; lower distance_mm')
    return max(0, int(np.argmax(runs)) - 1)


def _rows(path, capture, start, stop):
    rows = slice(round(start * capture.rate), round(stop * capture.rate))
    if not 0 <= rows.start < rows.stop <= len(capture.points):
        raise RecordingError(f'{path}: interval {start:g} to {stop:g} s; must be increasing and '
                             f'within the {len(capture.points) / capture.rate:g} s recorded')
    return rows


def _part(path, capture, options, released):
    """The slice of frames to keep."""
    origin = (released or 0) / capture.rate
    length = len(capture.points) / capture.rate
    start = 0.0 if options.start is None else origin + options.start
    stop = length if options.stop is None else origin + options.stop
    return _rows(path, capture, start, stop)


def _require_names(path, where, wanted, known):
    for name in wanted:
        if name not in known:
            raise RecordingError(f'{path}: no marker {name!r} in the {where}; it has: '
                                 f'{", ".join(known)}')
