"""Where the work of a trial is done: processes of this machine, or the workers of a Dask cluster.

The workers of a cluster see the same files under the same names, and have the same program.
Test: prove/test_workers.py
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from distributed import Client

from arm_brachy.core.errors import InputError
from arm_brachy.experiments.parallel import on_one_thread, process_pool
from arm_brachy.prove.seal import program

TIMEOUT = 10.0      # s that a scheduler may take to answer


@dataclass(frozen=True)
class Workers:
    """count : processes at a time, of this machine
    cluster : address of a Dask scheduler whose workers do the work instead, '' = none
    """

    count: int = 1
    cluster: str = ''

    def each(self, work, tasks, *, waits=False):
        """Yield what work(*task) returns for every task, in their order, all being under way.

        waits : the work is done by processes that it starts, so that threads will do here
        What has not begun is called off when one fails or the caller looks no further.
        Raises InputError for a cluster that does not answer, has no workers or another program.
        """
        tasks = list(tasks)
        if tasks:
            with self._pool(len(tasks), waits) as pool:
                for future in [pool.submit(on_one_thread, work, *task) for task in tasks]:
                    yield future.result()

    @contextmanager
    def _pool(self, tasks, waits):
        if not self.cluster:
            count = min(self.count, tasks)
            pool = ThreadPoolExecutor(count) if waits else process_pool(count)
            try:
                yield pool
            finally:
                pool.shutdown(cancel_futures=True)
            return
        with _client(self.cluster) as client:
            pool = client.get_executor(pure=False, retries=0)
            try:
                yield pool
            finally:
                pool.shutdown(wait=False)


@contextmanager
def _client(address):
    """A distributed.Client whose workers have this very program."""
    try:
        client = Client(address, timeout=TIMEOUT)
    except (OSError, ValueError) as error:
        raise InputError(f'cluster {address}: {error}; must be the address of a Dask scheduler '
                         'that runs, e.g. tcp://host:8786') from None
    with client:
        _refuse_others(client, address)
        yield client


def _refuse_others(client, address):
    try:
        programs = client.run(program)
    except ImportError as error:
        raise InputError(f'cluster {address}: {error}; every worker must have arm_brachy '
                         'installed') from None
    if not programs:
        raise InputError(f'cluster {address} has no workers; must have one; start `dask worker '
                         f'{address} --nthreads 1`')
    other = [worker for worker, one in programs.items() if one != program()]
    if other:
        raise InputError(f'cluster {address}: worker {other[0]} has another arm_brachy than this '
                         'machine; must be the same on all; install it there again')
