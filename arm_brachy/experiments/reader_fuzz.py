"""Damaged files: every reader of foreign files ends right or in one line, soon and small.

    python -m arm_brachy.experiments.reader_fuzz --seed 1 --mutants 2000 \
        --out results/reader-fuzz.json

Each mutant is a sound file with one to three small damages (bytes, slices, numbers, lines), drawn
by seed, kind and number. Mutants are read in forked processes, 50 in each; where there is a second
reader, that reads them in others, and what both read is compared. Of
those not alike, `as_sound` are ours of the sound file, `told` go with a note, and
`differs` is what must not be.
A kind of file is one entry of KINDS.
"""

import argparse
import gc
import json
import os
import pickle
import re
import resource
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import ezc3d
import meshio
import numpy as np
import trimesh
import yaml
from rosbags.rosbag2.storage_mcap import McapReader
from ruamel.yaml.comments import TaggedScalar

from arm_brachy.core import config
from arm_brachy.core.errors import InputError
from arm_brachy.core.guard import decoded
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.recording import encode
from arm_brachy.recording.import_c3d import read_c3d
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.recover import recover
from arm_brachy.recording.writer import BagWriter
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.mesh import load_mesh
from arm_brachy.tissue.surface import read_surface

NAME = 'reader-fuzz'
SEED = 1
MUTANTS = 2000                        # of each kind
LONGEST_S, LARGEST_MB = 2.0, 1000.0   # processor time, resident
BATCH = 50                            # mutants a process reads
LIMIT_MB = 4000                      # of the second readers' address space: one of them is greedy
HEAD_SHARE, HEAD = 0.5, 1500         # so many damages fall into the first bytes, where counts are
WORDS = (b'-1', b'0', b'99999999999', b'1e308', b'nan', b'', b'x', b'4294967295', b'-0.5')


@dataclass(frozen=True)
class Kind:
    """One kind of file.

    suffix : of the files;  seeds : folder -> sound files as bytes, made there
    ours : path -> values, raising InputError in one line;  theirs : path -> values, or None
    """

    suffix: str
    seeds: Callable
    ours: Callable
    theirs: Callable | None = None


def damaged(data, rng):
    """Bytes with one to three damages."""
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        data = _damage(data, rng)
    return data


def _damage(data, rng):
    if not data:
        return b'\0'
    reach = min(HEAD, len(data)) if rng.random() < HEAD_SHARE else len(data)
    at, length = int(rng.integers(reach)), int(rng.geometric(0.05))
    kind = rng.choice(['byte', 'bit', 'word', 'cut', 'drop', 'double', 'insert', 'number', 'line'],
                      p=[0.25, 0.15, 0.1, 0.05, 0.1, 0.05, 0.05, 0.2, 0.05])
    if kind in ('byte', 'bit'):
        new = int(rng.integers(256)) if kind == 'byte' else data[at] ^ (1 << int(rng.integers(8)))
        return data[:at] + bytes([new]) + data[at + 1:]
    if kind == 'word':
        word = int(rng.choice([0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1]))
        return data[:at] + word.to_bytes(4, 'little') + data[at + 4:]
    if kind == 'cut':
        return data[:at]
    if kind == 'drop':
        return data[:at] + data[at + length:]
    if kind == 'double':
        return data[:at] + data[at:at + length] + data[at:]
    if kind == 'insert':
        return data[:at] + rng.bytes(length) + data[at:]
    separator = b'\n' if kind == 'line' else b' '
    parts = data.split(separator)
    i, j = rng.integers(len(parts), size=2)
    if kind == 'line':
        parts[i], parts[j] = parts[j], parts[i]
    else:
        parts[i] = WORDS[rng.integers(len(WORDS))]
    return separator.join(parts)


@dataclass(frozen=True)
class Reading:
    """What came of one reading. status : 'read', 'refused', 'crash' or 'hang'."""

    status: str
    value: object
    seconds: float
    peak_mb: float


def read_apart(reader, files, limit_mb=None):
    """Yield the Reading of each file, in order, in forked processes of BATCH files each.

    files : functions that write one and return its path. One that kills its process is a crash or
    a hang, and the next file gets a new process.
    """
    at = 0
    while at < len(files):
        inside, outside = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(inside)
            try:
                _in_child(reader, files[at:at + BATCH], outside, limit_mb)
            finally:
                os._exit(1)
        os.close(outside)
        done = 0
        with os.fdopen(inside, 'rb') as stream:
            while (length := stream.read(8)):
                done += 1
                yield Reading(*pickle.loads(stream.read(int.from_bytes(length, 'little'))))
        _, status, usage = os.wait4(child, 0)
        at += done
        if status:
            killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
            yield Reading('hang' if killed == signal.SIGALRM else 'crash', f'status {status}',
                          LONGEST_S, usage.ru_maxrss / 1024.0)
            at += 1


