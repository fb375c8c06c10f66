"""Workers: one thread each, and gone when their block raises."""

import os
import time
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from pace_drake.processes import use_one_thread, worker_processes

VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def threads():
    np.dot(np.ones((2, 2)), np.ones(2))
    import scipy.linalg  # noqa: F401  loaded late, and with a library of its own

    return {pool["num_threads"] for pool in threadpool_info()}


def test_this_process(monkeypatch):
    for name in VARIABLES:
        monkeypatch.setenv(name, "2")
    with threadpool_limits(2):
        assert threads() == {2}
        use_one_thread()
        assert threads() == {1}
        assert {os.environ[name] for name in VARIABLES} == {"1"}


def test_workers_whatever_they_inherit(monkeypatch):
    for name in VARIABLES:
        monkeypatch.setenv(name, "2")
    with worker_processes(1) as workers:
        assert workers.submit(threads).result() == {1}


def test_workers_end_with_the_block(tmp_path):
    begun = tmp_path / "begun"
    futures = []

    def interrupted():
        with worker_processes(1) as workers:
            futures.extend(workers.submit(slow, path) for path in (begun, tmp_path / "never"))
            while not begun.exists():
                time.sleep(0.05)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    pid = int(begun.read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert isinstance(futures[1].exception(), BrokenProcessPool)
    assert not (tmp_path / "never").exists()


def slow(path):
    path.with_suffix(".part").write_text(str(os.getpid()))
    path.with_suffix(".part").rename(path)
    time.sleep(600)
