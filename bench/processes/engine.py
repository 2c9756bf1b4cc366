"""Runs work in this process, or on the executor of several local processes or of a Dask cluster.

In a race each worker times on a core of its own (see `cores`) and keeps its solvers' processes from part to part. It
writes its rows itself, so a cluster's workers must reach the run's folder under the same path.
"""

import multiprocessing
import os
import signal
import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Literal

from bench.messages.task import ChildSettings, RaceError
from bench.processes.solver_child import SolverPool
from bench.timing import cores
from piezo_model.checks import check
from solvers.registry import Entry

Backend = Literal["local", "dask"]
"""Location of the workers."""
MapUnordered = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
"""Calls a function with each item; yields the results in any order."""


@dataclass(frozen=True)
class Workers:
    """Number and location of the workers; not part of a race's settings, since it may be resumed elsewhere.

    ``count`` applies to this machine, since a cluster knows its own number; ``scheduler`` is the address of a Dask
    scheduler.
    """

    count: int = 1
    backend: Backend = "local"
    scheduler: str = ""

    def check(self) -> None:
        """RaceError if these workers cannot be had."""
        is_local, there = self.backend == "local", len(cores.usable())
        check(
            is_local or self.scheduler,
            "the backend dask needs the address of a scheduler, --scheduler tcp://host:8786",
            RaceError,
        )
        check(
            is_local or self.count == 1,
            "--workers is for this machine; a Dask cluster has its own number of workers",
            RaceError,
        )
        check(not is_local or not self.scheduler, "--scheduler needs --backend dask", RaceError)
        check(
            not is_local or self.count <= there,
            f"{self.count} workers need a core each, and this machine has {there}",
            RaceError,
        )

    @property
    def is_single(self) -> bool:
        """Whether this process does everything."""
        return self.backend == "local" and self.count == 1


@contextmanager
def started(workers: Workers) -> Iterator[MapUnordered]:
    """Start workers; the yielded function calls a picklable function with each item on them, and yields the
    results in any order.

    A cluster repeats an item whose worker was lost; the loss of a local worker is a ChildProcessError, and the caller
    says how to continue.
    """
    if workers.is_single:
        yield map
        return
    with _local(workers.count) if workers.backend == "local" else _cluster(workers.scheduler) as executor:
        try:
            yield lambda function, items: (
                done.result() for done in as_completed([executor.submit(function, item) for item in items])
            )
        except BrokenProcessPool:
            raise ChildProcessError("a worker was killed, perhaps for lack of memory") from None


@contextmanager
def _local(count: int) -> Iterator[Executor]:
    """Worker processes of this machine; an interruption ends them in the middle of their items."""
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _prepare_worker) as executor:
        try:
            yield executor
        except BaseException:
            for worker in set(multiprocessing.active_children()) - others:
                worker.kill()
            executor.shutdown(cancel_futures=True)
            raise


@contextmanager
def _cluster(scheduler: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, which end their solvers at the end."""
    try:
        from distributed import Client
    except ImportError:
        raise RaceError("the backend dask needs the package distributed: install piezobench[dask]") from None
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise RaceError(f"there is no Dask scheduler at {scheduler} ({' '.join(str(error).split())})") from None
    with client:
        check_cores(client, scheduler)
        with client.get_executor() as executor:
            try:
                yield executor
            except BaseException:
                executor.shutdown(wait=False)
                client.run(interrupt_workers)
                raise
        client.run(close_workers)


def check_cores(client: Any, address: str) -> None:
    """RaceError if the cluster has no worker, or a host has more worker threads than cores, some of which would wait
    for ever."""
    members = client.scheduler_info()["workers"]
    check(members, f"the Dask cluster at {address} has no worker", RaceError)
    threads, numbers = Counter[str](), defaultdict[str, set[int]](set)
    for member, (host, usable) in client.run(lambda: (os.uname().nodename, cores.usable())).items():
        threads[host] += members[member]["nthreads"]
        numbers[host].update(usable)
    for host, count in threads.items():
        check(
            count <= len(numbers[host]),
            f"{count} Dask workers on {host} need a core each, and they have {len(numbers[host])}; start fewer, each "
            "with one thread",
            RaceError,
        )


# The following functions run in a worker.


def _prepare_worker() -> None:
    """Leave interruptions to the parent, and end as soon as it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


class _Worker(ExitStack):
    """The solvers of one thread, on a core of its own."""

    def __init__(self, entries: tuple[Entry, ...], settings: ChildSettings) -> None:
        super().__init__()
        self.key, self.core = (entries, settings), self.enter_context(cores.claim())
        # A Dask worker under a nanny is a daemon, and multiprocessing forbids daemons to have children; ours end with
        # their connection.
        multiprocessing.current_process().daemon = False
        self.pool, self.is_busy = self.enter_context(SolverPool(entries, settings, self.core.number)), False


_workers: dict[int, _Worker] = {}
"""By thread; solvers stay from part to part of a race."""


def work(part: Any, entries: tuple[Entry, ...], settings: ChildSettings) -> Any:
    """Do one part of a race with the solvers of this thread, and return it; those of another race are closed."""
    thread = threading.get_ident()
    worker = _workers.get(thread)
    if worker is None or worker.key != (entries, settings):
        if worker is not None:
            worker.close()
        worker = _workers[thread] = _Worker(entries, settings)
    worker.is_busy = True
    try:
        with worker.core.pinned():
            part.do(worker.pool)
    except BaseException:
        _workers.pop(thread).close()
        raise
    worker.is_busy = False
    return part


def interrupt_workers() -> None:
    """End the solvers of this process in the middle of their tasks; each part that is being done fails, and the others
    are closed."""
    for thread, worker in [*_workers.items()]:
        worker.pool.interrupt()
        if not worker.is_busy:
            _workers.pop(thread).close()


def close_workers() -> None:
    """End the solvers of this process, and release their cores."""
    while _workers:
        _workers.popitem()[1].close()