def _in_child(reader, files, outside, limit_mb):
    """Read and tell, then leave the process."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    if limit_mb:
        resource.setrlimit(resource.RLIMIT_AS, (limit_mb * 2**20,) * 2)
    with os.fdopen(outside, 'wb') as stream:
        for write in files:
            path, start = write(), time.process_time()
            signal.alarm(int(50 * LONGEST_S))      # of a loaded machine
            told = _told(reader, path)
            signal.alarm(0)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            data = pickle.dumps((*told, time.process_time() - start, peak))
            stream.write(len(data).to_bytes(8, 'little') + data)
            stream.flush()
    os._exit(0)


def _told(reader, path):
    """(status, value) of a reading."""
    try:
        return 'read', reader(path)
    except InputError as error:
        return ('refused', str(error)) if '\n' not in str(error) else ('crash', repr(error))
    except BaseException:  # noqa: BLE001  a traceback is what is looked for here
        return 'crash', traceback.format_exc()[-1500:]


def same(ours, theirs):
    """True if all that the second reader has is in ours, alike; NaN in ours is left out."""
    if isinstance(theirs, list):
        return isinstance(ours, list) and len(ours) == len(theirs) and all(map(same, ours, theirs))
    if isinstance(theirs, dict):
        return isinstance(ours, dict) and all(k in ours and same(ours[k], v)
                                              for k, v in theirs.items())
    if isinstance(theirs, np.ndarray):
        if np.shape(ours) != theirs.shape:
            return False
        left_out = np.isnan(ours) if theirs.dtype.kind == 'f' else np.zeros(theirs.shape, bool)
        return bool(np.array_equal(ours[~left_out], theirs[~left_out]))
    if isinstance(theirs, float):
        return ours == theirs or (ours != ours and theirs != theirs)
    return ours == theirs


def _judged(ours, sound):
    """Of values that the second reader has otherwise: whose fault, or told by a note."""
    if same(ours, sound):
        return 'as_sound'
    return 'told' if isinstance(ours, dict) and ours.get('notes') else 'differs'


def fuzz(name, kind, seed, mutants, folder, keep=None):
    """The row of one kind, and what went wrong: (number, what) each."""
    seeds, start = kind.seeds(folder), time.monotonic()

    def writer(k):
        def write():
            path, data = folder / f'mutant{kind.suffix}', seeds[k % len(seeds)]
            if k < mutants:
                data = damaged(data, np.random.default_rng([seed, *name.encode(), k]))
            path.write_bytes(data)
            return path
        return write

    ours = list(read_apart(kind.ours, [writer(k) for k in range(mutants)]))
    whole = -(-mutants // len(seeds)) * len(seeds)     # from there on, files without damage
    sound = [one.value for one in read_apart(kind.ours, [writer(whole + k)
                                                         for k in range(len(seeds))])]
    again = [k for k, one in enumerate(ours) if one.status == 'read' and kind.theirs is not None]
    theirs = dict(zip(again, read_apart(kind.theirs, [writer(k) for k in again], LIMIT_MB),
                      strict=True))
    counts, wrong = Counter(one.status for one in ours), []
    for k, one in enumerate(ours):
        other = theirs.get(k)
        bad = f'{one.status}: {one.value}' if one.status in ('crash', 'hang') else None
        if one.seconds > LONGEST_S or one.peak_mb > LARGEST_MB:
            bad = f'{one.seconds:.1f} s, {one.peak_mb:.0f} MB'
        if other is not None and other.status == 'read' and not same(one.value, other.value):
            how = _judged(one.value, sound[k % len(seeds)])
            counts[how] += 1
            bad = 'differs from the second reader' if how == 'differs' else bad
        if bad:
            wrong.append((k, bad))
            if keep is not None:
                (keep / f'{name}-{k}{kind.suffix}').write_bytes(writer(k)().read_bytes())
    row = {'kind': name, 'mutants': mutants, **{key: counts[key] for key in (
        'read', 'refused', 'crash', 'hang', 'differs', 'told', 'as_sound')},
        'compared': sum(one.status == 'read' for one in theirs.values()),
        'second_reader_dies': sum(one.status in ('crash', 'hang') for one in theirs.values()),
        'slowest_cpu_s': round(max(one.seconds for one in ours), 2),
        'largest_mb': round(max(one.peak_mb for one in ours)),
        'took_s': round(time.monotonic() - start)}
    return row, wrong


def _sphere():
    return trimesh.creation.icosphere(2, 30.0)


def stl_seeds(_):
    """A binary and a text STL file."""
    text = trimesh.exchange.stl.export_stl_ascii(_sphere())
    return [trimesh.exchange.stl.export_stl(_sphere()), text.encode()]


def stl_ours(path):
    """Corners (m, 3, 3) in mm."""
    surface, notes = read_surface(path)
    return {'volume': round(1e9 * float(surface.volume), 3), 'notes': notes}


def stl_theirs(path):
    """The same by trimesh, with the checks of ours."""
    loaded = trimesh.load(path, force='mesh', process=False)
    surface, _ = read_surface(loaded)
    return {'volume': round(1e9 * float(surface.volume), 3)}


def msh_seeds(folder):
    """MSH 2.2 and 4.1, text and binary."""
    box = box_mesh((60.0, 40.0, 20.0), (4, 3, 2))
    tags = [np.full(len(box.tets), 4, dtype=np.int32)]
    found = []
    for kind, binary in (('gmsh22', False), ('gmsh22', True), ('gmsh', False), ('gmsh', True)):
        raw = meshio.Mesh(box.nodes, [('tetra', box.tets)],
                          cell_data={'gmsh:physical': tags, 'gmsh:geometrical': tags},
                          field_data={'gel': np.array([4, 3])})
        if kind == 'gmsh':
            raw.point_data['gmsh:dim_tags'] = np.tile([3, 4], (len(box.nodes), 1))
        meshio.write(folder / 'seed.msh', raw, file_format=kind, binary=binary)
        found.append((folder / 'seed.msh').read_bytes())
    return found


def msh_ours(path):
    """Nodes [m] and tetrahedra."""
    mesh = load_mesh(path, 'mm')
    return {'nodes': mesh.nodes, 'tets': mesh.tets, 'notes': mesh.notes}


def msh_theirs(path):
    """The same by meshio."""
    mesh = meshio.read(path)
    return {'nodes': np.asarray(mesh.points, float) * 1e-3,
            'tets': mesh.cells_dict['tetra'].astype(np.int64)}


def c3d_seeds(folder):
    """Four points in 60 frames, by ezc3d; with and without analog channels."""
    found = []
    for analogs in (0, 3):
        file = ezc3d.c3d()
        file['parameters']['POINT']['RATE']['value'] = [100.0]
        file['parameters']['POINT']['LABELS']['value'] = ['east', 'west', 'top', 'tip']
        file['parameters']['POINT']['UNITS']['value'] = ['mm']
        data = np.ones((4, 4, 60))
        data[:3] = 20.0 + 10.0 * np.random.default_rng(0).random((3, 4, 60))
        file['data']['points'] = data
        residual = np.zeros((1, 4, 60))
        residual[0, 1, 20:30] = -1.0
        file['data']['meta_points']['residuals'] = residual
        if analogs:
            file['parameters']['ANALOG']['RATE']['value'] = [200.0]
            file['parameters']['ANALOG']['LABELS']['value'] = [f'a{k}' for k in range(analogs)]
            file['data']['analogs'] = np.random.default_rng(1).random((1, analogs, 120))
        file.write(str(folder / 'seed.c3d'))
        found.append((folder / 'seed.c3d').read_bytes())
    return found


def c3d_ours(path):
    """Points [m] of every label that is there, rate."""
    found = read_c3d(path)
    return dict(zip(found.names, np.swapaxes(found.points, 0, 1), strict=True)) | {
        'rate': round(found.rate, 3), 'notes': found.notes}


def c3d_theirs(path):
    """The same by ezc3d, gaps as ours takes them."""
    file = ezc3d.c3d(str(path))
    unit = {'mm': 1e-3, 'm': 1.0}[file['parameters']['POINT']['UNITS']['value'][0]]
    points = np.swapaxes(np.moveaxis(file['data']['points'][:3], 0, -1), 0, 1) * unit
    hidden = (file['data']['meta_points']['residuals'][0] < 0).T
    points[hidden | ~np.isfinite(points).all(axis=2) | (np.abs(points) > 1e3).any(axis=2)] = np.nan
    labels = file['parameters']['POINT']['LABELS']['value']
    return {_label(label): points[:, k] for k, label in enumerate(labels) if label} | {
        'rate': round(float(file['header']['points']['frame_rate']), 3)}


def _label(text):
    data = text.encode(errors='surrogateescape')
    return decoded(data).strip(' \0')


def yaml_seeds(_):
    """The scenes and scenarios that are shipped."""
    return [p.read_bytes() for p in sorted(config_dir().rglob('*.yaml'))
            if p.parent.name in ('scenes', 'scenarios')]


def yaml_ours(path):
    """The file's tree; and the schema of a scene is applied to it."""
    tree = _plain(config.read_yaml(path))
    try:
        load_scene(path)
    except InputError as error:
        if '\n' in str(error):
            raise RuntimeError(error) from None
    return tree


