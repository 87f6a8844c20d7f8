"""`arm-brachy diagnose`: where recordings and model differ, what is missing, how sure."""

from dataclasses import replace
from pathlib import Path

import click

from arm_brachy.cli.output import (
    console,
    json_option,
    new_folder,
    result_folder,
    show_table,
    summary,
    working,
)
from arm_brachy.cli.progress import Clock, TimeIsOver, ended_after, shown
from arm_brachy.core.config import load
from arm_brachy.core.errors import ArmBrachyError, ConfigError, InputError, Interrupted
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis import pipeline as stages
from arm_brachy.diagnosis.bags import load_bags
from arm_brachy.diagnosis.experiment_design.moves import moves_of
from arm_brachy.diagnosis.forked import cores
from arm_brachy.diagnosis.free_vibration.corrected_run import as_let_go
from arm_brachy.diagnosis.free_vibration.screening import is_free
from arm_brachy.diagnosis.partial import partial_answer, quick_answer
from arm_brachy.diagnosis.progress import FREE_STEPS, STEPS, UNITS
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.report.corrected_scenario import base_scenario, write_corrected
from arm_brachy.diagnosis.report.next_steps import what_next
from arm_brachy.diagnosis.report.page import write_diagnosis
from arm_brachy.diagnosis.results.formatting import parameter
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.stages import Known

SCREENED = 5    # candidates of a linear screen that the terminal shows; the page shows more


@click.command()
@click.argument('bags', nargs=-1, required=True, type=click.Path(), metavar='BAG...')
@click.option('--scene', required=True, type=click.Path(), metavar='FILE',
              help='What the recordings are said to show.')
@click.option('--scene-of', 'scenes_of', multiple=True, metavar='BAG=FILE',
              help='Another scene for one of the bags, as it was given, of the same body without '
                   'pads with another weight or hung another way; may be given several times.')
@click.option('--null', 'null', multiple=True, type=click.Path(), metavar='BAG',
              help='A recording of the same cell in which nothing is wrong; may be given several '
                   'times. What it shows as well is no fault. Registration, touch points, '
                   'zeros and modulus may differ; markers should sit where they sat. Takes '
                   'longer.')
@click.option('--hold-out', 'held_out', multiple=True, type=click.Path(), metavar='BAG',
              help='A recording to test on, not fitted; may be given several times.')
@click.option('--calibration', type=click.Path(), metavar='FILE',
              help='How well your laboratory is calibrated, where otherwise than is taken for '
                   'granted: `arm-brachy keys calibration`.')
@click.option('--seed', default=0, show_default=True, type=click.IntRange(0),
              help='Of the random draws in tests and meshes.')
@click.option('--quick', is_flag=True,
              help='A first look: what the signals show without a tissue model, and candidate '
                   'terms ranked to first order at a few load states. No full fits, no verdict.')
@click.option('--time-limit', type=click.FloatRange(min=0.0, min_open=True), metavar='SECONDS',
              help='End after this time with what is known until then, as Ctrl-C does; exit '
                   'status 1.')
@click.option('--jobs', type=click.IntRange(1), metavar='N',
              help='Processes at a time; the answer is the same. Default: one a core.')
@click.option('--out', type=click.Path(), metavar='FOLDER',
              help='Of page, JSON and corrected scenario; new or empty. '
                   'Default: runs/diagnosis-<time>.')
@json_option
def diagnose(bags, scene, scenes_of, null, held_out, calibration, seed, quick, time_limit, jobs,
             out, json_file):
    """Say where BAGs differ from their model and what physics is missing.

    All BAGs are of one body. Kinds of push are held out in turn (or whole recordings, with
    --hold-out), and what is named has to predict them. Recordings whose stamps follow each other
    are of one session, in which what drifts goes on. Beside the page comes a scenario with what
    was found, for `arm-brachy run`.

    In a blind trial it took 1 to 7 minutes for one recording, with one --null 2 to 17 minutes
    (docs/reference/limits.md). A line on stderr tells the step, and about how long the rest of
    it takes.

    Ctrl-C ends with what is known until then: page and JSON are written, with verdict `partial`;
    exit status 130. A second Ctrl-C writes nothing.

    \b
    Example:
      arm-brachy diagnose runs/probe/bag --scene config/scenes/breast.yaml
      arm-brachy diagnose bare_1 hung_1 --hold-out bare_2 --scene bare.yaml \\
          --scene-of hung_1=hung.yaml
    """
    clock, every = Clock(UNITS), (*bags, *null, *held_out)
    files = scene_files(every, scene, scenes_of)
    read = {file: load_scene(file) for file in dict.fromkeys((scene, *files.values()))}
    calibrated = _calibration(calibration, read[scene])
    with working(f'reading {", ".join(every)}'):
        loaded = load_bags(bags, lambda bag: read[files[bag]], hold_out=held_out, null=null)
    made_by = summary(loaded.name, (), seed=seed)
    provenance = Provenance(loaded.name, seed, made_by.commit, made_by.machine, str(scene), (),
                            _typed(bags, scene, scenes_of, null, held_out, calibration, quick))
    clock.steps = FREE_STEPS if is_free(read[scene]) else STEPS
    with new_folder(result_folder(out, 'diagnosis')) as folder:
        answer = _run(loaded, provenance, calibrated, quick, time_limit, jobs or cores(), clock)
        most = _shows_most(answer.diagnosis, [one.scene for one in loaded.fitted])
        found = _corrected(answer.diagnosis, loaded.fitted, most, files[bags[most]], folder)
        write_diagnosis(found, answer.shown, folder / 'diagnosis.html')
        found.to_json(folder / 'diagnosis.json')
    if json_file:
        found.to_json(json_file)
    _show(found, folder)
    _end(found, folder, time_limit)


