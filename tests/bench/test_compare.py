"""Comparisons of runs: a run with itself, with one in which a solver was slowed, with a copy in which something changed."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import slowed_solver
from browser import Browser
from command_line import CommandLine
from conftest import Race
from programs import that_load

from bench.comparison import page as comparison
from bench.comparison.compare import RunComparison, compare_runs
from bench.comparison.levels import NAMES
from bench.comparison.lines import CHANGES
from bench.comparison.tiers import LOST
from bench.derived.table import ONESHOT
from bench.store import Run, RunError
from solvers import Status, Tier

Change = Callable[[Path], None]
SLOWED = ("osqp", "direct")
EVIL = "<script>document.title='run'</script>|`x`"


def copied(race: Race, folder: Path, change: Change) -> Run:
    shutil.copytree(race.run.path, folder)
    change(folder)
    return Run.open(folder)


def of_solver(rows: pd.DataFrame) -> pd.Series:
    return (rows.solver == SLOWED[0]) & (rows.lane == SLOWED[1])


def times_longer(folder: Path, which: Callable[[pd.DataFrame], pd.Series], factor: float) -> None:
    rows, times = pd.read_parquet(folder / "rows.parquet"), pd.read_parquet(folder / "times.parquet")
    tasks = set(rows[which(rows)].task)
    times["ns"] = [np.round(factor * ns).astype(np.int64) if task in tasks else ns for task, ns in zip(times.task, times.ns, strict=True)]
    times.to_parquet(folder / "times.parquet")


def slower(folder: Path) -> None:
    """Every time of one solver lane 20 % longer."""
    times_longer(folder, of_solver, 1.2)


def slower_all(folder: Path) -> None:
    """Every time of every solver 50 % longer, and of the fixed piece of work none."""
    times_longer(folder, lambda rows: rows.solver != "", 1.5)


def less_accurate(folder: Path) -> None:
    rows = pd.read_parquet(folder / "rows.parquet")
    rows.loc[of_solver(rows), "cost_gap"] = 1e6
    rows.to_parquet(folder / "rows.parquet")


def crashed(folder: Path) -> None:
    rows = pd.read_parquet(folder / "rows.parquet")
    rows.loc[of_solver(rows), ["status", "cost_gap"]] = [str(Status.CRASHED), np.nan]
    rows.to_parquet(folder / "rows.parquet")


def without(folder: Path) -> None:
    rows = pd.read_parquet(folder / "rows.parquet")
    times = pd.read_parquet(folder / "times.parquet")
    times[~times.task.isin(list(rows[of_solver(rows)].task))].to_parquet(folder / "times.parquet")
    rows[~of_solver(rows)].to_parquet(folder / "rows.parquet")


def other_settings(folder: Path) -> None:
    noted = json.loads((folder / "run.json").read_text())
    noted["settings"]["seed"] = 7
    noted["machine"]["processor"] = "An abacus"
    noted["field"] = {**noted["field"], "daqp (direct)": "0.0.1"}
    (folder / "run.json").write_text(json.dumps(noted))


def evil(folder: Path) -> None:
    less_accurate(folder)
    rows = pd.read_parquet(folder / "rows.parquet")
    rows["problem"] += EVIL
    rows.to_parquet(folder / "rows.parquet")


def lost(found: RunComparison) -> pd.DataFrame:
    """The tiers that are lost otherwise than by chance."""
    return found.tiers[(found.tiers.change == LOST) & ~found.tiers.by_chance]


def count(found: RunComparison, kind: str) -> int:
    return int(found.rows.changes.map(lambda changes: kind in changes).sum())


def test_a_run_with_itself_shows_no_difference(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    path = wide_race.run.path
    call = piezobench("compare", path, path, path, "--out", tmp_path / "c", "--fail-on", "difference")
    assert call.status == 0, call.stderr
    assert call.stdout.count("no difference") == 2
    assert "WARNING" not in call.stdout


@pytest.fixture(scope="module")
def slowed_races(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two races of a small field and a solver of one's own, which in the second one waits as long again as it works."""
    folder, words = tmp_path_factory.mktemp("slowed"), []
    for solver in ("daqp", "quadprog", "clarabel", "piqp", *that_load("proxsuite"), "qpalm", "scs", "osqp", "box_active_set"):
        words += ["--solver", solver]
    for name, factor in (("before", 1.0), ("after", 2.0)):
        call = piezobench("race", *words, "--solver", slowed_solver.write(folder / name, factor), "--lane", "direct", "--scaling",
                          "scaled", "--limit", 3, "--budget", 0.002, "--repeats", 2, "--name", name, "--out", folder / "runs")
        assert call.status == 0, call.stderr
    return folder / "runs" / "before", folder / "runs" / "after"