def _plain(tree):
    if isinstance(tree, dict):
        return {str(_plain(key)): _plain(value) for key, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_plain(value) for value in tree]
    if isinstance(tree, TaggedScalar):      # a bare `=`
        return tree.value
    return str(tree) if isinstance(tree, str) else tree


CORE = (  # scalars of YAML 1.2's core schema, section 10.3.2
    (r'null|Null|NULL|~|', lambda text: None), (r'true|True|TRUE', lambda text: True),
    (r'false|False|FALSE', lambda text: False), (r'[-+]?[0-9]+', int),
    (r'0o[0-7]+', lambda text: int(text[2:], 8)), (r'0x[0-9a-fA-F]+', lambda text: int(text, 16)),
    (r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?', float),
    (r'[-+]?\.(inf|Inf|INF)', lambda text: float(text.replace('.', ''))),
    (r'\.(nan|NaN|NAN)', lambda text: float('nan')))


def yaml_theirs(path):
    """The tree by PyYAML's parser, scalars by the core schema of YAML 1.2."""
    return _tree(yaml.compose(path.read_text(encoding='utf-8'), yaml.SafeLoader))


def _tree(node):
    if isinstance(node, yaml.MappingNode):
        return {str(_tree(key)): _tree(value) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [_tree(value) for value in node.value]
    if node.style is None:
        for pattern, read in CORE:
            if re.fullmatch(pattern, node.value):
                return read(node.value)
    return node.value


def mcap_seeds(folder):
    """A bag with two topics, compressed as ours are, and one that is not."""
    encoder, found = encode.Encoder(), []
    for name in ('a', 'b'):
        with BagWriter(folder / name) as bag:
            for topic in ('/x', '/y'):
                bag.add_topic(topic, encode.JOINT_STATE)
            for k in range(30):
                for topic in ('/x', '/y'):
                    bag.write(topic, encoder.joint_state(k, 'w', ['x'], [k / 7.0]), k * 10**7)
        found.append(next((folder / name).glob('*.mcap')).read_bytes())
    return found


def mcap_ours(path):
    """Messages of every topic: (log time, bytes). What `recover` makes of it is read too."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            recover(path, Path(folder) / 'new')
        except InputError:
            pass
    with BagReader(path) as bag:
        bag.attachments()
        bag.metadata()
        found = {'notes': bag.left_out, **{topic: [] for topic in bag.topics()}}
        for record, _ in bag.messages():
            found[record.topic].append((record.log_time_ns, bytes(record.data)))
    return found


def mcap_theirs(path):
    """The same by rosbags."""
    file = McapReader(path)
    file.open()
    found = {}
    for one, at, data in file.messages(file.connections, None, None):
        found.setdefault(one.topic, []).append((at, bytes(data)))
    return found


def inp_seeds(folder):
    """An Abaqus input file by meshio, and one with a part, an assembly and a set."""
    box = box_mesh((60.0, 40.0, 20.0), (4, 3, 2))
    meshio.write(folder / 'seed.inp', meshio.Mesh(box.nodes, [('tetra', box.tets)]))
    rows = [f'{k + 1}, {x!r}, {y!r}, {z!r}' for k, (x, y, z) in enumerate(box.nodes.tolist())]
    tets = [f'{k + 1}, ' + ', '.join(map(str, row)) for k, row in enumerate(box.tets + 1)]
    text = ['*Part, name=P', '*Node', *rows, '*Element, type=C3D4H', *tets,
            '*Nset, nset=A, generate', '1, 9, 2', '*End Part', '*Assembly, name=A',
            '*Instance, name=I, part=P', '1., 2., 3.', '*End Instance', '*End Assembly', '']
    return [(folder / 'seed.inp').read_bytes(), '\n'.join(text).encode()]


def bdf_seeds(folder):
    """Nastran bulk data by meshio, in two layouts."""
    box = box_mesh((60.0, 40.0, 20.0), (4, 3, 2))
    found = []
    for layout in ('fixed-large', 'fixed-small'):
        meshio.nastran.write(folder / 'seed.bdf', meshio.Mesh(box.nodes, [('tetra', box.tets)]),
                             point_format=layout)
        found.append((folder / 'seed.bdf').read_bytes())
    return found


def npz_seeds(folder):
    """Arrays of a mesh."""
    box = box_mesh((60.0, 40.0, 20.0), (4, 3, 2))
    np.savez(folder / 'seed.npz', nodes=box.nodes, tets=box.tets, **box.node_sets)
    return [(folder / 'seed.npz').read_bytes()]


def surface_seeds(kind):
    """A function that makes a sphere in a format of trimesh's."""
    def seeds(_):
        data = _sphere().export(file_type=kind)
        return [data.encode() if isinstance(data, str) else data]
    return seeds


KINDS = {
    'STL': Kind('.stl', stl_seeds, stl_ours, stl_theirs),
    'MSH': Kind('.msh', msh_seeds, msh_ours, msh_theirs),
    'C3D': Kind('.c3d', c3d_seeds, c3d_ours, c3d_theirs),
    'YAML': Kind('.yaml', yaml_seeds, yaml_ours, yaml_theirs),
    'MCAP': Kind('.mcap', mcap_seeds, mcap_ours, mcap_theirs),
    'INP': Kind('.inp', inp_seeds, msh_ours),
    'BDF': Kind('.bdf', bdf_seeds, msh_ours, msh_theirs),
    'NPZ': Kind('.npz', npz_seeds, msh_ours),
    'OBJ': Kind('.obj', surface_seeds('obj'), stl_ours, stl_theirs),
    'PLY': Kind('.ply', surface_seeds('ply'), stl_ours, stl_theirs),
    'OFF': Kind('.off', surface_seeds('off'), stl_ours, stl_theirs),
}


def reproduce(out_dir, mutants=MUTANTS, seed=SEED, kinds=tuple(KINDS), keep=None,
              say=lambda text: None):
    """Return the Result: how the mutants of each kind ended, and which were read otherwise.

    out_dir : receives nothing;  mutants : of each kind;  keep : folder for those that went wrong
    say : called with a line for each kind and for each mutant that went wrong
    """
    gc.freeze()   # or the collector of every child copies what it looks at
    rows = []
    for name in kinds:
        with tempfile.TemporaryDirectory() as folder:
            row, wrong = fuzz(name, KINDS[name], seed, mutants, Path(folder), keep)
        rows.append(row)
        say(json.dumps(row))
        for number, what in wrong:
            say(f'  {name} {number}: {what}')
    gc.unfreeze()
    return Result(NAME, seed, commit_of(share_dir()), machine_description(), tuple(rows),
                  targets_of(rows))


def targets_of(rows):
    """The Targets of rows of `fuzz`."""
    bad = sum(row[key] for row in rows for key in ('crash', 'hang', 'differs'))
    slow = max(row['slowest_cpu_s'] for row in rows)
    large = max(row['largest_mb'] for row in rows)
    return (
        Target('crashes, hangs and differences', bad, '', '0', bad == 0),
        Target('slowest file, processor time', slow, 's', f'<= {LONGEST_S:g}', slow <= LONGEST_S),
        Target('largest process', large, 'MB', f'<= {LARGEST_MB:g}', large <= LARGEST_MB))


def main():
    """Fuzz the kinds named, print rows and write them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, default=SEED)
    parser.add_argument('--mutants', type=int, default=MUTANTS)
    parser.add_argument('--kinds', default=','.join(KINDS))
    parser.add_argument('--out', type=Path)
    parser.add_argument('--keep', type=Path, help='folder for mutants that went wrong')
    given = parser.parse_args()
    result = reproduce(None, given.mutants, given.seed, given.kinds.split(','), given.keep,
                       lambda text: print(text, flush=True))
    if given.out:
        result.to_json(given.out)


if __name__ == '__main__':
    main()
