"""Make the recording of a case: four streams and what an honest user knows of the body."""
import json
from pathlib import Path

import numpy as np

from arm_brachy.prove.generator.case import truth_of
from arm_brachy.prove.generator.forms import act_of
from arm_brachy.prove.generator.plant import play
from arm_brachy.prove.generator.recorder import (
    clean_streams,
    exact_times,
    noisy_times,
    spoil,
    write_streams,
)
from arm_brachy.prove.generator.sensing import SENSING
from arm_brachy.prove.generator.strange import STRANGE_SENSING
from arm_brachy.prove.generator.surface import nominal_surface
from arm_brachy.prove.generator.world import marker_names, pad_markers, target_names

SEEN = {**SENSING, **STRANGE_SENSING}


def make(case, folder, cache):
    """Write the recording of `case` into `folder`; return its truth, which is not in there.

    cache : folder for solutions of unplanted bodies, shared by all cases.
    The truth has the labels, parameters, nuisances and, under 'heldout', the noise-free
    streams of a protocol never shown, which starts when the recording ends: arrays in SI, with
    the effects of sensors left out, and times from 0.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(case.noise_seed)
    run = play(case, cache)
    streams = clean_streams(run.world, run.t, run.u, run.y,
                            noisy_times(rng, case.sensors, run.shown))
    for effect in case.effects:
        if effect.name in SEEN:
            act_of(effect, SEEN)(streams, effect.values)
    spoil(rng, streams, case.sensors, case.nuisances)
    write_streams(streams, folder)
    (folder / 'body.json').write_text(json.dumps(known(case.body), indent=1))
    return {**truth_of(case), 'duration_s': run.shown, 'heldout': heldout(run)}


def heldout(run):
    """Noise-free streams of the held-out protocol: per stream, times, names and values."""
    streams = clean_streams(run.world, run.t, run.u, run.y, exact_times(run.shown, run.t[-1]))
    return {name: {'t_s': s.stamps, 'names': s.names, 'values': s.values}
            for name, s in streams.items()}


def known(body):
    """What an honest user knows of `body`: label, shape and places, at rest; SI, world frame."""
    vertices, triangles, on_base = nominal_surface(body)
    count = len(body.surface_markers)
    markers = np.vstack([body.points[:count], pad_markers(body.pads), body.base_markers])
    return {
        'frame': 'base plane z = 0, tissue above; SI',
        'reference': 'stress-free; every pad is bonded to the tissue under its disc at travel 0 '
                     'and only translates along its direction; encoders are on the motors',
        'E_Pa': body.modulus, 'nu': body.poisson, 'density_kg_m3': body.density,
        'gravity_m_s2': [0.0, 0.0, 0.0],
        'law': 'mu/2 (I1bar - 3) + kappa/2 (J - 1)^2',
        'surface': {'vertices_m': np.round(vertices, 9).tolist(),
                    'triangles': triangles.tolist(), 'base_triangles': on_base.tolist()},
        'pads': [{'name': p.name, 'centre_m': p.centre, 'direction': p.direction,
                  'radius_m': p.radius, 'stroke_m': p.stroke} for p in body.pads],
        'markers_m': dict(zip(marker_names(body), np.round(markers, 6).tolist(), strict=True)),
        'targets_m': dict(zip(target_names(body), np.round(body.points[count:], 6).tolist(),
                              strict=True)),
    }


