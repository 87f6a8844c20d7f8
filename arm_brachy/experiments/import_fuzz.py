"""Damaged CSV files and column maps given to `import csv`: right, or refused in one line.

2000 mutants from one seed: of a plain table, of exports of five instruments, and of their column
maps. Bytes are changed, taken out, doubled; cells become other numbers and words; lines are
exchanged and cut. Each has to end within LIMIT with a bag or an error of this package on one line.
Of plain tables every value in the bag is compared with a second reader, the csv module and
float(), which knows nothing of this one.
"""

import csv
import io
import resource
import shutil
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import share_dir
from arm_brachy.core.random import stream
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.recording.csv_presets import preset_map
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.reader import BagReader

NAME = 'import-fuzz'
SEED = 1
MUTANTS = 2000
LIMIT = 2.0         # s of processor time for one mutant
ASLEEP = 100        # s of the clock, of a loaded machine
LARGEST = 1.0       # GB of memory of the whole process
ROWS = 40
CELLS = (b'nan', b'', b'inf', b'1e400', b'-3.697314E28', b'1,5', b'0x10', b'1_0', b'lost', b'"',
         b'-9999', b'0', b'1e-320', b' 7 ', b'\xfc', b'\x00', b'--1', b'1.2.3')
MAP = """\
name: plain
optical:
  - csv: {path: FILE, time: t}
    columns: '{key}_{axis}'
    unit: mm
"""


def reproduce(out_dir, mutants=MUTANTS, seed=SEED):
    """Return the Result: mutants, how they ended, and the slowest, by kind of file.

    out_dir : receives nothing but the result that the command writes
    """
    rng, rows, silent, other = stream(seed, NAME), [], 0, []
    bases = _bases()
    kinds = sorted(bases)
    counts = {kind: Counter() for kind in kinds}
    slowest = dict.fromkeys(kinds, 0.0)
    with tempfile.TemporaryDirectory() as scratch:
        for i in range(mutants):
            kind = kinds[i % len(kinds)]
            outcome, seconds, changed = _try(Path(scratch), kind, *bases[kind], rng)
            counts[kind][outcome] += 1
            slowest[kind] = max(slowest[kind], seconds)
            silent += changed
            if outcome not in ('bag', 'refused'):
                other.append(f'{kind} {i}: {outcome}')
    for kind in kinds:
        rows.append({'kind': kind, 'mutants': sum(counts[kind].values()),
                     'bags': counts[kind]['bag'], 'refused': counts[kind]['refused'],
                     'slowest_s': round(slowest[kind], 2)})
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0**2
    targets = (Target(f'crashes or longer than {LIMIT:g} s', len(other), '', '= 0', not other),
               Target('values changed in silence', silent, '', '= 0', silent == 0),
               Target('memory', round(memory, 3), 'GB', '< 1', memory < LARGEST))
    rows += [{'kind': line} for line in other[:20]]
    return Result(NAME, seed, commit_of(share_dir()), machine_description(), tuple(rows), targets)


def _bases():
    """kind -> (bytes of a file, its name, text of a column map)."""
    t = np.arange(ROWS) * 0.01
    x = 10.0 + np.sin(t)
    plain = ['t,m1_x,m1_y,m1_z,m2_x,m2_y,m2_z'] + [
        f'{a:.2f},{b:.4f},2.5,3,20,{5 + 0.1 * a:.4f},6' for a, b in zip(t, x, strict=True)]
    points = [f'{b:.4f},2.5,3,20,5,6' for b in x]
    motive = ['Format Version,1.23,Take Name,T,Export Frame Rate,100.0,Length Units,Millimeters',
              '', ',Type' + ',Marker' * 6, ',Name,g:m1,g:m1,g:m1,g:m2,g:m2,g:m2',
              ',ID' + ',A' * 6, ',' + ',Position' * 6, 'Frame,Time (Seconds),X,Y,Z,X,Y,Z']
    motive += [f'{i},{a:.2f},{p}' for i, (a, p) in enumerate(zip(t, points, strict=True))]
    nexus = ['Trajectories', '100', ',,g:m1,,,g:m2,,', 'Frame,Sub Frame,X,Y,Z,X,Y,Z',
             ',,mm,mm,mm,mm,mm,mm'] + [f'{i + 1},0,{p}' for i, p in enumerate(points)]
    qtm = ['FREQUENCY\t100', 'MARKER_NAMES\tm1\tm2', 'Frame\tTime\tm1 X\tm1 Y\tm1 Z\tm2 X\tm2 Y'
           '\tm2 Z\t'] + [f'{i + 1}\t{a:.2f}\t' + p.replace(',', '\t')
                          for i, (a, p) in enumerate(zip(t, points, strict=True))]
    own = 'Frame,Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error,Markers'
    ndi = [f'Tools,Port 1: a  s/n:1,{own},Port 2: b  s/n:2,{own}'] + [
        f'2,Port 1: a,{i},0,OK,1,0,0,0,{b:.4f},2,3,0.1,0,Port 2: b,{i},0,OK,1,0,0,0,20,2,3,0.1,0'
        for i, b in enumerate(x)]
    ati = ['Start Time: 5/3/24', 'RDT Sample Rate: 100', 'Force Units: N',
           'Counts per Unit Force: 1000', 'Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz']
    ati += [f'0x00,{i + 1},{i},{round(1e3 * b)},5,6' for i, b in enumerate(x)]
    out = {'plain table': (_bytes(plain), 'plain.csv', MAP.replace('FILE', 'plain.csv'))}
    for preset, lines, rate in (('motive', motive, 0.0), ('nexus', nexus, 0.0),
                                ('qualisys', qtm, 0.0), ('ndi', ndi, 60.0), ('ati', ati, 0.0)):
        data = _bytes(lines)
        out[preset] = data, f'{preset}.csv', _map_of(preset, data, rate)
    out['column map'] = _bytes(plain), 'plain.csv', out['plain table'][2]
    return out


