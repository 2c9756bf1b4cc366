"""The rows of a one-shot race: every setting of a ladder on scaled data, the default on raw data, and the end of a
ladder."""

import json
from collections import Counter
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import faulty_solvers
import numpy as np
import pytest
from command_line import in_process
from measured_rows import form_of
from small_races import Race, race_of, saved

from bench.messages.task import PAPER, settings_ladder
from bench.problems.protocol import RaceProblem
from bench.races.race import EXPONENT, first_pass_settings, tasks_of
from bench.races.settings import RaceSettings
from solvers import Described, Lane, Problem, describe, find

LADDER = """
    @classmethod
    def ladder(cls, c):
        return tuple({"k": k} for k in (2, 4, 6, 8, 10))
"""
ENDS = {
    "crashes": "os._exit(3)",
    "hangs": "time.sleep(1000)",
    "lingers": "time.sleep(0.25)",
    "goes_on": "time.sleep(0.12)",
    "fails": "1 / 0",
}
"""The behaviour of a solver from its third setting on."""
STATUS = {
    "crashes": "crashed",
    "hangs": "timed_out",
    "lingers": "answered",
    "goes_on": "answered",
    "fails": "adapter_failed",
}


def with_ladder(folder: Path, name: str) -> Path:
    """A solver of five settings that logs those that it runs with."""
    note = "open(__file__ + '.log', 'a').write(str(self.settings.get('k', 0)) + ' ')"
    ends = f"self.settings.get('k', 0) >= 6 and {ENDS[name]}"
    return faulty_solvers.written(folder, name, "solve(self)", f"{note}; {ends}", LADDER)


def logged(folder: Path, name: str) -> set[int]:
    """The settings that it logged."""
    return set(map(int, (folder / f"{name}.py.log").read_text().split()))


WORDS = (
    "--set",
    "paper",
    "--limit",
    1,
    "--scaling",
    "scaled",
    "--budget",
    0.002,
    "--lane",
    "direct",
    "--solver",
    "daqp",
    "--rounds",
    0,
    "--time-limit",
    2,
)


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Race:
    """A race of solvers whose ladders end."""
    folder = tmp_path_factory.mktemp("ended")
    return race_of(
        folder,
        "run",
        *WORDS,
        *(word for name in ENDS for word in ("--solver", with_ladder(folder, name))),
    )


def names(race: Race) -> list[tuple[str, str, str, str, str]]:
    """Keys of the rows."""
    return [*race.hot[["scaling", "solver", "lane", "setting", "start"]].itertuples(index=False, name=None)]


def test_every_setting_is_measured_on_scaled_data_and_only_the_defaults_of_a_library_on_raw(clean_race: Race) -> None:
    expected = {("scaled", "null", "direct", "{}", "cold"), ("raw", "null", "direct", "{}", "cold")}
    for name in ("daqp", "osqp", "clarabel"):
        for setting in settings_ladder(describe(find(name, "direct"))):
            scalings = ("scaled", "raw") if setting.is_default else ("scaled",)
            expected |= {(scaling, name, "direct", setting.text, "cold") for scaling in scalings}
    assert sorted(names(clean_race)) == sorted(expected)
    rows = clean_race.hot
    assert rows[rows.solver != "null"].groupby(["scaling", "solver"]).is_default.sum().eq(1).all()
    assert rows.solve_us_p50.notna().all()


def test_a_row_has_its_setting_for_the_constant_one_and_for_the_constant_of_its_problem(
    clean_race: Race,
) -> None:
    row = clean_race.rows.query("solver == 'clarabel' and rung == 2 and scaling == 'scaled'").iloc[0]
    c = clean_race.run.problem("paper", row.problem).forms["scaled"].unit
    named, given = (json.loads(text)["tol_gap_abs"] for text in (row.setting, row.settings))
    assert (named, given) == (1e-8, pytest.approx(c * 1e-8))
    assert c != 1.0


@pytest.mark.parametrize("name", ENDS)
def test_a_crash_a_timeout_and_an_answer_of_more_than_a_tenth_of_the_limit_end_a_ladder_and_nothing_else_does(
    ended: Race, name: str
) -> None:
    rows = ended.rows[ended.rows.solver == name].sort_values("rung")
    assert rows.rung.tolist() == [-1, 0, 1, 2, 3, 4]
    goes_on = name in ("goes_on", "fails")
    assert [*rows.status] == ["answered"] * 3 + [STATUS[name], *[STATUS[name] if goes_on else "not_run"] * 2]
    assert logged(ended.run.path.parent, name) == ({0, 2, 4, 6, 8, 10} if goes_on else {0, 2, 4, 6})
    behind = rows[rows.status == "not_run"]
    assert behind[["cost_gap", "solve_us_p50"]].isna().all(axis=None)
    why = "took longer than 0.2 s" if name == "lingers" else f"ended with {STATUS[name]}"
    assert behind.message.str.contains(f"a looser setting {why} on this problem").all()


def test_skipped_settings_are_chosen_for_no_tier_and_are_no_failure_in_the_report(ended: Race) -> None:
    settings, report = ended.found.settings, (ended.run.path / "report.md").read_text()
    assert settings.set_index(["solver", "tier"]).setting["crashes", "high"] == '{"k": 2}'
    assert ("exit status 3" in report, "a looser setting" in report) == (True, False)