def test_a_solver_that_waits_as_long_as_it_works_is_found_between_two_races_and_no_other(
        piezobench: CommandLine, slowed_races: tuple[Path, Path], tmp_path: Path) -> None:
    before, after = slowed_races
    call = piezobench("compare", before, after, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 3, call.stdout
    assert re.search(r"slowed \(direct, in turns\) is slower: [12]\.\d\d times as long", call.stdout)
    lines = compare_runs(Run.open(before), Run.open(after)).times.lines
    assert set(lines.solver[lines.finding.isin(CHANGES)]) == {"slowed"}
    (line,) = lines[(lines.solver == "slowed") & (lines.timed == "in turns")].itertuples()
    assert line.ratio_low < 2.0 < 1.2 * line.ratio_high  # the wait is as long as the work, and not as the call around it
    assert line.ratio > line.shown


def test_between_the_same_races_the_other_way_round_nothing_is_worse(
        piezobench: CommandLine, slowed_races: tuple[Path, Path], tmp_path: Path) -> None:
    words = ("compare", *reversed(slowed_races), "--out", tmp_path / "c", "--fail-on")
    assert piezobench(*words, "difference").status == 3
    assert piezobench(*words, "regression", "--smallest", 100).status == 0
    assert piezobench(*words, "regression", "--smallest", 1.001).status == 4
    assert "a ratio above 1" in piezobench(*words, "regression", "--smallest", 1).refusal


def test_where_all_solvers_are_slower_and_the_fixed_piece_of_work_is_not_it_says_so_and_cannot_tell(
        piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    other = copied(wide_race, tmp_path / "slow", slower_all)
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 4
    assert "In turns, the field as a whole changed by a factor of 1.50, and the fixed piece of work timed beside it by 1.00" in call.stdout


def test_a_solver_that_raced_alone_is_not_taken_for_the_machine_and_nothing_can_be_told_of_it(
        piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    def alone(folder: Path) -> None:
        rows, times = pd.read_parquet(folder / "rows.parquet"), pd.read_parquet(folder / "times.parquet")
        rows = rows[of_solver(rows) | (rows.solver == "null")]
        rows.to_parquet(folder / "rows.parquet")
        times[times.task.isin(list(rows.task))].to_parquet(folder / "times.parquet")

    before = copied(wide_race, tmp_path / "before", alone)
    after = copied(wide_race, tmp_path / "after", lambda folder: alone(folder) or slower(folder))
    call = piezobench("compare", before.path, after.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 4
    assert "too few to tell a change of the machine from a change of theirs" in call.stdout
    assert "In 1 of 1 solver lane a change by a factor of 1.2 may have gone unseen: osqp (direct" in call.stdout


def test_rows_without_times_are_said_to_be_left_out(wide_race: Race, tmp_path: Path) -> None:
    def few(folder: Path) -> None:
        rows, times = pd.read_parquet(folder / "rows.parquet"), pd.read_parquet(folder / "times.parquet")
        tasks = set(rows[of_solver(rows)].task)
        times["ns"] = [ns[:2] if task in tasks else ns for task, ns in zip(times.task, times.ns, strict=True)]
        times.to_parquet(folder / "times.parquet")

    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "few", few))
    assert found.changed.empty
    assert re.fullmatch(r"The times of (\d+) rows are not compared, since .*", found.verdict[-1])
    assert int(found.verdict[-1].split()[3]) >= of_solver(found.rows).sum()


def test_what_is_less_accurate_is_a_regression_and_loses_its_tiers(wide_race: Race, tmp_path: Path) -> None:
    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "worse", less_accurate))
    reached = found.tiers[of_solver(found.tiers) & (found.tiers.setting_a != "") & (found.tiers.tier != Tier.STAGE)]  # which has no cost gap
    assert count(found, "less accurate") == of_solver(found.rows).sum() > 0
    assert len(lost(found)) == len(reached) > 0
    assert found.regressions == of_solver(found.rows).sum() + len(reached)
    assert found.times.differ == 0
    assert any("osqp (direct) no longer reaches 1e-3" in sentence for sentence in found.verdict)
    assert any("less accurate" in sentence for sentence in found.verdict)


