"""`arm-brachy check`: what a scene makes of its mesh, before anything is recorded."""

from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np

from arm_brachy.cli.output import console, json_option, summary, working, writable
from arm_brachy.core.errors import ArmBrachyError, InputError, MeshError, RecordingError
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.report.figures import body_of
from arm_brachy.evaluation.scene_plate import SceneBody, scene_plate
from arm_brachy.offline import load_run
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import read_mesh
from arm_brachy.tissue.mesh_check import check_mesh
from arm_brachy.tissue.scene_check import body_row, pad_rows, point_rows
from arm_brachy.tissue.scene_faults import MM, Fault, scene_faults, size_faults, stroke_faults


@click.command()
@click.argument('scene', type=click.Path())
@click.option('--picture', type=click.Path(), metavar='FILE.png', callback=writable,
              help='Also draw body, held region, pads, markers and targets from six sides.')
@click.option('--bag', 'bags', multiple=True, type=click.Path(), metavar='BAG',
              help='A recording: from where to where each pad went in it is listed, and must be '
                   'within the strokes; may be given several times.')
@json_option
def check(scene, picture, bags, json_file):
    """Say what a SCENE makes of its mesh, and what in it cannot be meant.

    What is wrong is told in red, and the exit status is 1: a marker off the surface, a target
    outside, a value that looks like another unit, a modulus or density that no body has, a stroke
    shorter than what was recorded. The rest is to be compared with the rig: `base_normal` points
    from what is held into the body (none: that is held from opposite sides, or all around), a pad
    covers nearly 100 % of its disc (its nodes' polygon is a little smaller; much less, and the pad
    is beside the body or the mesh too coarse), none of a pad's set is inside, a marker sits on the
    surface, a target is inside it (< 0). A mesh that cuts a rim is made anew by
    `arm-brachy mesh --scene`.

    \b
    Example:
      arm-brachy check config/scenes/breast.yaml --picture breast.png
    """
    if picture and picture.suffix.lower() != '.png':
        raise InputError(f'{picture}: --picture writes PNG; name a file that ends on .png')
    described = load_scene(scene)
    strokes = _strokes(bags, described)
    with working(f'reading {scene}'):
        body, faults = _judged(described)
        rows = [] if body is None else [body_row(body), *pad_rows(described, body),
                                        *point_rows(described, body)]
        rows += strokes
        faults = (*faults, *stroke_faults(described, _travels(strokes)))
    result = summary(described.name, rows)
    result.table(console)   # not `show`: body, pads, points, strokes have own columns
    for note in () if body is None else body.mesh.notes:
        console.print(f'note  {note}', markup=False, highlight=False)
    if json_file:
        replace(result, rows=(*rows, *map(asdict, faults))).to_json(json_file)
    for fault in faults:
        console.print(f'wrong    {fault}', style='bold red', highlight=False, markup=False)
    if picture and body is not None:
        scene_plate(_drawn(described, body), _names(faults, 'marker', 'target'),
                    _names(faults, 'pads')).save(picture)
        console.print(f'picture  {picture}', highlight=False)
    if faults:
        raise ArmBrachyError(f'{scene}: {len(faults)} of its values cannot be meant; mend them '
                             'and check again')


def _names(faults, *kinds):
    return {fault.name for fault in faults if fault.kind in kinds}


def _judged(scene):
    """(SoftBody of a Scene, its faults); None where there is none, for one of them.

    Raises MeshError for a mesh file that cannot be read: that is bad input, not a fault of values.
    """
    if not Path(scene.mesh.file).is_file():
        raise InputError(f'{scene.mesh.file}: no such mesh file; named by scene {scene.name}')
    read = read_mesh(scene.mesh.file, scene.mesh.unit)
    try:
        mesh = check_mesh(read, scene.mesh.file)
        faults = size_faults(scene, mesh)
        if faults:
            return None, faults
        body = build_body(scene, mesh)
    except MeshError as error:      # told as every other fault is, with the same exit status
        return None, (Fault('', str(error), ''),)
    return body, scene_faults(scene, body)


def _drawn(scene, body):
    plain = body_of(scene, body.mesh)
    return SceneBody(plain.rest, plain.tets, plain.pads, plain.markers, held=body.fixed,
                     radii={p.name: p.radius for p in scene.pads if not p.set},
                     targets={t.name: np.array(t.position) for t in scene.targets})


def _strokes(bags, scene):
    """A row for every pad and bag: from where to where its encoder says that it went [mm].

    None where the bag has no encoder of the pad. Raises RecordingError for a bag of other pads.
    """
    out, known = [], {pad.name for pad in scene.pads}
    for bag in bags:
        run = load_run(bag, measured=True)
        if run.encoder is None or not known & set(run.encoder_pads):
            has = ', '.join(run.encoder_pads) or 'none'
            raise RecordingError(f'{bag}: has encoders of {has}; must be of a pad of scene '
                                 f'{scene.name}: {", ".join(sorted(known)) or "it has none"}')
        went = dict(zip(run.encoder_pads, MM * run.encoder.values.T, strict=True))
        for pad in scene.pads:
            q = went.get(pad.name)
            told = [] if q is None else q[np.isfinite(q)]
            low, high = map(float, (np.min(told), np.max(told))) if len(told) else (None, None)
            out.append({'bag': str(bag), 'pad': pad.name, 'from_mm': low, 'to_mm': high,
                        'stroke_mm': MM * pad.stroke})
    return out


def _travels(strokes):
    """Pad name -> largest travel [m] of the rows of `_strokes`."""
    out = {}
    for row in strokes:
        if row['to_mm'] is not None:
            out[row['pad']] = max(out.get(row['pad'], 0.0), row['to_mm'] / MM)
    return out
