"""The batch race, with real contestants in real processes; no test depends on the speed of the machine."""

import json
import re
import shutil
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from programs import that_load
from small_races import assert_harmless, killed_and_resumed

from bench.messages.task import silent
from bench.races.batch import report
from bench.races.batch.contestant import WARM_UP, Batched, BatchRequest, Contestant, Families
from bench.races.batch.race import BATCH, SKIPPED, BatchRace, BatchSettings, Programs, skip_reason, task_of
from bench.races.kind import kinds
from bench.store import Run
from bench.timing import cores
from bench.timing.clock import Effort
from solvers import BoxBatch, find
from solvers.registry import OURS

TINY = ("--race", "batch", "--limit", 2, "--largest", 4, "--repeats", 1, "--budget", 0.001)
FIELD = ("box_batch", "box_active_set", "daqp", *that_load("proxsuite"))
LIAR = '''
"""Answers zero, and aborts on a large batch."""
import os
import numpy as np
from bench.races.batch.contestant import Contestant


class Liar(Contestant):
    algorithm, licence, distribution = "none", "MIT", "liar"

    def solve(self, P, q, lb, ub):
        if len(q) == 4:
            os.abort()
        return np.zeros(q.shape)
'''


@pytest.fixture(scope="module")
def raced(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A tiny race that was killed in the middle and resumed."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "liar.py").write_text(LIAR)
    words = [word for name in (*FIELD, folder / "liar.py") for word in ("--solver", name)]
    run = Run(folder / "run")
    resumed = killed_and_resumed(piezobench, run, "rows", 3, "race", *TINY, *words, "--out", folder, "--name", "run")
    assert "solves" in resumed.call.stdout
    rows = run.rows(BATCH).set_index("task")
    for task, row in resumed.kept.items():
        (before,) = json.loads(str(row))
        assert rows.loc[task].cpu_us_p50 == before["cpu_us_p50"] or before["status"] == "crashed"
    return run


def test_every_contestant_has_a_row_for_each_batch_and_repeat(raced: Run) -> None:
    rows = raced.rows(BATCH)
    assert not rows.duplicated(["d", "solver", "lane", "threads", "batch", "repeat"]).any()
    one = rows[rows.threads == 1]
    assert one.groupby("solver").size().eq(2 * 2).all()
    assert set(one.solver) == {*FIELD, "liar"}
    ours = rows[rows.solver.isin(OURS)]
    assert set(ours.solver) == {"box_batch", "box_active_set"}
    assert (ours.status == "ok").all()
    assert (ours.share_high == 1.0).all()
    assert (ours.judged > 0).all()
    assert (ours.cpu_us_p50 > 0.0).all()


def test_wrong_answers_are_missed_and_a_contestant_that_crashed_gets_no_larger_batch(raced: Run) -> None:
    liar = raced.rows(BATCH).query("solver == 'liar'")
    small, large = liar[liar.batch < 4], liar[liar.batch == 4]
    assert (small.status == "missed").all()
    assert (small.share_low == 0.0).all()
    assert set(large.status) == {"crashed"}
    table = report.summary(raced.rows(BATCH))
    assert set(report.everywhere_right(table).solver) >= {"box_batch", "box_active_set"}
    assert "liar" not in set(report.everywhere_right(table).solver)
    assert "liar" not in " ".join(report.verdict(table))


def test_the_report_begins_with_our_solver_beside_the_best_other_and_lists_every_contestant(raced: Run) -> None:
    found, path = kinds()["batch"].write(raced)
    for sentence, d in zip(found.verdict, (18, 60), strict=False):
        assert re.match(rf"At d = {d} box_(batch|lanes|active_set)† solves ", sentence)  # whichever is the fastest here
        assert "the best other with equally accurate answers" in sentence
    several = [sentence.startswith("With a thread on each of ") for sentence in found.verdict[2:]]
    assert several == [True] * (len(cores.usable()) > 1)
    text = path.read_text(encoding="utf-8")
    assert "![Programs per second and core by batch size](batch.svg)" in text
    assert "| 60 | liar | direct | 1 | 4 | crashed |" in text
    assert "<svg" in (raced.path / "batch.svg").read_text(encoding="utf-8")
    lines = found.figures[0].data
    assert lines[lines.name == "box_batch†"].groupby("view").size().to_dict() == {"d = 18": 2, "d = 60": 2}


def test_a_race_in_which_every_answer_is_right_has_a_report_without_misses(raced: Run, tmp_path: Path) -> None:
    copy = Run(shutil.copytree(raced.path, tmp_path / "right"))
    rows = raced.rows(BATCH)
    rows[rows.status == "ok"].to_parquet(copy.path / BATCH.file)
    assert "Missed and skipped batches" not in kinds()["batch"].write(copy)[1].read_text(encoding="utf-8")


def test_a_batch_that_would_take_too_long_is_skipped_with_the_reason() -> None:
    before = {"status": "ok", "batch": 4, "wall_us_p50": 200_000.0, "message": ""}
    assert skip_reason(before, 16, 2.0) == "a batch of 16 would take 3.2 s, and the limit is 2 s"
    assert skip_reason(before, 16, 4.0) == ""
    assert skip_reason({**before, "status": SKIPPED, "message": "why"}, 64, 4.0) == "why"
    assert skip_reason({**before, "status": "crashed"}, 16, 4.0) == "the batch of 4 ended as crashed"


def row_of(run: Run, programs: Programs, judged: int, batch: int, repeat: int, outcome: Batched) -> dict[str, Any]:
    """The row of an outcome with ``judged`` judged answers."""
    race = BatchRace(run, BatchSettings(judged=judged), silent)
    race.programs = {18: programs}
    (row,) = race.rows(task_of(find("daqp", "direct"), 18, batch, 1, repeat), outcome)
    return row


def test_no_two_programs_are_alike_and_answers_are_judged_by_proven_optima(raced: Run) -> None:
    programs = Programs(raced, 18, 300, 0, 2, silent)
    P, q, lb, ub = programs.families.block(0, 300)
    assert len(np.unique(P.reshape(300, -1), axis=0)) == len(np.unique(q, axis=0)) == 300
    for part, whole in zip(programs.families.block(100, 200), (P, q, lb, ub), strict=True):
        np.testing.assert_array_equal(part, whole[100:200])
    x, _ = BoxBatch(18).solve(P, q, lb, ub)

    def judged(answers: np.ndarray) -> dict[str, float]:
        one = np.ones(1, dtype=np.int64)
        outcome = Batched(found=True, answers=answers, times={"wall": one, "cpu": one}, programs=one)
        return row_of(raced, programs, 16, 256, 1, outcome)

    assert judged(x[1:257])["share_high"] == 1.0
    assert judged(x[1:257])["judged"] == 16
    # each is the answer of the program before; to 1e-3 one in a hundred is right by chance
    assert judged(x[:256])["share_mid"] == 0.0
    spoiled = x[1:257].copy()
    spoiled[next(programs.judged(1, 257, 16))[0] - 1] += 1e-4
    assert judged(spoiled)["share_high"] == 15 / 16


class Later:
    """An answer whose conversion to an array takes half a millisecond."""

    def __init__(self, x: np.ndarray) -> None:
        self.x = x

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        time.sleep(5e-4)
        return self.x


class Notes(Contestant):
    """Answers lazily with q, and records that of each call."""

    algorithm, licence, distribution = "none", "MIT", "notes"
    given: ClassVar[list[list[float]]] = []

    def solve(self, P: np.ndarray, q: np.ndarray, lb: np.ndarray, ub: np.ndarray) -> Any:
        self.given.append(q[:, 0].tolist())
        return Later(q)


class Compiles(Notes):
    compiles = True


@pytest.fixture
def families() -> Families:
    """Programs of one variable, each with another q."""
    nothing = np.full((2, 1), np.inf)
    return Families(np.ones((2, 3, 1, 1)), np.arange(6.0).reshape(2, 3, 1), -nothing, nothing, (0,), 400 + WARM_UP)


def timed(cls: type[Notes], families: Families, size: int) -> Batched:
    cls.given.clear()
    outcome = BatchRequest(families, size, 100, 400, 1, Effort(1.0)).answer(cls, True)
    assert isinstance(outcome, Batched), outcome.message
    assert np.array_equal(outcome.answers, families.block(100, 100 + len(outcome.answers))[1])
    return outcome


@pytest.mark.parametrize(("cls", "size", "most"), [(Notes, 2, 2), (Notes, 100, WARM_UP), (Compiles, 100, 100)])
def test_a_contestant_warms_up_on_programs_that_are_not_timed(
    families: Families, cls: type[Notes], size: int, most: int
) -> None:
    timed(cls, families, size)
    first, *others = cls.given
    q = families.block(0, families.count)[1][:, 0]
    assert len({*q}) == families.count
    assert {*first} <= {*q[400:]}
    assert len(first) == most  # a contestant that compiles gets a batch of the full size
    assert {*np.concatenate(others)} <= {*q[100:400]}


def test_a_lazy_answer_is_computed_inside_its_time(families: Families) -> None:
    assert (timed(Notes, families, 100).times["wall"] >= 500_000).all()


def test_times_are_medians_of_the_groups_of_calls_and_of_the_repeats(raced: Run) -> None:
    programs, rows = Programs(raced, 18, 300, 0, 2, silent), []
    for repeat, ns in enumerate(([1000, 3000, 9000], [5000, 5000, 5000], [1000, 1000, 1000])):
        outcome = Batched(
            found=True,
            answers=np.zeros((3, 18)),
            times={"wall": 2 * np.array(ns), "cpu": np.array(ns)},
            programs=np.ones(3, dtype=np.int64),
        )
        rows.append(row_of(raced, programs, 1, 1, repeat, outcome))
    assert [row["cpu_us_p50"] for row in rows] == [3.0, 5.0, 1.0]
    line = report.summary(pd.DataFrame(rows)).iloc[0]
    assert (line.core_rate, line.rate) == (1e6 / 3.0, 1e6 / 6.0)


def test_an_unknown_contestant_is_refused(piezobench: CommandLine, tmp_path: Path) -> None:
    refusal = piezobench("race", "--race", "batch", "--solver", "clarabel", "--out", tmp_path / "results").refusal
    assert "there is no contestant 'clarabel'; known are box_active_set, box_batch, " in refusal
    refusal = piezobench(
        "race", "--race", "batch", "--solver", tmp_path / "none.py", "--out", tmp_path / "results"
    ).refusal
    assert "none.py: is not a file" in refusal
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("labels", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_no_text_of_a_batch_race_is_evaluated_in_its_report(
    piezobench: CommandLine, browser: Browser, raced: Run, tmp_path: Path, labels: bool
) -> None:
    assert_harmless(piezobench, browser, raced, BATCH, tmp_path, labels)
