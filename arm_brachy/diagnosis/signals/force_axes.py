"""Force sensors of one axis: load cells in line with their actuators, recorded as vectors.

What such a cell reads is one component of a vector, or its length along a line; the rest of the
vector is no measurement, and to compare it with a model would name forces across that nobody saw.
Test: diagnosis/structural/test_one_axis.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.signals.stream import components

LINE = 1e-3     # of the spread of a sensor's readings, that may be off a line: rounding
IN_LINE = 0.99  # cosine of a line and a push, from which one goes along the other
FEWEST = 20     # samples of a sensor


def measured_axes(values):
    """Vectors (n, k, 3) with the axes that a sensor never has set to zero beside those it has."""
    absent = np.isnan(values).all(axis=0)
    absent &= ~absent.all(axis=1, keepdims=True)
    return np.where(absent, 0.0, values)


def along_pushes(stream, pushes, notes):
    """The Stream of forces with c = 1, along the pushes, if a sensor has but one axis.

    A sensor of three axes beside such has three channels of its name: along its push and, after
    all of those, across it.
    pushes : name of a pad -> unit vector (3,);  notes : list that is told
    Vectors along an axis that is not the push are readings of a sensor in its own frame: of
    unknown sign, so that what is read under the greatest load is taken to push back. On any other
    line they are forces that keep their direction, without noise: all axes were measured.
    """
    along = np.array([pushes[name] for name in stream.names])
    axes = [reading_axis(stream.values[stream.valid[:, k], k], way) for k, way in enumerate(along)]
    known = [name for name, axis in zip(stream.names, axes, strict=True) if axis is not None]
    if not known:
        return stream
    read = np.array([way if axis is None else axis for axis, way in zip(axes, along, strict=True)])
    turned = [name for k, name in enumerate(stream.names) if (read[k] != along[k]).any()]
    notes.append(f'The force sensors of {", ".join(known)} have one axis: forces are compared '
                 'along the push of these pads.')
    if turned:
        notes.append(f'What is read on {", ".join(turned)} lies on a line that is not the push: '
                     'it is taken for the force in line with the actuator.')
    index = list(range(len(axes)))
    for k, axis in enumerate(axes):
        if axis is None:
            index += [k, k]
            read, along = (np.vstack([one, across(along[k])]) for one in (read, along))
    stream = stream.channels(index)
    return replace(stream, values=components(stream.values, read), along=along)


def reading_axis(values, push):
    """Axis (3,) along which a sensor of one axis shows the force along the push, None for others.

    values : (n, 3) [N] of one sensor;  push : unit vector (3,). See `along_pushes`.
    """
    line = _line(values, push)
    if line is None or abs(line @ push) >= IN_LINE:
        return None if line is None else push
    return _pushing_back(line, values)


def across(way):
    """[(3,), (3,)] across a unit vector: the axes of the frame by the least turn that takes the
    third, the one nearest to it, onto its line.

    Each is nearest to an axis of its own.
    """
    near = int(np.abs(way).argmax())
    axis = np.sign(way[near]) * np.eye(3)[near]
    both = axis + way
    return [e - both * (e @ way) / (1.0 + axis @ way)
            for k, e in enumerate(np.eye(3)) if k != near]


def _line(values, push):
    """Direction (3,) of a line that values (n, 3) lie on, a push or an axis; None if they do not.
    """
    if len(values) < FEWEST:
        return None
    spread, ways = np.linalg.svd(values - values.mean(axis=0), full_matrices=False)[1:]
    told = max(abs(ways[0] @ push), np.abs(ways[0]).max()) >= IN_LINE
    return ways[0] if told and spread[1] <= LINE * spread[0] and spread[0] > 0.0 else None


def _pushing_back(line, values):
    """The direction of a line (3,) along which values (n, 3) are negative where they are largest.
    """
    read = values @ line
    off = read - np.nanmedian(read)
    return -line if off[np.nanargmax(np.abs(off))] > 0.0 else line
