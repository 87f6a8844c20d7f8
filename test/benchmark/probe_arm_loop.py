"""The arm's loop of 1 kHz with physics: processor time of a period, and its ratio to real time.

    OMP_NUM_THREADS=1 python test/benchmark/probe_arm_loop.py [--json]

Rows: the loop in the air, the loop in contact with force control, PyBullet alone. Processor time
of this thread, the least of REPEATS of 500 periods; all limits are on.
"""

import argparse
import json
import time
from types import SimpleNamespace

import numpy as np

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import commit_of, machine_description
from arm_brachy.robot.panda_holder import PandaHolder
from arm_brachy.robot.probe_arm_params import PERIOD, ProbeArmParams
from arm_brachy.robot.probe_holder import Errand, Way

REPEATS, TICKS, PERIODS = 9, 10, 50
SPRING = 300.0      # N/m


def least(call):
    """Least processor time [us] of a period over REPEATS of TICKS ticks."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        for _ in range(TICKS):
            call()
        times.append(time.process_time() - start)
    return 1e6 * min(times) / (TICKS * PERIODS)


def rows():
    """One row a case."""
    params = ProbeArmParams()
    holder = PandaHolder(params, np.random.default_rng(1))
    R, p = holder.home
    still = np.zeros(3)
    air = Errand(Way.POSE, R, p, still, still)
    push = Errand(Way.FORCE, R, p, still, still, seek=params.approach_speed, force=params.force)
    stiffness = np.zeros((6, 6))
    stiffness[2, 2] = SPRING

    def in_contact():
        depth = max(0.0, p[2] - holder.state().p_true[2])
        wrench = np.array([0.0, 0.0, SPRING * depth, 0.0, 0.0, 0.0])
        holder.run(push, SimpleNamespace(wrench=wrench, stiffness=stiffness), PERIODS)

    def physics():
        simulation, forces = holder._simulation, holder._memory.torque
        for _ in range(PERIODS):
            simulation.read_into(holder._memory.q, holder._memory.dq)
            simulation.advance(forces)

    holder.run(air, None, PERIODS)     # compiled, or loaded from the cache
    cases = (('in the air', lambda: holder.run(air, None, PERIODS)), ('in contact', in_contact),
             ('PyBullet alone', physics))
    out = []
    for name, call in cases:
        cost = least(call)
        out.append({'case': name, 'period_us': round(cost, 1),
                    'times_real_time': round(1e6 * PERIOD / cost, 1)})
    holder.close()
    return out


def main():
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--json', action='store_true', help='one object, with commit and machine')
    found = rows()
    if parser.parse_args().json:
        print(json.dumps({'name': 'probe_arm_loop', 'seed': 1, 'commit': commit_of(share_dir()),
                          'machine': machine_description(), 'rows': found}, indent=2))
        return
    for row in found:
        print(f'{row["case"]:15s} {row["period_us"]:7.1f} us a period, '
              f'{row["times_real_time"]:5.1f} times real time')


if __name__ == '__main__':
    main()
