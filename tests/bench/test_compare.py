"""Comparisons of a run with itself, with a run in which one solver is slower, and with changed copies."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import slowed_solver
from browser import Browser
from command_line import CommandLine
from conftest import Change, Race
from programs import that_load

from bench.comparison import report as comparison
from bench.comparison.compare import CANNOT_TELL, FASTER, NAMES, SAME, SLOWER, Comparison, compare_runs
from bench.messages.verdict import Status
from bench.store import Run, RunError

SLOWED = ("osqp", "direct")


def of_solver(rows: pd.DataFrame) -> pd.Series:
    return (rows.solver == SLOWED[0]) & (rows.lane == SLOWED[1])


def slowed(race: Race, factor: float, which: Callable[[pd.DataFrame], pd.Series] = of_solver) -> Change:
    """Multiply every time of some solver lanes."""
    tasks = set(race.rows[which(race.rows)].task)
    return lambda times: times.assign(
        ns=[
            np.round(factor * ns).astype(np.int64) if task in tasks else ns
            for task, ns in zip(times.task, times.ns, strict=True)
        ]
    )


def less_accurate(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(cost_gap=rows.cost_gap.mask(of_solver(rows), 1e6))


def without(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[~of_solver(rows)]


def changed(found: Comparison) -> set[tuple[str, str]]:
    """Solver lanes that became slower or faster."""
    those = found.times[found.times.finding.isin([SLOWER, FASTER])]
    return set(zip(those.solver, those.lane, strict=True))


def test_a_run_with_itself_shows_no_difference(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    path = wide_race.run.path
    call = piezobench.run("compare", path, path, path, "--out", tmp_path / "c", "--fail-on", "difference")
    assert call.stdout.count("no difference in") == 2
    assert "WARNING" not in call.stdout


@pytest.fixture(scope="module")
def slowed_races(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two races of a few solvers and of one that takes three times as long in the second race."""
    folder, words = tmp_path_factory.mktemp("slowed"), []
    for solver in (
        "daqp",
        "quadprog",
        "clarabel",
        "piqp",
        *that_load("proxsuite"),
        "qpalm",
        "scs",
        "osqp",
        "box_active_set",
    ):
        words += ["--solver", solver]
    for name, factor in (("before", 1.0), ("after", 3.0)):
        piezobench.run(
            "race",
            *words,
            "--solver",
            slowed_solver.write(folder / name, factor),
            "--lane",
            "direct",
            "--scaling",
            "scaled",
            "--limit",
            3,
            "--budget",
            0.002,
            "--repeats",
            2,
            "--name",
            name,
            "--out",
            folder / "runs",
        )
    return folder / "runs" / "before", folder / "runs" / "after"