def test_what_has_no_answer_any_more_changed_its_status_and_is_a_regression(wide_race: Race, tmp_path: Path) -> None:
    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "crashed", crashed))
    assert count(found, "status changed") == of_solver(found.rows).sum() == found.regressions - len(lost(found))
    assert any("for example from ok to crashed" in sentence for sentence in found.verdict)


def test_a_tier_that_is_lost_by_timed_answers_on_one_problem_is_no_difference_and_noted(wide_race: Race, tmp_path: Path) -> None:
    def missed(folder: Path) -> None:
        rows = pd.read_parquet(folder / "rows.parquet")
        rows.loc[of_solver(rows) & (rows.problem == rows.problem.iloc[0]) & (rows.scaling == "scaled"), "timed_gap"] = 1.0
        rows.to_parquet(folder / "rows.parquet")

    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "missed", missed))
    assert found.tiers.by_chance.any()
    assert found.differences == found.regressions == 0
    assert f"by chance as far as can be told: {found.tiers.by_chance.sum()}." in found.notes[-1]


def test_settings_that_one_of_the_runs_did_not_run_are_not_compared(wide_race: Race, tmp_path: Path) -> None:
    def ended(folder: Path) -> None:
        rows = pd.read_parquet(folder / "rows.parquet")
        rows.loc[of_solver(rows) & (rows.rung > 1), ["status", "cost_gap"]] = [str(Status.NOT_RUN), np.nan]
        rows.to_parquet(folder / "rows.parquet")

    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "ended", ended))
    those = of_solver(wide_race.rows) & (wide_race.rows.rung > 1)
    assert len(found.rows) == len(wide_race.rows) - those.sum() < len(wide_race.rows)
    assert found.tiers[of_solver(found.tiers)].by_chance.any()
    assert found.regressions == 0


def test_repeats_of_a_measurement_are_one_row(slowed_races: tuple[Path, Path]) -> None:
    runs = [Run.open(path) for path in slowed_races]
    rows, raced = compare_runs(*runs).rows, [run.rows(ONESHOT) for run in runs]
    assert all(set(each.repeat) == {0, 1} for each in raced)
    first, second = (set(each.task[each.status != Status.NOT_RUN]) for each in raced)
    assert set(rows.task) == first & second  # what was run in any repeat of both
    assert not rows.duplicated(NAMES).any()
    assert set(rows.in_run) == {"both"}


def test_what_is_gone_is_a_regression_and_what_is_new_is_not(wide_race: Race, tmp_path: Path) -> None:
    fewer = copied(wide_race, tmp_path / "fewer", without)
    gone, new = compare_runs(wide_race.run, fewer), compare_runs(fewer, wide_race.run)
    assert gone.tiers[of_solver(gone.tiers)].empty
    assert count(gone, "gone") == gone.regressions == of_solver(wide_race.rows).sum()
    assert count(new, "new") == of_solver(wide_race.rows).sum()
    assert new.regressions == 0


