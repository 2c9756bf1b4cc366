"""A race on several workers, local or of a cluster, gives the rows of a race on one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import faulty_solvers
import pandas as pd
import pytest
from command_line import CommandLine, kill_worker, wait_until, wait_until_gone
from programs import library
from small_races import MACHINES, SMALL, THIRD, TWO_CORES, Race, checkout, commit_of, commits, saved
from test_store import of_first_answers

from bench.messages.task import RaceError
from bench.processes.engine import check_cores
from bench.store import Run
from bench.timing import cores


def same_but_for_times_and_hosts(run: Run, race: Race) -> None:
    here, there = (of_first_answers(rows).drop(columns=["host"]) for rows in (run.rows(), race.rows))
    pd.testing.assert_frame_equal(here, there)


def hosts_and_cores(run: Run) -> set[tuple[str, int]]:
    return {(part["host"], part["core"]) for part in run.settings["conditions"]["parts"]}


def raced_by_two(piezobench: CommandLine, folder: Path, *words: object) -> Run:
    """A race on two workers; it is repeated if a concurrent test held a core and one worker did all the work."""
    for name in ("first", "second", "third"):
        with cores.claim(), cores.claim():
            pass  # no other process is timing now
        piezobench.run("race", *SMALL, *THIRD, "--out", folder, "--name", name, *words)
        run = Run(folder / name)
        if len(hosts_and_cores(run)) == 2:
            break
    return run


@pytest.mark.slow
@TWO_CORES
def test_two_local_workers_give_the_rows_of_one_and_have_a_core_each(
    piezobench: CommandLine, tmp_path: Path, clean_race: Race
) -> None:
    run = raced_by_two(piezobench, tmp_path, "--workers", 2)
    same_but_for_times_and_hosts(run, clean_race)
    assert len(hosts_and_cores(run)) == 2
    assert not (run.path / "parts").exists()


@pytest.mark.slow
@TWO_CORES
def test_a_race_whose_workers_were_killed_is_resumed_by_one_and_each_row_knows_the_commit_that_made_it(
    piezobench: CommandLine, tmp_path: Path, clean_race: Race
) -> None:
    run, (first, second) = Run(tmp_path / "run"), [checkout(tmp_path / name) for name in ("first", "second")]
    words = ("race", *SMALL, *THIRD, "--out", tmp_path, "--name", "run", "--workers", 2)
    piezobench.start(*words, folder=first).kill_once(lambda: len(saved(run)) >= 3)
    kept = saved(run)
    piezobench.run("resume", run.path, folder=second)
    same_but_for_times_and_hosts(run, clean_race)
    rows = run.rows()
    keys = rows.task + "-" + rows.timed + "-" + rows.repeat.astype(str)
    assert commits(run).tolist() == [commit_of(first if key in kept else second) for key in keys]
    assert {commit_of(first), commit_of(second)} <= {*(run.path / "report.md").read_text().split()}


@pytest.mark.slow
@TWO_CORES
@pytest.mark.parametrize("tasks", [0, 3])
def test_a_race_that_lost_a_worker_says_how_to_continue_and_keeps_its_run(
    piezobench: CommandLine, tmp_path: Path, clean_race: Race, tasks: int
) -> None:
    run = Run(tmp_path / "run")
    words = ("race", *SMALL, *THIRD, "--out", tmp_path, "--name", "run", "--workers", 2)
    ended = kill_worker(piezobench.start(*words), lambda: len(saved(run)) >= tasks)
    assert (ended.status, ended.stderr.splitlines()[0]) == (
        2,
        f"piezobench race: {run.path}: a worker was killed, perhaps for lack of memory; finished tasks are kept; run "
        f"'piezobench resume {run.path}' to continue",
    )
    assert piezobench(*words).refusal.endswith("already exists; give another name or resume it")
    assert len(saved(run)) >= tasks
    piezobench.run("resume", run.path)
    same_but_for_times_and_hosts(run, clean_race)


LONG = """
import time
from functools import partial
from pathlib import Path
from bench.processes import engine
from bench.messages.task import ChildSettings

