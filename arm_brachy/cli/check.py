"""`arm-brachy check`: what a scene makes of its mesh, before anything is recorded."""

import click

from arm_brachy.cli.output import console, json_option, summary, working, writable
from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.figures import body_of
from arm_brachy.evaluation.scene_plate import scene_plate
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.scene_check import body_row, pad_rows, point_rows


@click.command()
@click.argument('scene', type=click.Path())
@click.option('--picture', type=click.Path(), metavar='FILE.png', callback=writable,
              help='Also draw body, pads and markers from six sides.')
@json_option
def check(scene, picture, json_file):
    """Say what a SCENE makes of its mesh: size, base, pads, markers.

    Compare it with the rig: `base_normal` points from what is held into the body (none: that is
    held from opposite sides, or all around), a pad covers nearly 100 % of its disc (its nodes'
    polygon is a little smaller; much less, and the pad is beside the body or the mesh too coarse),
    none of a pad's set is inside, a marker sits on the surface, a target is inside it (< 0). A
    mesh that cuts a rim is made anew by `arm-brachy mesh --scene`.

    \b
    Example:
      arm-brachy check config/scenes/breast.yaml --picture breast.png
    """
    if picture and picture.suffix.lower() != '.png':
        raise InputError(f'{picture}: --picture writes PNG; name a file that ends on .png')
    described = load_scene(scene)
    with working(f'reading {scene}'):
        body = build_body(described)
        rows = [body_row(body), *pad_rows(described, body), *point_rows(described, body)]
    result = summary(described.name, rows)
    result.table(console)   # not `show`: body, pads and points have columns of their own
    if json_file:
        result.to_json(json_file)
    if picture:
        scene_plate(body_of(described, body.mesh)).save(picture)
        console.print(f'picture  {picture}', highlight=False)
