"""Work on one process, on several of this machine, or on a Dask cluster; all by joblib but the first.

In a race each worker times on a core of its own (see `cores`) and keeps its solvers' processes from part to part. It
writes its rows itself, so a cluster's workers must reach the run's folder under the same path.
"""

import multiprocessing
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from select import select
from typing import Any, Protocol, TypeVar

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

from bench.messages.race_error import RaceError
from bench.processes.forked_child import warm_up
from bench.processes.solver_child import SolverPool
from bench.processes.worker import ChildSettings
from bench.timing import cores
from solvers.registry import Entry

IDLE_S = 10
"""A local worker ends when it has waited so long for a part."""


class Part(Protocol):
    """What one worker does in one go; it can be sent anywhere."""

    def do(self, pool: SolverPool, tell: Callable[[Any], None]) -> None:
        """Do it; ``tell`` is told of each task before it starts."""


P = TypeVar("P", bound=Part)
T = TypeVar("T")
R = TypeVar("R")


class Backend(StrEnum):
    """Where the workers are."""

    LOCAL = "local"
    DASK = "dask"


@dataclass(frozen=True)
class Workers:
    """How work is spread; not part of a race's settings, since it may be resumed elsewhere.

    ``count`` are on this machine, and a cluster says itself how many it has; ``scheduler`` is the address of a Dask
    scheduler.
    """

    count: int = 1
    backend: Backend = Backend.LOCAL
    scheduler: str = ""

    def check(self) -> None:
        """RaceError where this cannot be."""
        if self.backend is Backend.DASK and not self.scheduler:
            raise RaceError("the backend dask needs the address of a scheduler, --scheduler tcp://host:8786")
        if self.backend is Backend.DASK and self.count > 1:
            raise RaceError("--workers counts those of this machine; a Dask cluster says itself how many it has")
        if self.backend is Backend.LOCAL and self.scheduler:
            raise RaceError("a scheduler goes with --backend dask")
        if self.backend is Backend.LOCAL and self.count > len(cores.usable()):
            raise RaceError(f"{self.count} workers need a core each, and this machine has {len(cores.usable())}")

    @property
    def is_one(self) -> bool:
        """Whether this process does everything."""
        return self.backend is Backend.LOCAL and self.count == 1


def distribute(parts: Sequence[P], entries: Sequence[Entry], settings: ChildSettings, workers: Workers) -> Iterator[P]:
    """Do parts of a race on several workers, which give their cores back in the end; yields them as they get done, in
    any order."""
    with _backend(workers) as (count, client):
        yield from _done(work, [(part, tuple(entries), settings) for part in parts], workers, count)
        if client is not None:
            client.run(close_pools)


def each(function: Callable[[T], R], items: Iterable[T], workers: Workers) -> Iterator[R]:
    """Call a function of an importable module with each item; yields what it returns, in any order.

    An item whose worker was lost is done again by another one of a cluster; of this machine's workers none may be lost.
    """
    if workers.is_one:
        yield from map(function, items)
        return
    with _backend(workers) as (count, _):
        try:
            yield from _done(function, zip(items), workers, count)
        except BrokenProcessPool:
            raise RaceError(
                "a worker was killed, perhaps for want of memory; what is done is kept, and the same command carries on"
            ) from None


def _done(
    function: Callable[..., R], arguments: Iterable[tuple[Any, ...]], workers: Workers, count: int
) -> Iterator[R]:
    # What waits in the queue of joblib's local workers when they are stopped ends in a KeyError of its own thread: only
    # what they take at once.
    parent, ahead = (os.getpid(), "2 * n_jobs") if workers.backend is Backend.LOCAL else (None, "all")
    yield from Parallel(n_jobs=count, batch_size=1, pre_dispatch=ahead, return_as="generator_unordered")(
        delayed(_attended)(function, some, parent) for some in arguments
    )


