"""The solvers that are compared, and how one is asked: in a process of its own."""

import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from arm_brachy.core.paths import PACKAGE
from arm_brachy.experiments.peers.problem import Answer

LIMIT = 1800.0   # s that a peer may take for one problem, search for its load steps included
INSTALL = 'not installed: pip install -r requirements-bench.txt'
THREADS = ('OMP_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')


@dataclass(frozen=True)
class Peer:
    """One solver.

    label : as in the table;  module : its program in this folder
    package : what must be installed
    elements : it is compared on;  alone : also run on one thread, or only on all cores
    """

    label: str
    module: str
    package: str
    elements: tuple = ('linear', 'quadratic')
    alone: bool = False

    def threads(self):
        """Numbers of threads to run it with."""
        cores = len(os.sched_getaffinity(0))
        return (1, cores) if self.alone and cores > 1 else (cores,)

    @property
    def installed(self):
        """True if the package is there."""
        return importlib.util.find_spec(self.package) is not None


OWN = Peer('arm_brachy', 'own', PACKAGE, alone=True)
FELUPE = Peer('FElupe + PARDISO', 'felupe_peer', 'felupe', alone=True)
SKFEM = Peer('scikit-fem + PARDISO', 'skfem_peer', 'skfem')
# It has no Neo-Hookean law; the time is that to 0.1 mm of its own equilibrium.
MUJOCO = Peer('MuJoCo flex (St. Venant-Kirchhoff, to 0.1 mm)', 'mujoco_peer', 'mujoco',
              elements=('linear',))


def ask(peer, problem, threads, folder):
    """Return the peer's Answer to a Problem, or in words why there is none.

    threads : that its libraries may use;  folder : Path for the files exchanged
    """
    if not peer.installed:
        return INSTALL
    question, answer = folder / 'problem.npz', folder / 'answer.npz'
    problem.save(question)
    answer.unlink(missing_ok=True)
    try:
        done = subprocess.run(
            [sys.executable, '-m', f'{PACKAGE}.experiments.peers.{peer.module}', question, answer],
            cwd=folder, env=_environment(threads), timeout=LIMIT, capture_output=True, text=True)
    except subprocess.TimeoutExpired:
        return f'not finished in {LIMIT:g} s'
    if done.returncode:
        said = done.stderr.strip().splitlines()
        return f'failed: {said[-1] if said else f"exit status {done.returncode}"}'
    return Answer.load(answer)


def _environment(threads):
    """This process's own, with the threads set and the package found from any folder."""
    source = str(Path(__file__).resolve().parents[3])
    path = [source, *filter(None, [os.environ.get('PYTHONPATH')])]
    return {**os.environ, **dict.fromkeys(THREADS, str(threads)),
            'PYTHONPATH': os.pathsep.join(path)}
