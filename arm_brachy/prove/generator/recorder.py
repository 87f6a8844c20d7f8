"""From what really happens to what is recorded: frames, zeros, noise, clocks, and files."""
import gzip
import io

import numpy as np

from arm_brachy.prove.generator.sensing import Stream
from arm_brachy.prove.generator.sensors import (
    RATES,
    coloured,
    lost,
    quantise,
    sample_times,
)
from arm_brachy.prove.generator.world import columns_at, marker_names, target_names


def clean_streams(world, t, u, y, times):
    """Noise-free streams of motor travel u and pad travel y (n, p) on the fine clock t (n,).

    times : per stream, true times and stamps.
    """
    names = tuple(pad.name for pad in world.body.pads)
    streams = {}
    for name, (true, stamps) in times.items():
        travel = columns_at(true, t, y)
        if name == 'encoders':
            values, kept = columns_at(true, t, u), names
        elif name == 'forces':
            values, kept = world.outputs(true, travel)[1], names
        elif name == 'optical':
            values, kept = world.markers(true, travel), marker_names(world.body)
        else:
            values, kept = world.targets(true, travel), target_names(world.body)
        streams[name] = Stream(kept, true, stamps, values, travel)
    return streams


def exact_times(start, end):
    """Times of all streams from `start` to `end` without jitter, and stamps that begin at 0."""
    return {name: ((s := np.arange(0.005, end - start - 0.01, 1 / rate)) + start, s)
            for name, rate in RATES.items()}


def noisy_times(rng, sensors, end):
    """Times of all streams as the sensors take and stamp them."""
    return {name: sample_times(rng, sensors, name, end) for name in RATES}


def spoil(rng, streams, sensors, nuisances):
    """Add registration, zeros, noise, quantisation and dropouts to `streams`, in place."""
    streams['optical'].values = nuisances.optical(streams['optical'].values)
    streams['em'].values = streams['em'].values + nuisances.em_zero
    streams['forces'].values = streams['forces'].values + nuisances.force_zero
    for name, stream in streams.items():
        if sensors.noise[name]:
            stream.values = stream.values + coloured(
                rng, stream.values.shape, sensors.noise[name], RATES[name], sensors.colour)
        if name in sensors.quantum:
            stream.values = quantise(stream.values, sensors.quantum[name])
    for name in ('optical', 'em'):
        for i in range(streams[name].values.shape[1]):
            streams[name].values[lost(rng, streams[name].true, sensors.bursts), i] = np.nan


COLUMNS = {
    'encoders': ('q_{}_m', '%.7f'),
    'forces': ('f_{}_{}_N', '%.4f'),
    'optical': ('{}_{}_m', '%.7f'),
    'em': ('{}_{}_m', '%.7f'),
}


def write_streams(streams, folder):
    """Write `<stream>.csv.gz` of every stream: stamps, then its columns, empty where unseen.

    Targets that were lost at an instant are empty there, like markers.
    """
    for name, stream in streams.items():
        pattern, digits = COLUMNS[name]
        axes = ('x', 'y', 'z') if stream.values.ndim == 3 else ('',)
        head = [pattern.format(n, a) for n in stream.names for a in axes]
        text = io.StringIO()
        table = np.column_stack([stream.stamps, stream.values.reshape(len(stream.stamps), -1)])
        np.savetxt(text, table, delimiter=',', comments='', header=','.join(['t_s', *head]),
                   fmt=['%.6f', *[digits] * len(head)])
        content = text.getvalue().replace('nan', '').encode()
        (folder / f'{name}.csv.gz').write_bytes(gzip.compress(content, 6, mtime=0))
