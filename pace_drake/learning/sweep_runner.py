"""Running the tasks of a sweep through Ray (extra ``ray``), the log of finished rows, and their table."""

import fcntl
import json
import os
import socket
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from pace_drake import __version__
from pace_drake.errors import InputError, require
from pace_drake.files import write_whole
from pace_drake.learning.sweep import ROW_UNITS, Failure, SweepTask, run_task

#: [byte] that Ray reserves for each task: a worker takes up to 0.85 GB (docs/learning.md).
WORKER_MEMORY = 1 << 30
#: [byte] of Ray's store of objects; rows are small.
_OBJECT_STORE_MEMORY = 100 << 20

_LINE_START = b'{"key": '


def import_ray(local: bool = True) -> ModuleType:
    """Returns the module ``ray``, set up to report nothing to its makers.

    Args:
        local: whether it is to listen on this machine alone.

    Raises:
        InputError: Ray or pyarrow is not installed.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if local:
        # Ray replaces a ``_node_ip_address`` of 127.0.0.1 by the machine's own and listens on all interfaces; this is
        # what makes it stay on the loopback. It is read when ray is imported.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    try:
        import pyarrow  # noqa: F401  (for the table in the end: better to know now)
        import ray
    except ModuleNotFoundError as error:
        raise InputError(f"a sweep needs {error.name}: install it with pip install 'pace_drake[ray]'") from error
    return ray


@contextmanager
def cluster(jobs: int | None = None, address: str | None = None) -> Iterator[None]:
    """Ray for the time of a sweep: on this machine's cores, or a cluster that runs; one in use already stays.

    Args:
        jobs: tasks at a time on this machine; None: as many as it has cores.
        address: of the head of an existing cluster, or "auto".

    Raises:
        InputError: Ray is not installed, or nobody answers at the address.
    """
    ray = import_ray(local=address is None)
    if ray.is_initialized():
        yield
        return
    quiet: dict[str, Any] = {"namespace": "pace_drake", "log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        # "local", or else RAY_ADDRESS would lead elsewhere.
        cores = len(os.sched_getaffinity(0))
        ray.init(
            "local",
            num_cpus=jobs or cores,
            include_dashboard=False,
            object_store_memory=_OBJECT_STORE_MEMORY,
            _node_ip_address="127.0.0.1",
            **quiet,
        )
    else:
        _knock(address)
        try:
            ray.init(address, **quiet)
        except Exception as error:  # several unrelated types, by what is wrong with the address
            ray.shutdown()
            raise InputError(f"--address {address}: cannot join the Ray cluster: {_first_line(error)}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    # Ray itself tries for two minutes.
    host, _, port = address.rpartition(":")
    if host and port.isdigit() and "/" not in host:
        try:
            socket.create_connection((host, int(port)), timeout=10.0).close()
        except (OSError, OverflowError) as error:
            raise InputError(f"--address {address}: nobody answers there ({error})") from error


@dataclass(frozen=True)
class _Unfinished:
    """What an attempt gives that gives no row; ``final`` if another one would end alike."""

    reason: str
    final: bool


def _attempt(run: Callable[[SweepTask], dict[str, Any]], task: SweepTask) -> dict[str, Any] | _Unfinished:
    # Exceptions are turned into text in the worker: not all of them can be sent.
    try:
        return run(task)
    except Exception as error:
        return _Unfinished(f"{type(error).__name__}: {_first_line(error)}", isinstance(error, InputError))


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def run_tasks(
    tasks: Sequence[SweepTask],
    on_row: Callable[[SweepTask, dict[str, Any]], object],
    on_failure: Callable[[Failure], object] = lambda _failure: None,
    *,
    run: Callable[[SweepTask], dict[str, Any]] = run_task,
    jobs: int | None = None,
    retries: int = 2,
) -> list[Failure]:
    """Runs tasks in the ``cluster`` that one is in, each in a worker with one thread.

    Args:
        tasks: in the order in which they start.
        on_row: called here with each row, as soon as it is there.
        on_failure: called here with each task that is given up.
        run: what a task is; another one is for tests.
        jobs: most tasks at a time; None: one for each core of the cluster.
        retries: how many times a task that raised, or whose worker died, is tried again, after the others. Input that
            cannot be used is not: it would not be better then.

    Returns:
        The failures.

    Raises:
        InputError: the cluster has too little memory for a worker.
    """
    import ray

    resources = ray.cluster_resources()
    require(
        resources.get("memory", 0.0) >= WORKER_MEMORY,
        "memory",
        f"a worker needs {WORKER_MEMORY / 2**30:.0f} GiB, Ray has {resources.get('memory', 0.0) / 2**30:.1f} to give",
    )
    limit = jobs or max(1, int(resources.get("CPU", 1)))
    remote = ray.remote(num_cpus=1, memory=WORKER_MEMORY, max_retries=0)(_attempt)
    waiting = deque((task, 0) for task in tasks)
    running: dict[Any, tuple[SweepTask, int]] = {}
    failures: list[Failure] = []
    try:
        while waiting or running:
            while waiting and len(running) < limit:
                task, retried = waiting.popleft()
                running[remote.remote(run, task)] = task, retried
            (done,), _ = ray.wait(list(running), num_returns=1)
            task, retried = running.pop(done)
            try:
                outcome = ray.get(done)
            except ray.exceptions.RayTaskError as error:  # before the task began, such as no pace_drake on that machine
                outcome = _Unfinished(str(error).strip().splitlines()[-1], False)
            except ray.exceptions.RayError as error:  # the worker or its machine is gone
                outcome = _Unfinished(_first_line(error), False)
            if isinstance(outcome, dict):
                on_row(task, outcome)
            elif outcome.final or retried >= retries:
                failures.append(Failure(task.cell, outcome.reason))
                on_failure(failures[-1])
            else:
                waiting.append((task, retried + 1))
    finally:
        for ref in running:
            ray.cancel(ref, force=True)
    return failures


class SweepLog:
    """Finished rows, one a line (JSON), each on the disk before the next task's is waited for.

    A context manager, which leaves no empty file. The file is locked: two sweeps do not write the same one.

    Args:
        path: made if it is not there; of an older one the rows are read, and a last line that was not written whole is
            cut off.

    Attributes:
        rows: by the key of their task.

    Raises:
        InputError: the file cannot be written, is no log, or is in use by another sweep.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, dict[str, Any]] = {}
        try:
            self._file = path.open("a+b")
        except OSError as error:
            raise InputError(f"{path}: cannot write the rows: {error.strerror}") from error
        try:
            self._read()
        except BaseException:
            self._file.close()
            raise

    def _read(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{self.path}: another sweep writes it at the moment; choose another --out") from None
        self._file.seek(0)
        *lines, rest = self._file.read().split(b"\n")
        for number, line in enumerate(lines, 1):
            with suppress(ValueError, KeyError, TypeError):
                entry = json.loads(line)
                self.rows[entry["key"]] = dict(entry["row"])
                continue
            raise InputError(f"{self.path}: line {number} is no row of a sweep; choose another --out, or remove it")
        if not rest.startswith(_LINE_START[: len(rest)]):
            raise InputError(f"{self.path}: ends in what is no row of a sweep; choose another --out, or remove it")
        if rest:
            self._file.truncate(self._file.tell() - len(rest))

    def append(self, task: SweepTask, row: dict[str, Any]) -> None:
        """Keeps a row; it is on the disk when this returns."""
        line = json.dumps({"key": task.key, "row": row}, allow_nan=False).encode() + b"\n"
        # First: Ctrl-C while a slow disk writes would leave a row that nobody knows of, in a file that is then removed.
        self.rows[task.key] = row
        self._file.write(line)
        self._file.flush()
        os.fsync(self._file.fileno())

    def __enter__(self) -> "SweepLog":
        return self

    def __exit__(self, *_: object) -> None:
        if not self.rows:
            self.path.unlink(missing_ok=True)
        self._file.close()


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes rows as Parquet, whole; units are in the metadata of the columns.

    Args:
        path: ends in .parquet; an older file is replaced.
        rows: as ``run_task`` gives them.
    """
    import pyarrow
    from pyarrow import parquet

    def kind(name: str) -> Any:
        if name in ("scenario", "estimator", "observation"):
            return pyarrow.string()
        if name in ("seed", "steps", "episodes", "peak_memory"):
            return pyarrow.int64()
        return pyarrow.list_(pyarrow.float64()) if name.endswith("_idle") else pyarrow.float64()

    columns = [pyarrow.field(name, kind(name), metadata={"unit": unit}) for name, unit in ROW_UNITS.items()]
    schema = pyarrow.schema(columns, metadata={"pace_drake": __version__})
    table = pyarrow.Table.from_pylist(list(rows), schema=schema)
    write_whole(path, lambda part: parquet.write_table(table, part))