def test_a_race_killed_in_a_ladder_that_ended_resumes_after_that_end_and_has_the_same_rows(
    tmp_path: Path, ended: Race
) -> None:
    files = [with_ladder(tmp_path, name) for name in ("crashes", "goes_on")]
    run = ended.unfinished(tmp_path / "run", solver_files=[*map(str, files)])
    both = ended.rows[ended.rows.solver.isin(["crashes", "goes_on", "daqp", "null"])]
    part = run.part(f"paper--{both.problem.iloc[0]}--scaled--0")
    with part.appended():  # as if it had been killed just before the first that was not run
        for row in takewhile(lambda row: row["status"] != "not_run", both.to_dict("records")):
            part.save(row, {})
    assert sum(key.startswith("crashes-") for key in saved(run)) == 4
    (tmp_path / "crashes.py.log").write_text("")
    done = in_process("resume", run.path, *(word for file in files for word in ("--solver", file)))
    assert done.status == 1, "one of its own solvers crashes"
    assert logged(tmp_path, "crashes").isdisjoint({6, 8, 10})
    resumed = Race(run, run.rows(), done)
    assert (names(resumed), [*resumed.rows.status]) == (names(replace(ended, rows=both)), [*both.status])


def test_wrappers_are_measured_at_their_defaults_and_at_the_setting_nearest_to_1e_8(wide_race: Race) -> None:
    rows = wide_race.rows[wide_race.rows.lane == "qpsolvers"]
    assert set(rows.solver) >= {"daqp", "osqp"}
    for (_, scaling), part in rows.groupby(["solver", "scaling"]):
        settings = 2 if scaling == "scaled" else 1
        assert (part.rung.nunique(), set(part.problem)) == (settings, set(wide_race.rows.problem))
    assert set(rows[(rows.solver == "osqp") & (rows.scaling == "scaled")].rung) == {-1, 2}


def problem_of_one(name: str, line: bool = False) -> RaceProblem:
    """A problem of one variable, with the start of a straight line if ``line``."""
    starts = {"line": np.ones(1)} if line else {}
    qp = Problem(np.eye(1), np.ones(1), lb=np.zeros(1))
    return RaceProblem("paper", name, {"scaled": form_of(qp, starts=starts)})


def described(name: str, lane: str, count: int = 8) -> Described:
    """A solver with a ladder, one exponent a rung."""
    ladder = tuple({"eps": 10.0 ** -(2 * i + 1)} for i in range(count))
    return Described(name, Lane(lane), "", "", "", False, ladder, {}, tuple(2.0 * i + 1 for i in range(count)))


def test_a_wrapper_has_the_looser_of_two_near_settings_others_all_and_a_default_on_the_ladder_counts_once() -> None:
    assert EXPONENT == 8.0
    assert [setting.rung for setting in first_pass_settings(described("a", "qpsolvers"))] == [-1, 3]
    assert [setting.rung for setting in first_pass_settings(described("a", "direct"))] == [-1, *range(8)]
    without = Described("a", Lane.QPSOLVERS, "", "", "", False, ({"eps": 1e-2}, {"eps": 1e-8}))
    assert [setting.rung for setting in first_pass_settings(without)] == [-1, 0, 1]
    ours = describe(find("box_active_set", "kernel"))
    assert [(setting.text, setting.rung, setting.is_default) for setting in settings_ladder(ours)] == [("{}", 0, True)]
    raw = tasks_of(RaceSettings(scalings=("raw",)), [described("a", "direct")], problem_of_one("p"), "raw")
    assert [task.setting.rung for task in raw] == [-1, *range(8)]  # raw data alone are the first scaling


def test_every_lane_is_measured_on_every_problem_and_the_papers_method_also_from_the_straight_line() -> None:
    field = [described("a", "cvxpy"), described("a", "qpsolvers"), described(PAPER, "direct")]
    problems = [problem_of_one(f"p{i}", line) for i, line in enumerate((True, False))]
    tasks = [task for problem in problems for task in tasks_of(RaceSettings(), field, problem, "scaled")]
    assert Counter((task.lane, task.problem) for task in tasks if task.setting.is_default and task.start == "cold") == {
        (lane, problem.name): 1 for lane in (Lane.CVXPY, Lane.QPSOLVERS, Lane.DIRECT) for problem in problems
    }
    at_line = [(task.solver, task.problem, task.setting.rung) for task in tasks if task.start == "line"]
    assert at_line == [(PAPER, "p0", rung) for rung in (-1, *range(8))]


def test_given_settings_are_raced_beside_the_defaults_in_place_of_the_ladder(
    tmp_path: Path,
) -> None:
    given = """osqp={"eps_abs": 1e-6, "eps_rel": 0.0, "max_iter": 100000}"""
    few = (
        "--limit",
        2,
        "--set",
        "measured",
        "--scaling",
        "scaled",
        "--budget",
        0.002,
        "--rounds",
        4,
        "--lane",
        "direct",
    )
    race = race_of(tmp_path, "run", *few, "--solver", "osqp", "--solver", "daqp", "--settings", given)
    rows = race.hot.query("solver == 'osqp'")
    measured = {*rows[["rung", "is_default", "status"]].itertuples(index=False, name=None)}
    assert measured == {(-1, True, "answered"), (0, False, "answered")}
    assert all(json.loads(text) == json.loads(given[5:]) for text in rows[rows.rung == 0].settings)
    assert race.hot[race.hot.solver == "daqp"].setting.nunique() == 3
