"""A small C3D writer for tests: every processor, integers and floats, and what writers get wrong.

Source: The C3D File Format, User Guide, Motion Lab Systems 2021.
"""

import struct

import numpy as np

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86


class Writer:
    """Bytes of numbers as one processor keeps them."""

    def __init__(self, processor=INTEL):
        self.processor = processor
        self.order = '>' if processor == MIPS else '<'

    def integers(self, values):
        return np.asarray(values).astype(np.int64).astype(self.order + 'u2').tobytes()

    def floats(self, values):
        values = np.asarray(values, dtype=np.float32)
        if self.processor != DEC:
            return values.astype(self.order + 'f4').tobytes()
        words = (values * np.float32(4.0)).astype('<f4').view('<u2').reshape(-1, 2)
        return np.ascontiguousarray(words[:, ::-1]).tobytes()

    def parameter(self, group, name, kind, shape, data):
        body = struct.pack('<bB', kind, len(shape)) + bytes(shape) + data + b'\0'
        head = bytes([len(name), group]) + name.encode()
        return head + self.integers([len(body) + 2]) + body

    def group(self, number, name):
        return bytes([len(name), 256 - number]) + name.encode() + self.integers([3]) + b'\0'

    def texts(self, group, name, values):
        width = max([len(v.encode('latin-1')) for v in values] + [1])
        data = b''.join(v.encode('latin-1').ljust(width) for v in values)
        return self.parameter(group, name, -1, [width, len(values)], data)


def write_c3d(path, points, labels, *, processor=INTEL, scale=-1.0, residual=None, unit='mm',
              rate=100.0, analog=0, declared=None, header_points=None, frames=None, more=()):
    """Write points (n, k, 3) [unit] and return the path.

    scale : negative = floats, else the step of integers;  residual : (n, k), negative = not seen
    analog : values behind each frame, in the header;  declared : the same in ANALOG:USED, or None
    header_points, frames : what the header and POINT:FRAMES say, where it is not the truth
    more : (name, kind, shape, bytes) of further parameters of POINT
    """
    w, (n, k, _) = Writer(processor), points.shape
    residual = np.zeros((n, k)) if residual is None else residual
    frames = n if frames is None else frames

    def section(start):
        records = [
            w.group(1, 'POINT'), w.parameter(1, 'USED', 2, [], w.integers([k])),
            w.parameter(1, 'FRAMES', 2, [], w.integers([min(frames, 65535)])),
            w.parameter(1, 'DATA_START', 2, [], w.integers([start])),
            w.parameter(1, 'SCALE', 4, [], w.floats([scale])),
            w.parameter(1, 'RATE', 4, [], w.floats([rate])), w.texts(1, 'LABELS', labels),
            w.texts(1, 'UNITS', [unit]), *(w.parameter(1, *one) for one in more)]
        if declared is not None:
            records += [w.group(2, 'ANALOG'),
                        w.parameter(2, 'USED', 2, [], w.integers([declared]))]
        return b''.join(records) + b'\0\0'

    blocks = -(-(4 + len(section(0))) // BLOCK)
    start = 2 + blocks
    parameters = (bytes([1, 0x50, blocks, processor]) + section(start)).ljust(blocks * BLOCK,
                                                                             b'\0')
    head = (bytes([2, 0x50])
            + w.integers([k if header_points is None else header_points, analog, 1,
                          min(n, 65535), 10]) + w.floats([scale])
            + w.integers([start, 1 if analog else 0]) + w.floats([rate]))
    rows = np.zeros((n, 4 * k + analog))
    places = rows[:, :4 * k].reshape(n, k, 4)
    places[..., :3] = points / (scale if scale > 0.0 else 1.0)
    places[..., 3] = np.where(residual < 0, -1, residual)
    rows[:, 4 * k:] = 154.0
    data = w.floats(rows) if scale < 0.0 else w.integers(np.rint(rows))
    path.write_bytes(head.ljust(BLOCK, b'\0') + parameters
                     + data.ljust(-(-len(data) // BLOCK) * BLOCK, b'\0'))
    return path
