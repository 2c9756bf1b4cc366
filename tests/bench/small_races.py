"""Small races that tests share, what they need of a cluster, and changed copies of them."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import faulty_solvers
import hostile_files
import pandas as pd
import pytest
from command_line import CommandLine, Finished, in_process
from programs import library

from bench.derived.measurements import Measurements
from bench.messages.task import Row
from bench.store import Run
from bench.timing import cores

TWO_CORES = pytest.mark.skipif(len(cores.usable()) < 2, reason="two workers need two cores")
REFERENCE = Path(__file__).parents[2] / "results" / "reference"
"""The committed run."""
DASK = str(Path(sys.executable).with_name("dask"))
MACHINES = ("stage-one", "stage-two")
"""Host names of the machines of the cluster."""


Change = Callable[[pd.DataFrame], pd.DataFrame]


@dataclass(frozen=True)
class Race:
    run: Run
    rows: pd.DataFrame
    call: Finished

    @cached_property
    def found(self) -> Measurements:
        """Derived measurements."""
        return Measurements(self.rows, self.run.times())

    @property
    def hot(self) -> pd.DataFrame:
        """The rows of the first pass and of warm starts."""
        return self.rows[self.rows.timed == "hot"]

    def copied(
        self, folder: Path, rows: Change = lambda rows: rows, times: Change = lambda times: times, **noted: object
    ) -> Run:
        """A copy of the run with changed rows, their times, and notes in ``run.json`` or on the ``machine``."""
        shutil.copytree(self.run.path, folder)
        changed_rows, changed_times = rows(self.rows.copy()), times(self.run.times())
        changed_rows.to_parquet(folder / "rows.parquet")
        changed_times[changed_times.task.isin(changed_rows.task)].to_parquet(folder / "times.parquet")
        hostile_files.change_machine(folder, **noted.pop("machine", {}))
        settings = json.loads((folder / "run.json").read_text())
        merged = {name: {**settings[name], **new} if isinstance(new, Mapping) else new for name, new in noted.items()}
        (folder / "run.json").write_text(json.dumps({**settings, **merged}))
        return Run.open(folder)

    def unfinished(self, folder: Path, **settings: object) -> Run:
        """A copy of the run before its first task, with other settings."""
        run = self.copied(folder, settings=settings)
        (run.path / "rows.parquet").unlink()
        (run.path / "parts").mkdir()
        return run


def checkout(folder: Path) -> Path:
    """A folder with a commit of its own, which is named as the folder."""
    folder.mkdir()
    commit = ("-c", "user.name=A", "-c", "user.email=a@b.c", "commit", "-q", "--allow-empty", "-m", folder.name)
    for words in (("init", "-q"), commit):
        subprocess.run(["git", *words], cwd=folder, check=True)
    return folder


def commit_of(folder: Path) -> str:
    """The commit of a checkout."""
    return subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=folder, text=True).strip()


def commits(run: Run) -> pd.Series:
    """The commit that made each row."""
    return run.rows().machine.map({key: made["environment"]["commit"] for key, made in run.machines.items()})


SMALL = (
    "--set",
    "paper",
    "--limit",
    1,
    "--budget",
    0.002,
    "--lane",
    "direct",
    "--solver",
    "daqp",
    "--solver",
    "osqp",
    "--time-limit",
    4,
    "--memory",
    512,
    "--rounds",
    8,
)
THIRD = ("--solver", "clarabel")
WIDE = ("bouc_wen-staircase", "duhem-multi_sine", "d008", "d018")


def saved(run: Run) -> dict[str, Row]:
    """The row of each finished task, during the race."""
    return {key: row for part in run.parts() for key, row in part.rows.items()}


def race_of(out: Path, name: str, *words: object, command: Callable[..., Finished] = in_process) -> Race:
    """A finished one-shot race with these options. Those in this process share one server of the solvers' processes;
    each of the others would import every library again."""
    call = command("race", "--out", out, "--name", name, *words)
    assert call.status == ("\nWrong: " in call.stdout), (call.stdout, call.stderr)
    run = Run.open(out / name)
    return Race(run, run.rows(), call)


def raced(out: Path, name: str, *words: object) -> Race:
    """A small one-shot race with further options."""
    return race_of(out, name, *(SMALL[2:] if "--set" in words else SMALL), *words)


@pytest.fixture(scope="session")
def clean_race(tmp_path_factory: pytest.TempPathFactory) -> Race:
    """Three honest solvers on one problem."""
    race = raced(tmp_path_factory.mktemp("clean"), "clean", *THIRD)
    # The settings of three solvers (3, 8 and 9) on scaled data, their defaults on raw data, and the floor on both.
    assert len(race.hot) == 25
    return race


@pytest.fixture(scope="session")
def faulty_race(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    """Two honest solvers among solvers with every fault, in a process whose output is all kept."""
    folder = tmp_path_factory.mktemp("faulty")
    return race_of(
        folder,
        "faulty",
        *SMALL,
        *(word for path in faulty_solvers.write_all(folder) for word in ("--solver", path)),
        command=piezobench,
    )


@pytest.fixture(scope="session")
def wide_race(tmp_path_factory: pytest.TempPathFactory) -> Race:
    """Solvers in three lanes on two problems of two sets, and the paper's method."""
    return raced(
        tmp_path_factory.mktemp("wide"),
        "wide",
        "--set",
        "paper",
        "--set",
        "orders",
        *(word for name in WIDE for word in ("--problem", name)),
        "--lane",
        "kernel",
        "--lane",
        "qpsolvers",
        "--solver",
        "box_active_set",
        "--solver",
        "projected_difference",
    )


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A cluster of two machines as a user starts it: a scheduler, and a worker under its nanny in a process that has
    another host name, where the system allows that."""
    library("distributed")
    folder = tmp_path_factory.mktemp("cluster")
    environment = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": os.pathsep.join(sys.path)}
    file, processes = folder / "scheduler.json", []
    own_name = ("unshare", "--map-root-user", "--uts", "sh", "-c", 'hostname $0 && exec "$@"')
    names = (
        MACHINES if subprocess.run([*own_name, "one", "true"], check=False, capture_output=True).returncode == 0 else ()
    )
    with (folder / "log").open("w") as log:

        def start(*words: str, cwd: Path = folder) -> None:
            processes.append(subprocess.Popen(words, cwd=cwd, env=environment, stdout=log, stderr=log))

        start(DASK, "scheduler", "--no-dashboard", "--port", "0", "--host", "127.0.0.1", "--scheduler-file", str(file))
        for number in range(2):
            start(
                *((*own_name, names[number]) if names else ()),
                *(DASK, "worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard"),
                *("--local-directory", str(folder)),
                cwd=checkout(folder / MACHINES[number]),
            )
        from distributed import Client

        with Client(scheduler_file=str(file), timeout="60s") as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        yield address
        for process in reversed(processes):
            process.terminate()
            process.wait()
