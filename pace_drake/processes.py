"""How processes share this computer: linear algebra on one thread, and pools of workers that end with who made them."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from threadpoolctl import threadpool_limits


def use_one_thread() -> None:
    """Keeps linear algebra of this process, and of those that it starts, on one thread from now on.

    Our matrices are small: two threads gain nothing on a free machine. On a busy one each product waits, spinning, for
    a thread that does not run, and what takes a tenth of a second takes minutes.
    """
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = "1"  # read by libraries that are still to be loaded
    threadpool_limits(1)


def _begin() -> None:
    # Ctrl-C reaches all processes of a terminal: only the one that holds the pool shall answer it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_one_thread()


@contextmanager
def worker_processes(num: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes with one thread of linear algebra each.

    When its block raises, they are ended with it, in the middle of what they do: that may have minutes to go.

    Args:
        num: how many.
    """
    # "spawn": threads of torch and numba do not survive a fork.
    with ProcessPoolExecutor(num, get_context("spawn"), _begin) as pool:
        try:
            yield pool
        except BaseException:
            for process in (pool._processes or {}).values():
                process.terminate()  # which ends what waits, too
            raise
