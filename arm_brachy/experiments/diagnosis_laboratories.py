"""Recordings of other laboratories through the diagnosis: one is fitted, another is held out.

Nothing is tuned and nothing is told but the scene: a dome pushed by four discs, recorded by
another code in which nothing is hidden, and a silicone beam that was held and let go, with and
without a weight at its end, each of them twice: one load alone, then both told together.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from arm_brachy.core import config
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.bags import load_bags
from arm_brachy.diagnosis.pipeline import diagnose
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.report.page import write_diagnosis
from arm_brachy.diagnosis.results.formatting import spoken
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.evaluation.result import Result, commit_of, machine_description
from arm_brachy.experiments import dome_rig, recordings, silicone_beam
from arm_brachy.experiments.parallel import process_pool
from arm_brachy.recording.import_c3d import C3dImport, import_c3d

NAME = 'diagnosis-laboratories'
SEED = 0
DOME_PAIRS = (('A', 'B'), ('A', 'C'), ('B', 'A'))
BEAM_SCENES = {'gravity': 'silicone_beam.yaml', 'load52': 'silicone_beam_load52.yaml'}


@dataclass(frozen=True)
class Pair:
    """Recordings to fit and as many to test on: bags, one of each scene."""

    scenes: tuple
    fitted: tuple
    held_out: tuple

    @property
    def name(self):
        """Of the pair, for files."""
        return '_'.join(bag.name for bag in (*self.fitted, *self.held_out))


def reproduce(out_dir):
    """Import and diagnose every pair; write JSON and a page each into `out_dir`.

    Returns evaluation.result.Result: a row per pair and stream with the verdict and the errors
    held out. No goals are set. Raises InputError if the recordings are absent.
    """
    sources = recordings.folder(dome_rig.SET), recordings.folder(silicone_beam.SET)
    out_dir = Path(out_dir)
    with tempfile.TemporaryDirectory() as scratch:
        pairs = (*domes(sources[0], Path(scratch)), *beams(sources[1], Path(scratch)))
        with process_pool(len(pairs)) as pool:
            rows = [row for some in pool.map(rows_of, pairs, [out_dir] * len(pairs))
                    for row in some]
    result = Result(NAME, SEED, commit_of(share_dir()), str(machine_description()), tuple(rows))
    result.to_json(out_dir / f'{NAME}.json')
    return result


def domes(source, scratch):
    """Import the dome's recordings; yields Pair."""
    scene, bags = dome_rig.imported(source, scratch)
    for fitted, held_out in DOME_PAIRS:
        yield Pair((str(scene),), (bags[fitted],), (bags[held_out],))


def beams(source, scratch):
    """Import the beam's recordings, two of each load; yields Pair, of each load and of both."""
    pairs = []
    options = config.load(C3dImport, config_dir() / 'imports' / 'silicone_beam.yaml')
    for load, file in BEAM_SCENES.items():
        scene = config_dir() / 'scenes' / file
        bags = import_c3d(sorted(source.glob(f'*{load}*.c3d')), scratch, options,
                          load_scene(scene))['bags']
        pairs.append(Pair((str(scene),), *((Path(bag['bag']),) for bag in bags)))
    yield from pairs
    yield Pair(*(sum((getattr(pair, part) for pair in pairs), ())
                 for part in ('scenes', 'fitted', 'held_out')))


def rows_of(pair, out_dir):
    """Diagnose a Pair and write its page; returns a row per stream, errors rms per axis."""
    scenes = {bag: load_scene(scene) for bags in (pair.fitted, pair.held_out)
              for bag, scene in zip(bags, pair.scenes, strict=True)}
    loaded = load_bags(pair.fitted, scenes.get, hold_out=pair.held_out)
    source = Provenance(pair.name, SEED, commit_of(share_dir()), str(machine_description()),
                        ', '.join(Path(scene).name for scene in pair.scenes), ())
    answer = diagnose(loaded.fitted, source, held_out=loaded.held_out)
    write_diagnosis(answer.diagnosis, answer.shown, out_dir / f'{pair.name}.html')
    return [_row(pair, answer.diagnosis, fit) for fit in answer.diagnosis.fit]


def _row(pair, found, fit):
    unit, scale = edge_unit(fit.stream)
    errors = {'as_given': fit.as_given, 'recalibrated': fit.recalibrated,
              'with_the_causes': fit.named, 'noise_floor': fit.noise_floor}
    return {'fitted': ' + '.join(bag.name for bag in pair.fitted),
            'held_out': fit.held_out or pair.held_out[0].name, 'verdict': found.verdict,
            'said': ' or '.join(spoken(c.term) for c in found.causes),
            'stream': fit.stream, 'unit': unit,
            **{key: None if value is None else value / scale for key, value in errors.items()}}


def markdown(body):
    """The README's table of a Result as mapping."""
    lines = ['| fitted, held out | verdict | stream | as given | recalibrated | with the causes | '
             'noise alone |', '|---|---|---|---|---|---|---|']
    for row in body['rows']:
        said = f'`{row["verdict"]}`' + (f': {row["said"]}' if row['said'] else '')
        errors = ('-' if row[key] is None else f'{row[key]:.3f}' for key in
                  ('as_given', 'recalibrated', 'with_the_causes', 'noise_floor'))
        lines.append(f'| {row["fitted"]}, {row["held_out"]} | {said} | {row["stream"]} / '
                     f'{row["unit"]} | ' + ' | '.join(errors) + ' |')
    return '\n'.join(lines)
