"""A campaign against the cell: forged and faulty commands, deaths of nodes, hostile files.

Three parts, all from one seed. Faults to pads, needle and probe at wall pace, with drivers and
supervisor over DDS (`control.faults`). Whole cells in lockstep, of which a node is killed or
stopped at a random moment. Damaged files: half are CSV tables and column maps (`import_fuzz`),
half meshes, surfaces, C3D, YAML and MCAP (`reader_fuzz`). The invariants are the Targets.

What is done is kept line by line in the folder of the campaign, and the same campaign begun again
there goes on after it.
Test: experiments/test_abuse.py
"""

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from arm_brachy import graph, launcher
from arm_brachy.control.faults import OF_THE_NEEDLE, Bounds, Kind, draw
from arm_brachy.core.errors import ArmBrachyError, InputError
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.random import stream
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import import_fuzz, reader_fuzz
from arm_brachy.recording.reader import CellBag
from arm_brachy.recording.recover import recover
from arm_brachy.scenario import load_cell

NAME = 'abuse'
KEPT = 'done.jsonl'     # in the folder of a campaign
SEED = 1
FAULTS = 1000
CELLS = 10
FILES = 10_000
SCENARIO = 'target_1.yaml'
WITH_PROBE = 'procedure.yaml'
PROBE_CELLS = 4         # every so many cells, one has needle and probe
BENCHES = {'abuse_bench': (SCENARIO, {*Kind} - {*OF_THE_NEEDLE}),
           'abuse_probe_bench': (WITH_PROBE, {*OF_THE_NEEDLE})}
LOSS_S = 0.25           # of a recording that was killed
HOLD_S = 0.05           # simulated time that a cell in lockstep goes on after a death: one tick
BEGIN_S, SPAN_S = 0.5, 2.0     # simulated time at which a node of a cell dies


def reproduce(out_dir, faults=FAULTS, cells=CELLS, files=FILES, seed=SEED, say=lambda text: None):
    """Return the Result of a campaign.

    out_dir : receives logs and bags of the cells, and what is done so far; a campaign of the same
        seed there goes on where it was left
    faults, cells, files : how many of each part;  say : called with a line now and then
    Raises InputError for a folder with a campaign of another seed.
    """
    log = Log(Path(out_dir), seed)
    rows = _faults(faults, seed, log, say) if faults else []
    deaths = [log.once(f'cell {k}', lambda k=k: _death(Path(out_dir) / f'cell_{k}', k, seed, say))
              for k in range(cells)]
    read, judged = _files(out_dir, files, seed, log, say) if files else ([], [])
    targets = [*_fault_targets(rows, faults), *_death_targets(deaths), *judged]
    table = [*_by_kind(rows), *deaths, *read]
    return Result(NAME, seed, commit_of(share_dir()), machine_description(), tuple(table),
                  tuple(targets))


class Log:
    """What a campaign has done: a line of JSON each, in its folder."""

    def __init__(self, folder, seed):
        """Read what is there. Raises InputError if that is of another seed."""
        self._file, self._done = folder / KEPT, {}
        if self._file.exists():
            for line in self._file.read_text(encoding='utf-8').splitlines():
                entry = json.loads(line)
                self._done[entry['what']] = entry['row']
        before = self.once('seed', lambda: seed)
        if before != seed:
            raise InputError(f'{folder}: holds a campaign of seed {before}; got {seed}: name '
                             'another folder with --out, or that seed')

    def keep(self, what, row):
        """Note what came of something."""
        self._done[what] = row
        with self._file.open('a', encoding='utf-8') as file:
            file.write(json.dumps({'what': what, 'row': row}) + '\n')

    def get(self, what):
        """What came of it, None if it has not been done."""
        return self._done.get(what)

    def once(self, what, do):
        """What came of it, now or before."""
        if what not in self._done:
            self.keep(what, do())
        return self._done[what]


def _faults(n, seed, log, say):
    """What came of each fault, as the benches have it."""
    for name, (scenario, kinds) in BENCHES.items():
        mine = [k for k, fault in enumerate(draw(n, seed)) if fault.kind in kinds]
        done = sum(log.get(f'fault {k}') is not None for k in mine)
        if done < len(mine):
            _bench(name, scenario, n, seed, done, log, say)
    return [log.get(f'fault {k}') for k in range(n)]


def _bench(name, scenario, n, seed, done, log, say):
    """Run one bench over its faults, without the first that are done."""
    with tempfile.TemporaryDirectory() as scratch, launcher.Domain() as domain:
        bench = launcher.NodeProcess(name, {
            'scenario': str(config_dir() / 'scenarios' / scenario),
            'key_file': f'{scratch}/bag.key', 'faults': float(n), 'seed': float(seed),
            'done': float(done)})
        environment = {**os.environ, **launcher.node_environment(), 'ROS_DOMAIN_ID': str(domain),
                       'ROS_LOG_DIR': scratch}
        errors = Path(scratch) / 'log'
        with errors.open('w') as told, subprocess.Popen(
                bench.argv(), stdout=subprocess.PIPE, stderr=told, text=True, env=environment,
                preexec_fn=launcher.die_with_parent) as process:
            for line in process.stdout:
                if line.startswith('{'):
                    row = json.loads(line)
                    log.keep(f'fault {row["number"]}', row)
                    say(f'fault {row["number"]} of {n}: {Kind[row["kind"]].value}')
        if process.returncode != 0:
            last = errors.read_text(errors='replace').strip().splitlines()[-1:]
            raise ArmBrachyError(f'{name} ended with status {process.returncode} among {n} '
                                 f'faults: {" ".join(last)}')