def _calibration(path, scene):
    """The Calibration of a file, None = what is taken for granted."""
    if path is None:
        return None
    if not scene.pads:
        raise InputError(f'--calibration {path} for scene {scene.name}, which has no pads; must '
                         'be given for bodies with pads; leave it out')
    return load(Calibration, path)


def scene_files(bags, scene, scenes_of):
    """Bag -> scene file of it: `scene` but where one of `scenes_of`, BAG=FILE, names another.

    Raises InputError for a bag that is none of `bags`, or named twice.
    """
    files = dict.fromkeys(bags, scene)
    named = set()
    for one in scenes_of:
        bag, _, file = one.rpartition('=')
        if not bag or not file or bag not in files or bag in named:
            raise InputError(f'--scene-of {one}; must be BAG=FILE, each BAG once and one of '
                             f'{", ".join(map(str, bags))}, written the same way')
        named.add(bag)
        files[bag] = file
    return files


def _typed(bags, scene, scenes_of, null, held_out, calibration, quick):
    words_ = ['arm-brachy diagnose', *map(str, bags), f'--scene {scene}']
    words_ += [f'--scene-of {one}' for one in scenes_of]
    words_ += [f'--null {bag}' for bag in null]
    words_ += [f'--hold-out {bag}' for bag in held_out]
    words_ += [f'--calibration {calibration}'] if calibration else []
    return ' '.join(words_ + (['--quick'] if quick else []))


def _run(loaded, provenance, calibration, quick, time_limit, jobs, clock):
    """The Answer, under a line of progress; a partial one if it is ended before its time."""
    known = Known()
    left = None if time_limit is None else max(time_limit - clock.elapsed, 1e-3)
    try:
        with shown(clock) as progress, ended_after(left):
            asked = quick_answer if quick else stages.diagnose
            return asked(loaded.fitted, provenance, held_out=loaded.held_out, null=loaded.null,
                         progress=progress, calibration=calibration, known=known, jobs=jobs)
    except KeyboardInterrupt as ended:
        if not known.evidences:
            raise
        why = 'time_limit' if isinstance(ended, TimeIsOver) else 'interrupted'
        with working('writing what is known'):
            return partial_answer(known, provenance, why, clock.elapsed)


def _end(found, folder, time_limit):
    """Raise Interrupted (130), or ArmBrachyError (1), for an answer that was ended early."""
    why = found.unfinished and found.unfinished.why
    if why == 'interrupted':
        raise Interrupted(f'interrupted; what was known until then is in {folder}')
    if why == 'time_limit':
        raise ArmBrachyError(f'the time limit of {time_limit:g} s is over; what was known until '
                             f'then is in {folder}')


def _shows_most(found, scenes):
    """Number of the core.scene.Scene in which most of a Diagnosis acts, of equals most loads."""
    def acts(scene):
        return sum(not cause.scenes or scene.name in cause.scenes for cause in found.likeliest())

    return max(range(len(scenes)), key=lambda i: (acts(scenes[i]), len(scenes[i].loads)))


def _corrected(found, evidences, shown, scene, folder):
    """The Diagnosis with the path of the corrected scenario, if there is anything to correct."""
    if found.verdict == 'partial':
        return found
    evidence = evidences[shown]
    if not [cause for cause in found.causes if cause.physical] and not found.recalibrated:
        return found
    motion = motion_of(evidence)
    base = base_scenario(scene, Path(scene).stem, found.provenance.seed)
    if is_free(evidence.scene):
        base = as_let_go(base, evidences, shown)
    elif motion is not None:
        base = replace(base, moves=moves_of(motion, evidence.scene.pads, base.actuators,
                                            base.tick))
    try:
        return replace(found, scene=str(write_corrected(found, base, folder / 'corrected.yaml')))
    except ConfigError as error:    # the answer took minutes and stands without
        note = f'No scenario with what was found could be written: {error}.'
        return replace(found, notes=(*found.notes, note))


def _show(found, folder):
    console.print(' '.join(filter(None, (found.sentence, sentences.remaining(found)))),
                  highlight=False)
    console.print(f'verdict   {found.verdict}', highlight=False)
    if found.nearest is not None:
        console.print(sentences.nearest(found), highlight=False)
    for numbers in sentences.numbers(found):
        console.print(f'found     {numbers}', highlight=False)
    for name, _, *numbers in found.fitted_anyway():
        console.print(f'fitted    {parameter(name, *numbers)}', highlight=False)
    for one in found.screen[:SCREENED]:
        console.print(f'screen    {sentences.screened(one)}', highlight=False)
    if found.fit:
        show_table(summary('held-out error (rms per axis)', tuple(map(_row, found.fit)),
                           seed=found.provenance.seed))
    for note in found.notes:
        console.print(f'note      {note}', highlight=False)
    for step in what_next(found):
        console.print(f'next      {step}', highlight=False)
    if found.scene:
        console.print(f'scenario  {found.scene}')
    console.print(f'report    {folder / "diagnosis.html"}')


def _row(one):
    unit, scale = edge_unit(one.stream)
    return {'stream': one.stream, 'unit': unit, **{key: None if v is None else v / scale
            for key, v in (('as_given', one.as_given), ('recalibrated', one.recalibrated),
                           ('with_what_was_found', one.named), ('noise', one.noise_floor))}}
