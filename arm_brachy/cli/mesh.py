"""`arm-brachy mesh`: a surface to a mesh that a scene can name."""

from pathlib import Path

import click

from arm_brachy.cli.output import json_option, show, summary, working
from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import load_scene
from arm_brachy.tissue.mesh_command import mesh_command


@click.command()
@click.argument('surface', type=click.Path())
@click.argument('output', type=click.Path())
@click.option('--edge-length-mm', required=True, type=float, help='Edge length wished for.')
@click.option('--unit', default='mm', type=click.Choice(['mm', 'm']), show_default=True,
              help='Of the surface file; the mesh is in m.')
@click.option('--scene', type=click.Path(), metavar='FILE',
              help='Scene whose pads the mesh is for: their rims become edges.')
@json_option
def mesh(surface, output, edge_length_mm, unit, scene, json_file):
    """Fill a closed SURFACE with tetrahedra.

    SURFACE is an STL, OBJ, PLY or OFF file, OUTPUT one that holds tetrahedra: .msh, .vtu, .vtk,
    .xdmf, .inp, .mesh or .npz.
    A second call gives another mesh of equal quality, so a mesh is never overwritten.

    A mesh that cuts across the rim of a pad holds another disc than the pad's: pushes are then off
    by some percent. With --scene it does not; the scene may name OUTPUT before it is there.

    Qualities are mean ratios, 1 of a regular element and 0 of a flat one. Edges shorter than
    wished for are those of rims and of a curved surface, which is cut by surface_distance at most.
    What results are wrong by with this mesh, `diagnose` finds out itself.

    \b
    Example:
      arm-brachy mesh config/scenes/breast/breast.stl breast.msh \\
        --edge-length-mm 12 --scene config/scenes/breast.yaml
    """
    if Path(output).exists():
        raise InputError(f'{output}: exists; name another file')
    patches = load_scene(scene).pads if scene else ()
    if scene and not patches:
        raise InputError(f'{scene}: pads = none; must be one at least for --scene; leave it out')
    with working(f'meshing {surface}'):
        figures = mesh_command(surface, output, edge_length_mm=edge_length_mm, unit=unit,
                               patches=patches)
    show(summary('mesh', [figures]), json_file)
