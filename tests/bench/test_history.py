"""``piezobench combine`` puts runs side by side, and ``history`` follows a solver through them."""

import json
from pathlib import Path

import pandas as pd
import pytest
from command_line import CommandLine
from conftest import Race


def with_more_iterations(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(iterations=rows.iterations + rows.iterations.where(rows.solver == "osqp", 0) // 10)


def test_one_iteration_in_ten_more_is_found_exactly_and_the_same_run_is_not(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    first = clean_race.run.path
    same, later = (
        clean_race.copied(tmp_path / name, rows=change).path
        for name, change in (("same", lambda rows: rows), ("later", with_more_iterations))
    )
    piezobench.run("history", first, same, "--solver", "osqp")
    found = piezobench("history", first, same, later, "--solver", "osqp")
    assert found.status == 3
    assert found.stdout.count("times as many iterations") == 1
    assert "later, direct, " in found.stdout


def test_the_newest_run_is_printed_as_names_units_and_values(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    later = clean_race.copied(tmp_path / "later", rows=with_more_iterations).path
    said = piezobench("history", clean_race.run.path, later, "--solver", "osqp", "--json")
    values = {line["name"]: (line["unit"], line["value"]) for line in json.loads(said.stdout)}
    assert values["osqp (direct) time"] == ("ratio", 1.0)
    assert values["osqp (direct) iterations"][1] == pytest.approx(1.1, abs=0.01)


def test_runs_are_combined_on_the_problems_that_both_have(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    other = clean_race.copied(tmp_path / "other")
    said = piezobench("combine", clean_race.run.path, other.path, "--out", tmp_path / "page", "--json")
    rows = json.loads(said.stdout)["rows"]
    assert {row["run"] for row in rows} == {clean_race.run.path.name, "other"}
    assert {row["solver"] for row in rows} == {"clarabel", "daqp", "osqp"}
    assert all(row["daqp (direct)"] == 1.0 for row in rows if row["solver"] == "daqp")
    assert all(row["problems"] == 1 and row["over_floor"] > 1.0 for row in rows)
    assert (tmp_path / "page/combined.html").is_file()


def with_another_digest(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(digest="0" * 16)


def test_runs_that_cannot_be_combined_or_followed_are_refused_and_nothing_is_written(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    first, out = clean_race.run.path, tmp_path / "page"
    other = clean_race.copied(tmp_path / "other", rows=with_another_digest).path
    for words, why in (
        (("combine", first, "--out", out), "two runs or more are combined"),
        (("combine", first, first, "--out", out), f"two runs are called {first.name}"),
        (("combine", first, other, "--out", out), "the runs have no problem in common"),
        (("combine", first, other, "--out", tmp_path), "already exists"),
        (("history", first, "--solver", "osqp"), "a history has two runs or more"),
        (("history", first, other, "--solver", "quadprog"), "has no solver 'quadprog'"),
    ):
        assert why in piezobench(*words).refusal
    assert not out.exists()