def test_a_solver_that_waits_is_found_between_two_races_and_no_other(
    piezobench: CommandLine, slowed_races: tuple[Path, Path], tmp_path: Path
) -> None:
    before, after = slowed_races
    call = piezobench("compare", before, after, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 3, call.stdout
    assert re.search(r"^slowed +direct +(interleaved|hot) +slower +[1-4]\.\d\d", call.stdout, re.MULTILINE)
    assert changed(compare_runs(Run.open(before), Run.open(after))) == {("slowed", "direct")}


def test_between_the_same_races_the_other_way_round_nothing_is_worse(
    piezobench: CommandLine, slowed_races: tuple[Path, Path], tmp_path: Path
) -> None:
    words = ("compare", *reversed(slowed_races), "--out", tmp_path / "c", "--fail-on")
    assert piezobench(*words, "difference").status == 3
    assert piezobench(*words, "regression", "--smallest", 100).status == 0
    assert piezobench(*words, "regression", "--smallest", 1.001).status == 4
    assert "a ratio above 1" in piezobench(*words, "regression", "--smallest", 1).refusal


def test_repeats_of_a_measurement_are_one_task(slowed_races: tuple[Path, Path]) -> None:
    found = compare_runs(*map(Run.open, slowed_races))
    assert (found.times.problems <= 6).all()
    assert not any(rows.duplicated(NAMES).any() for rows in found.alone)


def test_if_all_solvers_are_slower_and_the_fixed_piece_of_work_is_not_the_comparison_states_it_and_cannot_tell(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    other = wide_race.copied(tmp_path / "slow", times=slowed(wide_race, 1.5, lambda rows: rows.solver != ""))
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 4
    output = " ".join(call.stdout.split())
    assert "The field as a whole changed by a factor of 1.50" in output
    assert "and the fixed piece of work timed beside it by 1.00" in output


def test_a_solver_that_raced_alone_is_not_taken_for_the_machine_and_cannot_be_compared(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    def alone(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[of_solver(rows) | (rows.solver == "null")]

    before = wide_race.copied(tmp_path / "before", alone)
    after = wide_race.copied(tmp_path / "after", alone, slowed(wide_race, 1.2))
    call = piezobench("compare", before.path, after.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 4
    assert (
        "In 1 of 1 solver lane a change by a factor of 1.2 may have gone unseen: too few lanes race to tell a "
        "change from noise"
    ) in " ".join(call.stdout.split())


def test_a_lane_with_too_few_times_cannot_be_compared(wide_race: Race, tmp_path: Path) -> None:
    few = set(wide_race.rows[of_solver(wide_race.rows)].task)
    found = compare_runs(
        wide_race.run,
        wide_race.copied(
            tmp_path / "few",
            times=lambda times: times.assign(ns=times.ns.mask(times.task.isin(few), times.ns.str[:2])),
        ),
    )
    assert found.times.finding[of_solver(found.times)].tolist() == [CANNOT_TELL]
    assert set(found.times.finding[~of_solver(found.times)]) == {SAME}
    assert (found.differences, found.cannot_tell) == (0, True)


def test_a_solver_with_wrong_answers_loses_its_tiers_which_is_a_regression(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    worse = wide_race.copied(tmp_path / "worse", less_accurate)
    call = piezobench("compare", wide_race.run.path, worse.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 3
    assert re.search(r"^osqp +direct .*lost 1e-3 ", call.stdout, re.MULTILINE)
    back = compare_runs(worse, wide_race.run)
    assert back.regressions == 0
    assert of_solver(back.gained).all()
    assert {"low", "mid"} <= set(back.gained.tier)


def test_settings_that_one_of_the_runs_did_not_run_are_not_compared(wide_race: Race, tmp_path: Path) -> None:
    def ended(rows: pd.DataFrame) -> pd.DataFrame:
        rows.loc[of_solver(rows) & (rows.rung > 1), ["status", "cost_gap"]] = [str(Status.NOT_RUN), np.nan]
        return rows

    found = compare_runs(wide_race.run, wide_race.copied(tmp_path / "ended", ended))
    assert found.regressions == 0
    only, none = found.alone
    assert len(only) == (of_solver(wide_race.rows) & (wide_race.rows.rung > 1)).sum() > 0
    assert none.empty


def test_different_settings_and_machines_come_first_and_all_fits_on_a_screen(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    other = wide_race.copied(
        tmp_path / "elsewhere",
        without,
        slowed(wide_race, 1.2, lambda rows: rows.solver == "daqp"),
        settings={"seed": 7},
        machine={"processor": "An abacus"},
        field={"daqp (direct)": "0.0.1"},
    )
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c")
    lines = call.stdout.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines[:-1])) <= 100
    output = " ".join(call.stdout.split())
    assert output.startswith("WARNING: Different machines: processor is")
    assert "WARNING: Different settings: seed is 0 in the first run and 7 in the second." in output
    assert "WARNING: Different solvers: daqp (direct) is" in output
    count = wide_race.rows[of_solver(wide_race.rows)].task.nunique()
    assert output.count(f"Only {wide_race.run.path.name} has {count} rows, of osqp (direct).") == 1
    assert "An abacus" in (tmp_path / "c" / "comparison.md").read_text()


def test_the_json_document_is_complete(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    other = wide_race.copied(tmp_path / "slow", times=slowed(wide_race, 1.2))
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c", "--json")
    document = json.loads(call.stdout)
    assert document == json.loads((tmp_path / "c" / "comparison.json").read_text())
    assert (document["format"], document["version"]) == ("piezobench-comparison", 4)
    (one,) = document["comparisons"]
    assert (one["regressions"], one["lost"], one["gained"], one["difference"]) == (1, [], [], True)
    assert [(line["solver"], line["lane"], line["ratio"]) for line in one["lines"] if line["finding"] == "slower"] == [
        (*SLOWED, pytest.approx(1.2, rel=0.001))
    ]


def test_the_page_shows_what_differs_and_markdown_survives_any_name(
    browser: Browser, wide_race: Race, tmp_path: Path
) -> None:
    other = wide_race.copied(tmp_path / "b<script>|`x`", less_accurate)
    found = [compare_runs(wide_race.run, other)]
    page = comparison.write(found, comparison.report(found), tmp_path / "c")
    assert "ratios_1" in browser.sections(page)
    markdown = page.with_suffix(".md").read_text()
    assert {line.count("|") for line in markdown.splitlines() if line.startswith("|")} == {len(comparison.HEADINGS) + 1}
    assert "<script>" not in markdown


def test_one_run_alone_cannot_be_compared(piezobench: CommandLine, wide_race: Race) -> None:
    assert "two runs or more" in piezobench("compare", wide_race.run.path).refusal


def test_runs_of_another_kind_are_refused_in_one_sentence(wide_race: Race, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="only one-shot races"):
        compare_runs(wide_race.run, wide_race.copied(tmp_path / "other", race="stream"))
