"""``piezobench verify`` refuses a run whose accuracies do not follow from its stored answers, and a missed answer is
kept as a file from which it can be reproduced."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import in_process
from recording_files import text_file
from small_races import Race, race_of

from bench.derived.summary import misses
from bench.problem_files.miss import Miss
from bench.race_table import MISSES
from bench.races.runs import write
from bench.verification import TIMED
from solvers import Lane, get


def test_an_honest_run_agrees_in_every_row(clean_race: Race) -> None:
    said = in_process("verify", clean_race.run.path).stdout
    judged = re.match(rf"{len(clean_race.rows)} rows: (\d+) first and (\d+) timed answers were judged again", said)
    assert min(map(int, judged.groups())) > 0.8 * len(clean_race.rows)


def edited(**values: Callable[[pd.Series], object]) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A change of some columns in the row of an ordinary answer."""

    def change(rows: pd.DataFrame) -> pd.DataFrame:
        at = rows.index[(rows.solver == "osqp") & rows.is_default & (rows.timed == "hot")][0]
        for column, value in values.items():
            rows.at[at, column] = value(rows.loc[at])
        return rows

    return change


FORGOTTEN = {
    "timed_call": lambda row: -1,
    **dict.fromkeys(TIMED, lambda row: np.nan),
    **dict.fromkeys(MISSES.values(), lambda row: 0),
}


def with_answers_exchanged(rows: pd.DataFrame) -> pd.DataFrame:
    """The answers of the loosest and the tightest setting of a solver, exchanged."""
    loose, *_, tight = rows.index[(rows.solver == "osqp") & (rows.scaling == "scaled") & (rows.timed == "hot")]
    rows.at[loose, "answer"], rows.at[tight, "answer"] = rows.at[tight, "answer"], rows.at[loose, "answer"]
    return rows


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (edited(cost_gap=lambda row: row.cost_gap / 2.0), "its cost gap is"),
        (edited(violation=lambda row: row.violation + 1e-16), "its violation is"),
        (edited(weight_error=lambda row: row.weight_error + 1e-6), "its weight error is"),
        (edited(model_error_percent=lambda row: 0.0), "its model error percent is"),
        (edited(stage_excess=lambda row: 0.0), "its stage excess is"),
        (edited(timed_stage_excess=lambda row: 0.0), "its timed stage excess is"),
        (edited(timed_gap=lambda row: 0.0), "its timed gap is 0 in the run"),
        (edited(timed_gap=lambda row: np.nan), "its timed gap is nan in the run"),
        (edited(timed_answer=lambda row: row.timed_answer * (1.0 + 1e-9)), "its timed"),
        (edited(timed_shares=lambda row: np.roll(row.timed_shares, 1)), "its timed gap is"),
        (edited(timed_shares=lambda row: row.timed_shares[:-1]), "the draw of its timed answer does not fit"),
        (edited(misses_exact=lambda row: 0), "misses_exact is 0 of"),
        (edited(misses_low=lambda row: row.judged + 1), "judged answers to"),
        (edited(judged=lambda row: row.samples + 1), "judged answers to"),
        (edited(timed_call=lambda row: -1), "its timed gap is"),
        (edited(**FORGOTTEN), "its judged is"),
        (edited(**FORGOTTEN, judged=lambda row: 0), "its timed answers are missing"),
        (edited(digest=lambda row: "0" * 16), "its digest does not match the stored problem"),
        (edited(answer=lambda row: ()), "and nan from its answer"),
        (with_answers_exchanged, "its cost gap is"),
    ],
)
def test_a_run_whose_rows_were_edited_is_refused(
    clean_race: Race, tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], why: str
) -> None:
    run = clean_race.copied(tmp_path / "run", lambda rows: change(rows[rows.solver == "osqp"].copy()))
    assert re.search(
        f"{re.escape(str(run.path))} does not agree with its answers: .*{re.escape(why)}",
        in_process("verify", run.path).refusal,
    )


