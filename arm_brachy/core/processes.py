"""Processes that another one started, and its end.

Test: experiments/test_parallel.py
"""

import multiprocessing
import os
import threading


def end_with_parent():
    """End this process at once when the one that started it dies, however suddenly.

    For processes of `multiprocessing`: they would go on with what nobody waits for.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent():
    multiprocessing.parent_process().join()
    os._exit(1)
