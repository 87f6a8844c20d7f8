"""What `arm-brachy mesh` does: a surface file in, a mesh file out.

Test: test_meshing.py, test_refinement.py
"""

from arm_brachy.tissue.disc_meshing import mesh_with_discs
from arm_brachy.tissue.formats.writing import format_of, write_mesh
from arm_brachy.tissue.meshing import mesh_surface, report_of
from arm_brachy.tissue.surface import read_surface


def mesh_command(surface, output, *, edge_length_mm, unit='mm', patches=()):
    """Mesh a surface file into a mesh file; what `arm-brachy mesh` prints.

    surface : path of the surface;  output : path to write, format by its extension (`FORMATS`)
    edge_length_mm : wished for;  unit : 'm' or 'mm', of the surface file
    patches : core.scene.PadPatch whose rims are to be edges
    Returns the rows of the quality table; the mesh file is in metres. Raises MeshError.
    """
    format_of(output)
    edge = edge_length_mm * 1e-3
    if patches:
        body, repairs = read_surface(surface, unit=unit)
        mesh = mesh_with_discs(body, patches, edge_length=edge, unit='m')
        report = report_of(body, mesh, edge, repairs)
    else:
        mesh, report = mesh_surface(surface, edge_length=edge, unit=unit)
    write_mesh(output, mesh)
    return {'surface': str(surface), 'mesh': str(output)} | report.rows()
