"""Fresh plants under an ultrasound probe and a needle: estimators that are told of it, or not.

Pads push, the probe comes down until it presses with a drawn force, a needle goes in beside it.
Body, pads and depth are those of `fresh_plants`; place and turn of the probe, its force, hole and
depth of the needle are drawn by the same seed.

    python -m arm_brachy.experiments.loaded_plants [ESTIMATOR] [--plants 12]

prints error and coverage of an estimator, without and with these loads. It is told what force
sensor and encoders of a cell tell: pose and force of the probe, tip and force of the needle.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.cell import Body
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import run_dir
from arm_brachy.core.random import stream
from arm_brachy.devices.needle import NeedleForce, NeedleParams
from arm_brachy.estimation.known_load import needle_loads, probe_load
from arm_brachy.experiments import (
    fit_cases,
    fresh_plants,
    inside_estimators,
    inside_plants,
    inside_study,
)
from arm_brachy.experiments.inside_measurements import session
from arm_brachy.experiments.inside_plants import FullIntegration, Push
from arm_brachy.robot.template import Template, TemplateParams
from arm_brachy.tissue.instruments import Instruments
from arm_brachy.tissue.needle_path import NeedleInTissue
from arm_brachy.tissue.probe_face import ProbeFace

LOADS = ('pads alone', 'probe', 'probe and needle')   # at rows 1, 2, 3 of a Push
SKIN = 12e-3                    # m, from the template to the skin
FORCE = (2.0, 4.0)              # N, of the probe along its axis
BESIDE = 12e-3                  # m, of the probe from the apex, at most, in x and in y
TILT = 10.0                     # deg, of its axis, sd about x and y
HOLES = (4, 9)                  # of the template, columns and rows
DEPTH = (45e-3, 75e-3)          # m, from the template to the tip
DESCENT, LOWEST = 0.5e-3, 0.03  # m, step of the probe; how far below the apex it gives up
INSERTION = 2.5e-3              # m, step of the needle
SPEED = 5e-3                    # m/s of both


class _Loaded:
    """A plant stepped with its instruments, at constant speed."""

    def __init__(self, fresh):
        self.scene, self.name = fresh_plants.scene(fresh), f'loaded {fresh.number}'
        self._body = Body(self.scene, (*fresh_plants.terms(fresh), FullIntegration()),
                          instruments=Instruments(ProbeFace(), NeedleForce(NeedleParams())))
        self.pad_names, self.point_names = self._body.pad_names, self._body.point_names
        self.top = self._body.mesh.nodes[:, 2].max()
        self._t = 0.0

    def step(self, t, q):
        """As cell.Body, for inside_plants.Walk."""
        self._t = t
        return self._body.step(t, q)

    def loaded(self, q, way, probe, needle=None):
        """Reading with the tools there, a way [m] after the last one. Raises NotConverged."""
        self._t += way / SPEED
        reading = self._body.step(self._t, q, probe, needle)
        if not reading.outcome.ok:
            raise NotConverged(f'plant {self.name} under its instruments: '
                               f'{reading.outcome.advice}')
        return reading


def solve(number, seed=fresh_plants.SEED):
    """(Push of a number: rest, the first push of that fresh plant, then LOADS[1:]; what is told).

    Told is (4, 12 + 6 + 3 + 2): pose of the probe and wrench on it in its axes, tip of the needle,
    its force and its length inside; zero where there is none. Raises NotConverged.
    """
    fresh, rng = fresh_plants.drawn(number, seed), stream(seed, f'loaded_plants/{number}')
    body = _Loaded(fresh)
    q = fresh.depths[0] * np.array([pad in fresh.pads[0] for pad in body.pad_names], dtype=float)
    walk = inside_plants.Walk(body, body.name)
    readings = [walk.to(np.zeros_like(q)), walk.to(q)]
    probe, pressed = _pressed(body, q, rng)
    pierced, tip, inside = _pierced(body, q, probe, rng)
    readings += [pressed, pierced]
    at = [[body.point_names.index(n) for n in names(body.scene)]
          for names in (inside_plants.tissue_markers, inside_plants.target_names)]
    markers, targets = (np.array([r.points[i] for r in readings]) for i in at)
    told = np.zeros((4, 23))
    for k, reading in ((2, pressed), (3, pierced)):
        wrench = reading.probe.wrench.reshape(2, 3) @ probe[0]
        told[k, :18] = np.concatenate([probe[0].ravel(), probe[1], wrench.ravel()])
    told[3, 18:] = *tip, pierced.needle_force, inside
    return Push(fresh.pads[0], np.array([np.zeros_like(q), q, q, q]), markers, targets), told


def known(told):
    """Return the KnownLoads of a row of what is told."""
    R, p, wrench, tip = told[:9].reshape(3, 3), told[9:12], told[12:18], told[18:21]
    if not R.any():
        return ()
    face, axis = ProbeFace(), Template.placed(TemplateParams()).R
    needle = needle_loads(axis, tip, *told[21:]) if told[22] > 0.0 else ()
    return probe_load(R, p, wrench, face.width, face.thickness), *needle


def _pressed(body, q, rng):
    """(pose, Reading) of the probe where it presses with a drawn force."""
    R = Rotation.from_euler('xyz', [np.pi + np.radians(TILT) * rng.standard_normal(),
                                    np.radians(TILT) * rng.standard_normal(),
                                    rng.uniform(-np.pi, np.pi)]).as_matrix()
    force, (x, y) = rng.uniform(*FORCE), rng.uniform(-BESIDE, BESIDE, 2)
    for fall in np.arange(0.0, LOWEST, DESCENT):
        pose = R, np.array([x, y, body.top + 2e-3 - fall])
        reading = body.loaded(q, DESCENT, pose)
        if -reading.probe.wrench[:3] @ R[:, 2] >= force:
            return pose, reading
    raise NotConverged(f'plant {body.name}: the probe presses with less than {force:.1f} N')


def _pierced(body, q, probe, rng):
    """(Reading with the needle in, straight from a hole; its tip; its length inside)."""
    template = Template.placed(TemplateParams())
    hole, depth = template.hole(*rng.integers(*HOLES, 2)), rng.uniform(*DEPTH)
    reading = None
    for way in np.arange(INSERTION, depth, INSERTION):
        shaft = hole + np.linspace(0.0, way, 21)[:, None] * template.axis
        reading = body.loaded(q, INSERTION, probe, NeedleInTissue(shaft, way))
    return reading, shaft[-1], way - SKIN


def plants(cache, count, seed=fresh_plants.SEED):
    """Number -> (Push, what is told) of so many, solved or read.

    One that has no equilibrium is left out by name.

    cache : folder, created where absent
    """
    found = {}
    for number in range(count):
        file = Path(cache) / f'told-{seed}-{number}.npz'
        file.parent.mkdir(parents=True, exist_ok=True)
        if not file.is_file():
            try:
                push, told = solve(number, seed)
            except NotConverged as error:
                print(f'left out: {error}', file=sys.stderr)
                continue
            np.savez(file, pads=np.array(push.pads), q=push.q, markers=push.markers,
                     targets=push.targets, told=told)
        with np.load(file) as data:
            found[number] = Push(tuple(str(p) for p in data['pads']), data['q'], data['markers'],
                                 data['targets']), data['told']
    return found


def scores(name, solved):
    """Rows (load, told, markers, error [m], squared distance, named) of an estimator's truths.

    name : of inside_estimators;  solved : as `plants` returns;  told : of probe and needle
    markers : how many;  named : with UNKNOWN_LOAD
    """
    rows, model = [], inside_plants.model_scene()
    entry = inside_estimators.entry(name)
    for count, keep in inside_study.MARKER_SETS.items():
        names = inside_plants.tissue_markers(model)[keep]
        built = entry.build(model, (), inside_plants.target_names(model), names, entry.params)
        for number, (push, told) in solved.items():
            seen = session(fresh_plants.scene(fresh_plants.drawn(number)), push, names,
                           fit_cases.SEED, f'loaded {number}')
            for k, (load, end) in enumerate(zip(LOADS, seen.ends, strict=True)):
                for loads in ((), known(told[k + 1])) if k else ((),):
                    built.reset()
                    said = built.step(replace(seen.surfaces[end], loads=loads))
                    rows += [(load, bool(loads), count, *pair,
                              said.notice is Outcome.UNKNOWN_LOAD)
                             for pair in inside_study.compare(said, push.targets[k + 1]).T]
    return rows


def main():
    """Print what an estimator makes of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('estimator', nargs='?', default='map')
    parser.add_argument('--plants', type=int, default=12)
    given = parser.parse_args()
    solved = plants(run_dir() / inside_study.CACHE, given.plants)
    rows = scores(given.estimator, solved)
    print(f'{given.estimator}, {len(solved)} plants')
    for case in dict.fromkeys(row[:3] for row in rows):
        load, told, count = case
        error, distance, named = np.array([r[3:] for r in rows if r[:3] == case]).T
        share = np.mean(distance <= inside_study.INSIDE_95)
        low, high = inside_study.wilson(share, len(distance))
        print(f'{load + (", told" if told else ""):22s} {count:3d} markers: '
              f'mean {1e3 * error.mean():.3f} mm, in 95 % '
              f'ellipsoid {100 * share:.0f} % ({100 * low:.0f} to {100 * high:.0f}), load '
              f'named {100 * named.mean():.0f} %')


if __name__ == '__main__':
    main()