@contextmanager
def _backend(workers: Workers) -> Iterator[tuple[int, Any]]:
    """Choose joblib's backend; yields the number of its workers, and the client of a cluster."""
    if workers.backend is Backend.LOCAL:
        with parallel_config(backend="loky", idle_worker_timeout=IDLE_S):
            yield workers.count, None
        get_reusable_executor().shutdown(wait=True)
        return
    with _client(workers.scheduler) as client, parallel_config(backend="dask", client=client):
        yield -1, client


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A client of the cluster."""
    try:
        from distributed import Client
    except ImportError:
        raise RaceError("the backend dask needs the package distributed: install piezobench[dask]") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise RaceError(f"there is no Dask scheduler at {address} ({' '.join(str(error).split())})") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise RaceError(f"the Dask cluster at {address} has no worker")
        _check_cores(client)
        yield client


def _check_cores(client: Any) -> None:
    """RaceError where a host of the cluster has more workers (threads of them) than cores, which would wait for
    ever."""
    threads: Counter[str] = Counter()
    there = client.run(cores_here)
    for address, worker in client.scheduler_info()["workers"].items():
        threads[there[address][0]] += worker["nthreads"]
    for host, count in dict(there.values()).items():
        if threads[host] > count:
            raise RaceError(
                f"{threads[host]} Dask workers on {host} need a core each, and it has {count}; start fewer, each "
                f"with one thread"
            )


# What follows runs in a worker.


def cores_here() -> tuple[str, int]:
    """Name of this machine and number of its cores."""
    return os.uname().nodename, len(cores.usable())


_waiting: list[tuple[SolverPool, cores.Core]] = []
"""Pools of this process that no thread of it is using."""
_lock = threading.Lock()


def work(part: P, entries: tuple[Entry, ...], settings: ChildSettings) -> P:
    """Do one part with the pool that waits here, or with a new one on a free core."""
    pool, core = _taken(entries, settings)
    try:
        with core.pinned():
            part.do(pool, lambda task: None)
    except BaseException:
        _close([(pool, core)])
        raise
    with _lock:
        _waiting.append((pool, core))
    return part


def _attended(function: Callable[..., R], arguments: tuple[Any, ...], parent: int | None) -> R:
    if parent is not None:
        _end_with(parent)
    return function(*arguments)


@cache
def _end_with(parent: int) -> None:
    """Have this process end at once when its parent does: joblib's would wait for ever with a result that nobody reads
    any more."""
    try:
        handle = os.pidfd_open(parent)
    except ProcessLookupError:
        os._exit(1)
    if os.getppid() != parent:
        os._exit(1)

    def wait() -> None:
        select([handle], [], [])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _taken(entries: tuple[Entry, ...], settings: ChildSettings) -> tuple[SolverPool, cores.Core]:
    with _lock:
        ours = [pair for pair in _waiting if (pair[0].entries, pair[0].settings) == (entries, settings)]
        of_others = [pair for pair in _waiting if pair not in ours]
        taken = ours.pop() if ours else None
        _waiting[:] = ours
    _close(of_others)
    if taken is not None:
        return taken
    core = cores.claim()
    _permit_children()
    warm_up(entries, settings.preload)
    return SolverPool(entries, settings, core.number), core


def _permit_children() -> None:
    """Let this process start others, whoever started it.

    Under a nanny a Dask worker is a daemon, to which multiprocessing forbids children; ours end with their connection.
    A worker of joblib's tells its children of a way to start processes that only joblib knows.
    """
    multiprocessing.current_process().daemon = False
    if multiprocessing.get_start_method() not in multiprocessing.get_all_start_methods():
        multiprocessing.set_start_method("forkserver", force=True)


def close_pools() -> None:
    """End the processes that wait here, and give their cores back."""
    with _lock:
        closing = list(_waiting)
        _waiting.clear()
    _close(closing)


def _close(pairs: Iterable[tuple[SolverPool, cores.Core]]) -> None:
    for pool, core in pairs:
        pool.close()
        core.close()