def test_other_settings_and_another_machine_are_said_first(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    other = copied(wide_race, tmp_path / "elsewhere", other_settings)
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c")
    first, second, *_ = call.stdout.splitlines()
    assert first.startswith("WARNING: Different machines: processor")
    assert second == "WARNING: Different settings: seed is 0 in the first run and 7 in the second."
    assert "The solver daqp (direct) is" in call.stdout
    markdown = (tmp_path / "c" / "comparison.md").read_text()
    assert markdown.index("An abacus") < markdown.index("no difference")


def test_the_json_says_everything(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    other = copied(wide_race, tmp_path / "slow", slower)
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c", "--json")
    said, written = json.loads(call.stdout), json.loads((tmp_path / "c" / "comparison.json").read_text())
    assert said == written
    assert (said["format"], said["version"]) == ("piezobench-comparison", 3)
    (one,) = said["comparisons"]
    assert len(one["rows"]) == len(wide_race.rows)
    assert {tier["setting_a"] == tier["setting_b"] for tier in one["tiers"]} == {True}
    assert one["regressions"] == len({(line["solver"], line["lane"]) for line in one["lines"] if line["finding"] == "slower"}) == 1
    assert one["cannot_tell"] == compare_runs(wide_race.run, other).cannot_tell


def test_the_page_shows_what_differs_and_names_as_text(browser: Browser, wide_race: Race, tmp_path: Path) -> None:
    first = copied(wide_race, tmp_path / "<b>a", lambda folder: evil(folder) or slower(folder))
    second = copied(wide_race, tmp_path / "b", lambda folder: evil(folder) or less_accurate(folder))
    rows = pd.read_parquet(second.path / "rows.parquet")
    rows.loc[of_solver(rows), "cost_gap"] = 1e-5
    rows.to_parquet(second.path / "rows.parquet")
    found = compare_runs(first, second)
    page = comparison.write([found], tmp_path / "c")
    for width in ("desktop", "phone"):
        browser.open(page, width)
        assert browser.console() == []
        assert all(plot["marks"] > 0 for plot in browser.plots())
        browser.picture(f"comparison-{width}")
    assert browser.run("return document.title") == "Comparison of <b>a, b"
    assert browser.run("return document.querySelectorAll('main b').length") == 0
    assert EVIL in browser.run("return document.querySelector('main').textContent")
    table = [line for line in page.with_suffix(".md").read_text().splitlines() if line.startswith("|")]
    assert {line.count("|") for line in table} == {
        len(headings) + 1 for headings in (comparison.LINE_HEADINGS, comparison.TIER_HEADINGS, comparison.HEADINGS)}
    assert "<script>" not in page.with_suffix(".md").read_text()


def test_many_changes_of_a_kind_are_one_sentence(wide_race: Race, tmp_path: Path) -> None:
    def renamed(folder: Path) -> None:
        rows = pd.read_parquet(folder / "rows.parquet")
        rows["task"] += "'"
        rows["problem"] += "'"
        rows.to_parquet(folder / "rows.parquet")

    found = compare_runs(wide_race.run, copied(wide_race, tmp_path / "renamed", renamed))
    assert len(found.verdict) == 3
    assert f"solver lanes are gone in {len(wide_race.rows)} rows" in found.verdict[1]
    assert f"solver lanes are new in {len(wide_race.rows)} rows" in found.verdict[2]


def test_one_run_alone_cannot_be_compared(piezobench: CommandLine, wide_race: Race) -> None:
    assert "two runs or more" in piezobench("compare", wide_race.run.path).refusal


def test_runs_of_another_kind_are_refused(wide_race: Race, tmp_path: Path) -> None:
    def stream(folder: Path) -> None:
        (folder / "run.json").write_text(json.dumps({**json.loads((folder / "run.json").read_text()), "race": "stream"}))
    with pytest.raises(RunError, match="only one-shot races"):
        compare_runs(wide_race.run, copied(wide_race, tmp_path / "stream", stream))
