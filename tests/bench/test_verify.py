"""``piezobench verify`` refuses a run whose accuracies do not follow from its stored answers."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from small_races import Race


def test_an_honest_run_agrees_in_every_row(piezobench: CommandLine, clean_race: Race) -> None:
    said = piezobench("verify", clean_race.run.path).stdout
    judged = re.match(rf"{len(clean_race.rows)} rows: (\d+) first and (\d+) timed answers were judged again", said)
    assert min(map(int, judged.groups())) > 0.8 * len(clean_race.rows)


def edited(column: str, value: Callable[[pd.Series], object]) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A change of one column in the row of an ordinary answer."""

    def change(rows: pd.DataFrame) -> pd.DataFrame:
        at = rows.index[(rows.solver == "osqp") & rows.is_default & (rows.timed == "hot")][0]
        rows.at[at, column] = value(rows.loc[at])
        return rows

    return change


def with_answers_exchanged(rows: pd.DataFrame) -> pd.DataFrame:
    """The answers of the loosest and the tightest setting of a solver, exchanged."""
    loose, *_, tight = rows.index[(rows.solver == "osqp") & (rows.scaling == "scaled") & (rows.timed == "hot")]
    rows.at[loose, "answer"], rows.at[tight, "answer"] = rows.at[tight, "answer"], rows.at[loose, "answer"]
    return rows


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (edited("cost_gap", lambda row: row.cost_gap / 2.0), "its cost gap is"),
        (edited("violation", lambda row: row.violation + 1e-16), "its violation is"),
        (edited("weight_error", lambda row: row.weight_error + 1e-6), "its weight error is"),
        (edited("model_error_percent", lambda row: 0.0), "its model error percent is"),
        (edited("stage_excess", lambda row: 0.0), "its stage excess is"),
        (edited("timed_stage_excess", lambda row: 0.0), "its timed stage excess is"),
        (edited("timed_gap", lambda row: 0.0), "its timed gap is 0 in the run"),
        (edited("timed_gap", lambda row: np.nan), "its timed gap is nan in the run"),
        (edited("timed_answer", lambda row: row.timed_answer * (1.0 + 1e-9)), "its timed"),
        (edited("timed_shares", lambda row: np.roll(row.timed_shares, 1)), "its timed gap is"),
        (edited("timed_shares", lambda row: row.timed_shares[:-1]), "the draw of its timed answer does not fit"),
        (edited("misses_exact", lambda row: 0), "misses_exact is 0 of"),
        (edited("misses_low", lambda row: row.judged + 1), "judged answers, and its timed gap"),
        (edited("digest", lambda row: "0" * 16), "its digest does not match the stored problem"),
        (edited("answer", lambda row: ()), "and nan from its answer"),
        (with_answers_exchanged, "its cost gap is"),
    ],
)
def test_a_run_whose_rows_were_edited_is_refused(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], why: str
) -> None:
    run = clean_race.copied(tmp_path / "run", change)
    refusal = piezobench("verify", run.path).refusal
    assert f"{run.path} does not agree with its answers: " in refusal
    assert why in refusal


def change_a_bit(path: Path) -> None:
    arrays = dict(np.load(path))
    arrays["scaled/q"] = np.nextafter(arrays["scaled/q"], np.inf)
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("spoil", "why"), [(change_a_bit, "the certificate belongs to other data"), (Path.unlink, "is missing")]
)
def test_a_run_whose_problem_was_changed_in_one_bit_or_is_missing_is_refused(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path, spoil: Callable[[Path], None], why: str
) -> None:
    run = clean_race.copied(tmp_path / "run")
    spoil(*(run.path / "problems").glob("*.npz"))
    assert why in piezobench("verify", run.path).refusal