def _bytes(lines):
    return ('\r\n'.join(lines) + '\r\n').encode()


def _map_of(preset, data, rate):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f'{preset}.csv'
        file.write_bytes(data)
        text = io.StringIO()
        YAML().dump(preset_map(preset, [str(file)], rate=rate), text)
    return text.getvalue().replace(str(file), file.name)


def _try(scratch, kind, data, name, column_map, rng):
    """(how it ended, seconds, values changed) of one mutant."""
    for part in scratch.iterdir():
        shutil.rmtree(part) if part.is_dir() else part.unlink()
    text = column_map.encode()
    if kind == 'column map':
        text = _mutant(text, rng)
    else:
        data = _mutant(data, rng)
    (scratch / name).write_bytes(data)
    (scratch / 'map.yaml').write_bytes(text)
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _too_long)
    signal.alarm(ASLEEP)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    begin, changed = time.process_time(), 0
    try:
        import_csv(scratch / 'map.yaml', scratch / 'bag')
        outcome = 'bag'
    except ArmBrachyError as error:
        outcome = 'refused' if '\n' not in str(error) else f'several lines: {str(error)[:100]!r}'
    except _TooLong:
        outcome = f'longer than {LIMIT:g} s'
    # A study of crashes: whatever else is raised is what it is there to find.
    except Exception as error:  # noqa: BLE001
        outcome = f'{type(error).__name__}: {str(error)[:100]!r}'
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.alarm(0)
    seconds = time.process_time() - begin
    if outcome == 'bag' and kind == 'plain table':
        changed = _changed(scratch, data)
    return outcome, seconds, changed


class _TooLong(BaseException):
    """No exception that a reader's guard would take for damage of the file."""


def _too_long(*_):
    raise _TooLong


def _mutant(data, rng):
    """One change of bytes, cells or lines, or two; changes of a cell are the most frequent."""
    for _ in range(int(rng.integers(1, 3))):
        at, end = sorted(int(i) for i in rng.integers(0, len(data) + 1, 2))
        end = min(end, at + 60)
        lines = data.split(b'\r\n')
        i, j = (int(k) for k in rng.integers(0, len(lines), 2))
        change = int(rng.integers(0, 14))
        if change == 0 and at < len(data):
            data = data[:at] + bytes([int(rng.integers(0, 256))]) + data[at + 1:]
        elif change == 1:
            data = data[:at] + data[end:]
        elif change == 2:
            data = data[:end] + data[at:end] + data[end:]
        elif change == 3:
            data = data[:max(at, 1)]
        elif change == 4:
            lines[i], lines[j] = lines[j], lines[i]
            data = b'\r\n'.join(lines)
        elif change == 5:
            data = b'\r\n'.join(lines).replace(b',', (b';', b'\t', b',,')[j % 3])
        else:
            cells = lines[i].split(b',')
            cells[j % len(cells)] = CELLS[int(rng.integers(0, len(CELLS)))]
            lines[i] = b','.join(cells)
            data = b'\r\n'.join(lines)
    return data


def _changed(scratch, data):
    """Values of the bag that a second reader does not find in the file at that time."""
    rows = list(csv.DictReader(io.StringIO(data.decode('utf-8-sig'), newline='')))
    there = {}
    for row in rows:
        try:
            there.setdefault(round(float(row['t']) * 1e9), row)
        except (TypeError, ValueError, OverflowError, KeyError):
            continue
    changed = 0
    with BagReader(scratch / 'bag') as bag:
        frames = [m for _, m in bag.messages(['/optical/markers'])]
    shift = 0
    if there:
        shift = frames[0].header.stamp.sec * 10**9 + frames[0].header.stamp.nanosec - min(there)
        shift = shift if shift % 10**9 == 0 else 0
    for frame in frames:
        t = frame.header.stamp.sec * 10**9 + frame.header.stamp.nanosec - shift
        row = there.get(t, {})
        for name, point in zip(frame.ids, frame.points, strict=True):
            for axis in 'xyz':
                value = getattr(point, axis)
                if np.isfinite(value):
                    changed += not _same(row.get(f'{name}_{axis}'), value)
    return changed


def _same(cell, value):
    try:
        return abs(float(cell) * 1e-3 - value) <= 1e-12 * max(1.0, abs(value))
    except (TypeError, ValueError):
        return False