class Part:
    result = bytes(1_000_000)  # does not fit into a pipe

    def do(self, pool):
        Path("mark").touch()
        time.sleep(0.5)

def race():
    work = partial(engine.work, entries=(), settings=ChildSettings())
    with engine.started(engine.Workers(2)) as map_unordered:
        list(map_unordered(work, [Part(), Part()]))
"""


@pytest.mark.slow
@TWO_CORES
def test_a_worker_with_a_long_result_ends_with_the_race_that_was_killed(tmp_path: Path) -> None:
    (tmp_path / "long.py").write_text(LONG)
    words = [sys.executable, "-c", "import long; long.race()"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    with subprocess.Popen(words, start_new_session=True, cwd=tmp_path, env=environment) as race:
        while not (tmp_path / "mark").exists():
            assert race.poll() is None
            time.sleep(0.01)
        race.kill()
    wait_until_gone(race.pid)


@TWO_CORES
def test_an_interrupted_race_on_a_cluster_ends_solvers_in_compiled_code_and_gives_the_cores_back(
    piezobench: CommandLine, tmp_path: Path, scheduler: str
) -> None:
    file = faulty_solvers.written(tmp_path, "hangs", *faulty_solvers.FAULTS["hangs"])
    words = ("race", *SMALL, "--scaling", "scaled", "--out", tmp_path, "--backend", "dask", "--scheduler", scheduler)
    call = piezobench.start(*words, "--time-limit", 1000, "--name", "first", "--solver", file)

    def saved_of(solver: str) -> int:
        return sum(key.startswith(f"{solver}-") for key in saved(Run(tmp_path / "first")))

    wait_until(lambda: saved_of("osqp") == 8, call.stderr.read_text)  # then hangs is next
    time.sleep(0.5)
    os.kill(call.pid, signal.SIGINT)
    assert (call.wait().status, saved_of("hangs")) == (130, 0)
    piezobench.run(*words, "--name", "second")


@TWO_CORES
def test_a_dask_cluster_of_two_machines_gives_the_rows_of_a_local_race_repeatedly_and_each_row_names_its_machine(
    piezobench: CommandLine, tmp_path: Path, clean_race: Race, scheduler: str
) -> None:
    for folder in ("first", "second"):  # the cluster's workers have released the cores of the first race
        run = raced_by_two(piezobench, tmp_path / folder, "--backend", "dask", "--scheduler", scheduler)
        same_but_for_times_and_hosts(run, clean_race)
        hosts = [host for host, _ in hosts_and_cores(run)]
        assert sorted(hosts) in ([*MACHINES], 2 * [os.uname().nodename])
        rows = run.rows()
        assert {*rows.host} == {*hosts}
        assert len({*zip(rows.host, commits(run), strict=True)}) == commits(run).nunique() == 2


@pytest.mark.slow
@TWO_CORES
def test_the_workers_of_a_host_have_the_cores_of_all_of_them() -> None:
    distributed = library("distributed")
    first, second = cores.usable()[:2]
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        addresses = [*client.scheduler_info()["workers"]]
        for address, core in zip(addresses, (first, second), strict=True):
            client.run(lambda core: os.sched_setaffinity(os.getpid(), {core}), core, workers=[address])
        check_cores(client, cluster.scheduler_address)
        client.run(lambda: os.sched_setaffinity(os.getpid(), {first}), workers=addresses)
        with pytest.raises(RaceError, match=r"2 Dask workers on .* need a core each, and they have 1; start fewer"):
            check_cores(client, cluster.scheduler_address)


@pytest.mark.slow
def test_a_missing_scheduler_is_one_sentence(piezobench: CommandLine, tmp_path: Path) -> None:
    library("distributed")
    call = piezobench("race", *SMALL, "--out", tmp_path, "--backend", "dask", "--scheduler", "tcp://127.0.0.1:9")
    assert "there is no Dask scheduler at tcp://127.0.0.1:9" in call.refusal
