"""The CSV files that a laboratory hands over, one a device, and the column map that reads them.

Test: experiments/gel_block/test_recorder.py, experiments/half_cylinder/test_recorder.py
"""

from dataclasses import dataclass

import numpy as np
from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.recording.csv_map import ColumnMap, CsvFile, Encoders, Forces, Optical, Tools

ENCODERS, OPTICAL, FORCES, EM = 'encoders', 'optical', 'forces', 'em'
MM = 1e-3
# Device -> its entry of a column map.
KINDS = {ENCODERS: (Encoders, {'unit': 'mm'}), OPTICAL: (Optical, {'unit': 'mm'}),
         FORCES: (Forces, {'sign': 'on_tool'}), EM: (Tools, {'unit': 'mm'})}


@dataclass(frozen=True)
class Recorded:
    """One device's file: names (k,), stamps (t,) [s], values (t, k) or (t, k, 3), SI.

    What was not seen is NaN.
    """

    names: tuple
    stamps: np.ndarray
    values: np.ndarray


def write_recording(recorded, folder, name, formats):
    """Write DEVICE.csv of every device and their column map, columns.yaml; returns its path.

    recorded : device (of KINDS) -> Recorded;  folder : made if it is not there
    name : of the recording;  formats : device -> pattern of its columns, digits of its cells;
        positions are in mm, forces in N
    """
    folder.mkdir(parents=True, exist_ok=True)
    for device, one in recorded.items():
        _write_csv(folder / f'{device}.csv', one, *formats[device],
                   unit=1.0 if device == FORCES else MM)
    path, yaml = folder / 'columns.yaml', YAML()
    with path.open('w', encoding='utf-8') as file:
        yaml.dump(config.to_mapping(_columns(recorded, name, formats)), file)
    return path


def _write_csv(path, one, pattern, digits, *, unit):
    axes = 'xyz' if one.values.ndim == 3 else ('',)
    header = [pattern.format(key=key, axis=axis) for key in one.names for axis in axes]
    values = one.values.reshape(len(one.stamps), -1) / unit
    with path.open('w', encoding='utf-8') as file:
        file.write(','.join(['t_s', *header]) + '\n')
        for t, row in zip(one.stamps, values, strict=True):
            cells = ('' if np.isnan(value) else digits % value for value in row)
            file.write(','.join([f'{t:.6f}', *cells]) + '\n')


def _columns(recorded, name, formats):
    """The csv_map.ColumnMap of a recording; names are those of the scene."""
    def given(kind, device, **more):
        return (kind(CsvFile(f'{device}.csv', time='t_s'), formats[device][0],
                     names={key: key for key in recorded[device].names}, **more),)

    return ColumnMap(name, **{device: given(kind, device, **more)
                              for device, (kind, more) in KINDS.items() if device in recorded})
