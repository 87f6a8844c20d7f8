"""How a peer is run and timed, the same for all: convergence first, untimed, then the clock.

A Newton peer is given every advantage that a user could find by trial: before the clock starts it
is solved with 1, 2, 3, ... load steps until one number converges, and the correction at which the
error first falls below the tolerance is noted. The timed solves make exactly those corrections,
without a convergence test.
"""

import argparse
import re
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from arm_brachy.experiments.peers.problem import Answer, Problem

TOLERANCE = 1e-6     # m, largest distance of a node from the converged solution
TIGHT = 1e-10        # m, last correction of the converged solution: four decades below
LOAD_STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
MOST_CORRECTIONS = 15   # in the last load step; Newton's method that needs more does not converge
REPEATS = 5          # at least, and until
LONG = 3.0           # s of them are timed: of solves of some milliseconds the least of many counts
PATIENCE = 20.0      # s of timed solves, after which no other repetition begins


class Diverged(ArithmeticError):
    """Newton's method left the region where it converges; fewer or more load steps may help."""


@dataclass
class Plan:
    """How Newton's method goes: equal load steps, one correction in each but the last.

    load_steps : number;  corrections : made in the last, or None until one is below TIGHT
    iterates : (n, 3) positions after each correction of the last step, while searching
    """

    load_steps: int
    corrections: int | None = None
    iterates: list = field(default_factory=list)

    def finished(self, step, count, size, x):
        """True if load step `step` (from 1) needs no other correction.

        count : corrections made in it;  size : [m] of the last one;  x : (n, 3) [m] after it
        Raises Diverged.
        """
        if step < self.load_steps:
            return True
        if self.corrections is not None:
            return count >= self.corrections
        self.iterates.append(np.array(x))
        if not size < np.inf or count > MOST_CORRECTIONS:
            raise Diverged(f'correction {count} is {size} m with {self.load_steps} load steps')
        return size <= TIGHT


def find_plan(solve, problem, failures):
    """Return (Plan to be timed, the tight solution's (x, pad_force)).

    solve : (Problem, Plan) -> (x, pad_force);  failures : exceptions that mean "does not converge"
    Raises Diverged if no number of load steps converges.
    """
    for load_steps in LOAD_STEPS:
        plan = Plan(load_steps)
        try:
            x, pad_force = solve(problem, plan)
        except (Diverged, *failures):
            continue
        errors = [np.linalg.norm(one - x, axis=1).max() for one in plan.iterates]
        enough = 1 + next(k for k, error in enumerate(errors) if error <= TOLERANCE)
        return Plan(load_steps, enough), (x, pad_force)
    raise Diverged(f'no convergence with up to {LOAD_STEPS[-1]} load steps')


def timed(call):
    """Return (result, CPU s, wall s) of the call that needed the least CPU time, all threads.

    No call begins once PATIENCE is used up, so what is slow is run once.
    """
    best, spent, made = None, 0.0, 0
    while (made < REPEATS or spent < LONG) and spent <= PATIENCE:
        cpu, wall = time.process_time(), time.perf_counter()
        result = call()
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        if best is None or cpu < best[1]:
            best = result, cpu, wall
        spent, made = spent + wall, made + 1
    return best


def peak_memory():
    """Peak resident memory [B] of this process: VmHWM of proc(5).

    Not getrusage's, which a process inherits from the one that started it.
    """
    status = Path('/proc/self/status').read_text(encoding='utf-8')
    return 1024.0 * int(re.search(r'VmHWM:\s+(\d+) kB', status)[1])


def newton_answer(solve, problem, failures, version):
    """The Answer of a Newton peer; arguments as in `find_plan`."""
    plan, (tight, pad_force) = find_plan(solve, problem, failures)
    (x, _), cpu, wall = timed(lambda: solve(problem, plan))
    return Answer(x, tight, pad_force, cpu, wall, plan.load_steps - 1 + plan.corrections,
                  plan.load_steps, peak_memory(), version)


def main(answer):
    """Command line of a peer: read the problem, call `answer`, write what it returns."""
    parser = argparse.ArgumentParser()
    parser.add_argument('problem', type=Path)
    parser.add_argument('answer', type=Path)
    files = parser.parse_args()
    answer(Problem.load(files.problem)).save(files.answer)