def change_a_bit(path: Path) -> None:
    arrays = dict(np.load(path))
    arrays["scaled/q"] = np.nextafter(arrays["scaled/q"], np.inf)
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("spoil", "why"), [(change_a_bit, "the certificate belongs to other data"), (Path.unlink, "is missing")]
)
def test_a_run_whose_problem_was_changed_in_one_bit_or_is_missing_is_refused(
    clean_race: Race, tmp_path: Path, spoil: Callable[[Path], None], why: str
) -> None:
    run = clean_race.copied(tmp_path / "run")
    spoil(*(run.path / "problems").glob("*.npz"))
    assert why in in_process("verify", run.path).refusal


SOMETIMES = '''"""A solver that is off by a thousandth on the paper's problems, and right on measured ones."""

from solvers.direct.daqp import Daqp


class Sometimes(Daqp):
    name = "sometimes"

    def solve(self, warm_start=None):
        x = super().solve(warm_start)
        return x if x.size == 19 else 1.001 * x
'''


NEVER = SOMETIMES.replace('"sometimes"', '"right"').replace("x if x.size == 19 else 1.001 * x", "x")


@pytest.fixture(scope="module")
def race(tmp_path_factory: pytest.TempPathFactory) -> Race:
    """A race in which a solver misses 1e-9 on two of four problems."""
    folder = tmp_path_factory.mktemp("misses")
    files = text_file(folder, SOMETIMES, name="sometimes.py"), text_file(folder, NEVER, name="right.py")
    words = (
        "--limit",
        2,
        "--set",
        "measured",
        "--set",
        "paper",
        "--scaling",
        "scaled",
        "--budget",
        0.01,
        "--rounds",
        0,
    )
    return race_of(
        folder,
        "run",
        *words,
        "--lane",
        "direct",
        *(word for solver in ("daqp", *files) for word in ("--solver", solver)),
    )


def test_each_lane_that_misses_some_problems_has_its_worst_miss_kept(race: Race) -> None:
    found = misses(race.found)
    assert set(found.problem_set[found.solver == "sometimes"]) == {"paper"}
    kept = {path.name for path in (race.run.path / "misses").iterdir()}
    assert {name.split("-")[0] for name in kept} == set(found.solver)
    assert len(kept) == len(found.drop_duplicates(["solver", "lane"]))


def test_the_printed_lines_reproduce_the_miss(
    race: Race, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solvers.registry._added", [])  # to which the lines add the solver of a file
    (line,) = re.findall(r"To solve the first again: (.*)$", (race.run.path / "report.md").read_text(), re.MULTILINE)
    solver = re.search(r"misses/(\w+)-direct", line)[1]
    assert re.findall(r"(\w+)\.py", line) == [solver] * (solver != "daqp")
    exec(compile(line.replace("\\", "").replace("&#39;", "'"), "report.md", "exec"), {})
    kept, again = map(float, capsys.readouterr().out.split())
    assert kept > 1e-9
    assert again == pytest.approx(kept, rel=0.5)


def test_a_kept_miss_has_the_judged_gap_and_a_solver_that_is_right_solves_it(race: Race) -> None:
    rows = race.rows.set_index("solver")
    for path in (race.run.path / "misses").iterdir():
        miss = Miss.load(path)
        worst = rows.loc[[miss.solver], ["cost_gap", "timed_gap"]].to_numpy()
        assert np.isclose(miss.gap(miss.x), worst, rtol=1e-3, atol=1e-12).any()
        assert abs(miss.gap(miss.solve(get("daqp", lane=Lane.DIRECT)))) < 1e-9


def test_no_misses_are_kept_if_none_are_wanted(race: Race, tmp_path: Path) -> None:
    run = race.copied(tmp_path / "run", settings={"keep_misses": 0})
    shutil.rmtree(run.path / "misses")
    write(run)
    assert not (run.path / "misses").exists()