def _files(out_dir, n, seed, log, say):
    """(rows, targets) of both studies of damaged files."""
    say('damaged files: tables')
    tables = log.once(f'{n} files: tables', lambda: json.loads(import_fuzz.reproduce(
        out_dir, mutants=n // 2, seed=seed).to_json()))
    each = -(-(n - n // 2) // len(reader_fuzz.KINDS))
    rows = []
    for kind in reader_fuzz.KINDS:
        say(f'damaged files: {kind}')
        rows += log.once(f'{n} files: {kind}', lambda kind=kind: reader_fuzz.reproduce(
            out_dir, mutants=each, seed=seed, kinds=(kind,)).rows)
    return ([*tables['rows'], *rows], [*(Target(**target) for target in tables['targets']),
                                       *reader_fuzz.targets_of(rows)])


def _by_kind(rows):
    kinds = defaultdict(list)
    for row in rows:
        kinds[row['kind']].append(row)
    return [{'kind': Kind[kind].value, 'faults': len(some),
             'violations': sum(r['violated'] for r in some),
             'overshoot_mm': max(r['overshoot_mm'] for r in some),
             'rest_s': max(r['rest_s'] for r in some),
             'held_s': max(r['held_s'] for r in some),
             'obeyed': sum(r['obeyed'] for r in some),
             'not_recovered': sum(not r['recovered'] for r in some)}
            for kind, some in sorted(kinds.items())]


def _fault_targets(rows, n):
    if not n:
        return []
    bounds, worst = Bounds(), max((r['overshoot_mm'] for r in rows), default=np.inf)
    bad = sum(r['violated'] for r in rows)
    lost = n - sum(r['recovered'] for r in rows)
    obeyed, rest = sum(r['obeyed'] for r in rows), max((r['rest_s'] for r in rows), default=np.inf)
    return [Target('faults that moved something out of its range or late, or were obeyed', bad, '',
                   '= 0', bad == 0),
            Target('way of a pad or the needle outside its range', worst, 'mm',
                   f'<= {1e3 * bounds.overshoot:g}', worst <= 1e3 * bounds.overshoot),
            Target('until all rests without permission, wall pace', rest, 's',
                   f'<= {bounds.rest:g}', rest <= bounds.rest),
            Target('forged commands, goals and services that were obeyed', obeyed, '', '= 0',
                   obeyed == 0),
            Target('faults after which the cell did not run again', lost, '', '= 0', lost == 0)]


def _death(folder, k, seed, say):
    """Kill or stop a node of a cell in lockstep; returns what came of it."""
    shutil.rmtree(folder, ignore_errors=True)      # of a campaign that was ended meanwhile
    rng = stream(seed, f'{NAME}/{k}')
    scenario = WITH_PROBE if k % PROBE_CELLS == PROBE_CELLS - 1 else SCENARIO
    cell = load_cell(config_dir() / 'scenarios' / scenario)
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
    ended, (t, wall) = time.monotonic(), struck[0] if struck else (np.nan, np.nan)
    lost, after = _recorded(folder, t, victim, names)
    return {'kind': f'{number.name} {victim}', 'scenario': cell.scenario.name, 't_s': round(t, 2),
            'named': victim in said, 'noticed_s': round(ended - wall, 1), 'lost_s': lost,
            'went_on_s': after, 'left': len(runner.alive())}


def _recorded(folder, t, victim, names):
    """Seconds before the death that the recording does not hold, and those that it goes on.

    The launcher hears of the time now and then: the last that the victim said itself may be later
    than the time that the launcher knew of when it struck.
    """
    recover(folder / 'bag', folder / 'mended')
    with CellBag(folder / 'mended') as bag:
        end = bag.span_ns[1] * 1e-9
        own = [topic for topic in bag.topics()
               if graph.writers(topic.removeprefix('/'), names) == (victim,)]
        said = [record.log_time_ns * 1e-9 for record in bag.records(own)] if own else []
    return round(max(0.0, t - end), 3), round(max(0.0, end - max([t, *said])), 3)


def _death_targets(deaths):
    if not deaths:
        return []
    silent = sum(not d['named'] for d in deaths)
    lost, left = max(d['lost_s'] for d in deaths), sum(d['left'] for d in deaths)
    after = max(d['went_on_s'] for d in deaths)
    return [Target('deaths that nobody named', silent, '', '= 0', silent == 0),
            Target('time that a cell in lockstep went on after a death', after, 's',
                   f'<= {HOLD_S:g}', after <= HOLD_S + 1e-9),
            Target('recording lost', lost, 's', f'<= {LOSS_S:g}', lost <= LOSS_S + 1e-9),
            Target('processes left', left, '', '= 0', left == 0)]
