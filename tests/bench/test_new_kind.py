"""A new kind of race is one new folder and nothing else: a toy beside the others races, stops, resumes and reports."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import bench

WORKER = '''
"""What runs in a solver's process: toss a coin."""
from dataclasses import dataclass

from bench.passed.outcome import Outcome
from bench.passed.request import Request


@dataclass(frozen=True)
class Toss(Request):
    number: int

    def answer(self, cls, first):
        return Outcome(found=self.number % 2 == 0, solver_status=cls.name)
'''
KIND = '''
"""The toy race: its table, settings, run and report, and the ``KIND`` that registers it."""
from dataclasses import dataclass

import pyarrow as pa

from bench.passed.row import who
from bench.passed.task import Task
from bench.processes.line_up import LineUp
from bench.races.field import checked, field_of
from bench.races.kind import Kind
from bench.races.settings import RaceSettings, option, settings_of
from bench.races.toy.worker import Toss
from bench.report.report import Report, Table
from bench.store import Schema
from solvers import Tier

TOY = Schema("toy.parquet", ("solver", "lane", "repeat", "status", "heads"), ("solver", "repeat"), types={"heads": pa.bool_()})


@dataclass(frozen=True)
class ToySettings(RaceSettings):
    tosses: int = option(3, "Tosses of each solver.")


def race(run, progress, workers):
    settings = settings_of(run, ToySettings)
    with LineUp(checked(settings), settings.limits, None) as line_up:
        for solver in field_of(run, line_up.children.values()):
            for number in range(settings.tosses):
                task = Task("toy", "coin", "scaled", solver.name, solver.lane, (Tier.DEFAULT,), repeat=number)
                if not run.is_done(task):
                    outcome = line_up.children[solver.name, solver.lane].ask(Toss(number))
                    run.save(task, {**who(task, 1), "status": outcome.solver_status, "heads": outcome.found}, {})
                    if (run.path.parent / "stop").exists():
                        raise OSError("the coin rolled away")


def report(run):
    rows = run.rows(TOY)
    return Report([f"{rows.heads.sum()} of {len(rows)} tosses show heads."],
                  Table("Tosses", ("solver", "toss", "heads"), rows[["solver", "repeat", "heads"]].astype(str).values.tolist()), rows,
                  definitions=["heads: the even tosses."])


KIND = Kind("toy", "Toy race", "tosses of a coin", TOY, ToySettings, race, report, own_problems=True)
'''


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as it is, by links, and the toy's folder beside those of the other races."""
    root, real = tmp_path_factory.mktemp("root"), Path(bench.__file__).parent
    (root / "bench" / "races" / "toy").mkdir(parents=True)
    for source in (*real.iterdir(), *(real / "races").iterdir()):
        target = root / "bench" / source.relative_to(real)
        if not target.exists():
            target.symlink_to(source)
    toy = root / "bench" / "races" / "toy"
    for name, text in {"__init__.py": "", "worker.py": WORKER, "kind.py": KIND}.items():
        (toy / name).write_text(text)
    return root


def piezobench(root: Path, *words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "bench", *map(str, words)], cwd=root, capture_output=True, text=True, check=False)


def test_a_new_folder_races_stops_resumes_and_reports(root: Path) -> None:
    (root / "stop").touch()
    run = root / "run"
    asked = ("race", "--race", "toy", "--tosses", 4, "--solver", "daqp", "--lane", "direct", "--out", root, "--name", "run")
    stopped = piezobench(root, *asked)
    assert stopped.returncode == 2, stopped.stderr
    assert "the coin rolled away; what is done is kept" in stopped.stderr
    assert len(list((run / "tasks").glob("*.npz"))) == 1
    (root / "stop").unlink()
    resumed = piezobench(root, "resume", run)
    assert resumed.returncode == 0, resumed.stderr
    assert "2 of 4 tosses show heads." in resumed.stdout
    rows = pd.read_parquet(run / "toy.parquet")
    assert rows["repeat"].tolist() == [0, 1, 2, 3]
    assert set(rows.status) == {"daqp"}
    for name, said in (("report.md", "# Toy race run"), ("report.html", "Toy race run"), ("summary.csv", "daqp")):
        assert said in (run / name).read_text()


def test_the_options_of_a_new_kind_are_those_of_its_race_alone(root: Path) -> None:
    refused = piezobench(root, "race", "--race", "loop", "--tosses", 4)
    assert refused.returncode == 2
    assert "only a toy has tosses; ask for --race toy" in refused.stderr
