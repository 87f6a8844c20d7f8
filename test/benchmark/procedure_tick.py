"""A procedure's ticks: processor time of the probe's arm, of the procedure and of an image.

    OMP_NUM_THREADS=1 python test/benchmark/procedure_tick.py [SCENARIO] [--json]

Runs a scenario in one process until the needle is at its target, procedure.yaml by default. Rows:
the arm (plan, phases, force control and 1 kHz loop with PyBullet), its plan alone, its loop alone
(fifty periods in a tick of 50 ms; the goal is ten times real time), a step of the procedure, an
image with overlay, tip and target. Processor time of this thread, median, 95 % and largest; what
was compiled for it is not counted, since each first call is left out.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from arm_brachy.control.procedure_steps import Phase
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.inprocess import InProcess
from arm_brachy.scenario import load_cell

GOALS = {'arm, a tick': 20.0, 'its plan alone': 20.0, 'its loop alone': 5.0,
         'procedure, a tick': 20.0, 'image': 25.0}
OVER = (Phase.DWELLING, Phase.WITHDRAWING, Phase.FINISHED)


class Stopwatch:
    """Times calls of methods, by name."""

    def __init__(self):
        self.taken = {name: [] for name in GOALS}

    def on(self, owner, method, name, counts=lambda result: True):
        """Time `owner.method`; only results that count are kept."""
        call = getattr(owner, method)

        def timed(*args, **kwargs):
            begun = time.thread_time()
            result = call(*args, **kwargs)
            if counts(result):
                self.taken[name].append(1e3 * (time.thread_time() - begun))
            return result
        setattr(owner, method, timed)

    def rows(self):
        """One row a name, milliseconds."""
        return [{'what': name, 'calls': len(taken) - 1, 'median_ms': float(np.median(taken[1:])),
                 'p95_ms': float(np.quantile(taken[1:], 0.95)), 'largest_ms': max(taken[1:]),
                 'goal_ms': GOALS[name]} for name, taken in self.taken.items()]


def rows(path):
    """Run the scenario at `path`; one row for each of GOALS."""
    loop, watch = InProcess(load_cell(path), ('optical', 'force')), Stopwatch()
    side = loop.probe
    watch.on(side.arm, 'step', 'arm, a tick')
    watch.on(side.arm, '_planned', 'its plan alone')
    watch.on(side.arm.holder, 'run', 'its loop alone')
    watch.on(side.procedure, 'step', 'procedure, a tick')
    watch.on(side.imager, 'see', 'image', lambda frame: frame is not None)
    while side.procedure.phase not in OVER:
        loop.tick()
    return watch.rows()


def main():
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('scenario', nargs='?', type=Path,
                        default=config_dir() / 'scenarios' / 'procedure.yaml')
    parser.add_argument('--json', action='store_true', help='one object, with commit and machine')
    given = parser.parse_args()
    found = rows(given.scenario)
    if given.json:
        print(json.dumps({'name': 'procedure_tick', 'commit': commit_of(share_dir()),
                          'machine': machine_description(), 'rows': found}, indent=2))
        return
    for row in found:
        print(f'{row["what"]:18s} {row["calls"]:5d} calls, median {row["median_ms"]:6.2f} ms, '
              f'95 % {row["p95_ms"]:6.2f} ms, largest {row["largest_ms"]:6.2f} ms, '
              f'goal {row["goal_ms"]:g} ms')


if __name__ == '__main__':
    main()
