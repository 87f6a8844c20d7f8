"""A campaign against the cell: forged and faulty commands, deaths of nodes, hostile files.

Three parts, all from one seed. Faults to orders, at wall pace, with driver and supervisor over
DDS (`control.faults`). Whole cells in lockstep, of which a node is killed or stopped at a random
moment. Damaged CSV files and column maps (`import_fuzz`). The invariants are the Targets.
Test: experiments/test_abuse.py
"""

import json
import os
import signal
import subprocess
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from arm_brachy import graph, launcher
from arm_brachy.control.faults import Bounds, Kind
from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.random import stream
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import import_fuzz
from arm_brachy.recording.reader import CellBag
from arm_brachy.recording.recover import recover
from arm_brachy.scenario import load_cell

NAME = 'abuse'
SEED = 1
FAULTS = 1000
CELLS = 10
FILES = 10_000
SCENARIO = 'target_1.yaml'
LOSS_S = 0.25           # of a recording that was killed
BEGIN_S, SPAN_S = 0.5, 2.0     # simulated time at which a node of a cell dies


def reproduce(out_dir, faults=FAULTS, cells=CELLS, files=FILES, seed=SEED, say=lambda text: None):
    """Return the Result of a campaign.

    out_dir : receives logs and bags of the cells
    faults, cells, files : how many of each part;  say : called with a line now and then
    """
    rows = _faults(faults, seed, say) if faults else []
    deaths = [_death(Path(out_dir) / f'cell_{k}', k, seed, say) for k in range(cells)]
    fuzz = import_fuzz.reproduce(out_dir, mutants=files, seed=seed) if files else None
    targets = [*_fault_targets(rows, faults), *_death_targets(deaths),
               *(fuzz.targets if fuzz else ())]
    table = [*_by_kind(rows), *deaths, *(fuzz.rows if fuzz else ())]
    return Result(NAME, seed, commit_of(share_dir()), machine_description(), tuple(table),
                  tuple(targets))


def _faults(n, seed, say):
    """What came of each fault, as the bench has it."""
    with tempfile.TemporaryDirectory() as scratch, launcher.Domain() as domain:
        bench = launcher.NodeProcess('abuse_bench', {
            'scenario': str(config_dir() / 'scenarios' / SCENARIO),
            'key_file': f'{scratch}/bag.key', 'faults': float(n), 'seed': float(seed)})
        environment = {**os.environ, **launcher.node_environment(), 'ROS_DOMAIN_ID': str(domain),
                       'ROS_LOG_DIR': scratch}
        log = Path(scratch) / 'log'
        with log.open('w') as errors, subprocess.Popen(
                bench.argv(), stdout=subprocess.PIPE, stderr=errors, text=True,
                env=environment) as process:
            rows = []
            for line in process.stdout:
                rows.append(json.loads(line))
                say(f'fault {len(rows)} of {n}: {Kind[rows[-1]["kind"]].value}')
        if process.returncode != 0:
            last = log.read_text(errors='replace').strip().splitlines()[-1:]
            raise ArmBrachyError(f'the bench ended with status {process.returncode} after '
                                 f'{len(rows)} of {n} faults: {" ".join(last)}')
    return rows


def _by_kind(rows):
    kinds = defaultdict(list)
    for row in rows:
        kinds[row['kind']].append(row)
    return [{'kind': Kind[kind].value, 'faults': len(some),
             'violations': sum(r['violated'] for r in some),
             'overshoot_mm': max(r['overshoot_mm'] for r in some),
             'rest_s': max(r['rest_s'] for r in some),
             'not_recovered': sum(not r['recovered'] for r in some)}
            for kind, some in sorted(kinds.items())]


def _fault_targets(rows, n):
    if not n:
        return []
    bounds, worst = Bounds(), max((r['overshoot_mm'] for r in rows), default=np.inf)
    bad = sum(r['violated'] for r in rows)
    lost = n - sum(r['recovered'] for r in rows)
    return [Target('faults that moved a pad out of its range or late', bad, '', '= 0', bad == 0),
            Target('way of a pad outside its range', worst, 'mm',
                   f'<= {1e3 * bounds.overshoot:g}', worst <= 1e3 * bounds.overshoot),
            Target('faults after which the cell did not run again', lost, '', '= 0', lost == 0)]


def _death(folder, k, seed, say):
    """Kill or stop a node of a cell in lockstep; returns what came of it."""
    rng = stream(seed, f'{NAME}/{k}')
    cell = load_cell(config_dir() / 'scenarios' / SCENARIO)
    names = [n for n in graph.cell_of(cell.scenario, cell.scene.pads)]
    victim, when = str(rng.choice(names)), BEGIN_S + SPAN_S * rng.random()
    number = signal.SIGKILL if rng.random() < 0.5 else signal.SIGSTOP
    say(f'cell {k}: {number.name} to {victim} at {when:.1f} s')
    struck = []

    def strike(name, values):
        if not struck and values.get('t', 0.0) >= when:
            struck.append((values['t'], time.monotonic()))
            os.kill(runner.pid_of(victim), number)

    runner = launcher.Launcher(
        launcher.cell_processes(cell, cell.path, folder / 'bag', speed_limit=1.0),
        graph.CELL_CLOCK.name, folder / 'logs', strike)
    try:
        runner.run()
        said = ''
    except ArmBrachyError as error:
        said = str(error)
    t, wall = struck[0] if struck else (np.nan, np.nan)
    return {'kind': f'{number.name} {victim}', 't_s': round(t, 2),
            'named': victim in said, 'noticed_s': round(time.monotonic() - wall, 1),
            'lost_s': _lost(folder, t), 'left': len(runner.alive())}


def _lost(folder, t):
    """Seconds before the death that the recording does not hold."""
    recover(folder / 'bag', folder / 'mended')
    with CellBag(folder / 'mended') as bag:
        return round(max(0.0, t - bag.span_ns[1] * 1e-9), 3)


def _death_targets(deaths):
    if not deaths:
        return []
    silent = sum(not d['named'] for d in deaths)
    lost, left = max(d['lost_s'] for d in deaths), sum(d['left'] for d in deaths)
    return [Target('deaths that nobody named', silent, '', '= 0', silent == 0),
            Target('recording lost', lost, 's', f'<= {LOSS_S:g}', lost <= LOSS_S + 1e-9),
            Target('processes left', left, '', '= 0', left == 0)]
