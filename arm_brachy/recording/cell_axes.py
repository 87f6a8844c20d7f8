"""The axes of load cells, as a column map names them, in those of the scene.

Test: recording/test_import_csv.py
"""

import numpy as np

from arm_brachy.core.errors import ConfigError, RecordingError

SQUARE = 0.02   # cosine: a degree off, axes as people write them down


def force_vectors(options, table, measured):
    """Return (names, forces (n, k, 3)) of csv_map.Forces in the axes of the scene, as counted.

    measured : (names, cells (n, k, c)) -> cells with NaN for what is no measurement
    Cells of one axis give vectors along it, those of three are turned as they are mounted.
    Raises RecordingError for a mounting of a cell that the file does not have.
    """
    if options.directions:
        return _along_one_axis(options, table, measured)
    names, read = table.columns(options.columns, options.names, options.axes)
    read = measured(names, read)
    strange = [name for name in options.mounted if name not in names]
    if strange:
        raise RecordingError(f'{table.path}: has the cells {", ".join(names)}; `mounted` has '
                             f'{", ".join(strange)} as well: it must name some of these')
    turns = [axes_of(*options.mounted[name]) if name in options.mounted else np.eye(3)
             for name in names]
    return names, np.einsum('nkj,kji->nki', read, np.array(turns))


def check_axes(where, options, by_axis):
    """Refuse directions and mountings that are none, with a ConfigError.

    by_axis : True if the pattern of the columns has an {axis}, which cells of one axis have not
    """
    _check_directions(where, options, by_axis)
    check_mounting(where, options.mounted, () if options.directions else options.names or None)


def check_mounting(where, mounted, names):
    """Refuse, with a ConfigError, mountings that are none, or of cells not in names (None = any).
    """
    for name, (x, z) in mounted.items():
        if names is not None and name not in names:
            raise ConfigError(f'{where}.mounted: has {name}; must be a three-axis cell of this '
                              'section, without `directions`')
        size = np.linalg.norm(x) * np.linalg.norm(z)
        if not abs(np.dot(x, z)) <= SQUARE * size or size == 0.0:
            raise ConfigError(f'{where}.mounted.{name} = {[list(x), list(z)]}; must be two '
                              'directions at right angles: where x and z of the cell point')


def _along_one_axis(options, table, measured):
    names = options.names or {name: name for name in options.directions}
    names, read = table.columns(options.columns, names)
    read = measured(names, read)
    ways = np.array([options.directions[name] for name in names])
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return names, read * ways


def axes_of(x, z):
    """Unit vectors (3, 3), a row each, along x, y and z of a right-handed cell; z as it is."""
    z = np.array(z) / np.linalg.norm(z)
    x = np.array(x) - np.dot(x, z) * z
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _check_directions(where, options, by_axis):
    """A cell of one axis has a direction and no columns by axis; others the other way round."""
    ways = options.directions
    if bool(ways) == by_axis:
        raise ConfigError(
            f'{where}.columns = {options.columns!r}; must hold {{axis}}, or have `directions` for '
            'load cells of one axis, and not both')
    for key, here, there in (('directions', ways, options.names), ('names', options.names, ways)):
        lacking = sorted(set(there) - set(here))
        if ways and options.names and lacking:
            raise ConfigError(f'{where}.{key}: lacks {", ".join(lacking)}; must have every pad of '
                              'this section, in `names` and in `directions`')
    for name, way in ways.items():
        if not np.linalg.norm(way) > 0.0:
            raise ConfigError(f'{where}.directions.{name} = {list(way)}; must be a direction')
